//! Simple point sets, integrators, samplers and filters for tests, most of them made of closures.
//!
//! ```
//! use dapple_conformance::toys::{Independent, Traced, one_round};
//! use dapple_core::{Block, Draws, Estimate, Frame, Limits, Render, Worker};
//! use dapple_core::plan::Retention;
//!
//! let mut grey = Traced(|draws: &Draws<'_>, _: &mut Worker| Estimate::new([draws.block(Block::new(0))[0]; 3]));
//! let mut sampler = one_round(Independent::new(7), Retention::Keep, vec![1, 2, 3]);
//! let film = Render::new(Frame::new(3, 1)?, &Limits::samples(9)).run(&mut grey, &mut sampler)?;
//! assert_eq!(film.counts(), [1, 2, 3]);
//! # Ok::<(), dapple_core::Error>(())
//! ```

use dapple_core::integrator::TrainingData;
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::point_set::mix;
use dapple_core::render::{Control, Monitor, Status};
use dapple_core::{
    Block, Draws, Error, Estimate, Film, Filter, Filtered, Frame, Integrator, Limits, Needs, PointSet, Render,
    SampleId, Sampler, Snapshot, Worker,
};

/// Independent points: the four numbers are a hash of seed, sample and block.
#[derive(Clone, Copy, Debug)]
pub struct Independent {
    /// The seed.
    pub seed: u64,
    /// The number of samples in each stream of a pixel.
    pub capacity: u64,
}

impl Independent {
    /// Points with unlimited capacity.
    pub const fn new(seed: u64) -> Self {
        Self { seed, capacity: u64::MAX }
    }
}

impl PointSet for Independent {
    fn describe(&self) -> String {
        format!("independent:seed={}", self.seed)
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let [x, y] = id.pixel.map(u64::from);
        let sample = id.index ^ (u64::from(id.stream) << 48) ^ (u64::from(block) << 40);
        let key = mix(mix(self.seed) ^ x ^ (y << 32)) ^ mix(sample);
        [1, 2, 3, 4].map(|k| (mix(key.wrapping_add(k)) >> 40) as f32 / (1u64 << 24) as f32)
    }

    fn capacity(&self) -> u64 {
        self.capacity
    }
}

/// A point set made of a closure that receives sample and block.
pub struct Points<F>(pub F);

impl<F: Fn(SampleId, u32) -> [f32; 4] + Send + Sync> PointSet for Points<F> {
    fn describe(&self) -> String {
        "points".into()
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        (self.0)(id, block)
    }
}

/// An integrator made of a closure that receives the random numbers and the [`Worker`].
pub struct Traced<F>(pub F);

impl<F: Fn(&Draws<'_>, &mut Worker) -> Estimate + Sync> Integrator for Traced<F> {
    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        (self.0)(draws, worker)
    }
}

/// An integrator made of a closure that receives the pixel and four random numbers. Half of the radiance is indirect lighting.
pub struct Field<F>(pub F);

impl<F: Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync> Integrator for Field<F> {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let radiance = (self.0)(draws.pixel(), draws.block(Block::new(0)));
        Estimate::new(radiance).with_indirect(radiance.map(|value| 0.5 * value))
    }
}

/// An integrator with training passes, made of a closure that receives the data of the passes so far.
pub struct Learner<F> {
    /// The closure, called once per sample.
    pub trace: F,
    /// The number of training passes that the integrator requests.
    pub passes: usize,
    /// The data of the training passes so far.
    pub learned: Vec<TrainingData>,
}

impl<F: Fn(&[TrainingData], &Draws<'_>, &mut Worker) -> Estimate + Sync> Learner<F> {
    /// An integrator that requests `passes` training passes and has learned nothing yet.
    pub fn new(passes: usize, trace: F) -> Self {
        Self { trace, passes, learned: Vec::new() }
    }
}

impl<F: Fn(&[TrainingData], &Draws<'_>, &mut Worker) -> Estimate + Sync> Integrator for Learner<F> {
    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        (self.trace)(&self.learned, draws, worker)
    }

    fn wants_training(&self) -> bool {
        self.learned.len() < self.passes
    }

    fn learn(&mut self, pass: &TrainingData) {
        self.learned.push(pass.clone());
    }
}

/// A sampler made of a closure that plans each round.
pub struct ToySampler<F> {
    /// The point set that supplies the samples' random numbers.
    pub points: Independent,
    /// The statistics that the closure reads.
    pub needs: Needs,
    /// The closure, called before each round.
    pub plan: F,
}

impl<F: FnMut(&Feedback<'_>, &mut Plan) -> Progress + Send> Sampler for ToySampler<F> {
    fn name(&self) -> &str {
        "planned"
    }

    fn needs(&self) -> Needs {
        self.needs
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        Ok((self.plan)(seen, plan))
    }
}

/// A sampler of one round that traces `counts[i]` samples in pixel `i`, all kept or all discarded as `retention` says.
pub fn one_round(
    points: Independent,
    retention: Retention,
    counts: Vec<u32>,
) -> ToySampler<impl FnMut(&Feedback<'_>, &mut Plan) -> Progress + Send> {
    let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
        plan.counts.clone_from(&counts);
        plan.retention = retention;
        if seen.round == 0 { Progress::Trace } else { Progress::Done }
    };
    ToySampler { points, needs: Needs::none(), plan }
}

/// A filter made of a closure that receives the film.
pub struct ToyFilter<F> {
    /// The filter's name.
    pub name: &'static str,
    /// The statistics that the closure reads.
    pub needs: Needs,
    /// The closure that turns a film into an image.
    pub apply: F,
}

impl<F: Fn(&Film) -> Filtered + Send + Sync> Filter for ToyFilter<F> {
    fn name(&self) -> &str {
        self.name
    }

    fn needs(&self) -> Needs {
        self.needs
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        Ok((self.apply)(film))
    }
}

/// Renders with a budget that is raised step by step through `budgets` (total numbers of samples). Returns the last film.
///
/// # Panics
///
/// If a render fails.
pub fn raised(
    integrator: &mut dyn Integrator,
    sampler: &mut dyn Sampler,
    needs: Needs,
    frame: Frame,
    budgets: &[u64],
) -> Film {
    let (mut film, mut end) = (None, End(Vec::new()));
    for total in budgets {
        let (limits, before) = (Limits::samples(*total), std::mem::take(&mut end.0));
        let render = Render::new(frame, &limits).needs(needs).monitor(&mut end);
        let rendered = match film {
            None => render.run(integrator, sampler),
            Some(_) => Snapshot::from_bytes(&before).and_then(|from| render.resume(from, integrator, sampler)),
        };
        film = Some(rendered.unwrap_or_else(|e| panic!("a budget of {total}: {e}")));
    }
    film.expect("there is a budget")
}

/// The state at the end of a render.
struct End(Vec<u8>);

impl Monitor for End {
    fn progress(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }

    fn end(&mut self, status: &Status<'_>) {
        self.0 = status.snapshot();
    }
}
