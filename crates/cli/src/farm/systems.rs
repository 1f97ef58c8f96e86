//! The job files of each system, filled from templates, and the folder to which they are written.

use super::{Job, filled};
use crate::{Failure, Result};
use dapple_scene::image::write_file;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Scripts for Slurm: an array of tasks, one per part, then a task that waits for the whole array and submits the next stage
/// [Slurm `sbatch`: `--array`, `--dependency=afterok`, `--parsable`, `--requeue`].
///
/// At the time limit and before a requeue, Slurm sends SIGTERM to all processes of a task, so that they write a checkpoint.
pub(super) fn slurm(job: &Job<'_>, files: &mut Files) -> Result<String> {
    files.add("render.sbatch", &job.filled(include_str!("render.sbatch")))?;
    files.add("plan.sbatch", &job.filled(include_str!("plan.sbatch")))?;
    files.add("submit.sh", &job.filled(include_str!("submit.sh")))?;
    Ok(format!("sh {}/submit.sh", quoted(&job.folder)))
}

/// A task of a job with a known number of stages: its action, the number of its stage, and its arguments for stage.sh.
type Task = (&'static str, String, String);

/// The tasks in order. A render task runs once per part; `part` is the placeholder for the part's number.
fn tasks(job: &Job<'_>, part: &str) -> Result<Vec<Task>> {
    let stage = |stage: u32| {
        let [render, plan] = [format!("render {part} {stage}"), format!("plan {stage}")];
        [("render", stage.to_string(), render), ("plan", stage.to_string(), plan)]
    };
    let mut tasks = vec![("start", String::new(), "current".to_owned())];
    tasks.extend((0..job.stages()?).flat_map(stage));
    tasks.push(("merge", String::new(), "merge".into()));
    Ok(tasks)
}

/// A job template of Open Job Description, version 2023-09, as JSON.
pub(super) fn openjd(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let name = |(what, stage, _): &Task| format!("{}{}{stage}", what[..1].to_uppercase(), &what[1..]);
    let (mut steps, mut before) = (Vec::new(), None);
    for task in tasks(job, "{{Task.Param.Part}}")? {
        let args: Vec<&str> = ["{{Param.Folder}}/stage.sh"].into_iter().chain(task.2.split(' ')).collect();
        let mut step = json!({
            "name": name(&task),
            "script": { "actions": { "onRun": { "command": "sh", "args": args } } },
        });
        if task.0 == "render" {
            let range = format!("1-{}", job.options.parts);
            step["parameterSpace"] =
                json!({ "taskParameterDefinitions": [{ "name": "Part", "type": "INT", "range": range }] });
        }
        if let Some(before) = before.replace(name(&task)) {
            step["dependencies"] = json!([{ "dependsOn": before }]);
        }
        steps.push(step);
    }
    let mut template: Value =
        serde_json::from_str(&job.filled(include_str!("job.template.json"))).map_err(Failure::new)?;
    template["steps"] = steps.into();
    files.add("job.template.json", &serde_json::to_string_pretty(&template).map_err(Failure::new)?)?;
    Ok(format!("openjd check {0}/job.template.json, and submit it to your farm", job.folder))
}

/// A job specification of OpenCue, of document type `cjsl-1.12`.
pub(super) fn opencue(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let (name, parts) = (job.plain_name().replace('-', "_"), format!("1-{}", job.options.parts));
    let tasks = tasks(job, "#IFRAME#")?;
    let layer = |(what, stage, _): &Task| if stage.is_empty() { (*what).into() } else { format!("{what}_{stage}") };
    let cores = if job.threads > 0 { format!("\n        <cores>{}</cores>", job.threads) } else { String::new() };
    let gibibytes = |bytes: u64| format!("\n        <memory>{}g</memory>", bytes.div_ceil(1 << 30));
    let limits = cores + &job.memory.map_or_else(String::new, gibibytes);
    let described = |task: &Task| {
        let (kind, range) = if task.0 == "render" { ("Render", &*parts) } else { ("Util", "1-1") };
        let command = format!("sh {}/stage.sh {}", quoted(&job.folder), task.2);
        let command = command.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        let values: [(&str, &str); 5] =
            [("LAYER", &layer(task)), ("TYPE", kind), ("COMMAND", &command), ("RANGE", range), ("LIMITS", &limits)];
        filled(include_str!("layer.xml"), &values)
    };
    let depend = |pair: &[Task]| {
        let values: [(&str, &str); 3] = [("JOB", &name), ("LAYER", &layer(&pair[1])), ("ON", &layer(&pair[0]))];
        filled(include_str!("depend.xml"), &values)
    };
    let layers: String = tasks.iter().map(described).collect();
    let depends: String = tasks.windows(2).map(depend).collect();
    let text = filled(include_str!("job.xml"), &[("JOB", &name), ("LAYERS", &layers), ("DEPENDS", &depends)]);
    files.add("job.xml", &job.filled(&text))?;
    Ok(format!("opencue.api.launchSpecAndWait(open('{}/job.xml').read()) in Python", job.folder))
}

/// An Indexed Job of Kubernetes for all parts, as JSON. The pod of part 1 also plans and merges. Jobs have no dependencies:
/// all pods run at once and wait for each other's files.
pub(super) fn kubernetes(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let mut requests = Map::new();
    if job.threads > 0 {
        requests.insert("cpu".into(), job.threads.to_string().into());
    }
    requests.extend(job.memory.map(|bytes| ("memory".into(), bytes.to_string().into())));
    let quoted = |text: &str| Value::from(text).to_string();
    let (options, requests) = (job.options, Value::from(requests).to_string());
    let values = [quoted(&options.container), quoted(&options.claim), quoted(&job.folder), requests];
    let values = ["CONTAINER", "CLAIM", "PATH", "REQUESTS"].into_iter().zip(values.each_ref().map(String::as_str));
    let text = filled(&job.filled(include_str!("job.json")), &values.collect::<Vec<_>>());
    let list: Value = serde_json::from_str(&text).map_err(Failure::new)?;
    files.add("job.json", &serde_json::to_string_pretty(&list).map_err(Failure::new)?)?;
    Ok(format!("kubectl apply -f {}/job.json", job.folder))
}

/// The files of a job, collected in memory and then written together.
pub(super) struct Files {
    folder: PathBuf,
    all: Vec<(PathBuf, String)>,
}

impl Files {
    /// Creates the folder, and an empty list of files for it.
    pub(super) fn new(folder: &Path) -> Result<Self> {
        for folder in [folder, &folder.join("log")] {
            let cannot =
                |e| Failure::new(format!("{}: cannot create the folder: {e}; choose another folder", folder.display()));
            std::fs::create_dir_all(folder).map_err(cannot)?;
        }
        Ok(Self { folder: folder.to_owned(), all: Vec::new() })
    }

    /// Adds a file. Returns an error if the folder holds a job with another description of the render.
    pub(super) fn add(&mut self, name: &str, text: &str) -> Result<()> {
        let path = self.folder.join(name);
        if name == DESCRIPTION
            && let Ok(there) = std::fs::read_to_string(&path)
            && there.trim() != text.trim()
        {
            let folder = self.folder.display();
            return Err(Failure::new(format!(
                "{folder} holds a job of another render, whose finished parts would be reused; choose another --output"
            )));
        }
        self.all.push((path, text.trim_end().to_owned() + "\n"));
        Ok(())
    }

    /// Writes all files, and makes shell scripts executable.
    pub(super) fn finish(self) -> Result<()> {
        for (path, text) in self.all {
            write_file(&path, text.as_bytes()).map_err(Failure::new)?;
            if path.extension().is_some_and(|kind| kind == "sh" || kind == "sbatch") {
                make_executable(&path).map_err(|e| Failure::new(format!("{}: {e}", path.display())))?;
            }
        }
        Ok(())
    }
}

/// The file with the description of the render.
pub(super) const DESCRIPTION: &str = "render.json";

#[cfg(unix)]
fn make_executable(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755))
}

#[cfg(not(unix))]
fn make_executable(_: &Path) -> std::io::Result<()> {
    Ok(())
}

/// Quotes a text as one argument of a shell.
pub(super) fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}
