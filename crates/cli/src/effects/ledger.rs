//! Measurement of each effect's cost and share of the image, by renders with and without the effect.

use crate::machine::cpu_seconds;
use crate::stop::Stop;
use crate::{Failure, Result, failure};
use dapple_core::{Control, Frame, Status};
use dapple_job::{BudgetSpec, CropSpec, JobError, JobMonitor, LoadedScene, PreparedScene, RenderSpec};
use dapple_metrics::{Difference, Measured, Pixels, difference};
use dapple_renderer::light::LightSelection;
use dapple_scene::{Effect, Effects, Scene};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::{Duration, Instant};

/// The settings of the renders that measure effects.
pub(super) struct Settings {
    pub(super) frame: Frame,
    pub(super) spp: u32,
    pub(super) seeds: u32,
    /// True hides the progress bar.
    pub(super) silent: bool,
}

/// The measurements of all effects that the scene uses.
pub(super) struct Ledger {
    pub(super) resolution: [u32; 2],
    pub(super) spp: u32,
    pub(super) seeds: u32,
    /// The measurements of effects, in the order of [`Effects::called`]; fewer if the user interrupted.
    pub(super) rows: Vec<Row>,
    /// The cost and the light of paths beyond the scene's depth limit, by comparison with unlimited depth. `None` if
    /// the scene sets no limit, or no path is long enough to be cut.
    pub(super) beyond_depth: Option<Shares>,
    /// The mean seconds of tracing an image with every effect: processor time of all threads if the system reports it,
    /// else wall time. `None` if no image was measured.
    pub(super) seconds: Option<f64>,
    pub(super) interrupted: bool,
}

/// The measurement of one effect, or the reason why the effect cannot be left out.
pub(super) struct Row {
    pub(super) effect: Effect,
    pub(super) measured: std::result::Result<Shares, String>,
}

/// The cost of an effect in tracing time, and its share of the image.
pub(super) struct Shares {
    /// The natural logarithm of the tracing time with the effect over the time without it.
    pub(super) log_time: Measured,
    pub(super) image: Difference,
}

/// A rendered image, and the seconds of tracing it.
struct Render {
    pixels: Vec<[f32; 3]>,
    seconds: f64,
}

impl Ledger {
    /// Measures every effect of the scene by leaving it out. Images with and without the effect alternate, and their
    /// order changes with the seed, so that a slower machine favours neither.
    pub(super) fn measure(whole: &Scene, effects: &Effects, settings: &Settings, stop: &Stop) -> Result<Self> {
        let endless = Scene { max_depth: None, ..whole.clone() };
        // Without interreflection, paths scatter at most once, and no depth limit cuts them.
        let cut = whole.max_depth.is_some() && Effects::of(&endless).has(Effect::Interreflection);
        let mut studio = Studio::new(settings, effects.called().len() + usize::from(cut), stop);
        let mut ledger = Self {
            resolution: settings.frame.size(),
            spp: settings.spp,
            seeds: settings.seeds,
            rows: Vec::new(),
            beyond_depth: None,
            seconds: None,
            interrupted: false,
        };
        let with = prepare(whole, settings).map_err(|e| failure::of_job(&e))?;
        let mut seconds = Vec::new();
        if cut || !effects.called().is_empty() {
            // The first image is slower because caches are cold, and is not timed.
            ledger.interrupted = studio.render(&with, 1)?.is_none();
        }
        for called in effects.called() {
            if ledger.interrupted {
                break;
            }
            studio.about(called.effect);
            let less = dapple_renderer::without(whole, called.effect).map_err(|e| e.to_string());
            let world = less.and_then(|s| prepare(&s, settings).map_err(first_line));
            let without = match world {
                Ok(world) => world,
                Err(why) => {
                    studio.skip();
                    ledger.rows.push(Row { effect: called.effect, measured: Err(why) });
                    continue;
                }
            };
            let Some(pairs) = studio.pairs(&with, &without)? else {
                ledger.interrupted = true;
                break;
            };
            seconds.extend(pairs.iter().map(|[a, _]| a.seconds));
            ledger.rows.push(Row { effect: called.effect, measured: Ok(Shares::of(settings, pairs)?) });
        }
        if cut && !ledger.interrupted {
            studio.bar.set_prefix("beyond the depth");
            let endless = prepare(&endless, settings).map_err(|e| failure::of_job(&e))?;
            match studio.pairs(&endless, &with)? {
                Some(pairs) => ledger.beyond_depth = Some(Shares::of(settings, pairs)?),
                None => ledger.interrupted = true,
            }
        }
        studio.bar.finish_and_clear();
        ledger.seconds = (!seconds.is_empty()).then(|| seconds.iter().sum::<f64>() / seconds.len() as f64);
        Ok(ledger)
    }
}

impl Shares {
    /// Computes the cost and share of an effect from pairs of renders with and without it.
    fn of(settings: &Settings, pairs: Vec<[Render; 2]>) -> Result<Self> {
        let logs: Vec<f64> = pairs.iter().map(|[a, b]| (a.seconds / b.seconds).ln()).collect();
        let (with, without): (Vec<_>, Vec<_>) = pairs.into_iter().map(|[a, b]| (a.pixels, b.pixels)).unzip();
        Ok(Self { log_time: mean(&logs), image: differ(settings.frame.size(), &with, &without)? })
    }
}

fn first_line(problems: impl ToString) -> String {
    problems.to_string().lines().next().unwrap_or_default().to_owned()
}

fn differ(size: [u32; 2], with: &[Vec<[f32; 3]>], without: &[Vec<[f32; 3]>]) -> Result<Difference> {
    let mut sides = [Vec::new(), Vec::new()];
    for (side, renders) in sides.iter_mut().zip([with, without]) {
        for values in renders {
            side.push(Pixels::new(size, values).map_err(Failure::new)?);
        }
    }
    difference(&sides[0], &sides[1]).map_err(Failure::new)
}

/// The mean of at least two `values`, with its standard error.
fn mean(values: &[f64]) -> Measured {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    Measured { value: mean, standard_error: (squares / (n - 1.0) / n).sqrt() }
}

/// The renderer of images for the measurements, with a progress bar.
struct Studio<'s> {
    settings: &'s Settings,
    stop: Stop,
    bar: ProgressBar,
    clock: Instant,
}

/// The number of steps of the progress bar per image.
const STEPS: u64 = 100;

impl<'s> Studio<'s> {
    fn new(settings: &'s Settings, effects: usize, stop: &Stop) -> Self {
        // The bar hides itself if stderr is not a terminal.
        let target = if settings.silent { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let images = 1 + 2 * u64::from(settings.seeds) * effects as u64;
        let bar = ProgressBar::with_draw_target(Some(STEPS * images), target);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {prefix}{msg}") {
            bar.set_style(style);
        }
        Self { settings, stop: stop.clone(), bar, clock: Instant::now() }
    }

    fn about(&self, effect: Effect) {
        self.bar.set_prefix(format!("without {effect}"));
    }

    /// Advances the progress bar past an effect that is not rendered.
    fn skip(&self) {
        self.bar.inc(STEPS * 2 * u64::from(self.settings.seeds));
    }

    /// Renders, for each seed, one image of each of two worlds: with and without an effect. `None` if the user stopped
    /// it.
    fn pairs(&mut self, with: &PreparedScene, without: &PreparedScene) -> Result<Option<Vec<[Render; 2]>>> {
        let mut pairs = Vec::new();
        for seed in 1..=u64::from(self.settings.seeds) {
            let turned = seed % 2 == 0;
            let worlds = if turned { [without, with] } else { [with, without] };
            let Some(first) = self.render(worlds[0], seed)? else { return Ok(None) };
            let Some(second) = self.render(worlds[1], seed)? else { return Ok(None) };
            pairs.push(if turned { [second, first] } else { [first, second] });
        }
        Ok(Some(pairs))
    }

    fn render(&mut self, prepared: &PreparedScene, seed: u64) -> Result<Option<Render>> {
        let mut job = prepared.job(&spec(self.settings).seed(seed)).map_err(|e| failure::of_job(&e))?;
        let start = self.bar.position();
        let before = cpu_seconds();
        let film = job.run(None, self).map_err(|e| failure::of_job(&e))?.film;
        let cpu = cpu_seconds().zip(before).map(|(after, before)| after - before);
        self.bar.set_position(start + STEPS);
        if film.record().interrupted {
            return Ok(None);
        }
        let seconds = cpu.unwrap_or_else(|| film.record().trace_seconds()).max(1e-9);
        Ok(Some(Render { pixels: film.image(), seconds }))
    }
}

/// The description of a render with or without an effect: uniform sampling, unfiltered.
fn spec(settings: &Settings) -> RenderSpec {
    let [w, h] = settings.frame.resolution();
    RenderSpec::new("effects")
        .sampler("uniform")
        .points("sobol")
        .filter("none")
        .light_selection(LightSelection::Power)
        .budget(BudgetSpec::Spp(f64::from(settings.spp)))
        .resolution(w, h)
        .crop(CropSpec::Whole)
}

fn prepare(scene: &Scene, settings: &Settings) -> std::result::Result<PreparedScene, JobError> {
    LoadedScene::from_scene(&spec(settings), scene.clone())?.build()
}

impl JobMonitor for Studio<'_> {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        if self.stop.asked() {
            return Control::Stop;
        }
        if !self.bar.is_hidden() {
            let (done, all) = (self.bar.position(), self.bar.length().unwrap_or(1));
            let image = done / STEPS * STEPS;
            let share = status.samples as f64 / status.expected.max(1) as f64;
            let now = image + ((share * STEPS as f64) as u64).min(STEPS - 1);
            self.bar.set_position(now);
            if now > 0 {
                let left = self.clock.elapsed().as_secs_f64() * (all - now) as f64 / now as f64;
                let left = Duration::try_from_secs_f64(left).unwrap_or(Duration::MAX);
                self.bar.set_message(format!(", {} left", HumanDuration(left)));
            }
        }
        Control::Continue
    }
}
