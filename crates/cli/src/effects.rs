//! The subcommand `dapple effects SCENE`.

mod measure;
mod report;

use crate::machine::start_threads;
use crate::output::{say, tell, warn};
use crate::render::values::resolution;
use crate::stop::Stop;
use crate::{Failure, Outcome, Result, failure};
use dapple_core::Frame;
use dapple_job::{LoadOptions, LoadedScene, RenderSpec, Warning};
use dapple_scene::{Effects, Scene, bundled};
use measure::Studio;
use report::Report;
use std::path::PathBuf;

/// The longest side in pixels of images if the user sets no resolution. The results hardly depend on the resolution,
/// but the waiting time does.
const LONGEST: u32 = 192;

/// List the effects (kinds of light transport) that a scene uses, the objects that cause them, their cost in time and
/// their share of the image
///
/// Each effect is left out in turn: the image is rendered alternately with and without it, with --seeds seeds. The cost
/// is a share of the tracing time, at equal samples per pixel. The share of the image is given in two ways: the mean radiance
/// that is lost without the effect, and the relMSE of the image without it, from which noise is subtracted. The light of paths beyond the scene's
/// depth limit is measured, too. Each value has the half width of its 95 % interval.
#[derive(clap::Args)]
#[command(after_help = AFTER)]
pub(crate) struct EffectsArgs {
    /// A scene file, a model (.gltf, .glb, .obj, .ply, .stl), or a bundled scene: teapot, terrain, cornell, furnace, plates, lens, motion, glass, room, grass, door, tea, cabin, many-lights, caustic, chess, zone-plate, penumbra
    #[arg(value_name = "SCENE", default_value = bundled::DEFAULT)]
    scene: PathBuf,

    /// List the effects and the objects that cause them, without rendering
    #[arg(long)]
    list: bool,

    /// Width and height in pixels [default: the scene's aspect ratio, the longer side at most 192]
    #[arg(long, value_name = "WxH", value_parser = resolution, conflicts_with = "list")]
    resolution: Option<[u32; 2]>,

    /// Samples per pixel of each image
    #[arg(long, value_name = "N", default_value_t = 16, conflicts_with = "list")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..))]
    spp: u32,

    /// Number of seeds; each effect is rendered once with and once without it per seed
    #[arg(long, value_name = "N", default_value_t = 4, conflicts_with = "list")]
    #[arg(value_parser = clap::value_parser!(u32).range(4..=64))]
    seeds: u32,

    /// Number of threads; 0 is one per core
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,

    /// Print warnings about unsupported features of the scene instead of refusing it
    #[arg(long)]
    allow_unsupported: bool,

    /// Print one line of JSON instead of the table; show no progress
    #[arg(long)]
    json: bool,
}

const AFTER: &str = "\
Examples:
  dapple effects scene.pbrt --list
  dapple effects cornell
  dapple effects scene.pbrt --resolution 320x180 --spp 64 --seeds 8 --json

`dapple render --without EFFECT` renders the image without it.";

pub(crate) fn run(options: &EffectsArgs) -> Result<Outcome> {
    let stop = Stop::listen()?;
    start_threads(options.threads)?;
    let spec = RenderSpec::new(options.scene.to_string_lossy()).allow_unsupported(options.allow_unsupported);
    let loaded = LoadedScene::read(&spec, &LoadOptions::default().without_digest());
    let loaded = loaded.map_err(|e| failure::of_job(&e))?;
    for warning in loaded.warnings().iter().filter(|warning| matches!(warning, Warning::Notice(_))) {
        warn(failure::warning(warning));
    }
    let scene = loaded.scene();
    let effects = Effects::of(scene);
    let by_chance = Effects::found_by_chance(scene);
    let mut report = Report::new(scene, &effects, by_chance.as_ref());
    if !options.list {
        measure(options, scene.clone(), &mut report, &stop)?;
    }
    if report.interrupted {
        say("interrupted", "an effect whose images were not all rendered has no figures");
    }
    tell(if options.json { report.json() } else { report.table() })?;
    if report.interrupted { Ok(Outcome::Interrupted) } else { Ok(Outcome::Done) }
}

fn measure(options: &EffectsArgs, mut scene: Scene, report: &mut Report<'_>, stop: &Stop) -> Result<()> {
    let [width, height] = options.resolution.unwrap_or_else(|| shrink(scene.film.resolution));
    let frame = Frame::new(width, height).map_err(Failure::new)?;
    // A crop window in the file is in pixels of its own resolution; effects are measured on the whole image.
    if scene.film.crop.take().is_some() {
        warn("the scene's crop window is not followed: the figures are of the whole image");
    }
    (report.resolution, report.spp, report.seeds) = (Some(frame.size()), Some(options.spp), Some(options.seeds));
    Studio::new(frame, options, stop).measure(&scene, report)
}

/// Shrinks a size in pixels to the same aspect ratio with sides of at most [`LONGEST`].
fn shrink(size: [u32; 2]) -> [u32; 2] {
    let longest = size[0].max(size[1]).max(1);
    let shrunk = |side: u32| (u64::from(side) * u64::from(LONGEST)).div_ceil(u64::from(longest)).max(1) as u32;
    if longest <= LONGEST { size } else { size.map(shrunk) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_keep_their_shape() {
        assert_eq!(shrink([1280, 720]), [192, 108]);
        assert_eq!(shrink([100, 50]), [100, 50]);
        assert_eq!(shrink([1, 4_000_000_000]), [1, 192]);
    }
}
