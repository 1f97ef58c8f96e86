//! The subcommand `dapple study`, and the hidden `dapple study-run`.

mod args;
mod progress;

pub(crate) use args::StudyArgs;

use crate::machine::{cpu_seconds, start_threads};
use crate::output::{say, tell};
use crate::stop::Stop;
use crate::{Failure, Outcome, Result};
use dapple_job::JobError;
use dapple_job::memory::size;
use dapple_study::{
    InProcess, Processes, RunRequest, Runner, Study, StudyError, StudyOptions, StudyStatus, merge_studies, write_report,
};
use progress::Bar;
use std::io::Read;
use std::path::Path;

/// The name of the hidden subcommand that makes a single run of a study in its own process.
const ONE: &str = "study-run";

pub(crate) fn run(options: &StudyArgs) -> Result<Outcome> {
    if options.report_only {
        return deliver(&options.output, options.quiet);
    }
    if options.merge {
        return merge(options);
    }
    let plan = match options.plan() {
        Ok(plan) => plan,
        Err(args::Wrong::Arguments(wrong)) => return Err(Failure::usage("study", wrong)),
        Err(args::Wrong::File(failure)) => return Err(failure),
    };
    let stop = Stop::listen()?;
    // The plan allows at most 1024 threads, so that the number fits in 16 bits.
    start_threads(u16::try_from(plan.threads).unwrap_or(0))?;
    let mut runner: Box<dyn Runner> = match plan.fresh {
        false => Box::new(InProcess::new(cpu_seconds)),
        true => Box::new(Processes::new(&itself()?, &[ONE])),
    };
    let folder = &match options.shard {
        Some(shard) => options.output.join(format!("{SHARD}{}-of-{}", shard.index() + 1, shard.of())),
        None => options.output.clone(),
    };
    let shared = options.shard.map(|_| options.output.join("references"));
    let session = StudyOptions::default().with_references(options.references.clone().or(shared));
    let session = session.with_command(std::env::args()).with_shard(options.shard);
    let mut bar = Bar::new(options.quiet, stop);
    let opened = Study::open(plan, folder, &session, &mut bar);
    let Some(mut study) = opened.map_err(|e| failure_of(&e, &mut bar))? else {
        bar.finish();
        say("interrupted", "before the first run: finished references are kept");
        return Ok(Outcome::Interrupted);
    };
    let (before, runs) = (study.runs().len(), study.expected());
    if before > 0 && before < runs {
        say("study", &format!("resuming after {before} of {runs} runs"));
    }
    let ended = study.run(&mut *runner, &mut bar).map_err(|e| failure_of(&e, &mut bar))?;
    bar.finish();
    if ended == StudyStatus::Stopped {
        let (done, at) = (study.runs().len(), folder.display());
        say("interrupted", &format!("{done} of {runs} runs are in {at}; the same command resumes"));
        if done > 0 {
            deliver(folder, options.quiet)?;
        }
        return Ok(Outcome::Interrupted);
    }
    deliver(folder, options.quiet)
}

/// The beginning of the names of folders of shards.
const SHARD: &str = "shard-";

/// Merges the shards in the folder of the study, and writes the report.
fn merge(options: &StudyArgs) -> Result<Outcome> {
    let folder = &options.output;
    let wrong = |e| Failure::new(format!("{}: cannot list the folder: {e}", folder.display()));
    let mut shards = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(wrong)? {
        let entry = entry.map_err(wrong)?;
        if entry.file_name().to_string_lossy().starts_with(SHARD) && entry.path().join("study.json").exists() {
            shards.push(entry.path());
        }
    }
    shards.sort();
    if shards.is_empty() {
        let at = folder.display();
        return Err(Failure::new(format!(
            "{at}: no shards of a study; make them by dapple study … --shard I/N -o {at}"
        )));
    }
    let runs = merge_studies(&shards, folder).map_err(|e| Failure::lines(&e))?;
    if !options.quiet {
        tell(format!("{runs} runs of {} shards", shards.len()))?;
    }
    deliver(folder, options.quiet)
}

/// Writes the summary and the report of the study in `folder`.
fn deliver(folder: &Path, quiet: bool) -> Result<Outcome> {
    let _ = write_report(folder).map_err(Failure::new)?;
    if !quiet {
        tell(format!("{}: the report", folder.join("report.html").display()))?;
        tell(format!("{}: all its figures", folder.join("summary.csv").display()))?;
        tell(format!("{}: its tables and plots, for other pages", folder.join("summary.md").display()))?;
        tell(format!("{}: every run, a line of JSON each", folder.join("runs.jsonl").display()))?;
        tell(format!("{}: the same runs as a table", folder.join("runs.csv").display()))?;
        tell(format!("{}: tables and curves for LaTeX", folder.join("latex").display()))?;
        tell(format!("{}: a notebook that reads the runs", folder.join("notebook.ipynb").display()))?;
        tell(format!("{}: images for tev and JERI", folder.join("viewer").display()))?;
        tell(format!("{}: the plan and the machine", folder.join("study.json").display()))?;
    }
    Ok(Outcome::Done)
}

/// Runs `dapple study-run`: reads a request as JSON from stdin, and writes the finished run as JSON to stdout.
pub(crate) fn run_one() -> Result<Outcome> {
    // Ctrl-C stops a study between its runs; the handler lets this run finish.
    let _stop = Stop::listen()?;
    let mut json = String::new();
    std::io::stdin().read_to_string(&mut json).map_err(|e| Failure::new(format!("cannot read the run: {e}")))?;
    let request: RunRequest = serde_json::from_str(&json).map_err(|e| {
        Failure::new(format!("this is not a run ({e}); dapple study makes runs, and starts this command by itself"))
    })?;
    start_threads(u16::try_from(request.threads).unwrap_or(0))?;
    let run = InProcess::fresh(cpu_seconds).run(&request).map_err(|e| Failure::lines(&e))?;
    tell(serde_json::to_string(&run).map_err(Failure::new)?)?;
    Ok(Outcome::Done)
}

fn itself() -> Result<std::path::PathBuf> {
    std::env::current_exe().map_err(|e| Failure::new(format!("--fresh: cannot find this program: {e}")))
}

/// Makes the failure for an error of a study, with advice that names command-line options.
fn failure_of(error: &StudyError, bar: &mut Bar) -> Failure {
    bar.finish();
    match error {
        StudyError::Load(JobError::Memory { estimate, limit, .. }) => {
            let limit = limit.bytes().map_or_else(String::new, size);
            Failure::new(format!("a run takes at least {estimate}, and {limit} is all there is; lower --resolution"))
        }
        StudyError::Load(error) => crate::failure::of_job(error),
        _ => Failure::lines(error),
    }
}
