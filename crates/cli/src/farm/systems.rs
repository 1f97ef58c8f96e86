//! The files of a job for each system.

use super::Job;
use super::files::{Files, quoted};
use crate::{Failure, Result};
use serde_json::{Value, json};

/// Scripts for Slurm: an array of parts, then a task that depends on all of it and submits the next stage [Slurm `sbatch`:
/// `--array`, `--dependency=afterok`, `--parsable`, `--requeue`].
///
/// At the time limit and before a requeue, Slurm sends SIGTERM to all processes of a task: time for a checkpoint.
pub(super) fn slurm(job: &Job<'_>, files: &mut Files) -> Result<String> {
    files.add_script("render.sbatch", &job.filled(include_str!("render.sbatch")))?;
    files.add_script("plan.sbatch", &job.filled(include_str!("plan.sbatch")))?;
    files.add_script("submit.sh", &job.filled(include_str!("submit.sh")))?;
    Ok(format!("sh {}/submit.sh", quoted(&job.folder)))
}

/// A job template of Open Job Description, version 2023-09, as JSON.
pub(super) fn openjd(job: &Job<'_>, files: &mut Files) -> Result<String> {
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
    let mut steps = vec![step("Start", None, &[stage, "current"])];
    let mut before = "Start".to_owned();
    for number in 0..job.stages()? {
        let (render, plan) = (format!("Render{number}"), format!("Plan{number}"));
        let number = number.to_string();
        steps.push(step(&render, Some(&before), &[stage, "render", PART, &number]));
        steps.push(step(&plan, Some(&render), &[stage, "plan", &number]));
        before = plan;
    }
    steps.push(step("Merge", Some(&before), &[stage, "merge"]));
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

/// A job specification of OpenCue, after its document type `cjsl-1.12`.
pub(super) fn opencue(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let name = job.plain_name().replace('-', "_");
    let parts = format!("1-{}", job.options.parts);
    // Layers in their order, each with its frames and the arguments of stage.sh.
    let mut layers: Vec<(String, &str, String)> = vec![("start".to_owned(), "1-1", "current".to_owned())];
    for number in 0..job.stages()? {
        layers.push((format!("render_{number}"), &*parts, format!("render #IFRAME# {number}")));
        layers.push((format!("plan_{number}"), "1-1", format!("plan {number}")));
    }
    layers.push(("merge".into(), "1-1", "merge".into()));
    let described: String =
        layers.iter().map(|(layer, range, arguments)| layer_of(job, layer, range, arguments)).collect();
    let depends: String = layers.windows(2).map(|pair| depend(&name, &pair[1].0, &pair[0].0)).collect();
    let (show, retries) = (&job.options.show, job.options.tries - 1);
    let text = format!(
        r#"<?xml version="1.0"?>
<!DOCTYPE spec PUBLIC "SPI Cue Specification Language" "http://localhost:8080/spcue/dtd/cjsl-1.12.dtd">
<spec>
  <facility>local</facility>
  <show>{show}</show>
  <shot>render</shot>
  <user>dapple</user>
  <job name="{name}">
    <paused>False</paused>
    <maxretries>{retries}</maxretries>
    <autoeat>False</autoeat>
    <layers>
{described}    </layers>
  </job>
  <depends>
{depends}  </depends>
</spec>
"#
    );
    files.add("job.xml", &text)?;
    Ok(format!("opencue.api.launchSpecAndWait(open('{}/job.xml').read()) in Python", job.folder))
}

fn layer_of(job: &Job<'_>, name: &str, range: &str, arguments: &str) -> String {
    let kind = if name.starts_with("render") { "Render" } else { "Util" };
    let command = escaped(&format!("sh {}/stage.sh {arguments}", quoted(&job.folder)));
    let cores = if job.threads > 0 { format!("\n        <cores>{}</cores>", job.threads) } else { String::new() };
    let gibibytes = |bytes: u64| format!("\n        <memory>{}g</memory>", bytes.div_ceil(1 << 30));
    let memory = job.memory.map_or_else(String::new, gibibytes);
    format!(
        r#"      <layer name="{name}" type="{kind}">
        <cmd>{command}</cmd>
        <range>{range}</range>
        <chunk>1</chunk>{cores}{memory}
        <services><service>shell</service></services>
      </layer>
"#
    )
}

/// The dependency of a layer on all frames of another.
fn depend(job: &str, layer: &str, on: &str) -> String {
    format!(
        r#"    <depend type="LAYER_ON_LAYER">
      <depjob>{job}</depjob>
      <deplayer>{layer}</deplayer>
      <onjob>{job}</onjob>
      <onlayer>{on}</onlayer>
    </depend>
"#
    )
}

/// Text between the tags of XML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Jobs of Kubernetes as JSON: an Indexed Job of all parts, whose pod of part 1 plans and merges.
pub(super) fn kubernetes(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let (name, parts, tries) = (job.plain_name(), job.options.parts, job.options.tries);
    let pod = |arguments: &str| {
        let command = format!("exec sh \"$FOLDER/stage.sh\" {arguments}");
        let mut requests = serde_json::Map::new();
        if job.threads > 0 {
            requests.insert("cpu".into(), job.threads.to_string().into());
        }
        if let Some(bytes) = job.memory {
            requests.insert("memory".into(), bytes.to_string().into());
        }
        json!({
            "spec": {
                "restartPolicy": "Never",
                "containers": [{
                    "name": "dapple",
                    "image": job.options.container,
                    "command": ["sh", "-c", command],
                    "env": [{ "name": "FOLDER", "value": job.folder }],
                    "resources": { "requests": requests },
                    "volumeMounts": [{ "name": "job", "mountPath": job.folder }],
                }],
                "volumes": [{ "name": "job", "persistentVolumeClaim": { "claimName": job.options.claim } }],
            },
        })
    };
    let item = |what: &str, spec: Value| json!({ "apiVersion": "batch/v1", "kind": "Job", "metadata": { "name": format!("{name}-{what}") }, "spec": spec });
    let indexed = |verb: &str| {
        json!({
            "completionMode": "Indexed",
            "completions": parts,
            "parallelism": parts,
            "backoffLimitPerIndex": tries - 1,
            "template": pod(&format!("{verb} \"$((JOB_COMPLETION_INDEX + 1))\"")),
        })
    };
    // Jobs have no dependencies: all pods run at once and wait for each other's files.
    let items = [item("render", indexed("work"))];
    let list = json!({ "apiVersion": "v1", "kind": "List", "items": items });
    files.add("job.json", &serde_json::to_string_pretty(&list).map_err(Failure::new)?)?;
    Ok(format!("kubectl apply -f {}/job.json", job.folder))
}
