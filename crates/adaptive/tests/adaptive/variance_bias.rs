//! The bias of each policy of the preset `variance`, checked against closed forms. The naive rule is the control and
//! must be caught.

use crate::common::*;
use dapple_adaptive::{Adaptive, PilotPolicy, VarianceOptions};
use dapple_conformance::statistics::{Bernoulli, FAMILY, Mean, Naive, Verdict, critical, image_mean, kept, power};
use dapple_core::{Feedback, Integrator, Limits, Needs, Plan, Progress, Retention, Sampler};
use dapple_low_discrepancy::Random;

const P: f32 = 0.1;

/// The mean over pixels and its standard error between 64 replicates of `side` x `side` pixels (128: 2^20 in total).
/// The budget couples counts within a replicate, so only replicates are independent.
fn measure<S: Sampler>(make: impl Fn(u64) -> S, spp: u64, side: u32) -> Mean {
    means_of(&mut Bernoulli(P), make, spp, side)
}

fn means_of<S: Sampler>(scene: &mut dyn Integrator, make: impl Fn(u64) -> S, spp: u64, side: u32) -> Mean {
    let size = frame(side, side);
    let limits = Limits::samples(spp * size.pixels() as u64);
    (0..64).map(|seed| image_mean(&run(scene, &mut make(seed), size, &limits).unwrap())).collect()
}

/// The deviation in standard errors. With 63 degrees of freedom, 5 is exceeded with p = 5e-6 per test, 10 with p <
/// 1e-13.
fn deviation(mean: Mean) -> f64 {
    mean.deviation(f64::from(P))
}

fn variance_sampler(policy: PilotPolicy, radius: u32, seed: u64) -> Adaptive<Random> {
    let options = VarianceOptions::default().policy(policy).radius(radius).pilot(4);
    Adaptive::variance_with_options(Random::new(seed), options).unwrap()
}

#[test]
fn discarding_and_crossing_are_unbiased_on_fewer_pixels_a01() {
    check_discarding_and_crossing(64);
}

#[test]
#[ignore = "4 s: 2^20 pixels; 2^18 are tested always"]
fn discarding_and_crossing_are_unbiased_a01() {
    check_discarding_and_crossing(128);
}

fn check_discarding_and_crossing(side: u32) {
    for policy in [PilotPolicy::Discard, PilotPolicy::Cross] {
        for radius in [0, 1] {
            let got = measure(|seed| variance_sampler(policy, radius, 100 + seed), 10, side);
            assert!(deviation(got).abs() < 5.0, "{policy:?}, radius {radius}: {got:?}");
        }
    }
}

/// The default policy is biased, detectably if a pixel decides alone.
#[test]
fn keeping_is_biased_a01() {
    let got = measure(|seed| variance_sampler(PilotPolicy::Keep, 0, 200 + seed), 10, 64);
    assert!(deviation(got) < -10.0, "{got:?}");
}

#[test]
fn the_naive_rule_is_caught_and_meets_its_closed_form_a01() {
    let closed = kept(P.into(), 4, 64);
    assert!((closed - 0.038575).abs() < 1e-6, "{closed}");
    let mean = measure(|seed| Naive { points: Random::new(300 + seed), pilot: 4, total: 64 }, 64, 64);
    assert!(mean.against(P.into()).p() < 1e-12, "the naive rule is not caught: {mean:?}");
    assert!(mean.against(closed).p() > FAMILY, "{mean:?} instead of {closed}");
    // With 2^20 pixels the tests of the unbiased policies detect a bias of 3 %. The naive rule's is 61 %.
    let got = measure(|seed| variance_sampler(PilotPolicy::Discard, 0, 100 + seed), 10, 128);
    let power = power(0.03 * f64::from(P) / got.standard_error(), 5e-6, 63.0);
    assert!(power > 0.99, "{power}: {got:?}");
}

/// Samples of mean 1 with a heavy tail: `exp(1.5 z - 1.125)` for a normal z [after Box and Muller 1958].
fn lognormal(_: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    let z = (-2.0 * (1.0 - u[0]).ln()).sqrt() * (std::f32::consts::TAU * u[1]).cos();
    [(1.5 * z - 1.125).exp(); 3]
}

/// Low runs look converged: stopping at a relative standard error of 0.2, one sample at a time from 16 on, loses a
/// tenth.
#[test]
fn heavy_tails_stop_early_a02() {
    let stops = |seed: u64| {
        let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
            plan.retention = Retention::Keep;
            for (i, n) in plan.counts.iter_mut().enumerate() {
                let moments = seen.film.moments(i);
                let count = moments.count as f64;
                let error = moments.variance().map_or(0.0, |v| (v[0] / count).sqrt());
                *n = if seen.round == 0 { 16 } else { u32::from(error >= 0.2 * moments.mean[0] && count < 400.0) };
            }
            if plan.total() > 0 { Progress::Trace } else { Progress::Done }
        };
        Planned { points: Random::new(600 + seed), needs: Needs::none().with_variance(), plan }
    };
    let naive = means_of(&mut Field(lognormal), stops, 400, 16);
    assert!((0.85..0.95).contains(&naive.mean) && naive.deviation(1.0) < -10.0, "{naive:?}");
    for policy in [PilotPolicy::Discard, PilotPolicy::Cross] {
        let got = means_of(&mut Field(lognormal), |seed| variance_sampler(policy, 0, 700 + seed), 16, 64);
        assert!(got.against(1.0).p() > FAMILY, "{policy:?}: {got:?}");
    }
}

/// The unbiased policies are equal within 0.3 %, by an equivalence test of 3e7 samples per policy.
#[test]
#[ignore = "T2: 6e7 samples"]
fn heavy_tails_leave_unbiased_policies_within_a_third_of_a_percent_a02() {
    for policy in [PilotPolicy::Discard, PilotPolicy::Cross] {
        let got = means_of(&mut Field(lognormal), |seed| variance_sampler(policy, 0, 800 + seed), 32, 128);
        // Student's quantile with 63 degrees of freedom is 1.044 of the normal one.
        let verdict = got.equals(1.0, 0.003, 1.05 * critical(1e-3));
        assert_eq!(verdict, Verdict::Pass, "{policy:?}: {got:?}");
    }
}

/// With one sample of a million in a dim image, no pixel takes more than its cap, and no other less than a kept pilot.
#[test]
fn one_firefly_takes_no_more_than_its_cap_a12() {
    let firefly = |pixel: [u32; 2], u: [f32; 4]| [if pixel == [7, 9] && u[3] < 0.2 { 1e6 } else { 0.5 + u[0] }; 3];
    let size = frame(24, 24);
    let most_of = |mut sampler: Adaptive<Random>| {
        let film = run(&mut Field(firefly), &mut sampler, size, &Limits::samples(32 * 576)).unwrap();
        film.counts().into_iter().max().unwrap()
    };
    for policy in [PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross] {
        for radius in [0, 2] {
            let options = VarianceOptions::default().policy(policy).radius(radius).pilot(4).cap(2.0);
            for seed in 0..20 {
                let mut sampler = Adaptive::variance_with_options(Random::new(seed), options).unwrap();
                let limits = Limits::samples(32 * 576);
                let film = run(&mut Field(firefly), &mut sampler, size, &limits).unwrap();
                let counts = film.counts();
                // A discarded pilot is not in the image: all of its samples are traced, and at least one more.
                let least = if policy == PilotPolicy::Discard { 1 } else { 4 };
                let traced = |i: usize| film.discarded(i).count + counts[i];
                assert!((0..576).all(|i| traced(i) >= 4 + u64::from(policy == PilotPolicy::Discard)), "{policy:?}");
                // The cap is 2 times the mean; halves may each be one sample above.
                assert!(counts.iter().all(|n| (least..=2 * 32 + 2).contains(n)), "{policy:?}, {radius}: {counts:?}");
                assert_eq!(film.record().samples, 32 * 576);
            }
        }
    }
    // Negative control: under a higher cap one pixel takes more, in some images.
    let most = (0..20).map(|seed| most_of(variance_sampler(PilotPolicy::Keep, 0, seed)));
    assert!(most.max() > Some(2 * 32 + 2));
}

/// Halves that decide for each other are unbiased only if averaged equally.
#[test]
fn crossing_with_weights_by_count_is_caught_a01() {
    let by_count = |seed| {
        let mut inner = variance_sampler(PilotPolicy::Cross, 0, 400 + seed);
        let needs = inner.needs();
        let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
            let progress = inner.next_round(seen, plan).unwrap();
            plan.combine = dapple_core::Combine::ByCount;
            progress
        };
        Planned { points: Random::new(400 + seed), needs, plan }
    };
    let got = measure(by_count, 10, 64);
    assert!(deviation(got).abs() > 10.0, "{got:?}");
}

/// Only one sample in 1000 sees the light, so almost every pilot is black.
#[test]
fn a_pilot_without_variance_stops_no_pixel_a03() {
    let field = |_: [u32; 2], u: [f32; 4]| [f32::from(u8::from(u[1] < 1e-3)); 3];
    let size = frame(64, 64);
    let means = |policy| -> Mean {
        let runs: Vec<f64> = (0..32)
            .map(|seed| {
                let mut sampler = variance_sampler(policy, 2, 500 + seed);
                let film = run(&mut Field(field), &mut sampler, size, &Limits::samples(32 * 4096));
                let film = film.unwrap();
                let alone = (0..4096).filter(|&i| film.count(i) <= 4).count();
                assert_eq!(alone, 0, "{policy:?}: {alone} pixels were stopped by a pilot without variance");
                image_mean(&film)
            })
            .collect();
        runs.into_iter().collect()
    };
    // A pixel with a black pilot keeps its floor, even if a few bright pixels could take all samples.
    for policy in [PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross] {
        let options = VarianceOptions::default().policy(policy).pilot(4).cap(20.0);
        let mut sampler = Adaptive::variance_with_options(Random::new(500), options).unwrap();
        let film = run(&mut Field(field), &mut sampler, size, &Limits::samples(64 * 4096)).unwrap();
        let least = film.counts().into_iter().min().unwrap();
        assert!(least > 4, "{policy:?}: {least}");
    }
    for policy in [PilotPolicy::Discard, PilotPolicy::Cross] {
        let mean = means(policy);
        assert!(mean.deviation(1e-3).abs() < 5.0, "{policy:?}: {mean:?}");
    }
}

#[test]
fn constant_images_are_sampled_uniformly_a04() {
    for value in [0.0, 0.5, 1e30] {
        for policy in [PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross] {
            let size = frame(13, 11);
            for total in [4 * 143, 10 * 143 + 7, 33 * 143 + 1] {
                let mut sampler =
                    Adaptive::variance_with_options(Random::new(1), VarianceOptions::default().policy(policy)).unwrap();
                let limits = Limits::samples(total);
                let film = run(&mut Field(|_, _| [value; 3]), &mut sampler, size, &limits).unwrap();
                let counts = film.counts();
                let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
                // A pixel's halves may each differ by one.
                let allowed = if policy == PilotPolicy::Cross { 2 } else { 1 };
                assert!(most - least <= allowed, "{value}, {policy:?}, {total}: {least} .. {most}");
                assert_eq!(film.record().samples, total);
                assert!(film.image().iter().flatten().all(|x| *x == value));
            }
        }
    }
}
