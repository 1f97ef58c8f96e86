//! Renders by many machines: plans and their parts in files, and processes that mpirun or srun started together.

use super::progress::Progress;
use super::{Live, RenderArgs, Show, file_conflicts, load, prepare, warn_all};
use crate::machine::start_threads;
use crate::output::{say, tell, warn};
use crate::stop::Stop;
use crate::{Failure, Outcome, Result, failure};
use dapple_distributed::{Processes, dismiss, refuse};
use dapple_job::memory::{MemoryEstimate, MemoryLimit};
use dapple_job::output::FileIdentity;
use dapple_job::{
    BudgetSpec, CheckpointOptions, Checkpoints, Job, LoadOptions, OutputFiles, PlanFile, RenderSpec, RowsFiles, Shard,
    Warning,
};
use dapple_scene::image::{check_writable, write_file};
use std::path::{Path, PathBuf};

/// The options of work on a plan.
pub(crate) struct PlanOptions {
    pub(crate) threads: u16,
    pub(crate) memory: Option<u64>,
    pub(crate) quiet: bool,
    pub(crate) progress_every: Option<f64>,
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

    /// The job of a render, checked to fit into memory; `None` if the program was stopped before.
    fn job(&self, spec: &RenderSpec, output: &Path, progress: &Progress) -> Result<Option<Job>> {
        progress.phase("reading");
        let limit = self.memory.map_or_else(MemoryLimit::of_machine, MemoryLimit::given);
        let loaded = load(spec, &LoadOptions::default().with_limit(limit), limit)?;
        file_conflicts::check_inputs(&loaded, std::iter::once(("--output", output)))?;
        check_writable(output).map_err(Failure::new)?;
        warn_all(loaded.warnings());
        let Some((mut job, _)) = prepare(loaded, OutputFiles::none(), progress)? else { return Ok(None) };
        let expected = job.memory_in_stages().map_err(|e| failure::of_job(&e))?;
        expected.check(limit).map_err(|e| failure::of_job(&e))?;
        Ok(Some(job))
    }
}

/// Writes the plan of the first stage.
pub(crate) fn first_plan(spec: &RenderSpec, output: &Path, options: &PlanOptions) -> Result<Outcome> {
    if matches!(spec.budget, BudgetSpec::Seconds(_)) {
        let why = "the machines of a plan have no common clock; use --spp, --samples or --error";
        return Err(Failure::usage("--time", why));
    }
    let progress = options.progress()?;
    let Some(mut job) = options.job(spec, output, &progress)? else { return Ok(Outcome::Interrupted) };
    progress.phase("planning");
    let bytes = job.first_plan().map_err(|e| failure::of_job(&e))?;
    write_file(output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !options.quiet {
        tell(format!("{}: a plan; render its parts with --from and --shard I/N", output.display()))?;
    }
    Ok(Outcome::Done)
}

/// Joins the parts of a plan, and writes the next plan.
pub(crate) fn next_plan(
    parts: &[PathBuf],
    from: Option<&Path>,
    output: &Path,
    options: &PlanOptions,
) -> Result<Outcome> {
    let rows = RowsFiles::read(parts).map_err(|e| failure::of_job(&e))?;
    let named =
        || rows.plan().ok_or_else(|| Failure::new("these are shards of an image; dapple merge makes the image"));
    let from = from.map_or_else(named, Ok)?;
    keep(output, parts.iter().map(|part| ("a part", part.as_path())).chain([("--from", from)]))?;
    let plan = PlanFile::read(from).map_err(|e| failure::of_job(&e))?;
    let progress = options.progress()?;
    let Some(mut job) = options.job(plan.spec(), output, &progress)? else { return Ok(Outcome::Interrupted) };
    progress.phase("planning");
    let (bytes, done) = job.next_plan(&plan, &rows).map_err(|e| failure::of_job(&e))?;
    write_file(output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !options.quiet {
        let path = output.display();
        tell(match done {
            true => format!("{path}: done; dapple merge makes the image"),
            false => format!("{path}: the next plan"),
        })?;
    }
    Ok(Outcome::Done)
}

/// Traces a part of a plan, or of an image without a plan (a shard).
pub(super) fn part(args: &RenderArgs, shard: Shard) -> Result<Outcome> {
    let plan = args.from.as_deref().map(PlanFile::read).transpose().map_err(|e| failure::of_job(&e))?;
    let spec = match &plan {
        Some(plan) if args.spec.is_none() => plan.spec().clone(),
        _ => args.spec()?,
    };
    if args.print_spec {
        tell(spec.to_json_pretty().map_err(Failure::new)?)?;
        return Ok(Outcome::Done);
    }
    let output = args.outputs.first().cloned().unwrap_or_else(|| part_name(&spec, shard));
    keep(&output, args.from.iter().map(|plan| ("--from", plan.as_path())))?;
    let checkpoints = CheckpointOptions::open(args.checkpoints()).map_err(|e| failure::of_job(&e))?;
    let options = PlanOptions::from(args);
    let mut progress = options.progress()?;
    let Some(mut job) = options.job(&spec, &output, &progress)? else { return Ok(Outcome::Interrupted) };
    progress.begin(&job);
    let traced = job.trace_part(plan.as_ref(), shard, checkpoints, &mut progress).map_err(|e| failure::of_job(&e))?;
    let Some(bytes) = traced else {
        warn(failure::warning(&Warning::ShardStopped(shard)));
        return Ok(Outcome::Interrupted);
    };
    write_file(&output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !args.quiet {
        let next =
            if plan.is_some() { "dapple plan joins all parts" } else { "dapple merge makes the image of all shards" };
        tell(format!("{}: part {shard}; {next}", output.display()))?;
    }
    Ok(Outcome::Done)
}

/// The name of a part's file if none is given.
fn part_name(spec: &RenderSpec, shard: Shard) -> PathBuf {
    let scene = Path::new(&spec.scene).file_stem().map_or("scene".into(), |stem| stem.to_string_lossy());
    format!("{scene}-{}-of-{}.part", shard.index() + 1, shard.of()).into()
}

/// Refuses to write over an input.
fn keep<'a>(output: &Path, inputs: impl Iterator<Item = (&'static str, &'a Path)>) -> Result<()> {
    let written = FileIdentity::of(output);
    for (who, input) in inputs {
        if FileIdentity::of(input).is_same(&written) {
            let (path, input) = (output.display(), input.display());
            let wrong = format!("--output {path}: this is {who} ({input}), which would be lost; write to another file");
            return Err(Failure::new(wrong));
        }
    }
    Ok(())
}

/// The number of processes that a launcher started together, as it says in the environment.
fn launched() -> u32 {
    const SIZES: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MV2_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS"];
    let size = |name: &&str| std::env::var(name).ok()?.parse().ok();
    SIZES.iter().find_map(size).unwrap_or(1)
}

/// The processes of which this is one; `None` for a process alone.
#[cfg(not(feature = "mpi"))]
pub(super) fn processes() -> Result<Option<Box<dyn Processes>>> {
    match launched() {
        0 | 1 => Ok(None),
        processes => Err(Failure::new(format!(
            "{processes} processes were started together, and this program has no MPI: each would render the whole image; \
             build it with --features mpi, or start one process (docs/CLUSTER.md)"
        ))),
    }
}

/// The processes of which this is one; `None` for a process alone.
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
            "{launched} processes were started together, and MPI connects {of}; start them by the mpirun of the MPI library \
             that this program was built with, or by srun --mpi=pmix"
        )));
    }
    Ok(Some(Box::new(processes)))
}

/// Renders together with other processes: process 0 plans, filters, prints and writes, all trace.
pub(super) fn together(args: &RenderArgs, spec: &RenderSpec, mut processes: Box<dyn Processes>) -> Result<Outcome> {
    let processes = &mut *processes;
    let stop = Stop::listen()?;
    start_threads(args.threads)?;
    if processes.rank() > 0 {
        let asked = stop.clone();
        let served = match worker(args, spec, stop) {
            Ok(mut job) => job.serve(processes, &mut || asked.asked()).map_err(|e| failure::of_job(&e)),
            // The first process reports it.
            Err(Failure(lines)) => refuse(&lines.join("; "), processes).map_err(|e| Failure::lines(&e)),
        };
        return served.map(|()| Outcome::Done);
    }
    let show = Show::from(args);
    let prepared = first(args, spec, &show, &stop);
    // Others wait for rows until they are told that none come.
    if !matches!(prepared, Ok(Some(_))) {
        dismiss(processes).map_err(|e| Failure::lines(&e))?;
    }
    let Some(First { mut job, expected, cpu, mut progress, checkpoints }) = prepared? else {
        return Ok(Outcome::Interrupted);
    };
    if !args.quiet && !args.json {
        say("together", &format!("{} processes", processes.size()));
    }
    progress.begin(&job);
    let traced = job.coordinate(checkpoints, &mut progress, processes, &mut || stop.asked());
    show.deliver(&job, traced.map_err(|e| failure::of_job(&e))?, (Some(&expected), cpu), progress)
}

/// The job of a process that traces for another.
fn worker(args: &RenderArgs, spec: &RenderSpec, stop: Stop) -> Result<Job> {
    let show = Show { quiet: true, ..Show::from(args) };
    let progress = Progress::new(&show, stop, Live::default());
    let limit = args.memory.map_or_else(MemoryLimit::of_machine, MemoryLimit::given);
    let loaded = load(spec, &LoadOptions::default().with_limit(limit), limit)?;
    let files = show.files(&loaded)?;
    let prepared = prepare(loaded, files, &progress)?;
    prepared.map(|(job, _)| job).ok_or_else(|| Failure::new("it was stopped"))
}

/// What process 0 has before the first stage.
struct First {
    job: Job,
    expected: MemoryEstimate,
    cpu: Option<f64>,
    progress: Progress,
    checkpoints: Option<Checkpoints>,
}

/// Makes process 0 ready; `None` if it was stopped.
fn first(args: &RenderArgs, spec: &RenderSpec, show: &Show<'_>, stop: &Stop) -> Result<Option<First>> {
    let checkpoints = args.checkpoints().open().map_err(|e| failure::of_job(&e))?;
    let progress = Progress::new(show, stop.clone(), Live::open(&args.live())?);
    let limit = args.memory.map_or_else(MemoryLimit::of_machine, MemoryLimit::given);
    progress.phase("reading");
    let loaded = load(spec, &LoadOptions::default().with_limit(limit), limit)?;
    let files = show.files(&loaded)?;
    file_conflicts::check(args, &loaded, &files)?;
    files.prepare().map_err(|e| failure::of_job(&e))?;
    warn_all(loaded.warnings());
    let Some((mut job, cpu)) = prepare(loaded, files, &progress)? else { return Ok(None) };
    let expected = job.memory_in_stages().map_err(|e| failure::of_job(&e))?;
    expected.check(limit).map_err(|e| failure::of_job(&e))?;
    Ok(Some(First { job, expected, cpu, progress, checkpoints }))
}
