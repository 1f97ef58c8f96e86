//! The subcommand `dapple merge`.

use crate::render::{self, Show, values};
use crate::{Failure, Outcome, Result, failure};
use dapple_job::memory::{MemoryLimit, size};
use dapple_job::{Job, JobError, PlanFile, RenderSpec, RowsFiles, Traced};
use std::path::PathBuf;

/// The function that takes over the film of shards or of a plan.
type Film = Box<dyn FnOnce(&mut Job) -> std::result::Result<Traced, JobError>>;

/// Make an image from shards that several machines rendered, or from the last plan of a render in stages
///
/// The image has the same bits as a render on one machine with the same arguments and --light-selection power. The
/// scene is read again, from the path in the shards or from --scene. It must be the scene that was rendered.
#[derive(clap::Args)]
#[command(after_help = AFTER)]
pub(crate) struct MergeArgs {
    /// The files of all shards, in any order; or one .plan file, when `dapple plan` has reported that it is done
    #[arg(value_name = "SHARD", required = true)]
    shards: Vec<PathBuf>,

    /// Image file to write: .exr, .pfm or .png; may be repeated [default: as for dapple render]
    #[arg(short, long = "output", visible_alias = "outfile", value_name = "OUT", value_parser = values::output)]
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
    /// seconds of the merging
    #[arg(long)]
    json: bool,

    /// Show no summary; warnings are still printed, and the line of --json
    #[arg(short, long)]
    quiet: bool,
}

const AFTER: &str = "\
Example (docs/SHARDS.md has one for job arrays):
  dapple render scene.pbrt --sampler uniform --spp 256 --shard 1/2 -o 1.part
  dapple render scene.pbrt --sampler uniform --spp 256 --shard 2/2 -o 2.part
  dapple merge 1.part 2.part -o scene.exr";

pub(crate) fn run(args: &MergeArgs) -> Result<Outcome> {
    let limit = args.memory.map_or_else(MemoryLimit::of_machine, MemoryLimit::given);
    check_fits(&args.shards, limit)?;
    let plan = args.shards.iter().find(|path| values::has_extension(path, "plan"));
    let (film, mut spec): (Film, RenderSpec) = match (plan, args.shards.len()) {
        (Some(path), 1) => {
            let plan = PlanFile::read(path).map_err(|e| failure::of_job(&e))?;
            let spec = plan.spec().clone();
            (Box::new(move |job| job.finish_plan(&plan)), spec)
        }
        (Some(_), _) => return Err(Failure::usage("merge", "a .plan is the whole image; give it alone")),
        (None, _) => {
            let shards = RowsFiles::read(&args.shards).map_err(|e| failure::of_job(&e))?;
            let spec = shards.spec().clone();
            (Box::new(move |job| job.merge(&shards)), spec)
        }
    };
    if let Some(scene) = &args.scene {
        spec.scene = scene.to_string_lossy().into_owned();
    }
    let MergeArgs { exposure, json, quiet, .. } = *args;
    let show = Show { outputs: &args.outputs, exposure, json, quiet, ..Show::default() };
    render::merge(film, &spec, &show, (args.threads, limit))
}

/// Checks before reading that the films of all shards fit into memory: all parts, the whole, and the file being read. A
/// file that cannot be looked at counts as empty; reading it reports the error.
fn check_fits(shards: &[PathBuf], limit: MemoryLimit) -> Result<()> {
    let lengths: Vec<u64> = shards.iter().map(|path| std::fs::metadata(path).map_or(0, |found| found.len())).collect();
    let sum = lengths.iter().fold(0_u64, |sum, length| sum.saturating_add(*length));
    let needed = sum.saturating_mul(2).saturating_add(lengths.iter().copied().max().unwrap_or(0));
    match limit.bytes().filter(|limit| needed > *limit) {
        None => Ok(()),
        Some(limit) => {
            let (needed, limit) = (size(needed), size(limit));
            Err(Failure::new(format!("merging these shards takes {needed}, and {limit} is the limit; raise --memory")))
        }
    }
}
