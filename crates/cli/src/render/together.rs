//! A render by the processes that mpirun or srun started: all trace and filter, the first one prints and writes.

use super::{Live, Progress, RenderArgs, Show, load, prepare, roles, warn_all};
use crate::machine::start_threads;
use crate::output::say;
use crate::stop::Stop;
use crate::{Failure, Outcome, Result, failure};
use dapple_core::exchange::agree;
use dapple_core::{Exchange, Shard};
use dapple_job::memory::MemoryLimit;
use dapple_job::{Checkpoints, Job, LoadOptions, RenderSpec};

/// The number of processes that a launcher started together with this one, by its environment variables; 1 without a
/// launcher.
///
/// Open MPI, MPICH and Intel MPI, MVAPICH, and the steps of Slurm set these.
fn launched() -> u32 {
    const SIZES: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MV2_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS"];
    let size = |name: &&str| std::env::var(name).ok()?.parse().ok();
    SIZES.iter().find_map(size).unwrap_or(1)
}

/// The processes of the launcher; `None` for one process.
///
/// # Errors
///
/// If a launcher started several, and this program cannot talk to them: each would render and write the whole image.
#[cfg(not(feature = "mpi"))]
pub(super) fn start() -> Result<Option<Box<dyn Exchange>>> {
    match launched() {
        0 | 1 => Ok(None),
        processes => Err(Failure::new(format!(
            "{processes} processes were started together, and this program has no MPI: each would render the whole image; \
             build it with --features mpi, or start one process (docs/CLUSTER.md)"
        ))),
    }
}

/// The processes of the launcher; `None` for one process.
///
/// # Errors
///
/// If MPI cannot be started, or if srun started several processes without it.
#[cfg(feature = "mpi")]
pub(super) fn start() -> Result<Option<Box<dyn Exchange>>> {
    let launched = launched();
    if launched <= 1 {
        return Ok(None);
    }
    let connected = ["OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "MV2_COMM_WORLD_RANK"];
    if !connected.iter().any(|name| std::env::var_os(name).is_some()) {
        return Err(Failure::new(format!("srun started {launched} processes without MPI; add --mpi=pmix to srun")));
    }
    let processes = dapple_mpi::Processes::start().map_err(|e| Failure::new(e.to_string()))?;
    let of = processes.share().of();
    if of != launched {
        return Err(Failure::new(format!(
            "{launched} processes were started together, and MPI connects {of}; start them by the mpirun of the MPI library \
             that this program was built with, or by srun --mpi=pmix"
        )));
    }
    Ok(Some(Box::new(processes)))
}

/// A job that this process is ready to run with the others.
struct Ready {
    job: Job,
    cpu: Option<f64>,
    expected: dapple_job::memory::MemoryEstimate,
    checkpoints: Option<Checkpoints>,
    progress: Progress,
}

/// Renders together with the other processes. The first one reports the errors of all, and its status is that of the job:
/// launchers end all processes when one fails, before the first has printed.
pub(super) fn run(args: &RenderArgs, spec: &RenderSpec, mut exchange: Box<dyn Exchange>) -> Result<Outcome> {
    let is_first = exchange.share().index() == 0;
    let outcome = run_one(args, spec, &mut *exchange, is_first);
    if is_first { outcome } else { Ok(Outcome::Done) }
}

fn run_one(args: &RenderArgs, spec: &RenderSpec, exchange: &mut dyn Exchange, is_first: bool) -> Result<Outcome> {
    let show = if is_first { Show::from(args) } else { Show { json: false, quiet: true, ..Show::from(args) } };
    let ready = ready(args, spec, &show, exchange.share());
    let mine = match &ready {
        Ok(Some(_)) => Ok(Vec::new()),
        Ok(None) => Err("it was stopped".to_owned()),
        Err(Failure(lines)) => Err(lines.join("; ")),
    };
    let agreed = agree(exchange, mine);
    let Some(ready) = ready? else { return Ok(Outcome::Interrupted) };
    agreed.map_err(|e| Failure::lines(&e))?;
    let Ready { mut job, cpu, expected, checkpoints, mut progress } = ready;
    if is_first && !args.quiet && !args.json {
        say("together", &format!("{} processes", exchange.share().of()));
    }
    progress.begin(&job);
    let traced = job.run_together(checkpoints, &mut progress, exchange).map_err(|e| failure::of_job(&e))?;
    if is_first {
        return show.deliver(&job, traced, (Some(&expected), cpu), progress, Some(exchange));
    }
    job.finish_together(traced.film, exchange).map_err(|e| failure::of_job(&e))?;
    Ok(Outcome::Done)
}

/// Reads the scene and prepares the job. The first process also tests outputs, opens checkpoints and shows progress.
fn ready(args: &RenderArgs, spec: &RenderSpec, show: &Show<'_>, share: Shard) -> Result<Option<Ready>> {
    let is_first = share.index() == 0;
    let stop = Stop::listen()?;
    start_threads(args.threads)?;
    let checkpoints = match is_first {
        true => args.checkpoints().open().map_err(|e| failure::of_job(&e))?,
        false => None,
    };
    let live = if is_first { Live::open(&args.live())? } else { Live::default() };
    let progress = Progress::new(show, stop, live);
    let limit = args.memory.map_or_else(MemoryLimit::of_machine, MemoryLimit::given);
    progress.phase("reading");
    let loaded = load(spec, &LoadOptions::default().with_limit(limit), limit)?;
    let files = show.files(&loaded)?;
    if is_first {
        roles::check(args, &loaded, &files, None)?;
        files.prepare().map_err(|e| failure::of_job(&e))?;
        warn_all(loaded.warnings());
    }
    let Some((mut job, cpu)) = prepare(loaded, files, &progress)? else { return Ok(None) };
    let shows = is_first && args.live().is_on();
    let expected = job.memory_together(share, checkpoints.is_some()).map_err(|e| failure::of_job(&e))?;
    let expected = if shows { expected.with_live_image(job.frame()) } else { expected };
    expected.check(limit).map_err(|e| failure::of_job(&e))?;
    Ok(Some(Ready { job, cpu, expected, checkpoints, progress }))
}
