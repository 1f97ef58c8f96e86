//! What is rendered, and how: the options with what the scene says.

use super::Options;
use super::options::PixelShape;
use crate::{Failure, Result};
use dapple_core::{Budget, Error, Filter, Frame, Limits, Memory, Needs, PointSet, Sampler, Shard, Sharded};
use dapple_job::Stage;
use dapple_job::registry::{self, Setting};
use dapple_scene::{Effect, Effects};
use dapple_scene::{PixelFilter, Scene};

/// Mean samples per pixel at which `--error` gives up where no `--max-spp` is given.
const ERROR_SPP: u32 = 16384;

/// Everything that decides on the image besides the scene.
pub(super) struct Settings {
    pub(super) frame: Frame,
    pub(super) limits: Limits,
    pub(super) points_described: String,
    pub(super) adaptive: bool,
    pub(super) seed: u64,
    /// The budget as it was asked for.
    pub(super) asked: String,
    /// Effects to leave out: each once, called for by the scene, in the order in which they go.
    pub(super) without: Vec<Effect>,
    sampler: String,
    points: String,
    filter: String,
    setting: Setting,
}

/// What the words for sampler and filter make of the world on a stage.
pub(super) struct Methods {
    pub(super) sampler: Box<dyn Sampler>,
    pub(super) sampler_described: String,
    pub(super) filter: Box<dyn Filter>,
}

impl Settings {
    /// Takes resolution and crop from the scene where the options do not say, and makes the scene's depth and
    /// pixel filter what the options say.
    pub(super) fn new(options: &Options, scene: &mut Scene) -> Result<Self> {
        if let Some(depth) = options.max_depth {
            scene.max_depth = Some(depth);
        }
        if options.pixel_filter == PixelShape::Box {
            scene.film.pixel_filter = PixelFilter::default();
        }
        let without = without(&options.without, scene)?;
        let frame = frame(options, scene)?;
        let (budget, asked) = budget(options, frame.pixels() as u64);
        let mut limits = Limits::new(budget);
        limits.min_spp = options.min_spp;
        limits.max_spp = options.max_spp.unwrap_or(u32::MAX);
        let setting = Setting { seed: options.seed, spp: options.mean_spp().map(|spp| spp.ceil() as u64) };
        let points = registry::points(&options.points, setting).map_err(Failure::new)?;
        check_capacity(&points, setting)?;
        Ok(Self {
            frame,
            limits,
            points_described: points.describe(),
            adaptive: options.sampler.split(':').next().is_none_or(|name| name.trim() != "uniform"),
            seed: options.seed,
            asked,
            without,
            sampler: options.sampler.clone(),
            points: options.points.clone(),
            filter: options.filter.clone(),
            setting,
        })
    }

    /// Sampler and filter for the world on `stage`; clusters are made here. A time limit counts them.
    pub(super) fn methods(&mut self, stage: &Stage) -> Result<Methods> {
        let points = registry::points(&self.points, self.setting).map_err(Failure::new)?;
        let sampler = registry::sampler(&self.sampler, points, stage).map_err(Failure::new)?;
        let filter = registry::filter(&self.filter, stage).map_err(Failure::new)?;
        if let Budget::Seconds(seconds) = &mut self.limits.budget {
            // Never to nothing: a limit below what clusters took leaves the smallest image.
            *seconds = (*seconds - stage.cluster_seconds()).max(1e-3);
        }
        Ok(Methods { sampler_described: sampler.describe(), sampler, filter })
    }
}

impl Methods {
    /// What a render by these methods takes, all of it or a share.
    pub(super) fn memory(&mut self, settings: &Settings, needs: Needs, shard: Option<Shard>) -> Result<Memory> {
        let (frame, limits) = (&settings.frame, &settings.limits);
        let Some(shard) = shard else {
            return Ok(Memory::of_render(&*self.sampler, &*self.filter, needs, frame, limits));
        };
        let sharded = Sharded::new(&mut *self.sampler, shard, limits).map_err(|e| no_shard(shard, &e))?;
        Ok(Memory::of_render(&sharded, &*self.filter, needs, frame, limits))
    }
}

/// Why there is no such share.
pub(super) fn no_shard(shard: Shard, why: &Error) -> Failure {
    Failure::new(format!("--shard {shard}: {why} (uniform, cluster-thesis)"))
}

/// Effects that the scene calls for, of those that are to be left out.
fn without(asked: &[Effect], scene: &Scene) -> Result<Vec<Effect>> {
    let effects = Effects::of(scene);
    let mut without = asked.to_vec();
    // The choice among the lights comes last: the strongest of those that are left stays.
    without.sort_by_key(|&e| (e == Effect::SeveralLights, e));
    without.dedup();
    match without.iter().find(|e| !effects.has(**e)) {
        None => Ok(without),
        Some(effect) => {
            let called: Vec<&str> = effects.called().iter().map(|c| c.effect.name()).collect();
            let called = if called.is_empty() { "nothing".into() } else { called.join(", ") };
            Err(Failure::new(format!("--without {effect}: the scene does not call for it; it calls for {called}")))
        }
    }
}

fn frame(options: &Options, scene: &Scene) -> Result<Frame> {
    let full = scene.film.resolution;
    let [w, h] = options.resolution.unwrap_or(full);
    let frame = Frame::new(w, h).map_err(Failure::new)?;
    let scaled = scene.film.crop.map(|[x0, y0, x1, y1]| {
        // The file's window at another resolution, as pbrt has it: a share of the image.
        let share =
            |at: u32, from: u32, to: u32| (u64::from(at) * u64::from(to)).div_ceil(u64::from(from.max(1))) as u32;
        [share(x0, full[0], w), share(y0, full[1], h), share(x1, full[0], w), share(y1, full[1], h)]
    });
    match options.crop.or(scaled) {
        Some([x0, y0, x1, y1]) => frame.crop(x0, y0, x1, y1).map_err(Failure::new),
        None => Ok(frame),
    }
}

fn budget(options: &Options, pixels: u64) -> (Budget, String) {
    if let Some(seconds) = options.time {
        return (Budget::Seconds(seconds), format!("{seconds} seconds"));
    }
    if let Some(relmse) = options.error {
        let most = options.max_spp.unwrap_or(ERROR_SPP);
        let at_most = pixels * u64::from(most);
        return (Budget::Error { relmse, at_most }, format!("relMSE {relmse}, at most {most} spp"));
    }
    let spp = options.mean_spp().unwrap_or(super::DEFAULT_SPP);
    // At least one sample: a mean so small that it rounds to none is refused by its bounds.
    let samples = ((spp * pixels as f64).round() as u64).max(1);
    (Budget::Samples(samples), format!("{spp} spp, {samples} samples"))
}

/// What would fail after the first round fails now.
fn check_capacity(points: &dyn PointSet, setting: Setting) -> Result<()> {
    match setting.spp {
        Some(asked) if asked > points.capacity() => {
            let (points, capacity) = (points.describe(), points.capacity());
            Err(Failure::new(Error::SequenceExhausted { points, capacity, asked }))
        }
        _ => Ok(()),
    }
}
