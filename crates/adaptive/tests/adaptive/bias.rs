//! The bias of each policy of the error-driven sampler, checked against the closed form. The bias of
//! [`PilotPolicy::Keep`] is the control and must be caught [Kirk and Arvo 1991].

use crate::common::*;
use dapple_adaptive::{Adaptive, AdaptiveOptions, PilotPolicy, PoolShape};
use dapple_conformance::statistics::{Bernoulli, Mean, image_mean};
use dapple_core::Limits;
use dapple_low_discrepancy::Random;

const P: f32 = 0.1;
/// The probability of light where it is rare.
const RARE: f32 = 0.02;

/// The deviation of the image's mean from the expected value in standard errors, over 64 images. With 63 degrees of
/// freedom, 5 is exceeded with p = 5e-6 and 10 with p < 1e-13.
fn deviation(options: AdaptiveOptions, side: u32) -> f64 {
    deviation_of(P, options, side)
}

/// The same, for a field that is lit with the probability `p`.
fn deviation_of(p: f32, options: AdaptiveOptions, side: u32) -> f64 {
    let at = frame(side, side);
    let limits = Limits::samples(10 * at.pixels() as u64);
    let mean = |seed: u64| {
        let mut sampler = Adaptive::with_options(Random::new(700 + seed), options).unwrap();
        image_mean(&run(&mut Bernoulli(p), &mut sampler, at, &limits).unwrap())
    };
    (0..64).map(mean).collect::<Mean>().deviation(p.into())
}

/// Options with the largest bias: a pixel's own variance decides, and counts always adapt.
fn alone(policy: PilotPolicy) -> AdaptiveOptions {
    options().policy(policy).prior(0.0).gain(1.0).pilot(4)
}

#[test]
fn discarding_and_crossing_are_unbiased_a01() {
    for policy in [PilotPolicy::Discard, PilotPolicy::Cross] {
        for options in [alone(policy), alone(policy).prior(6.0).radius(1)] {
            let z = deviation(options, 128);
            assert!(z.abs() < 5.0, "{options:?}: {z} standard errors");
        }
    }
    let cells = alone(PilotPolicy::Discard).pool(PoolShape::Inside).geometry(2.0);
    let z = deviation(cells, 64);
    assert!(z.abs() < 5.0, "cells: {z} standard errors");
}

/// Counts by the neighbours' samples are unbiased, also where light is rare: one sample in 50 is lit. Two rounds are the default.
#[test]
fn counts_by_neighbours_are_unbiased_a01() {
    for (p, options) in [
        (P, alone(PilotPolicy::Neighbours).rounds(1)),
        (P, alone(PilotPolicy::Neighbours).radius(1)),
        (RARE, alone(PilotPolicy::Neighbours)),
        (RARE, alone(PilotPolicy::Neighbours).power(2.0).epsilon(0.3)),
    ] {
        let z = deviation_of(p, options, 128);
        assert!(z.abs() < 5.0, "{options:?}: {z} standard errors");
    }
}

#[test]
fn keeping_is_biased_a01() {
    let z = deviation(alone(PilotPolicy::Keep), 64);
    assert!(z < -10.0, "{z} standard errors");
}
