//! Scripts for Slurm: an array of parts, then a task that depends on all of it [Slurm `sbatch`: `--array`,
//! `--dependency=afterok`, `--parsable`, `--requeue`].

use super::Job;
use super::files::{Files, quoted};
use super::stages::Stages;
use crate::Result;

pub(super) fn write(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let (name, parts, folder) = (job.plain_name(), job.options.parts, quoted(&job.folder));
    let cores = if job.threads > 0 { format!("#SBATCH --cpus-per-task={}\n", job.threads) } else { String::new() };
    let memory = job.memory.map_or_else(String::new, |bytes| format!("#SBATCH --mem={}M\n", bytes.div_ceil(1 << 20)));
    let head = |what: &str, more: &str| {
        format!(
            "#!/bin/sh\n#SBATCH --job-name={name}-{what}\n#SBATCH --requeue\n#SBATCH --open-mode=append\n{cores}{memory}{more}"
        )
    };
    // At the time limit and before a requeue, Slurm sends SIGTERM to all processes of a task: time for a checkpoint.
    let array = format!("#SBATCH --array=1-{parts}\n#SBATCH --output=log/%A-%a.txt\n");
    let render =
        head("render", &array) + &format!("exec sh {folder}/stage.sh render \"$SLURM_ARRAY_TASK_ID\" \"$@\"\n");
    files.add_script("render.sbatch", &render)?;
    let one = head("merge", "#SBATCH --output=log/merge-%j.txt\n");
    let (after, last) = match job.stages {
        Stages::One => ("merge", one + &format!("exec sh {folder}/stage.sh merge\n")),
        Stages::Several { .. } => {
            let next = head("plan", "#SBATCH --output=log/plan-%j.txt\n");
            let submit = format!(
                "set -eu\nstage=$1\nshift\nsh {folder}/stage.sh plan \"$stage\"\n\
                 if sh {folder}/stage.sh is-done; then exec sh {folder}/stage.sh merge; fi\nexec sh {folder}/submit.sh \"$@\"\n"
            );
            ("plan", next + &submit)
        }
    };
    files.add_script(&format!("{after}.sbatch"), &last)?;
    files.add_script("submit.sh", &submit(job, after))?;
    Ok(format!("sh {folder}/submit.sh"))
}

/// The script that submits the array and the task after it.
fn submit(job: &Job<'_>, after: &str) -> String {
    let (folder, parts) = (quoted(&job.folder), job.options.parts);
    let (stage, of_stage) = match job.stages {
        Stages::One => (String::new(), ""),
        // The task after the array submits the next stage.
        Stages::Several { .. } => (
            "if sh stage.sh is-done; then exec sh stage.sh merge; fi\nstage=$(sh stage.sh current)\necho \"stage $stage\"\n"
                .to_owned(),
            " \"$stage\"",
        ),
    };
    let options = if of_stage.is_empty() { "" } else { " \"$@\"" };
    format!(
        "#!/bin/sh\n# Submits all parts, and the task after them. Options of sbatch, such as --partition=NAME, are passed on.\n\
         # Parts that are done end at once, so that a failed job is submitted again as it is.\n\
         set -eu\ncd {folder}\n{stage}\
         render=$(sbatch --parsable \"$@\" render.sbatch{of_stage})\n\
         {after}=$(sbatch --parsable --dependency=\"afterok:${{render%%;*}}\" --kill-on-invalid-dep=yes \"$@\" \
         {after}.sbatch{of_stage}{options})\n\
         echo \"array ${{render%%;*}} of {parts} parts, then {after} ${{{after}%%;*}}\"\n"
    )
}
