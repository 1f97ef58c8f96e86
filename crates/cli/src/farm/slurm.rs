//! Scripts for Slurm: an array of parts, then a task that depends on all of it [Slurm `sbatch`: `--array`,
//! `--dependency=afterok`, `--parsable`, `--requeue`].

use super::Job;
use super::files::{Files, quoted};
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
    // A part that Slurm stops gets SIGTERM in time for a checkpoint.
    let array = format!("#SBATCH --array=1-{parts}\n#SBATCH --signal=TERM@60\n#SBATCH --output=log/%A-%a.txt\n");
    let render = head("render", &array);
    files.add_script("render.sbatch", &format!("{render}exec sh {folder}/stage.sh render \"$SLURM_ARRAY_TASK_ID\"\n"))?;
    let merge = head("merge", "#SBATCH --output=log/merge-%j.txt\n");
    files.add_script("merge.sbatch", &format!("{merge}exec sh {folder}/stage.sh merge\n"))?;
    files.add_script(
        "submit.sh",
        &format!(
            "#!/bin/sh\n# Submits all parts, and the merge after them. Options of sbatch, such as --partition=NAME, are passed on.\n\
             # Parts that are done end at once, so that a failed job is submitted again as it is.\n\
             set -eu\ncd {folder}\n\
             render=$(sbatch --parsable \"$@\" render.sbatch)\n\
             merge=$(sbatch --parsable --dependency=\"afterok:${{render%%;*}}\" --kill-on-invalid-dep=yes \"$@\" merge.sbatch)\n\
             echo \"array ${{render%%;*}} of {parts} parts, then merge ${{merge%%;*}}\"\n"
        ),
    )?;
    Ok(format!("sh {folder}/submit.sh"))
}
