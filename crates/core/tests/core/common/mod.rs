//! Point sets, integrators and samplers of the tests' own.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

use dapple_core::{
    Block, Draws, Error, Estimate, Feedback, Film, Frame, Integrator, Limits, Needs, Plan, PointSet, Progress, Render,
    Retention, SampleId, Sampler, Sums, Worker,
};
use rand::{RngExt, SeedableRng};

/// Independent points: a PCG generator whose state is a hash of the sample's name.
#[derive(Clone, Copy, Debug)]
pub struct Independent {
    pub seed: u64,
    pub capacity: u64,
}

impl Independent {
    pub fn new(seed: u64) -> Self {
        Self { seed, capacity: u64::MAX }
    }
}

/// The finaliser of SplitMix64.
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

impl PointSet for Independent {
    fn describe(&self) -> String {
        format!("independent:seed={}", self.seed)
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let [x, y] = id.pixel.map(u64::from);
        let place = mix(mix(mix(self.seed ^ 0x5eed).wrapping_add(x)).wrapping_add(y << 20));
        let name = mix(place.wrapping_add(id.index)).wrapping_add((u64::from(id.stream) << 32) | u64::from(block));
        let mut rng = rand_pcg::Pcg32::new(mix(name), mix(!name));
        [rng.random(), rng.random(), rng.random(), rng.random()]
    }

    fn capacity(&self) -> u64 {
        self.capacity
    }
}

/// A generator for the tests themselves.
pub fn rng(seed: u64) -> rand_pcg::Pcg64 {
    rand_pcg::Pcg64::seed_from_u64(seed)
}

/// An integrator from a closure of the pixel and four numbers.
pub struct Field<F>(pub F);

impl<F: Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync> Integrator for Field<F> {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let radiance = (self.0)(draws.pixel(), draws.block(Block::new(0)));
        Estimate::new(radiance).with_indirect(radiance.map(|value| 0.5 * value))
    }
}

/// Grey noise whose spread grows to the right.
pub fn noise([x, _]: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    [0.1 + 0.05 * x as f32 * u[0], u[1], u[2] * u[3]]
}

/// Counts from a closure of the state; done if it returns `None`.
pub struct Planned<F> {
    pub points: Independent,
    pub needs: Needs,
    pub plan: F,
}

impl<F: FnMut(&Feedback<'_>, &mut Plan) -> Progress + Send> Sampler for Planned<F> {
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

/// One kept round of these counts.
pub fn counts(points: Independent, counts: Vec<u32>) -> Planned<impl FnMut(&Feedback<'_>, &mut Plan) -> Progress> {
    once(points, Retention::Keep, counts)
}

/// One round of these counts.
pub fn once(
    points: Independent,
    retention: Retention,
    counts: Vec<u32>,
) -> Planned<impl FnMut(&Feedback<'_>, &mut Plan) -> Progress> {
    let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
        plan.counts.clone_from(&counts);
        plan.retention = retention;
        if seen.round == 0 { Progress::Trace } else { Progress::Done }
    };
    Planned { points, needs: Needs::none(), plan }
}

pub fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).unwrap()
}

/// Renders without a monitor.
pub fn run(
    integrator: &mut dyn Integrator,
    sampler: &mut dyn Sampler,
    needs: Needs,
    frame: Frame,
    limits: &Limits,
) -> Result<Film, Error> {
    Render::new(frame, limits).needs(needs).run(integrator, sampler)
}

pub fn everything() -> Needs {
    Needs::none()
        .with_variance()
        .with_extrema()
        .with_halves()
        .with_feature_halves()
        .with_first_hits(3)
        .with_cost()
        .with_emission()
        .with_indirect()
        .with_sums(Sums::LOG | Sums::ROOT | Sums::ROOT_MOMENTS)
        .with_samples(5)
        .with_trajectories()
}

pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}
