//! The subcommand `dapple plan`.

use crate::render::many::{self, PlanOptions};
use crate::render::{described_in, values};
use crate::{Failure, Outcome, Result};
use std::path::PathBuf;

/// Plan the next stage of a render on many machines, from the parts of the stage before
///
/// Samplers and light selection that learn from samples need those of the whole image between two stages. A stage is a
/// training pass of the light selection, or the rest of a round of the sampler. `dapple render --from PLAN --shard I/N`
/// traces the parts of a stage, in any order and on any machines. After the last stage this command reports "done", and
/// `dapple merge PLAN` makes the image, with the bits of a render on one machine.
#[derive(clap::Args)]
#[command(after_help = AFTER)]
pub(crate) struct PlanArgs {
    /// The files of all parts of a stage, in any order
    #[arg(value_name = "PART", required_unless_present = "spec")]
    parts: Vec<PathBuf>,

    /// The plan to write, a .plan file
    #[arg(short, long, value_name = "PLAN")]
    output: PathBuf,

    /// The plan that the parts were traced from [default: the one that the first part names]
    #[arg(long, value_name = "PLAN", requires = "parts")]
    from: Option<PathBuf>,

    /// Plan the first stage of the render that this JSON file describes; without parts
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

const AFTER: &str = "\
Example with two parts; docs/SHARDS.md has more:
  dapple render scene.pbrt --spp 64 -o 0.plan          the first plan
  dapple render --from 0.plan --shard 1/2 -o 1.part
  dapple render --from 0.plan --shard 2/2 -o 2.part
  dapple plan 1.part 2.part -o 1.plan                  and so on, until it is done: then
  dapple merge 8.plan -o scene.exr";

pub(crate) fn run(args: &PlanArgs) -> Result<Outcome> {
    if !values::has_extension(&args.output, "plan") {
        return Err(Failure::usage("plan", "--output: a file name that ends in .plan is required"));
    }
    let PlanArgs { threads, memory, quiet, .. } = *args;
    let options = PlanOptions { threads, memory, quiet, progress_every: None };
    match &args.spec {
        Some(spec) => many::first_plan(&described_in(spec)?, &args.output, &options),
        None => many::next_plan(&args.parts, args.from.as_deref(), &args.output, &options),
    }
}
