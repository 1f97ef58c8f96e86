//! The mean under each policy, checked against closed forms. The biased policies are the controls that the test of
//! unbiasedness must reject.
//!
//! Seeds are fixed. A test within 5 standard errors fails by chance with probability 6e-7 (5e-6 if the error comes from
//! 64 replicates). There are about twenty such tests. A control beyond 10 passes by chance with less than 1e-13.

use crate::common::*;
use dapple_conformance::statistics::{Mean, image_mean, kept, refined};
use dapple_core::{Limits, Sampler};
use dapple_mitchell::{PilotPolicy, Stopping};

/// The mean over the pixels of a square image and its standard error, with budget to refine every pixel. A pixel's kept
/// samples decide nothing elsewhere, or (radius 0) only in itself, so pixels are uncorrelated.
fn measure(sampler: &mut dyn Sampler, p: f64, side: u32) -> Mean {
    let size = frame(side, side);
    let film = run(&mut bernoulli(p as f32), sampler, size, &Limits::samples(1000 * size.pixels() as u64));
    (0..size.pixels()).map(|i| film.mean(i)[0]).collect()
}

/// The deviation of the mean from the expected value, in standard errors.
fn deviation(mean: Mean, truth: f64) -> f64 {
    mean.deviation(truth)
}

/// Two images: probability, pilot, samples in total, and the mean under the naive rule.
const A01: [(f64, u32, u32, f64); 2] = [(0.1, 4, 64, 0.038575), (0.01, 16, 256, 0.002_017_58)];

#[test]
fn discarding_the_pilot_is_unbiased_a01() {
    for (p, n0, n, _) in A01 {
        let truth = f64::from(p as f32);
        let options = alone(n0, n - n0, Stopping::Threshold, PilotPolicy::Discard);
        for radius in [0, 1] {
            let got = measure(&mut mitchell(options.radius(radius), 1), p, 1024 >> (2 * radius));
            assert!(deviation(got, truth).abs() < 5.0, "mitchell, radius {radius}: {got:?} for {truth}");
        }
        let options = pbrt_options(n0, n, Stopping::Threshold, PilotPolicy::Discard);
        let got = measure(&mut pbrt(options, 2), p, 256);
        assert!(deviation(got, truth).abs() < 5.0, "pbrt: {got:?} for {truth}");
    }
}

#[test]
fn keeping_the_pilot_is_caught_and_meets_its_closed_form_a01() {
    for (p, n0, n, naive) in A01 {
        let closed = kept(p, n0, n);
        assert!((closed - naive).abs() < 1e-6, "{closed} for {naive}");
        let one = &mut mitchell(alone(n0, n - n0, Stopping::Threshold, PilotPolicy::Keep), 3);
        let other = &mut pbrt(pbrt_options(n0, n, Stopping::Threshold, PilotPolicy::Keep), 4);
        for sampler in [one as &mut dyn Sampler, other] {
            let got = measure(sampler, p, 256);
            assert!(deviation(got, p) < -10.0, "{}: {got:?} is not caught", sampler.describe());
            assert!(deviation(got, closed).abs() < 5.0, "{}: {got:?} for {closed}", sampler.describe());
        }
    }
}

#[test]
fn discarding_only_refined_pilots_is_caught_and_meets_its_closed_form_a01() {
    for (p, n0, n, _) in A01 {
        let closed = refined(p, n0);
        let one = &mut mitchell(alone(n0, n - n0, Stopping::Threshold, PilotPolicy::Refined), 5);
        let other = &mut pbrt(pbrt_options(n0, n, Stopping::Threshold, PilotPolicy::Refined), 6);
        for sampler in [one as &mut dyn Sampler, other] {
            let got = measure(sampler, p, 256);
            assert!(deviation(got, p) < -10.0, "{}: {got:?} is not caught", sampler.describe());
            assert!(deviation(got, closed).abs() < 5.0, "{}: {got:?} for {closed}", sampler.describe());
        }
    }
}

/// The closed forms for a pilot of two and `p = 0.2`.
#[test]
fn pilots_of_two_meet_their_closed_forms() {
    let p = 0.2_f64;
    // pbrt-v2's policy: 0.104 for any second count.
    let published = 3.0 * p * p - 2.0 * p * p * p;
    assert!((published - 0.104).abs() < 1e-12 && (published - refined(p, 2)).abs() < 1e-12);
    for max in [4, 32] {
        let got = measure(&mut pbrt(pbrt_options(2, max, Stopping::Threshold, PilotPolicy::Refined), 7), p, 256);
        assert!(deviation(got, published).abs() < 5.0, "max {max}: {got:?} for {published}");
    }
    // Keeps all samples and adds k.
    for k in [2, 8] {
        let more = f64::from(k);
        let closed = p * p + 2.0 * p * (1.0 - p) * (1.0 + more * p) / (2.0 + more);
        assert!((closed - kept(p, 2, 2 + k)).abs() < 1e-12);
        let got = measure(&mut mitchell(alone(2, k, Stopping::Threshold, PilotPolicy::Keep), 8), p, 256);
        assert!(deviation(got, closed).abs() < 5.0, "k {k}: {got:?} for {closed}");
        if k == 8 {
            assert!((closed - 0.1232).abs() < 1e-12);
        }
    }
    let got = measure(&mut mitchell(alone(2, 8, Stopping::Threshold, PilotPolicy::Discard), 9), p, 512);
    assert!(deviation(got, f64::from(p as f32)).abs() < 5.0, "{got:?} for {p}");
}

/// Under a budget, counts within an image are coupled: only the 64 replicates are independent.
fn replicates(make: impl Fn(u64) -> Box<dyn Sampler>, side: u32) -> Mean {
    let size = frame(side, side);
    let limits = Limits::samples(10 * size.pixels() as u64);
    (0..64).map(|seed| image_mean(&run(&mut bernoulli(0.1), &mut *make(seed), size, &limits))).collect()
}

#[test]
fn policies_keep_their_bias_under_a_budget_a01() {
    let truth = f64::from(0.1f32);
    for policy in POLICIES {
        for radius in [0, 1] {
            let options = alone(4, 8, Stopping::Budget, policy).radius(radius);
            // 2^20 pixels in total for the policies whose bias must be detected.
            let side = if policy == PilotPolicy::Discard && radius == 0 { 128 } else { 48 };
            let got = replicates(|seed| Box::new(mitchell(options, 100 + seed)), side);
            let off = deviation(got, truth);
            match (policy, radius) {
                (PilotPolicy::Discard, _) => assert!(off.abs() < 5.0, "{options:?}: {got:?}"),
                (_, 0) => assert!(off < -10.0, "{options:?}: {got:?} is not caught"),
                // A window of 9 pixels dilutes the bias. It has no closed form, and no test here.
                _ => {}
            }
        }
        let options = pbrt_options(4, 16, Stopping::Budget, policy);
        let got = replicates(|seed| Box::new(pbrt(options, 200 + seed)), 48);
        match policy {
            PilotPolicy::Discard => assert!(deviation(got, truth).abs() < 5.0, "{options:?}: {got:?}"),
            _ => assert!(deviation(got, truth) < -10.0, "{options:?}: {got:?} is not caught"),
        }
    }
}
