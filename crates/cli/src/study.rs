//! The subcommand `dapple study`, and the hidden `dapple study-run`.

use crate::machine::{Stop, cpu_seconds, start_threads};
use crate::output::{say, tell, warn};
use crate::progress::Display;
use crate::{Failure, Outcome, Result};
use dapple_core::render::Control;
use dapple_job::JobError;
use dapple_job::memory::size;
use dapple_study::{
    InProcess, Plan, Processes, RunRequest, Runner, Study, StudyError, StudyMonitor, StudyOptions, StudyProgress,
    StudyStatus, write_report,
};
use indicatif::HumanDuration;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Measure error against render time: samplers x point sets x filters x budgets x seeds over scenes
///
/// Every combination is rendered with every seed, timed and compared with a reference. Methods are compared at the same
/// samples per pixel, and in the time that the baseline takes. Methods alternate run by run, so that a temporary
/// slowdown of the machine affects all of them. Each finished run is a line of runs.jsonl in the folder DIR, beside
/// report.html. The same command resumes a stopped or killed study.
///
/// By default, the first method is that of `dapple render`: its sampler, points, filter and light selection.
///
/// The pixel filter of all images is a box one pixel wide. References are rendered once, with a point set that no
/// method uses, in two halves whose difference estimates the reference's own error.
#[derive(clap::Args)]
#[command(after_help = include_str!("help/study.txt").trim_end())]
pub(crate) struct StudyArgs {
    /// Plan of the study, in TOML; without one, the defaults below
    #[arg(value_name = "FILE.toml")]
    plan: Option<PathBuf>,

    /// Set a key of the plan; may be repeated. VALUE is TOML, or text without quotes
    ///
    /// Single values are accepted where a list is expected; use dots for nested keys (a.b=1). Setting resolution or
    /// lights overrides per-scene values.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,

    /// Folder for all results
    #[arg(short, long = "output", value_name = "DIR", default_value = "study")]
    output: PathBuf,

    /// Folder for rendered references that several studies share [default: in the study's folder]
    #[arg(long, value_name = "DIR")]
    references: Option<PathBuf>,

    /// Regenerate report and tables from the runs already in --output; render nothing
    #[arg(long, conflicts_with_all = ["plan", "sets"])]
    report_only: bool,

    /// Show no progress and no list of files; warnings are still printed
    #[arg(short, long)]
    quiet: bool,
}

/// The name of the hidden subcommand that performs a single run of a study in its own process.
const ONE: &str = "study-run";

impl StudyArgs {
    fn plan(&self) -> Result<Plan> {
        if let Some(file) = self.plan.as_ref().filter(|file| file.extension().is_some_and(|e| e != "toml")) {
            let file = file.display();
            let wrong = format!("{file} is not a plan (FILE.toml); use --set scenes={file} to study a scene");
            return Err(Failure::usage("study", wrong));
        }
        Plan::read(self.plan.as_deref(), &self.sets).map_err(|e| match &e {
            StudyError::Plan(wrong) if wrong.place.as_ref().is_none_or(|place| place.starts_with("--set")) => {
                Failure::usage("study", wrong.to_string())
            }
            _ => Failure::lines(&e),
        })
    }
}

pub(crate) fn run(options: &StudyArgs) -> Result<Outcome> {
    if options.report_only {
        return deliver(&options.output, options.quiet);
    }
    let plan = options.plan()?;
    let stop = Stop::listen()?;
    // The plan allows at most 1024 threads, so that the number fits in 16 bits.
    start_threads(u16::try_from(plan.settings.threads).unwrap_or(0))?;
    let mut runner: Box<dyn Runner> = match plan.settings.fresh {
        false if plan.settings.share_samples => Box::new(InProcess::new(cpu_seconds).sharing()),
        false => Box::new(InProcess::new(cpu_seconds)),
        true => Box::new(Processes::new(&itself()?, &[ONE])),
    };
    let folder = &options.output;
    let session = StudyOptions { references: options.references.clone(), command: std::env::args().collect() };
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

/// Writes the summary and the report of the study in `folder`.
fn deliver(folder: &Path, quiet: bool) -> Result<Outcome> {
    let _ = write_report(folder).map_err(Failure::new)?;
    if !quiet {
        tell(format!("{}: the report", folder.join("report.html").display()))?;
        tell(format!("{}: all its figures", folder.join("summary.csv").display()))?;
        tell(format!("{}: every run, a line of JSON each", folder.join("runs.jsonl").display()))?;
        tell(format!("{}: the same runs as a table", folder.join("runs.csv").display()))?;
        tell(format!("{}: the plan and the machine", folder.join("study.json").display()))?;
    }
    Ok(Outcome::Done)
}

/// Runs `dapple study-run`: reads a request as JSON from stdin, and writes the finished run as JSON to stdout.
pub(crate) fn run_one() -> Result<Outcome> {
    // Ctrl-C stops a study between its runs; the handler lets this run finish.
    let _stop = Stop::listen()?;
    let mut json = String::new();
    std::io::stdin().read_to_string(&mut json).map_err(|e| Failure::new(format!("cannot read the request: {e}")))?;
    let request: RunRequest = serde_json::from_str(&json).map_err(|e| {
        Failure::new(format!("this is not a run request ({e}); use dapple study, which starts this command itself"))
    })?;
    start_threads(u16::try_from(request.threads).unwrap_or(0))?;
    let run = InProcess::fresh(cpu_seconds).run(&request).map_err(|e| Failure::lines(&e))?;
    tell(serde_json::to_string(&run).map_err(Failure::new)?)?;
    Ok(Outcome::Done)
}

fn itself() -> Result<PathBuf> {
    std::env::current_exe().map_err(|e| {
        Failure::new(format!("fresh = true: the path of the program dapple is unknown ({e}); set fresh = false"))
    })
}

/// Converts an error of a study to a failure, with advice that names command-line options.
fn failure_of(error: &StudyError, bar: &mut Bar) -> Failure {
    bar.finish();
    match error {
        StudyError::Load(JobError::Memory { estimate, limit, .. }) => {
            let limit = limit.bytes().map_or_else(String::new, size);
            Failure::new(format!("a run takes at least {estimate}, but the limit is {limit}; lower the resolution"))
        }
        StudyError::Load(error) => crate::failure::of_job(error),
        _ => Failure::lines(error),
    }
}

/// The display of a study's progress, and the study's stop on Ctrl-C.
struct Bar {
    display: Display,
    stop: Stop,
}

impl Bar {
    fn new(quiet: bool, stop: Stop) -> Self {
        let display = Display::new(quiet, None);
        display.begin();
        Self { display, stop }
    }

    /// Removes the bar.
    fn finish(&mut self) {
        self.display = Display::Silent;
    }
}

impl StudyMonitor for Bar {
    fn progress(&mut self, progress: &StudyProgress<'_>) -> Control {
        if self.stop.asked() {
            return Control::Stop;
        }
        if !self.display.is_silent() {
            let left = progress.left.map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
            let left = left.map_or_else(String::new, |left| format!("{} left, ", HumanDuration(left)));
            let (done, runs) = (progress.done, progress.runs);
            self.display.update(progress.share, format!("{left}{done} of {runs} runs; {}", progress.doing));
        }
        Control::Continue
    }

    fn warning(&mut self, warning: &str) {
        warn(warning);
    }
}
