//! The bias of each policy of the error-driven sampler and of its preset `variance`, checked against closed forms. The bias of
//! [`PilotPolicy::Keep`] is the control and must be caught [Kirk and Arvo 1991].

use crate::support::*;
use dapple_adaptive::{Adaptive, AdaptiveOptions, PilotPolicy, PoolShape, VarianceOptions};
use dapple_conformance::statistics::{
    Bernoulli, BiasedSampler, FAMILY, Mean, Verdict, critical, image_mean, kept, power,
};
use dapple_conformance::toys::{Field, Independent, ToySampler};
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::{Block, Draws, Estimate, Integrator, Limits, Needs, Render, Sampler, SurfaceFeatures, Worker};
use dapple_low_discrepancy::Random;

const P: f32 = 0.1;
/// The probability of light where it is rare.
const RARE: f32 = 0.02;

/// The side of images whose policies are compared with expected values: 2^17 pixels in 64 replicates.
const SIDE: u32 = 48;

/// The mean over pixels and its standard error between 64 replicates of `side` x `side` pixels, whose films
/// record `needs`. The budget couples counts within a replicate, so only replicates are independent.
fn means_of<S: Sampler>(
    scene: &mut dyn Integrator,
    needs: Needs,
    make: impl Fn(u64) -> S,
    (spp, side): (u64, u32),
) -> Mean {
    let size = frame(side, side);
    let limits = Limits::samples(spp * size.pixels() as u64);
    let mean = |seed| image_mean(&Render::new(size, &limits).needs(needs).run(scene, &mut make(seed)).unwrap());
    (0..64).map(mean).collect()
}

/// A wall with lamps on it, far smaller than a pixel: a sample meets a lamp with this probability.
struct Lamps(f32);

impl Integrator for Lamps {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, ..] = draws.block(Block::new(0));
        let lit = u < self.0;
        let normal = if lit { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        Estimate::new([f32::from(u8::from(lit)); 3]).with_features(SurfaceFeatures::new([0.0; 3], normal, 1.0))
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(self.estimate(draws, &mut Worker::default()))
    }
}

/// The light of a pixel: chance alone, or lamps that surfaces show.
#[derive(Clone, Copy, Debug)]
enum Light {
    Chance(f32),
    Lamps(f32),
}

/// The deviation of the image's mean from the expected value in standard errors. With 63 degrees of freedom, 5 is exceeded with
/// p = 5e-6 and 10 with p < 1e-13.
fn deviation(light: Light, options: AdaptiveOptions, side: u32) -> f64 {
    let make = |seed: u64| Adaptive::with_options(Random::new(700 + seed), options).unwrap();
    match light {
        Light::Chance(p) => means_of(&mut Bernoulli(p), Needs::none(), make, (10, side)).deviation(p.into()),
        // As for a filter.
        Light::Lamps(p) => means_of(&mut Lamps(p), Needs::none().with_features(), make, (10, side)).deviation(p.into()),
    }
}

/// Options with the largest bias: a pixel's own variance decides, and counts always adapt.
fn alone(policy: PilotPolicy) -> AdaptiveOptions {
    options().policy(policy).prior(0.0).gain(1.0).pilot(4)
}

fn of_preset(policy: PilotPolicy, radius: u32) -> AdaptiveOptions {
    VarianceOptions::default().policy(policy).radius(radius).pilot(4).into()
}

/// Options for which surfaces tell where the light is.
fn by_surfaces(policy: PilotPolicy) -> AdaptiveOptions {
    options().policy(policy).pool(PoolShape::Similar).gain(1.0)
}

#[test]
fn unbiased_policies_are_unbiased_on_fewer_pixels_a01() {
    check_unbiased(SIDE);
}

#[test]
#[ignore = "20 s: 2^20 pixels; 2^17 are tested always"]
fn unbiased_policies_are_unbiased_a01() {
    check_unbiased(128);
}

/// Discarded and crossed pilots; counts by the neighbours' samples, also where light is rare (one sample in 50 is lit), in the two
/// rounds of the default. Pooled by the own surface, z was -44 for lamps.
fn check_unbiased(side: u32) {
    let of_halves =
        |policy| [alone(policy), alone(policy).prior(6.0).radius(1), of_preset(policy, 0), of_preset(policy, 1)];
    let known = [PilotPolicy::Discard, PilotPolicy::Cross].into_iter().flat_map(of_halves);
    let (beside, surfaces) = (alone(PilotPolicy::Neighbours), by_surfaces(PilotPolicy::Neighbours));
    let more = [
        (Light::Chance(P), beside.rounds(1)),
        (Light::Chance(P), beside.radius(1)),
        (Light::Chance(RARE), beside),
        (Light::Chance(RARE), beside.power(2.0).epsilon(0.3)),
        (Light::Lamps(P), surfaces.epsilon(0.3)),
        (Light::Lamps(P), surfaces),
        (Light::Lamps(RARE), surfaces.epsilon(0.3)),
        (Light::Chance(RARE), surfaces.pilot(1)),
        (Light::Lamps(P), surfaces.pilot(1)),
        (Light::Lamps(RARE), surfaces.pilot(1).epsilon(0.3)),
        (Light::Lamps(RARE), surfaces.pilot(2).epsilon(0.3)),
    ];
    for (light, options) in known.map(|options| (Light::Chance(P), options)).chain(more) {
        let z = deviation(light, options, side);
        assert!(z.abs() < 5.0, "{light:?}, {options:?}: {z} standard errors");
    }
}

#[test]
fn keeping_is_biased_a01() {
    let keep = PilotPolicy::Keep;
    let cases =
        [(Light::Chance(P), alone(keep)), (Light::Chance(P), of_preset(keep, 0)), (Light::Lamps(P), by_surfaces(keep))];
    for (light, options) in cases {
        let z = deviation(light, options, SIDE);
        assert!(z < -10.0, "{light:?}, {options:?}: {z} standard errors");
    }
}

fn variance_sampler(policy: PilotPolicy, radius: u32, seed: u64) -> Adaptive<Random> {
    preset(seed, VarianceOptions::default().policy(policy).radius(radius).pilot(4))
}

#[test]
fn the_naive_rule_is_caught_and_meets_its_closed_form_a01() {
    let closed = kept(P.into(), 4, 64);
    assert!((closed - 0.038575).abs() < 1e-6, "{closed}");
    let naive = |seed| BiasedSampler { points: Random::new(300 + seed), pilot: 4, total: 64 };
    let mean = means_of(&mut Bernoulli(P), Needs::none(), naive, (64, SIDE));
    assert!(mean.against(P.into()).p() < 1e-12, "the naive rule is not caught: {mean:?}");
    assert!(mean.against(closed).p() > FAMILY, "{mean:?} instead of {closed}");
    // With 2^20 pixels the tests of the unbiased policies detect a bias of 3 %. The naive rule's is 61 %.
    let discards = |seed| variance_sampler(PilotPolicy::Discard, 0, 100 + seed);
    let got = means_of(&mut Bernoulli(P), Needs::none(), discards, (10, 128));
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
                *n = if seen.round == 0 { 16 } else { u32::from(error >= 0.2 * moments.mean[0] && count < 200.0) };
            }
            if plan.total() > 0 { Progress::Trace } else { Progress::Done }
        };
        ToySampler { points: Independent::new(600 + seed), needs: Needs::none().with_variance(), plan }
    };
    let naive = means_of(&mut Field(lognormal), Needs::none(), stops, (200, 16));
    assert!((0.85..0.95).contains(&naive.mean) && naive.deviation(1.0) < -10.0, "{naive:?}");
    for policy in [PilotPolicy::Discard, PilotPolicy::Cross] {
        let make = |seed| variance_sampler(policy, 0, 700 + seed);
        let got = means_of(&mut Field(lognormal), Needs::none(), make, (16, SIDE));
        assert!(got.against(1.0).p() > FAMILY, "{policy:?}: {got:?}");
    }
}

/// The unbiased policies are equal within 0.3 %, by an equivalence test of 3e7 samples per policy.
#[test]
#[ignore = "T2: 6e7 samples"]
fn heavy_tails_leave_unbiased_policies_within_a_third_of_a_percent_a02() {
    for policy in [PilotPolicy::Discard, PilotPolicy::Cross] {
        let make = |seed| variance_sampler(policy, 0, 800 + seed);
        let got = means_of(&mut Field(lognormal), Needs::none(), make, (32, 128));
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
    let traced = |mut sampler: Adaptive<Random>| {
        let film = run(&mut Field(firefly), &mut sampler, size, &Limits::samples(32 * 576));
        assert_eq!(film.record().samples, 32 * 576);
        film
    };
    for policy in [PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross] {
        for radius in [0, 2] {
            let options = VarianceOptions::default().policy(policy).radius(radius).pilot(4).cap(2.0);
            for film in (0..20).map(|seed| traced(preset(seed, options))) {
                let counts = film.counts();
                // A discarded pilot is not in the image: all of its samples are traced, and at least one more.
                let least = if policy == PilotPolicy::Discard { 1 } else { 4 };
                let traced = |i: usize| film.discarded(i).count + counts[i];
                assert!((0..576).all(|i| traced(i) >= 4 + u64::from(policy == PilotPolicy::Discard)), "{policy:?}");
                // The cap is 2 times the mean; halves may each be one sample above.
                assert!(counts.iter().all(|n| (least..=2 * 32 + 2).contains(n)), "{policy:?}, {radius}: {counts:?}");
            }
        }
    }
    // Negative control: under a higher cap one pixel takes more, in some images.
    let most = (0..20).flat_map(|seed| traced(variance_sampler(PilotPolicy::Keep, 0, seed)).counts());
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
            plan.combine = dapple_core::plan::Combine::ByCount;
            progress
        };
        ToySampler { points: Independent::new(400 + seed), needs, plan }
    };
    let got = means_of(&mut Bernoulli(P), Needs::none(), by_count, (10, SIDE));
    assert!(got.deviation(P.into()).abs() > 10.0, "{got:?}");
}

/// Only one sample in 1000 sees the light, so almost every pilot is black.
#[test]
fn a_pilot_without_variance_stops_no_pixel_a03() {
    let field = |_: [u32; 2], u: [f32; 4]| [f32::from(u8::from(u[1] < 1e-3)); 3];
    let size = frame(32, 32);
    let counted = |options, seed, spp: u64| {
        let film = run(&mut Field(field), &mut preset(seed, options), size, &Limits::samples(spp * 1024));
        let least = film.counts().into_iter().min();
        assert!(least > Some(4), "{options:?}: a pixel was stopped at {least:?} by a pilot without variance");
        film
    };
    // A pixel with a black pilot keeps its floor, even if a few bright pixels could take all samples.
    for policy in [PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross] {
        let options = VarianceOptions::default().policy(policy).pilot(4);
        counted(options.cap(20.0), 500, 64);
        if policy != PilotPolicy::Keep {
            let mean: Mean = (0..32).map(|seed| image_mean(&counted(options, 500 + seed, 32))).collect();
            assert!(mean.deviation(1e-3).abs() < 5.0, "{policy:?}: {mean:?}");
        }
    }
}

#[test]
fn constant_images_are_sampled_uniformly_a04() {
    for value in [0.0, 0.5, 1e30] {
        for policy in [PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross] {
            let size = frame(13, 11);
            for total in [4 * 143, 10 * 143 + 7, 33 * 143 + 1] {
                let mut sampler = preset(1, VarianceOptions::default().policy(policy));
                let film = run(&mut Field(|_, _| [value; 3]), &mut sampler, size, &Limits::samples(total));
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
