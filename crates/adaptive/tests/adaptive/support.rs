//! Options, films and renders of the tests.

use dapple_adaptive::{Adaptive, AdaptiveOptions, PilotPolicy, VarianceOptions};
use dapple_core::plan::{BudgetLeft, Feedback, Plan};
use dapple_core::{Error, Estimate, Film, Frame, Integrator, Limits, Needs, Render, Sampler};
use dapple_low_discrepancy::Random;

/// Options for images that are compared without a denoiser. Kept samples decide, which all pools and rounds allow.
pub(crate) fn options() -> AdaptiveOptions {
    AdaptiveOptions::default().policy(PilotPolicy::Keep).epsilon(0.01)
}

pub(crate) fn with(options: AdaptiveOptions) -> Adaptive<Random> {
    Adaptive::with_options(Random::new(1), options).unwrap()
}

pub(crate) fn preset(seed: u64, options: VarianceOptions) -> Adaptive<Random> {
    Adaptive::variance_with_options(Random::new(seed), options).unwrap()
}

pub(crate) fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).unwrap()
}

pub(crate) fn run(scene: &mut dyn Integrator, sampler: &mut dyn Sampler, frame: Frame, limits: &Limits) -> Film {
    Render::new(frame, limits).run(scene, sampler).unwrap()
}

/// A square film of `pilot` samples in each pixel; `sample` takes the pixel and the number of the sample.
pub(crate) fn film(side: u32, needs: Needs, pilot: u32, sample: impl Fn(usize, u32) -> Estimate) -> Film {
    let mut film = Film::new(frame(side, side), needs);
    for i in 0..film.frame().pixels() {
        (0..pilot).for_each(|k| film.push_estimate(i, k as usize, &sample(i, k)));
    }
    film
}

/// The counts after the round that follows this film, for `spp` samples per pixel.
pub(crate) fn planned(spp: u64, sampler: &mut dyn Sampler, film: &Film) -> Result<Vec<u32>, Error> {
    let pixels = film.frame().pixels();
    let budget = BudgetLeft::new(spp * pixels as u64).with_spent(film.counts().iter().sum()).with_max_spp(100_000);
    let mut plan = Plan::empty(pixels);
    sampler.next_round(&Feedback::new(1, film, budget), &mut plan)?;
    assert!((1..=budget.left()).contains(&plan.total()));
    Ok(plan.counts.iter().zip(film.counts()).map(|(more, now)| more + now as u32).collect())
}

pub(crate) fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}
