//! Made-up images, and a renderer for them.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

use dapple_core::{
    Block, BudgetLeft, Draws, Estimate, Feedback, Film, Frame, Integrator, Limits, Plan, Render, Sampler, Worker,
};
use dapple_low_discrepancy::Random;
use dapple_mitchell::{Mitchell, MitchellOptions, MitchellPbrt, MitchellPbrtOptions, PilotPolicy, Stopping};

pub const POLICIES: [PilotPolicy; 3] = [PilotPolicy::Keep, PilotPolicy::Refined, PilotPolicy::Discard];

/// An integrator from a closure of the pixel and four numbers.
pub struct Field<F>(pub F);

impl<F: Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync> Integrator for Field<F> {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let radiance = (self.0)(draws.pixel(), draws.block(Block::new(0)));
        Estimate::new(radiance)
    }
}

/// 1 with probability `p`, else 0, in every pixel.
pub fn bernoulli(p: f32) -> Field<impl Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync> {
    Field(move |_, u: [f32; 4]| [f32::from(u8::from(u[0] < p)); 3])
}

pub fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).unwrap()
}

pub fn run(integrator: &mut dyn Integrator, sampler: &mut dyn Sampler, frame: Frame, limits: &Limits) -> Film {
    Render::new(frame, limits).run(integrator, sampler).unwrap()
}

/// Mitchell's rule for single pixels, with these rates.
pub fn alone(initial: u32, additional: u32, mode: Stopping, policy: PilotPolicy) -> MitchellOptions {
    MitchellOptions::default().initial(initial).additional(additional).radius(0).mode(mode).policy(policy)
}

pub fn mitchell(options: MitchellOptions, seed: u64) -> Mitchell<Random> {
    Mitchell::with_options(Random::new(seed), options).unwrap()
}

pub fn pbrt(options: MitchellPbrtOptions, seed: u64) -> MitchellPbrt<Random> {
    MitchellPbrt::with_options(Random::new(seed), options).unwrap()
}

pub fn pbrt_options(min: u32, max: u32, mode: Stopping, policy: PilotPolicy) -> MitchellPbrtOptions {
    MitchellPbrtOptions::default().min(min).max(max).mode(mode).policy(policy)
}

/// A film with these samples, pixel by pixel.
pub fn film(frame: Frame, sampler: &dyn Sampler, samples: &[Vec<[f32; 3]>]) -> Film {
    let mut film = Film::with_recorders(frame, sampler.needs(), sampler.recorders());
    for (i, samples) in samples.iter().enumerate() {
        samples.iter().for_each(|&s| film.push(i, 0, s));
    }
    film
}

/// The plan of a sampler after a film, for this many samples in total, without bounds.
pub fn ask(sampler: &mut dyn Sampler, film: &Film, total: u64) -> Plan {
    let budget = BudgetLeft::new(total).with_spent(film.record().samples).with_min_spp(0);
    let mut plan = Plan::empty(film.frame().pixels());
    sampler.next_round(&Feedback::new(1, film, budget), &mut plan).unwrap();
    plan
}

/// The finaliser of SplitMix64: pseudo-random numbers for the tests.
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
