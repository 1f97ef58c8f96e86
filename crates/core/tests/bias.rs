//! Whether deciding on kept samples shows in the mean: against closed forms, with the naive rule as
//! the control that must be caught.

mod common;

use common::*;
use dapple_core::samplers::{Pilot, Variance, VarianceOptions};
use dapple_core::{Fate, Feedback, Film, Limits, Needs, Plan, Progress, Sampler};

const P: f32 = 0.1;

fn bernoulli(_: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    [f32::from(u8::from(u[0] < P)); 3]
}

/// Mean over pixels and its standard error between 64 replicates of `side` x `side` pixels (128: 2^20
/// in all); counts in one replicate are coupled by the budget, so only replicates are independent.
fn measure<S: Sampler>(make: impl Fn(u64) -> S, spp: u64, side: u32) -> (f64, f64) {
    let size = frame(side, side);
    let means: Vec<f64> = (0..64)
        .map(|seed| {
            let limits = Limits::samples(spp * size.pixels() as u64);
            let film = run(&mut Field(bernoulli), &mut make(seed), Needs::none(), size, &limits).unwrap();
            picture_mean(&film)
        })
        .collect();
    let mean = means.iter().sum::<f64>() / 64.0;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / 63.0;
    (mean, (variance / 64.0).sqrt())
}

fn picture_mean(film: &Film) -> f64 {
    (0..film.frame().pixels()).map(|i| film.mean(i)[0]).sum::<f64>() / film.frame().pixels() as f64
}

/// 5 standard errors with 63 degrees of freedom: p = 5e-6 a test; 10: p < 1e-13.
fn deviation((mean, error): (f64, f64)) -> f64 {
    (mean - f64::from(P)) / error
}

fn variance_sampler(policy: Pilot, radius: u32, seed: u64) -> Variance<Independent> {
    let options = VarianceOptions { policy, radius, pilot: 4, ..VarianceOptions::default() };
    Variance::with_options(Independent::new(seed), options).unwrap()
}

#[test]
fn a01_discarding_and_crossing_are_unbiased() {
    for policy in [Pilot::Discard, Pilot::Cross] {
        for radius in [0, 1] {
            let got = measure(|seed| variance_sampler(policy, radius, 100 + seed), 10, 128);
            assert!(deviation(got).abs() < 5.0, "{policy:?}, radius {radius}: {got:?}");
        }
    }
}

/// The default policy is biased, and says so: the harness must see it where a pixel decides alone.
#[test]
fn a01_keeping_is_biased() {
    let got = measure(|seed| variance_sampler(Pilot::Keep, 0, 200 + seed), 10, 64);
    assert!(deviation(got) < -10.0, "{got:?}");
}

/// Stops at four equal samples, else goes on to 64, and keeps all.
fn naive(seed: u64, first: u32, last: u32) -> impl Sampler {
    let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
        plan.fate = Fate::Keep;
        for (i, n) in plan.counts.iter_mut().enumerate() {
            let mixed = seen.film.moments(i).m2[0] > 0.0;
            *n = if seen.round == 0 {
                first
            } else if mixed {
                last - first
            } else {
                0
            };
        }
        if seen.round < 2 && plan.total() > 0 { Progress::Trace } else { Progress::Done }
    };
    Planned { points: Independent::new(seed), needs: Needs::none().with_variance(), plan }
}

#[test]
fn a01_the_naive_rule_is_caught_and_meets_its_closed_form() {
    // STATISTICS S7: p^n0 + (n0 p - n0 p^n0 + (N - n0) p Pmix) / N with Pmix = 1 - p^n0 - (1-p)^n0.
    let (p, n0, n) = (f64::from(P), 4.0, 64.0);
    let all = p.powf(n0);
    let mixed = 1.0 - all - (1.0 - p).powf(n0);
    let closed = all + (n0 * p - n0 * all + (n - n0) * p * mixed) / n;
    assert!((closed - 0.038575).abs() < 1e-6, "{closed}");
    let (mean, error) = measure(|seed| naive(300 + seed, 4, 64), 64, 64);
    assert!(deviation((mean, error)) < -10.0, "the naive rule is not caught: {mean} +- {error}");
    assert!((mean - closed).abs() < 5.0 * error, "{mean} +- {error} instead of {closed}");
}

/// Halves that decide for each other are unbiased only when averaged equally: by count they are not.
#[test]
fn a01_crossing_with_weights_by_count_is_caught() {
    let by_count = |seed| {
        let mut inner = variance_sampler(Pilot::Cross, 0, 400 + seed);
        let needs = inner.needs();
        let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
            let progress = inner.next_round(seen, plan).unwrap();
            plan.combine = dapple_core::Combine::ByCount;
            progress
        };
        Planned { points: Independent::new(400 + seed), needs, plan }
    };
    let got = measure(by_count, 10, 64);
    assert!(deviation(got).abs() > 10.0, "{got:?}");
}

/// A light that only one sample in 1000 sees: the pilot sees nothing almost everywhere.
#[test]
fn a03_zero_variance_pilot() {
    let field = |_: [u32; 2], u: [f32; 4]| [f32::from(u8::from(u[1] < 1e-3)); 3];
    let size = frame(64, 64);
    let means = |policy| -> (f64, f64) {
        let runs: Vec<f64> = (0..32)
            .map(|seed| {
                let mut sampler = variance_sampler(policy, 2, 500 + seed);
                let film = run(&mut Field(field), &mut sampler, Needs::none(), size, &Limits::samples(32 * 4096));
                let film = film.unwrap();
                let alone = (0..4096).filter(|&i| film.count(i) <= 4).count();
                assert_eq!(alone, 0, "{policy:?}: {alone} pixels were stopped by a pilot without variance");
                picture_mean(&film)
            })
            .collect();
        let mean = runs.iter().sum::<f64>() / 32.0;
        (mean, (runs.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / 31.0 / 32.0).sqrt())
    };
    for policy in [Pilot::Discard, Pilot::Cross] {
        let (mean, error) = means(policy);
        assert!((mean - 1e-3).abs() < 5.0 * error, "{policy:?}: {mean} +- {error}");
    }
}

#[test]
fn a04_constant_pictures_are_sampled_uniformly() {
    for value in [0.0, 0.5, 1e30] {
        for policy in [Pilot::Keep, Pilot::Discard, Pilot::Cross] {
            let size = frame(13, 11);
            for total in [4 * 143, 10 * 143 + 7, 33 * 143 + 1] {
                let mut sampler = Variance::with_options(
                    Independent::new(1),
                    VarianceOptions { policy, ..VarianceOptions::default() },
                )
                .unwrap();
                let limits = Limits::samples(total);
                let film = run(&mut Field(|_, _| [value; 3]), &mut sampler, Needs::none(), size, &limits).unwrap();
                let counts = film.counts();
                let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
                // A pixel's halves may each differ by one.
                let allowed = if policy == Pilot::Cross { 2 } else { 1 };
                assert!(most - least <= allowed, "{value}, {policy:?}, {total}: {least} .. {most}");
                assert_eq!(film.record().samples, total);
                assert!(film.picture().iter().flatten().all(|x| *x == value));
            }
        }
    }
}
