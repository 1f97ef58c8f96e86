//! A job template of Open Job Description, version 2023-09, as JSON.

use super::Job;
use super::files::Files;
use super::stages::Stages;
use crate::{Failure, Result};
use serde_json::{Value, json};

pub(super) fn write(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let stage = "{{Param.Folder}}/stage.sh";
    let step = |name: &str, after: Option<&str>, args: &[&str]| -> Value {
        let mut step = json!({
            "name": name,
            "script": { "actions": { "onRun": { "command": "sh", "args": args } } },
        });
        if args.contains(&PART) {
            let range = format!("1-{}", job.options.parts);
            step["parameterSpace"] =
                json!({ "taskParameterDefinitions": [{ "name": "Part", "type": "INT", "range": range }] });
        }
        if let Some(after) = after {
            step["dependencies"] = json!([{ "dependsOn": after }]);
        }
        step
    };
    let steps: Vec<Value> = match job.stages {
        Stages::One => {
            vec![step("Render", None, &[stage, "render", PART]), step("Merge", Some("Render"), &[stage, "merge"])]
        }
        Stages::Several { .. } => {
            let mut steps = Vec::new();
            steps.push(step("Start", None, &[stage, "current"]));
            let mut before = Some("Start".to_owned());
            for number in 0..job.stages.most()? {
                let (render, plan) = (format!("Render{number}"), format!("Plan{number}"));
                let number = number.to_string();
                steps.push(step(&render, before.as_deref(), &[stage, "render", PART, &number]));
                steps.push(step(&plan, Some(&render), &[stage, "plan", &number]));
                before = Some(plan);
            }
            steps.push(step("Merge", before.as_deref(), &[stage, "merge"]));
            steps
        }
    };
    let template = json!({
        "specificationVersion": "jobtemplate-2023-09",
        "name": job.plain_name(),
        "description": format!("A render in {} parts, and the image of all, written by dapple farm.", job.options.parts),
        "parameterDefinitions": [{
            "name": "Folder",
            "type": "PATH",
            "objectType": "DIRECTORY",
            "dataFlow": "INOUT",
            // Relative to the template's folder: absolute defaults are not allowed.
            "default": ".",
            "description": "The job's folder, with stage.sh and render.json, at the same path on all machines.",
        }],
        "steps": steps,
    });
    files.add("job.template.json", &serde_json::to_string_pretty(&template).map_err(Failure::new)?)?;
    Ok(format!("openjd check {0}/job.template.json, and submit it to your farm", job.folder))
}

/// The number of a part, in the arguments of a step with a task per part.
const PART: &str = "{{Task.Param.Part}}";
