//! Renders on many machines: by plans and their parts in files (`dapple plan`, `dapple merge`), or by processes that mpirun
//! or srun started together.

use super::{
    Live, Ready, RenderArgs, Show, described_in, file_conflicts, limit, load, prepare, ready, values, warn_all,
};
use crate::machine::{Stop, start_threads};
use crate::output::{say, tell, warn};
use crate::progress::Progress;
use crate::{Failure, Outcome, Result, failure};
use dapple_distributed::{Processes, dismiss, refuse};
use dapple_job::memory::{MemoryLimit, size};
use dapple_job::output::FileIdentity;
use dapple_job::{
    BudgetSpec, Job, JobError, OutputFiles, PartNumber, PlanFile, RenderSpec, RowsFiles, Traced, Warning,
};
use dapple_scene::image::{check_writable, write_file};
use dapple_scene::text::file_stem;
use std::path::{Path, PathBuf};

/// The options of commands that read or write a plan.
pub(super) struct PlanOptions {
    threads: u16,
    memory: Option<u64>,
    quiet: bool,
    progress_every: Option<f64>,
}

impl From<&RenderArgs> for PlanOptions {
    fn from(args: &RenderArgs) -> Self {
        let RenderArgs { threads, memory, quiet, progress_every, .. } = *args;
        Self { threads, memory, quiet, progress_every }
    }
}

impl PlanOptions {
    fn progress(&self) -> Result<Progress> {
        let stop = Stop::listen()?;
        start_threads(self.threads)?;
        let show = Show { quiet: self.quiet, progress_every: self.progress_every, ..Show::default() };
        Ok(Progress::new(&show, stop, Live::default()))
    }

    /// The job of a render, checked to fit into memory; `None` if the user stopped the program.
    fn job(&self, spec: &RenderSpec, output: &Path, progress: &Progress) -> Result<Option<Job>> {
        progress.phase("reading");
        let limit = limit(self.memory);
        let loaded = load(spec, limit, true)?;
        file_conflicts::check_inputs(&loaded, None, std::iter::once(("--output", output)))?;
        check_writable(output).map_err(Failure::new)?;
        warn_all(&loaded.warnings);
        let Some((mut job, _)) = prepare(loaded, OutputFiles::none(), progress)? else { return Ok(None) };
        job.memory_in_stages().check(limit)?;
        Ok(Some(job))
    }
}

/// Writes the plan of the first stage.
pub(super) fn first_plan(spec: &RenderSpec, output: &Path, options: &PlanOptions) -> Result<Outcome> {
    if matches!(spec.budget, BudgetSpec::Seconds(_)) {
        let why = "--time cannot be used, since the machines of a plan have no common clock; use --spp or --error";
        return Err(Failure::usage("render", why));
    }
    let progress = options.progress()?;
    let Some(mut job) = options.job(spec, output, &progress)? else { return Ok(Outcome::Interrupted) };
    progress.phase("planning");
    let bytes = job.first_plan()?;
    write_file(output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !options.quiet {
        tell(format!("{}: a plan; render its parts with --from and --part I/N", output.display()))?;
    }
    Ok(Outcome::Done)
}

/// Joins the parts of a plan, and writes the next plan.
fn next_plan(parts: &[PathBuf], from: Option<&Path>, output: &Path, options: &PlanOptions) -> Result<Outcome> {
    let rows = RowsFiles::read(parts)?;
    let named =
        || rows.plan().ok_or_else(|| Failure::new("these parts have no plan; make the image with dapple merge"));
    let from = &*from.map_or_else(named, |from| Ok(from.to_owned()))?;
    keep(output, parts.iter().map(|part| ("a part", part.as_path())).chain([("--from", from)]))?;
    let plan = PlanFile::read(from)?;
    let progress = options.progress()?;
    let Some(mut job) = options.job(&plan.spec, output, &progress)? else { return Ok(Outcome::Interrupted) };
    progress.phase("planning");
    let (bytes, done) = job.next_plan(&plan, &rows)?;
    write_file(output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !options.quiet {
        let what = if done { "done; dapple merge makes the image" } else { "the next plan" };
        tell(format!("{}: {what}", output.display()))?;
    }
    Ok(Outcome::Done)
}

/// Traces a part of a plan or, without a plan, a part of an image.
pub(super) fn part(args: &RenderArgs, part: PartNumber) -> Result<Outcome> {
    let plan = args.from.as_deref().map(PlanFile::read).transpose()?;
    let spec = match &plan {
        Some(plan) if args.spec.is_none() => plan.spec.clone(),
        _ => args.spec()?,
    };
    if args.print_spec {
        tell(spec.to_json_pretty().map_err(Failure::new)?)?;
        return Ok(Outcome::Done);
    }
    let output = args.outputs.first().cloned().unwrap_or_else(|| part_name(&spec, part));
    keep(&output, args.from.iter().map(|plan| ("--from", plan.as_path())))?;
    let checkpoints = args.checkpoints().open()?;
    let options = PlanOptions::from(args);
    let mut progress = options.progress()?;
    let Some(mut job) = options.job(&spec, &output, &progress)? else { return Ok(Outcome::Interrupted) };
    progress.begin(&job);
    let traced = job.trace_part(plan.as_ref(), part, checkpoints, &mut progress)?;
    let Some(bytes) = traced else {
        warn(failure::warning(&Warning::PartStopped(part)));
        return Ok(Outcome::Interrupted);
    };
    write_file(&output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !args.quiet {
        let next = if plan.is_some() { "plan joins all parts" } else { "merge makes the image of all parts" };
        tell(format!("{}: part {part}; dapple {next}", output.display()))?;
    }
    Ok(Outcome::Done)
}

/// The name of a part's file if none is given.
fn part_name(spec: &RenderSpec, part: PartNumber) -> PathBuf {
    let scene = file_stem(&spec.scene).unwrap_or_else(|| "scene".into());
    format!("{scene}-{}-of-{}.part", part.index() + 1, part.of()).into()
}

/// Returns an error if `output` is also an input.
fn keep<'a>(output: &Path, inputs: impl Iterator<Item = (&'static str, &'a Path)>) -> Result<()> {
    let written = FileIdentity::of(output);
    for (who, input) in inputs {
        if FileIdentity::of(input).is_same(&written) {
            let (path, input) = (output.display(), input.display());
            let wrong = format!("--output {path}: this file is {who} ({input}); write to another file");
            return Err(Failure::new(wrong));
        }
    }
    Ok(())
}

/// The number of processes that a launcher started together, from environment variables; 1 without a launcher.
fn launched() -> u32 {
    const SIZES: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MV2_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS"];
    let size = |name: &&str| std::env::var(name).ok()?.parse().ok();
    SIZES.iter().find_map(size).unwrap_or(1)
}

/// The processes that were started together with this one; `None` for a process on its own.
#[cfg(not(feature = "mpi"))]
pub(super) fn processes() -> Result<Option<Box<dyn Processes>>> {
    match launched() {
        0 | 1 => Ok(None),
        processes => Err(Failure::new(format!(
            "{processes} processes were started together, but this build has no MPI, so each would render the whole \
             image; build Dapple with --features mpi, or start one process (docs/CLUSTER.md)"
        ))),
    }
}

/// The processes that were started together with this one; `None` for a process on its own.
#[cfg(feature = "mpi")]
pub(super) fn processes() -> Result<Option<Box<dyn Processes>>> {
    let launched = launched();
    if launched <= 1 {
        return Ok(None);
    }
    let connected = ["OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "MV2_COMM_WORLD_RANK"];
    if !connected.iter().any(|name| std::env::var_os(name).is_some()) {
        return Err(Failure::new(format!("srun started {launched} processes without MPI; add --mpi=pmix to srun")));
    }
    let processes = dapple_mpi::MpiProcesses::start().map_err(|e| Failure::new(e.to_string()))?;
    let of = processes.size();
    if of != launched {
        return Err(Failure::new(format!(
            "{launched} processes were started together, but MPI connects only {of}; start them with mpirun of the MPI library \
             that this program was built with, or by srun --mpi=pmix"
        )));
    }
    Ok(Some(Box::new(processes)))
}

/// Renders together with other processes. Process 0 plans, filters, prints and writes; all processes trace.
pub(super) fn together(args: &RenderArgs, spec: &RenderSpec, mut processes: Box<dyn Processes>) -> Result<Outcome> {
    let processes = &mut *processes;
    let stop = Stop::listen()?;
    start_threads(args.threads)?;
    if processes.rank() > 0 {
        let asked = stop.clone();
        let served = match worker(args, spec, stop) {
            Ok(mut job) => job.serve(processes, &mut || asked.asked()).map_err(|e| failure::of_job(&e)),
            // Process 0 reports the error.
            Err(Failure(lines)) => refuse(&lines.join("; "), processes).map_err(|e| Failure::lines(&e)),
        };
        return served.map(|()| Outcome::Done);
    }
    let show = Show::from(args);
    let prepared = ready(args, spec, &show, &stop, true);
    // The other processes wait for rows until process 0 dismisses them.
    if !matches!(prepared, Ok(Some(_))) {
        dismiss(processes).map_err(|e| Failure::lines(&e))?;
    }
    let Some(Ready { mut job, expected, cpu, mut progress, checkpoints }) = prepared? else {
        return Ok(Outcome::Interrupted);
    };
    if !args.quiet && !args.json {
        say("together", &format!("{} processes", processes.size()));
    }
    progress.begin(&job);
    let traced = job.coordinate(checkpoints, &mut progress, processes, &mut || stop.asked());
    show.deliver(&job, traced?, (Some(&expected), cpu), progress)
}

/// The job of a process that traces rows for process 0.
fn worker(args: &RenderArgs, spec: &RenderSpec, stop: Stop) -> Result<Job> {
    let show = Show { quiet: true, ..Show::from(args) };
    let progress = Progress::new(&show, stop, Live::default());
    let loaded = load(spec, limit(args.memory), true)?;
    let files = show.files(&loaded)?;
    let prepared = prepare(loaded, files, &progress)?;
    prepared.map(|(job, _)| job).ok_or_else(|| Failure::new("stopped before the first sample"))
}

/// Plan the next stage of a render on many machines, from the parts of the stage before
///
/// Samplers and light selection that learn from samples need all samples of a stage before the next one. A stage is one
/// training pass of the light selection, or what remains of a round of the sampler. `dapple render --from PLAN
/// --part I/N` renders the parts of a stage, in any order, on any machines. After the last stage this command prints
/// "done", and `dapple merge PLAN` makes the image, with the same bits as a render on one machine.
#[derive(clap::Args)]
#[command(after_help = include_str!("../help/plan.txt").trim_end())]
pub(crate) struct PlanArgs {
    /// Files of all parts of a stage, in any order
    #[arg(value_name = "PART", required_unless_present = "spec")]
    parts: Vec<PathBuf>,

    /// Plan to write: a .plan file
    #[arg(short, long, value_name = "PLAN")]
    output: PathBuf,

    /// Plan that the parts were rendered from [default: the plan recorded in the first part]
    #[arg(long, value_name = "PLAN", requires = "parts")]
    from: Option<PathBuf>,

    /// Create the first plan from these render settings (JSON, see `dapple render --print-spec`), without PART arguments
    #[arg(long, value_name = "FILE", conflicts_with_all = ["parts", "from"])]
    spec: Option<PathBuf>,

    /// Memory limit, such as 2G, 500M or a number of bytes; larger renders are refused [default: the machine's memory]
    #[arg(long, value_name = "SIZE", value_parser = values::size)]
    memory: Option<u64>,

    /// Number of threads; 0 is one per core
    #[arg(short = 't', long, visible_alias = "nthreads", value_name = "N", default_value_t = 0)]
    #[arg(value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,

    /// Show no progress and no summary; warnings are still printed
    #[arg(short, long)]
    quiet: bool,
}

pub(crate) fn plan(args: &PlanArgs) -> Result<Outcome> {
    if !values::has_extension(&args.output, "plan") {
        return Err(Failure::usage("plan", "--output: a file name that ends in .plan is required"));
    }
    let PlanArgs { threads, memory, quiet, .. } = *args;
    let options = PlanOptions { threads, memory, quiet, progress_every: None };
    match &args.spec {
        Some(spec) => first_plan(&described_in(spec)?, &args.output, &options),
        None => next_plan(&args.parts, args.from.as_deref(), &args.output, &options),
    }
}

/// A function that loads the film of parts or of a plan into a job.
type Film = Box<dyn FnOnce(&mut Job) -> std::result::Result<Traced, JobError>>;

/// Make an image from parts that several machines rendered, or from the final .plan of a multi-stage render
///
/// The image has the same bits as a render on one machine with the same arguments. Parts rendered without a plan use
/// `--light-selection power` by default; give the single-machine render the same option. The scene is read again, from the
/// path in the files or from --scene.
#[derive(clap::Args)]
#[command(after_help = include_str!("../help/merge.txt").trim_end())]
pub(crate) struct MergeArgs {
    /// Files of all parts, in any order; or the .plan file for which `dapple plan` printed "done"
    #[arg(value_name = "PART", required = true)]
    parts: Vec<PathBuf>,

    /// Image file to write: .exr, .pfm or .png; may be repeated [default: as for dapple render]
    #[arg(short, long = "output", visible_alias = "outfile", value_name = "OUT", value_parser = values::output())]
    outputs: Vec<PathBuf>,

    /// Path of the scene, if it has moved
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,

    /// Exposure of PNG images in stops; each stop doubles the brightness
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,

    /// Memory limit, such as 2G, 500M or a number of bytes; a larger merge is refused [default: the machine's memory]
    #[arg(long, value_name = "SIZE", value_parser = values::size)]
    memory: Option<u64>,

    /// Number of threads; 0 is one per core
    #[arg(short = 't', long, visible_alias = "nthreads", value_name = "N", default_value_t = 0)]
    #[arg(value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,

    /// Print one line of JSON instead of the summary; values are totals over all machines, except "cpu", the CPU
    /// seconds of the merge itself
    #[arg(long)]
    json: bool,

    /// Show no summary; warnings and the --json line are still printed
    #[arg(short, long)]
    quiet: bool,
}

pub(crate) fn merge(args: &MergeArgs) -> Result<Outcome> {
    let limit = limit(args.memory);
    check_fits(&args.parts, limit)?;
    let plan = args.parts.iter().find(|path| values::has_extension(path, "plan"));
    let (film, mut spec): (Film, RenderSpec) = match (plan, args.parts.len()) {
        (Some(path), 1) => {
            let plan = PlanFile::read(path)?;
            let spec = plan.spec.clone();
            (Box::new(move |job| job.finish_plan(&plan)), spec)
        }
        (Some(_), _) => return Err(Failure::usage("merge", "a .plan file holds the whole image; pass no other file")),
        (None, _) => {
            let parts = RowsFiles::read(&args.parts)?;
            let spec = parts.spec.clone();
            (Box::new(move |job| job.merge(&parts)), spec)
        }
    };
    if let Some(scene) = &args.scene {
        spec.scene.clone_from(scene);
    }
    let MergeArgs { exposure, json, quiet, .. } = *args;
    let show = Show { outputs: &args.outputs, exposure, json, quiet, ..Show::default() };
    super::merge(film, &spec, &show, (args.threads, limit))
}

/// Checks before reading that merging fits into memory: the films of all parts, the whole, and the file being read. A file
/// of unknown length counts as empty; reading it reports the error.
fn check_fits(parts: &[PathBuf], limit: MemoryLimit) -> Result<()> {
    let lengths: Vec<u64> = parts.iter().map(|path| std::fs::metadata(path).map_or(0, |found| found.len())).collect();
    let sum = lengths.iter().fold(0_u64, |sum, length| sum.saturating_add(*length));
    let needed = sum.saturating_mul(2).saturating_add(lengths.iter().copied().max().unwrap_or(0));
    if let Some(limit) = limit.bytes().filter(|limit| needed > *limit) {
        let (needed, limit) = (size(needed), size(limit));
        return Err(Failure::new(format!(
            "merging these parts takes {needed}, but the limit is {limit}; raise --memory"
        )));
    }
    Ok(())
}
