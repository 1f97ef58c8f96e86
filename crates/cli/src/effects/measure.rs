//! Measurement of each effect's cost and share of the image, by renders with and without the effect.

use super::EffectsArgs;
use super::report::{Figures, Report};
use crate::machine::cpu_seconds;
use crate::stop::Stop;
use crate::{Failure, Result, failure};
use dapple_core::{Control, Frame, Status};
use dapple_job::{BudgetSpec, CropSpec, JobError, JobMonitor, LoadedScene, PreparedScene, RenderSpec};
use dapple_metrics::{Measured, Pixels, difference};
use dapple_renderer::light::LightSelection;
use dapple_scene::{Effect, Effects, Scene};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A rendered image, and the seconds of tracing it.
struct Render {
    pixels: Vec<[f32; 3]>,
    seconds: f64,
}

/// The number of steps of the progress bar per image.
const STEPS: u64 = 100;

/// The renderer of images for the measurements, with a progress bar.
pub(super) struct Studio {
    size: [u32; 2],
    seeds: u64,
    /// The description of each render: uniform sampling, unfiltered.
    spec: RenderSpec,
    stop: Stop,
    bar: ProgressBar,
}

impl Studio {
    pub(super) fn new(frame: Frame, options: &EffectsArgs, stop: &Stop) -> Self {
        let [width, height] = frame.resolution();
        let spec = RenderSpec::new("effects")
            .sampler("uniform")
            .points("sobol")
            .filter("none")
            .light_selection(LightSelection::Power)
            .budget(BudgetSpec::Spp(f64::from(options.spp)))
            .resolution(width, height)
            .crop(CropSpec::Whole);
        // The bar hides itself if stderr is not a terminal.
        let target = if options.json { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(STEPS), target);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {prefix}, {eta} left") {
            bar.set_style(style);
        }
        Self { size: frame.size(), seeds: u64::from(options.seeds), spec, stop: stop.clone(), bar }
    }

    /// Measures every effect of the report by leaving it out. Images with and without the effect alternate, and their
    /// order changes with the seed, so that a slower machine favours neither.
    pub(super) fn measure(mut self, whole: &Scene, report: &mut Report<'_>) -> Result<()> {
        report.interrupted = self.measure_all(whole, report)?.is_none();
        self.bar.finish_and_clear();
        Ok(())
    }

    /// Fills in the report's figures; `None` if the user stopped it.
    fn measure_all(&mut self, whole: &Scene, report: &mut Report<'_>) -> Result<Option<()>> {
        let endless = Scene { max_depth: None, ..whole.clone() };
        // Without interreflection, paths scatter at most once, and no depth limit cuts them.
        let cut = whole.max_depth.is_some() && Effects::of(&endless).has(Effect::Interreflection);
        let with = self.prepare(whole).map_err(|e| failure::of_job(&e))?;
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
            self.bar.set_prefix("beyond the depth");
            let endless = self.prepare(&endless).map_err(|e| failure::of_job(&e))?;
            let Some(pairs) = self.pairs(&endless, &with)? else { return Ok(None) };
            report.beyond_depth = Some(self.figures(pairs)?);
        }
        Ok(Some(()))
    }

    fn prepare(&self, scene: &Scene) -> std::result::Result<PreparedScene, JobError> {
        LoadedScene::from_scene(&self.spec, scene.clone())?.build()
    }

    /// Renders, for each seed, one image of each of two worlds: with and without an effect. `None` if the user stopped
    /// it.
    fn pairs(&mut self, with: &PreparedScene, without: &PreparedScene) -> Result<Option<Vec<[Render; 2]>>> {
        let mut pairs = Vec::new();
        for seed in 1..=self.seeds {
            let turned = seed % 2 == 0;
            let worlds = if turned { [without, with] } else { [with, without] };
            let Some(first) = self.render(worlds[0], seed)? else { return Ok(None) };
            let Some(second) = self.render(worlds[1], seed)? else { return Ok(None) };
            pairs.push(if turned { [second, first] } else { [first, second] });
        }
        Ok(Some(pairs))
    }

    fn render(&mut self, prepared: &PreparedScene, seed: u64) -> Result<Option<Render>> {
        let mut job = prepared.job(&self.spec.clone().seed(seed)).map_err(|e| failure::of_job(&e))?;
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

    /// Computes the cost and share of an effect from pairs of renders with and without it.
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
fn mean(values: &[f64]) -> Measured {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    Measured { value: mean, standard_error: (squares / (n - 1.0) / n).sqrt() }
}

impl JobMonitor for Studio {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        if self.stop.asked() {
            return Control::Stop;
        }
        let image = self.bar.position() / STEPS * STEPS;
        let share = status.samples as f64 / status.expected.max(1) as f64;
        self.bar.set_position(image + ((share * STEPS as f64) as u64).min(STEPS - 1));
        Control::Continue
    }
}
