//! Samplers, and a renderer for made-up images.

pub(crate) use dapple_conformance::statistics::Bernoulli;
pub(crate) use dapple_conformance::toys::Field;
use dapple_core::plan::{BudgetLeft, Feedback, Plan};
pub(crate) use dapple_core::point_set::mix;
use dapple_core::{Film, Frame, Integrator, Limits, Render, Sampler};
use dapple_low_discrepancy::Random;
use dapple_mitchell::{Mitchell, MitchellOptions, MitchellPbrt, MitchellPbrtOptions, PilotPolicy, Stopping};

pub(crate) const POLICIES: [PilotPolicy; 3] = [PilotPolicy::Keep, PilotPolicy::Refined, PilotPolicy::Discard];

pub(crate) fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).unwrap()
}

pub(crate) fn run(integrator: &mut dyn Integrator, sampler: &mut dyn Sampler, frame: Frame, limits: &Limits) -> Film {
    Render::new(frame, limits).run(integrator, sampler).unwrap()
}

/// Mitchell's rule for single pixels, with these rates.
pub(crate) fn alone(initial: u32, additional: u32, mode: Stopping, policy: PilotPolicy) -> MitchellOptions {
    MitchellOptions::default().initial(initial).additional(additional).radius(0).mode(mode).policy(policy)
}

pub(crate) fn mitchell(options: MitchellOptions, seed: u64) -> Mitchell<Random> {
    Mitchell::with_options(Random::new(seed), options).unwrap()
}

pub(crate) fn pbrt(options: MitchellPbrtOptions, seed: u64) -> MitchellPbrt<Random> {
    MitchellPbrt::with_options(Random::new(seed), options).unwrap()
}

pub(crate) fn pbrt_options(min: u32, max: u32, mode: Stopping, policy: PilotPolicy) -> MitchellPbrtOptions {
    MitchellPbrtOptions::default().min(min).max(max).mode(mode).policy(policy)
}

/// A film with these samples, pixel by pixel.
pub(crate) fn film(frame: Frame, sampler: &dyn Sampler, samples: &[Vec<[f32; 3]>]) -> Film {
    let mut film = Film::with_recorders(frame, sampler.needs(), sampler.recorders());
    for (i, samples) in samples.iter().enumerate() {
        samples.iter().for_each(|&s| film.push(i, 0, s));
    }
    film
}

/// The plan of a sampler after a film, for this many samples in total, without bounds.
pub(crate) fn ask(sampler: &mut dyn Sampler, film: &Film, total: u64) -> Plan {
    let budget = BudgetLeft::new(total).with_spent(film.record().samples).with_min_spp(0);
    let mut plan = Plan::empty(film.frame().pixels());
    sampler.next_round(&Feedback::new(1, film, budget), &mut plan).unwrap();
    plan
}
