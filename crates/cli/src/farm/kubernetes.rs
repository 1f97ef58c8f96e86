//! Jobs of Kubernetes as JSON: an Indexed Job of all parts, and one that waits for them and merges. With several stages
//! the pod of part 1 plans and merges.

use super::Job;
use super::files::Files;
use super::stages::Stages;
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
    let items = match job.stages {
        Stages::One => {
            let merge = json!({ "backoffLimit": tries - 1, "template": pod("await") });
            vec![item("render", indexed("render")), item("merge", merge)]
        }
        // Jobs have no dependencies: all pods run at once and wait for each other's files.
        Stages::Several { .. } => vec![item("render", indexed("work"))],
    };
    let list = json!({ "apiVersion": "v1", "kind": "List", "items": items });
    files.add("job.json", &serde_json::to_string_pretty(&list).map_err(Failure::new)?)?;
    Ok(format!("kubectl apply -f {}/job.json", job.folder))
}
