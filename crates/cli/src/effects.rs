//! The subcommand `dapple effects SCENE`.

mod report;

use crate::machine::{Stop, cpu_seconds, start_threads};
use crate::output::{say, tell, warn};
use crate::render::values::resolution;
use crate::{Failure, Outcome, Result, failure};
use dapple_core::Frame;
use dapple_core::render::{Control, Status};
use dapple_job::{
    BudgetSpec, CropSpec, JobError, JobMonitor, LoadOptions, LoadedScene, PreparedScene, RenderSpec, Warning,
};
use dapple_metrics::{MeasuredValue, Pixels, difference};
use dapple_renderer::light::LightSelection;
use dapple_scene::{Effect, Effects, Scene, bundled};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use report::{Figures, Report};
use std::path::PathBuf;

/// Length in pixels of the longer side of images if the user sets no resolution. The results hardly depend on the resolution,
/// but the waiting time does.
const LONGEST: u32 = 192;

/// List the effects (kinds of light transport) that a scene uses, the objects that cause them, their cost in time and
/// their share of the image
///
/// Each effect is left out in turn: the image is rendered alternately with and without it, with --seeds seeds. The cost
/// is a share of the tracing time, at equal samples per pixel. The share of the image is given in two ways: the mean
/// radiance that is lost without the effect, and the relMSE of the image without it, corrected for noise. The light of
/// paths beyond the scene's depth limit is measured, too. Values have ± 95 % confidence intervals.
#[derive(clap::Args)]
#[command(after_help = include_str!("help/effects.txt").trim_end())]
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

    /// Number of seeds; per seed, the image is rendered once with and once without each effect
    #[arg(long, value_name = "N", default_value_t = 4, conflicts_with = "list")]
    #[arg(value_parser = clap::value_parser!(u32).range(4..=64))]
    seeds: u32,

    /// Number of threads; 0 is one per core
    #[arg(short = 't', long, visible_alias = "nthreads", value_name = "N", default_value_t = 0)]
    #[arg(value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,

    /// Ignore unsupported scene features with a warning instead of stopping
    #[arg(long)]
    allow_unsupported: bool,

    /// Print one line of JSON instead of the table; show no progress
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(options: &EffectsArgs) -> Result<Outcome> {
    let stop = Stop::listen()?;
    start_threads(options.threads)?;
    let spec = RenderSpec { allow_unsupported: options.allow_unsupported, ..RenderSpec::new(&options.scene) };
    let loaded = LoadedScene::read(&spec, &LoadOptions { digest: false, ..LoadOptions::default() });
    let loaded = loaded?;
    for warning in loaded.warnings.iter().filter(|warning| matches!(warning, Warning::Notice(_))) {
        warn(failure::warning(warning));
    }
    let scene = &loaded.scene;
    let effects = Effects::of(scene);
    let by_chance = Effects::found_by_chance(scene);
    let mut report = Report::new(scene, &effects, by_chance.as_ref());
    if !options.list {
        measure(options, Scene::clone(scene), &mut report, &stop)?;
    }
    if report.interrupted {
        say("interrupted", "effects whose images are incomplete have no results");
    }
    tell(if options.json { report.json() } else { report.table() })?;
    if report.interrupted { Ok(Outcome::Interrupted) } else { Ok(Outcome::Done) }
}

fn measure(options: &EffectsArgs, mut scene: Scene, report: &mut Report<'_>, stop: &Stop) -> Result<()> {
    let [width, height] = options.resolution.unwrap_or_else(|| shrink(scene.film.resolution));
    let frame = Frame::new(width, height).map_err(Failure::new)?;
    // A crop window in the file is in pixels of its own resolution; effects are measured on the whole image.
    if scene.film.crop.take().is_some() {
        warn("the scene's crop window is ignored: effects are measured on the whole image");
    }
    (report.resolution, report.spp, report.seeds) = (Some(frame.size()), Some(options.spp), Some(options.seeds));
    let mut studio = Studio::new(frame, options, stop);
    report.interrupted = studio.measure(&scene, report)?.is_none();
    studio.bar.finish_and_clear();
    Ok(())
}

/// Shrinks a size in pixels to the same aspect ratio with sides of at most [`LONGEST`].
fn shrink(size: [u32; 2]) -> [u32; 2] {
    let longest = size[0].max(size[1]).max(1);
    let shrunk = |side: u32| (u64::from(side) * u64::from(LONGEST)).div_ceil(u64::from(longest)).max(1) as u32;
    if longest <= LONGEST { size } else { size.map(shrunk) }
}

/// A rendered image, and its tracing time in seconds.
struct Render {
    pixels: Vec<[f32; 3]>,
    seconds: f64,
}

/// The number of steps of the progress bar per image.
const STEPS: u64 = 100;

/// The renderer of images for the measurements, with a progress bar.
struct Studio {
    size: [u32; 2],
    seeds: u64,
    /// The description of each render: uniform sampling, unfiltered.
    spec: RenderSpec,
    stop: Stop,
    bar: ProgressBar,
}

impl Studio {
    fn new(frame: Frame, options: &EffectsArgs, stop: &Stop) -> Self {
        let [width, height] = frame.resolution();
        let spec = RenderSpec {
            light_selection: Some(LightSelection::Power),
            budget: BudgetSpec::Spp(f64::from(options.spp)),
            crop: CropSpec::Whole,
            ..RenderSpec::new("effects").sampler("uniform").points("sobol").filter("none").resolution(width, height)
        };
        // The bar hides itself if stderr is not a terminal.
        let target = if options.json { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(STEPS), target);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {prefix}, {eta} left") {
            bar.set_style(style);
        }
        Self { size: frame.size(), seeds: u64::from(options.seeds), spec, stop: stop.clone(), bar }
    }

    /// Measures every effect by leaving it out, and stores the results in the report. Images with and without the effect
    /// alternate. Their order changes with the seed, so that a slower machine favours neither. `None` if the user stopped the
    /// measurement.
    fn measure(&mut self, whole: &Scene, report: &mut Report<'_>) -> Result<Option<()>> {
        let endless = Scene { max_depth: None, ..whole.clone() };
        // Without interreflection, paths scatter at most once, and no depth limit cuts them.
        let cut = whole.max_depth.is_some() && Effects::of(&endless).has(Effect::Interreflection);
        let with = self.prepare(whole)?;
        let pairs = report.effects.len() + usize::from(cut);
        if pairs == 0 {
            return Ok(Some(()));
        }
        self.bar.set_length(STEPS * (1 + 2 * self.seeds * pairs as u64));
        // The first image is slower because caches are cold, and is not timed.
        let Some(_) = self.render(&with, 1)? else { return Ok(None) };
        let mut seconds = Vec::new();
        for row in &mut report.effects {
            let effect = row.called.effect;
            self.bar.set_prefix(format!("without {effect}"));
            let less = dapple_renderer::without(whole, effect).map_err(|e| e.to_string());
            let without = match less.and_then(|scene| self.prepare(&scene).map_err(first_line)) {
                Ok(without) => without,
                Err(why) => {
                    self.bar.inc(STEPS * 2 * self.seeds);
                    row.kept = Some(why);
                    continue;
                }
            };
            let Some(pairs) = self.pairs(&with, &without)? else { return Ok(None) };
            seconds.extend(pairs.iter().map(|[a, _]| a.seconds));
            row.figures = self.figures(pairs)?;
            report.seconds = Some(seconds.iter().sum::<f64>() / seconds.len() as f64);
        }
        if cut {
            self.bar.set_prefix("beyond the depth limit");
            let endless = self.prepare(&endless)?;
            let Some(pairs) = self.pairs(&endless, &with)? else { return Ok(None) };
            report.beyond_depth = Some(self.figures(pairs)?);
        }
        Ok(Some(()))
    }

    fn prepare(&self, scene: &Scene) -> std::result::Result<PreparedScene, JobError> {
        LoadedScene::from_scene(&self.spec, scene.clone())?.build()
    }

    /// Renders two images for each seed: one with an effect and one without it. `None` if the user stopped the rendering.
    fn pairs(&mut self, with: &PreparedScene, without: &PreparedScene) -> Result<Option<Vec<[Render; 2]>>> {
        let mut pairs = Vec::new();
        for seed in 1..=self.seeds {
            let turned = seed % 2 == 0;
            let [first, second] = if turned { [without, with] } else { [with, without] };
            let Some(first) = self.render(first, seed)? else { return Ok(None) };
            let Some(second) = self.render(second, seed)? else { return Ok(None) };
            pairs.push(if turned { [second, first] } else { [first, second] });
        }
        Ok(Some(pairs))
    }

    fn render(&mut self, prepared: &PreparedScene, seed: u64) -> Result<Option<Render>> {
        let mut job = prepared.job(&self.spec.clone().seed(seed))?;
        let start = self.bar.position();
        let before = cpu_seconds();
        let film = job.run(None, self)?.film;
        let cpu = cpu_seconds().zip(before).map(|(after, before)| after - before);
        self.bar.set_position(start + STEPS);
        if film.record().interrupted {
            return Ok(None);
        }
        let seconds = cpu.unwrap_or_else(|| film.record().trace_seconds()).max(1e-9);
        Ok(Some(Render { pixels: film.image(), seconds }))
    }

    /// Computes the cost of an effect and its fraction of the image from pairs of renders with and without it.
    fn figures(&self, pairs: Vec<[Render; 2]>) -> Result<Figures> {
        let logs: Vec<f64> = pairs.iter().map(|[a, b]| (a.seconds / b.seconds).ln()).collect();
        let side = |i: usize| {
            let pixels = pairs.iter().map(|pair| Pixels::new(self.size, &pair[i].pixels));
            pixels.collect::<std::result::Result<Vec<_>, _>>().map_err(Failure::new)
        };
        let image = difference(&side(0)?, &side(1)?).map_err(Failure::new)?;
        Ok(Figures::new(mean(&logs), image, self.seeds as u32))
    }
}

fn first_line(problems: impl ToString) -> String {
    problems.to_string().lines().next().unwrap_or_default().to_owned()
}

/// The mean of at least two `values`, with its standard error.
fn mean(values: &[f64]) -> MeasuredValue {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    MeasuredValue { value: mean, standard_error: (squares / (n - 1.0) / n).sqrt() }
}

impl JobMonitor for Studio {
    fn progress(&mut self, status: &Status<'_>) -> Control {
        if self.stop.asked() {
            return Control::Stop;
        }
        let image = self.bar.position() / STEPS * STEPS;
        let share = status.samples as f64 / status.expected.max(1) as f64;
        self.bar.set_position(image + ((share * STEPS as f64) as u64).min(STEPS - 1));
        Control::Continue
    }
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
