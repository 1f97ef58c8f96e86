//! Images without geometry, for the tests of this crate.

use dapple_core::{
    Block, BudgetLeft, Draws, Estimate, Feedback, Film, Frame, Integrator, Limits, Plan, PointSet, Progress, Render,
    SampleId, Sampler, Worker,
};

/// An integrator from a closure of the pixel and four numbers.
pub(crate) struct Field<F>(pub(crate) F);

impl<F: Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync> Integrator for Field<F> {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        Estimate::new((self.0)(draws.pixel(), draws.block(Block::new(0))))
    }
}

/// 1 with probability `p`, else 0, in every pixel.
pub(crate) fn bernoulli(p: f32) -> Field<impl Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync> {
    Field(move |_, u: [f32; 4]| [f32::from(u8::from(u[0] < p)); 3])
}

pub(crate) fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).unwrap()
}

pub(crate) fn run(integrator: &mut dyn Integrator, sampler: &mut dyn Sampler, frame: Frame, limits: &Limits) -> Film {
    Render::new(frame, limits).run(integrator, sampler).unwrap()
}

/// A nearly normal number of mean 0 and variance 1, a sum of twelve uniform ones, named by `seed` and `k`.
pub(crate) fn near_normal(seed: u64, k: u64) -> f64 {
    let points = dapple_low_discrepancy::Random::new(seed);
    let block = |b: u32| points.block(SampleId::new([k as u32, 0], 0, k >> 32), b).map(|u| f64::from(u) - 0.5);
    (0..3).flat_map(block).sum()
}

/// The film of a sampler that plans until it is done. `sample` returns the radiance of a pixel's k-th sample.
pub(crate) fn planned_until_done(
    sampler: &mut dyn Sampler,
    frame: Frame,
    total: u64,
    sample: impl Fn(usize, u64) -> [f32; 3],
) -> Film {
    planned_estimates(sampler, frame, total, |i, k| Estimate::new(sample(i, k)))
}

/// The film of a sampler that plans until it is done. `sample` returns the estimate of a pixel's k-th sample.
pub(crate) fn planned_estimates(
    sampler: &mut dyn Sampler,
    frame: Frame,
    total: u64,
    sample: impl Fn(usize, u64) -> Estimate,
) -> Film {
    let mut film = Film::with_recorders(frame, sampler.needs(), sampler.recorders());
    for round in 0.. {
        let budget = BudgetLeft::new(total).with_spent(film.record().samples);
        let mut plan = Plan::empty(frame.pixels());
        if sampler.next_round(&Feedback::new(round, &film, budget), &mut plan).unwrap() == Progress::Done {
            break;
        }
        assert!(plan.total() <= budget.left() && round < 10_000);
        for (i, &count) in plan.counts.iter().enumerate() {
            (0..count).for_each(|_| film.push_estimate(i, 0, &sample(i, film.count(i))));
        }
    }
    film
}
