//! Jobs of Kubernetes as JSON: an Indexed Job of all parts, and one that waits for them and merges.

use super::Job;
use super::files::Files;
use crate::{Failure, Result};
use serde_json::{Value, json};

pub(super) fn write(job: &Job<'_>, files: &mut Files) -> Result<String> {
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
    let item = |what: &str, spec: Value| {
        json!({ "apiVersion": "batch/v1", "kind": "Job", "metadata": { "name": format!("{name}-{what}") }, "spec": spec })
    };
    let render = json!({
        "completionMode": "Indexed",
        "completions": parts,
        "parallelism": parts,
        "backoffLimitPerIndex": tries - 1,
        "template": pod("render \"$((JOB_COMPLETION_INDEX + 1))\""),
    });
    let merge = json!({ "backoffLimit": tries - 1, "template": pod("await") });
    let list = json!({ "apiVersion": "v1", "kind": "List", "items": [item("render", render), item("merge", merge)] });
    files.add("job.json", &serde_json::to_string_pretty(&list).map_err(Failure::new)?)?;
    Ok(format!("kubectl apply -f {}/job.json", job.folder))
}
