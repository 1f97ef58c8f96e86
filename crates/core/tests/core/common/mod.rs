//! Toys and helpers of several test files.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

pub use dapple_conformance::toys::{Field, Independent, Learner, Points, ToyFilter, ToySampler, Traced, one_round};
pub use dapple_conformance::{bits, on_threads};
pub use dapple_core::point_set::mix;

use dapple_adaptive::Sequence;
use dapple_core::integrator::TrainingData;
use dapple_core::limits::Schedule;
use dapple_core::render::{Control, Monitor, Status};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Draws, Error, Estimate, Film, FirstHit, Frame, Integrator, Limits, Needs, Render, Sampler, Snapshot, Worker,
};
use rand::SeedableRng;

/// A generator for the tests themselves.
pub fn rng(seed: u64) -> rand_pcg::Pcg64 {
    rand_pcg::Pcg64::seed_from_u64(seed)
}

/// Grey noise whose spread grows to the right.
pub fn noise([x, _]: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    [0.1 + 0.05 * x as f32 * u[0], u[1], u[2] * u[3]]
}

/// The numbers of a sample's first block.
pub fn numbers(draws: &Draws<'_>) -> [f32; 4] {
    draws.block(dapple_core::Block::new(0))
}

/// Learns in four passes, reports first hits, and now and then gives a bad sample.
pub fn learner() -> Learner<impl Fn(&[TrainingData], &Draws<'_>, &mut Worker) -> Estimate + Sync> {
    Learner::new(4, |learned, draws, worker| {
        let u = numbers(draws);
        worker.note(u64::from(draws.pixel()[0] / 5), u[0]);
        let shift: f64 = learned.iter().flat_map(|pass| pass.entries()).map(|e| e.sum / e.count as f64).sum();
        let value = if u[3] < 0.01 { -1.0 } else { u[1] + shift as f32 };
        let hit = FirstHit::new([u[0], u[1], u[2]], [0.0, 0.0, 1.0], u[0])
            .with_shading_normal([0.0, u[3], 1.0])
            .with_albedo([0.5, u[1], 0.25])
            .with_footprint(0.1)
            .with_material(3)
            .with_shape(5)
            .with_primitive(draws.pixel()[1]);
        let hit = (u[2] > 0.2).then_some(hit);
        Estimate::new([value, u[2], 0.5]).with_first_hit(hit).with_cost(2 + draws.pixel()[0] % 3)
    })
}

pub fn uniform(seed: u64) -> Uniform<Independent> {
    Uniform::new(Independent::new(seed))
}

/// Uniform sampling in three rounds, of which the first two end at these samples per pixel.
pub fn three_rounds(seed: u64, [first, second]: [u32; 2]) -> impl Sampler {
    Sequence::new(uniform(seed), first, Sequence::new(uniform(seed), second, uniform(seed)).unwrap()).unwrap()
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
        .with_half_variance()
        .with_feature_halves()
        .with_surfaces()
        .with_first_hits(3)
        .with_cost()
        .with_emission()
        .with_indirect()
        .with_trajectories()
}

/// One of four ways to cut a round into tiles and slices.
pub fn cut(i: usize) -> Schedule {
    let (tile_rows, progress_spp, shuffle) = [(1, 0, 0), (16, 1, 5), (33, 7, 0), (7, 0, 9)][i % 4];
    Schedule::default().with_tile_rows(tile_rows).with_progress_spp(progress_spp).with_shuffle(shuffle)
}

/// Keeps a snapshot of every slice, and of the end.
#[derive(Default)]
pub struct Keeper {
    pub slices: Vec<Vec<u8>>,
    pub end: Vec<u8>,
}

impl Keeper {
    /// All snapshots in order.
    pub fn all(&self) -> impl Iterator<Item = Snapshot> {
        self.slices.iter().chain([&self.end]).map(|bytes| snapshot(bytes))
    }
}

impl Monitor for Keeper {
    fn progress(&mut self, status: &Status<'_>) -> Control {
        self.slices.push(status.snapshot());
        Control::Continue
    }

    fn end(&mut self, status: &Status<'_>) {
        self.end = status.snapshot();
    }
}

pub fn snapshot(bytes: &[u8]) -> Snapshot {
    Snapshot::from_bytes(bytes).unwrap()
}
