//! The subcommand `dapple merge`.

use crate::render::{self, Show};
use crate::{Outcome, Result, failure};
use dapple_job::ShardSet;
use std::path::PathBuf;

/// Make an image from shards that several machines rendered
///
/// The image has the same bits as a render on one machine with the same arguments and --light-selection power. The
/// scene is read again, from the path in the shards or from --scene. It must be the scene that was rendered.
#[derive(clap::Args)]
#[command(after_help = AFTER)]
pub(crate) struct MergeArgs {
    /// The files of all shards, in any order
    #[arg(value_name = "SHARD", required = true)]
    shards: Vec<PathBuf>,

    /// Image file to write: .exr, .pfm or .png; may be repeated [default: as for dapple render]
    #[arg(short, long = "output", visible_alias = "outfile", value_name = "OUT", value_parser = render::values::output)]
    outputs: Vec<PathBuf>,

    /// Path of the scene, if it has moved
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,

    /// Exposure of PNG images in stops; each stop doubles the brightness
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,

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
  dapple render scene.pbrt --sampler uniform --spp 256 --shard 1/2 -o 1.shard
  dapple render scene.pbrt --sampler uniform --spp 256 --shard 2/2 -o 2.shard
  dapple merge 1.shard 2.shard -o scene.exr";

pub(crate) fn run(args: &MergeArgs) -> Result<Outcome> {
    let shards = ShardSet::read(&args.shards).map_err(|e| failure::of_job(&e))?;
    let mut spec = shards.spec().clone();
    if let Some(scene) = &args.scene {
        spec.scene = scene.to_string_lossy().into_owned();
    }
    let show = Show {
        outputs: &args.outputs,
        maps: None,
        features: false,
        half: false,
        layers: None,
        exposure: args.exposure,
        json: args.json,
        quiet: args.quiet,
        progress_every: None,
    };
    render::merge(shards, &spec, &show, args.threads)
}
