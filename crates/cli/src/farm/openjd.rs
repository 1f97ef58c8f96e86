//! A job template of Open Job Description, version 2023-09, as JSON.

use super::Job;
use super::files::Files;
use crate::{Failure, Result};
use serde_json::json;

pub(super) fn write(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let stage = "{{Param.Folder}}/stage.sh";
    let run = |args: &[&str]| json!({ "actions": { "onRun": { "command": "sh", "args": args } } });
    let template = json!({
        "specificationVersion": "jobtemplate-2023-09",
        "name": job.plain_name(),
        "description": format!("A render in {} parts, and the image of all, written by dapple farm.", job.options.parts),
        "parameterDefinitions": [{
            "name": "Folder",
            "type": "PATH",
            "objectType": "DIRECTORY",
            "dataFlow": "INOUT",
            "default": job.folder,
            "description": "The job's folder, with stage.sh and render.json, on all machines.",
        }],
        "steps": [
            {
                "name": "Render",
                "parameterSpace": {
                    "taskParameterDefinitions": [{ "name": "Part", "type": "INT", "range": format!("1-{}", job.options.parts) }],
                },
                "script": run(&[stage, "render", "{{Task.Param.Part}}"]),
            },
            {
                "name": "Merge",
                "dependencies": [{ "dependsOn": "Render" }],
                "script": run(&[stage, "merge"]),
            },
        ],
    });
    files.add("job.template.json", &serde_json::to_string_pretty(&template).map_err(Failure::new)?)?;
    Ok(format!("openjd check {0}/job.template.json, and submit it to your farm", job.folder))
}
