//! Rendering of one image by one method, with its cost measured.

use crate::{External, Method, Phases, StudyError, Subject};
use dapple_core::{Film, Filtered, Monitor, Needs};
use dapple_job::{BudgetSpec, JobError, RenderMonitor};

/// The settings for rendering one image: method, seed, samples and external filter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Order<'a> {
    pub(crate) method: &'a Method,
    pub(crate) seed: u64,
    /// The total number of samples to take.
    pub(crate) samples: u64,
    /// The method's filter, if it is an external program; otherwise `None`.
    pub(crate) external: Option<&'a External>,
    /// The number of threads of the external program; 0 is one per core.
    pub(crate) threads: usize,
}

impl<'a> Order<'a> {
    /// Makes settings for `samples` samples in total by `method`, with seed 0 and no external program.
    pub(crate) fn new(method: &'a Method, samples: u64) -> Self {
        Self { method, seed: 0, samples, external: None, threads: 0 }
    }
}

/// A rendered image and its cost.
pub(crate) struct Shot {
    pub(crate) film: Film,
    pub(crate) filtered: Filtered,
    pub(crate) seconds: Phases,
    /// The number of rays traced, probe rays included.
    pub(crate) rays: u64,
    pub(crate) cpu_s: Option<f64>,
}

/// Renders an image and measures its cost, the time of clustering included. The time in `monitor` does not count. `cpu`
/// returns the user and system seconds of this process so far.
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
    let job = |e: JobError| wrong(e.to_string());
    let before = cpu();
    let filter = if external.is_some() { "none" } else { &method.filter };
    let spec = subject.view.spec().sampler(&method.sampler).points(&method.points).filter(filter);
    let spec = spec.seed(seed).budget(BudgetSpec::Samples(samples));
    let mut render = subject.prepared().job(&spec).map_err(job)?;
    render.record(external.map_or(Needs::none(), External::needs));
    let traced = render.run(None, &mut RenderMonitor(monitor)).map_err(job)?;
    if let Some(panicked) = traced.failure {
        return Err(wrong(panicked));
    }
    let rendered = cpu();
    let image = match external {
        None => render.finish(traced.film).map_err(job)?,
        Some(external) => {
            let unit = 1.0 / render.world().space().scale();
            let (filtered, seconds) = external.apply(&traced.film, unit, threads).map_err(wrong)?;
            render.finished(traced.film, filtered, external.name.clone(), seconds)
        }
    };
    let seconds = image.seconds;
    // The time of an external program is its reported time, or else its wall time.
    let finished = if external.is_none() { cpu() } else { rendered.map(|cpu| cpu + seconds.filter) };
    let cpu_s = finished.zip(before).map(|(after, before)| after - before);
    let phases = Phases {
        load: seconds.load,
        bvh: seconds.bvh,
        cluster: seconds.cluster,
        probe: seconds.probe,
        plan: seconds.plan,
        trace: seconds.trace,
        filter: seconds.filter,
    };
    let rays = image.rays();
    Ok(Shot { film: image.film, filtered: image.filtered, seconds: phases, rays, cpu_s })
}
