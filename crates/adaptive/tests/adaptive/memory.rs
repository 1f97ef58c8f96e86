//! The forecast of a render's memory.

use crate::common::*;
use dapple_adaptive::{Adaptive, PilotPolicy, VarianceOptions};
use dapple_core::{Frame, Limits, Sampler, SamplerMemory};
use dapple_low_discrepancy::Random;

fn of(sampler: &dyn Sampler, frame: &Frame, samples: u64) -> SamplerMemory {
    sampler.memory(frame, &sampler.needs(), &Limits::samples(samples))
}

#[test]
fn a_whole_pilot_plans_nothing_and_a_discarded_one_has_a_bank() {
    let frame = frame(100, 50);
    let points = || Random::new(1);
    let options = VarianceOptions::default().policy(PilotPolicy::Discard);
    let discards = of(&Adaptive::variance_with_options(points(), options).unwrap(), &frame, 20_000);
    assert_eq!(discards.discarded, 5000 * 56, "discarded samples have statistics of their own");
    let variance = |budget| of(&Adaptive::variance(points()), &frame, budget);
    assert_eq!(variance(20_000).planning, 5000 * 4, "the pilot is all");
    assert!(variance(20_001).planning > 5000 * 100 && variance(40_000) == variance(20_001));
}
