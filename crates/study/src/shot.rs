//! One image by one method, with what it took.

use crate::{External, Method, Phases, StudyError, Subject};
use dapple_core::{Error, Film, Filter, Filtered, Limits, Monitor, Needs, Render};
use dapple_job::Stage;
use dapple_job::registry::{self, Setting};
use dapple_renderer::integrator;
use std::time::Instant;

/// What an image is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Order<'a> {
    pub(crate) method: &'a Method,
    pub(crate) seed: u64,
    /// Samples in all.
    pub(crate) samples: u64,
    /// The filter, where it is a program of somebody else's.
    pub(crate) external: Option<&'a External>,
    /// For that: 0 is one per core.
    pub(crate) threads: usize,
}

impl<'a> Order<'a> {
    /// With a seed of 0 and no program of others.
    pub(crate) fn new(method: &'a Method, samples: u64) -> Self {
        Self { method, seed: 0, samples, external: None, threads: 0 }
    }
}

/// What makes the image of a film: a filter of ours, or somebody else's.
enum Finish<'a> {
    Ours(Box<dyn Filter>),
    Theirs(&'a External),
}

impl Finish<'_> {
    fn needs(&self) -> Needs {
        match self {
            Self::Ours(filter) => filter.needs(),
            Self::Theirs(external) => external.needs(),
        }
    }

    /// The image, and the seconds that it took.
    fn apply(&self, film: &Film, unit: f64, threads: usize) -> Result<(Filtered, f64), String> {
        match self {
            Self::Ours(filter) => {
                let clock = Instant::now();
                let filtered = filter.apply(film).map_err(|e| e.to_string())?;
                Ok((filtered, clock.elapsed().as_secs_f64()))
            }
            Self::Theirs(external) => external.apply(film, unit, threads),
        }
    }
}

/// An image, and what it took.
pub(crate) struct Shot {
    pub(crate) film: Film,
    pub(crate) filtered: Filtered,
    pub(crate) seconds: Phases,
    /// Probes included.
    pub(crate) rays: u64,
    pub(crate) cpu_s: Option<f64>,
}

/// Renders as anybody would through the public items, clusters made anew. `monitor` is not counted in the times; `cpu`
/// tells this process' user and system seconds so far.
pub(crate) fn shoot(
    subject: &Subject,
    order: Order<'_>,
    monitor: &mut dyn Monitor,
    cpu: fn() -> Option<f64>,
) -> Result<Shot, StudyError> {
    let Order { method, seed, samples, external, threads } = order;
    let wrong = |why: String| {
        let what = format!("{}, {method}, seed {seed}, {samples} samples", subject.view.name);
        StudyError::Run { what, why }
    };
    let frame = subject.frame()?;
    let stage = Stage::new(subject.world.clone());
    let before = cpu();
    let spp = samples.div_ceil(frame.pixels() as u64);
    let points = registry::points(&method.points, Setting { seed, spp: Some(spp) });
    let sampler = points.and_then(|points| registry::sampler(&method.sampler, points, &stage));
    let mut sampler = sampler.map_err(|e| wrong(e.to_string()))?;
    let finish = match external {
        Some(external) => Finish::Theirs(external),
        None => Finish::Ours(registry::filter(&method.filter, &stage).map_err(|e| wrong(e.to_string()))?),
    };
    let mut integrator = integrator(&subject.world);
    let limits = Limits::samples(samples);
    let film = Render::new(frame, &limits)
        .needs(finish.needs())
        .monitor(monitor)
        .run(&mut *integrator, &mut *sampler)
        .map_err(|e: Error| wrong(e.to_string()))?;
    let rendered = cpu();
    let unit = 1.0 / subject.world.space().scale();
    let (filtered, filter) = finish.apply(&film, unit, threads).map_err(wrong)?;
    // What another program took is what it said, or the time that went by.
    let finished = if external.is_none() { cpu() } else { rendered.map(|seconds| seconds + filter) };
    let cpu_s = finished.zip(before).map(|(after, before)| after - before);
    let probes = stage.probe_cost();
    let seconds = Phases {
        load: subject.load,
        bvh: subject.bvh,
        cluster: stage.cluster_seconds(),
        probe: probes.seconds,
        // Probes are shot when the first round is planned.
        plan: (film.record().plan_seconds() - probes.seconds).max(0.0),
        trace: film.record().trace_seconds(),
        filter,
    };
    let rays = film.record().rays + probes.rays;
    Ok(Shot { film, filtered, seconds, rays, cpu_s })
}
