//! One picture by one method, with what it took.

use crate::{Method, Phases, StudyError, Subject};
use dapple_core::{Error, Film, Filtered, Limits, Watch, render};
use dapple_renderer::registry::{self, Setting};
use dapple_renderer::{Stage, integrator};
use std::time::Instant;

/// What a picture is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Order<'a> {
    pub(crate) method: &'a Method,
    pub(crate) seed: u64,
    /// Samples in all.
    pub(crate) samples: u64,
}

/// A picture, and what it took.
pub(crate) struct Shot {
    pub(crate) film: Film,
    pub(crate) filtered: Filtered,
    pub(crate) seconds: Phases,
    /// Probes included.
    pub(crate) rays: u64,
    pub(crate) cpu_s: Option<f64>,
}

/// Renders as anybody would through the public items, clusters made anew. `watch` is not counted in the times; `cpu`
/// tells this process' user and system seconds so far.
pub(crate) fn shoot(
    subject: &Subject,
    order: Order<'_>,
    watch: &mut dyn Watch,
    cpu: fn() -> Option<f64>,
) -> Result<Shot, StudyError> {
    let Order { method, seed, samples } = order;
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
    let filter = registry::filter(&method.filter, &stage).map_err(|e| wrong(e.to_string()))?;
    let mut integrator = integrator(&subject.world);
    let limits = Limits::samples(samples);
    let film = render(&mut *integrator, &mut *sampler, filter.needs(), frame, &limits, watch)
        .map_err(|e: Error| wrong(e.to_string()))?;
    let clock = Instant::now();
    let filtered = filter.apply(&film).map_err(|e| wrong(e.to_string()))?;
    let filter = clock.elapsed().as_secs_f64();
    let cpu_s = cpu().zip(before).map(|(after, before)| after - before);
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
