//! Tests of the statistical tests: each accepts true claims at its level, refutes false ones with its power, and rejects its
//! negative control.
//!
//! All data is synthetic, and all seeds are fixed. Bounds on rates are 5 standard deviations of the binomial: 6e-7 each.

use dapple_adaptive::{Adaptive, PilotPolicy, VarianceOptions};
use dapple_conformance::statistics::*;
use dapple_conformance::toys::Independent;
use dapple_core::point_set::mix;
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, Render, Sampler};
use dapple_metrics::student_t_quantile;

/// SplitMix64.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        ((mix(self.0) >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    /// A normal number with mean 0 and variance 1 [after Box and Muller 1958].
    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }

    fn exponential(&mut self) -> f64 {
        -self.uniform().ln()
    }
}

/// Returns `true` if `seen` of `all` agrees with a probability `p`, within 5 standard deviations.
fn is_rate(seen: usize, all: usize, p: f64) -> bool {
    let n = all as f64;
    (seen as f64 - n * p).abs() < 5.0 * (n * p * (1.0 - p)).sqrt() + 1.0
}

/// A path in a closed furnace of albedo 1/2 and emission 1/2, whose expectation is 1. It continues with probability 1/2, so `k`
/// bounces give `(k + 1) / 2`. Each bounce loses the fraction `leak` of the light.
fn furnace(noise: &mut Noise, leak: f64) -> f64 {
    let (mut light, mut throughput) = (0.0, 1.0);
    loop {
        light += 0.5 * throughput;
        if noise.uniform() < 0.5 {
            return light;
        }
        throughput *= 1.0 - leak;
    }
}

/// The loss at each bounce for which half a percent of the light is missing:
/// `1/2 / (1 - (1 - leak)/2) = 1 / (1 + leak) = 0.995`.
const HALF_A_PERCENT: f64 = 0.005 / 0.995;

#[test]
fn tails_agree_with_known_values() {
    // Two-sided critical values at 1 %.
    for (tests, z) in [(10_000, 4.89), (65_536, 5.25), (1920 * 1080, 5.85), (3 * 1920 * 1080, 6.03)] {
        assert!((critical(0.5 * sidak(0.01, tests)) - z).abs() < 0.006, "{tests}");
    }
    for p in [0.3, 1e-3, 1e-9, 1e-60] {
        for v in [1.0, 15.0, 63.0, 1e4] {
            let t = -student_t_quantile(p, v);
            assert!((student_tail(t, v) / p - 1.0).abs() < 1e-9, "{p} {v}");
        }
        assert!((normal_tail(-student_t_quantile(p, f64::INFINITY)) / p - 1.0).abs() < 1e-9, "{p}");
    }
    assert_eq!([student_tail(0.0, 3.0), student_tail(f64::INFINITY, 3.0)], [0.5, 0.0]);
    for p in [1e-9, 1e-3, 0.2] {
        assert!((adjusted(sidak(p, 1000), 1000) / p - 1.0).abs() < 1e-9);
    }
    // Standard normal deviates with about the probability of t.
    let test = |t: f64, v: f64| MeanTest { difference: t, standard_error: 1.0, degrees_of_freedom: v };
    for (t, v) in [(0.5, 15.0), (2.0, 15.0), (5.0, 30.0), (9.0, 15.0)] {
        let (z, p) = (test(t, v).z(), test(t, v).p());
        let exact = critical(0.5 * p);
        assert!((z / exact - 1.0).abs() < 0.01, "{t} {v}: {z} {exact}");
    }
}

#[test]
fn means_are_tested_at_their_level_and_power() {
    let mut noise = Noise(1);
    let (mut false_alarms, mut welch) = (0, 0);
    for _ in 0..2000 {
        let a: Mean = (0..16).map(|_| noise.normal()).collect();
        let b: Mean = (0..24).map(|_| 3.0 * noise.normal()).collect();
        false_alarms += usize::from(a.against(0.0).p() < 0.01);
        welch += usize::from(a.against_estimate(&b).p() < 0.01);
    }
    assert!(is_rate(false_alarms, 2000, 0.01), "{false_alarms}");
    assert!(is_rate(welch, 2000, 0.01), "{welch}");
    // The observed power agrees with the computed one if that is neither 0 nor 1.
    let mut seen = 0;
    for _ in 0..2000 {
        let a: Mean = (0..16).map(|_| noise.normal() + 1.0).collect();
        seen += usize::from(a.against(0.0).p() < 0.01);
    }
    let power = power(4.0, 0.01, 15.0);
    assert!((power - seen as f64 / 2e3).abs() < 0.04, "{power} {seen}");
    // Without spread, means are equal or different.
    let same: Mean = [2.0; 16].into_iter().collect();
    assert_eq!([same.against(2.0).p(), same.against(2.0 + 1e-15).p()], [1.0, 0.0]);
}

/// A furnace that loses 0.5 % fails at the level of a thousand tests in a family of 1e-6, and a sound one passes.
#[test]
fn a_mean_shows_a_leak_of_half_a_percent() {
    let level = sidak(FAMILY, 1000);
    let replicates = |leak: f64, seed: u64| -> Mean {
        let mut noise = Noise(seed);
        (0..64).map(|_| (0..50_000).map(|_| furnace(&mut noise, leak)).sum::<f64>() / 5e4).collect()
    };
    let sound = replicates(0.0, 2).against(1.0);
    assert!(sound.p() > level, "{sound:?}");
    // The power, from the variance of a path, which is 1/2.
    let power = power(0.005 / (0.5_f64 / 64.0 / 5e4).sqrt(), level, 63.0);
    assert!(power > 0.999, "{power}");
    let leaking = replicates(HALF_A_PERCENT, 3).against(1.0);
    assert!((leaking.difference + 0.005).abs() < 5.0 * leaking.standard_error, "{leaking:?}");
    assert!(leaking.p() < level, "{leaking:?}");
}

const WIDTH: usize = 64;
const PIXELS: usize = 64 * 56;

/// 16 replicates of a 64x56 image: exponential noise of mean 1 on a gradient, partly shared over the image.
fn made_up(seed: u64, edit: impl Fn(usize, &mut [f64; 3])) -> Vec<Vec<[f64; 3]>> {
    (0..16)
        .map(|r| {
            let mut noise = Noise(mix(seed) ^ mix(r + 99));
            let weather = 0.05 * noise.normal();
            let mut image: Vec<[f64; 3]> = (0..PIXELS)
                .map(|i| {
                    let level = 1.0 + 0.02 * (i % WIDTH) as f64;
                    let grey = level * noise.exponential() + weather;
                    [grey, grey + 0.1 * noise.normal(), level * noise.exponential()]
                })
                .collect();
            image.iter_mut().enumerate().for_each(|(i, p)| edit(i, p));
            image
        })
        .collect()
}

#[test]
fn images_are_tested_at_their_level() {
    let nothing = |_: usize, _: &mut [f64; 3]| {};
    let exact: Vec<[f64; 3]> = (0..PIXELS).map(|i| [1.0 + 0.02 * (i % WIDTH) as f64; 3]).collect();
    // Correct images raise no alarm at a family's level, and few at 5 %.
    let mut low = [0; 2];
    for seed in 0..30 {
        let two = images(WIDTH, &made_up(2 * seed, nothing), &made_up(2 * seed + 1, nothing));
        let one = image(WIDTH, &made_up(2 * seed, nothing), &exact);
        for (low, test) in low.iter_mut().zip([two, one]) {
            assert!(test.p() > FAMILY, "{seed}: {test:?}");
            *low += usize::from(test.p() < 0.05);
        }
    }
    // The tails of the pooled figures are approximate: at most twice the nominal rate.
    assert!(low.iter().all(|&low| low <= 8), "{low:?} of 30 below 5 %");

    let sound = made_up(1001, nothing);
    let against = |edit: &dyn Fn(usize, &mut [f64; 3])| images(WIDTH, &made_up(1000, edit), &sound);
    // One block of 56 has half its brightness.
    let block = against(&|i, p| {
        if i % WIDTH < 8 && i / WIDTH < 8 {
            *p = p.map(|v| v * 0.5);
        }
    });
    assert!(block.blocks < FAMILY && block.p() < FAMILY, "{block:?}");
    // Every block is off by 1.5 standard errors, half up, half down: no block is an outlier, and the mean is right.
    let chequered = against(&|i, p| {
        let up = (i % WIDTH / 8 + i / WIDTH / 8).is_multiple_of(2);
        *p = p.map(|v| v + if up { 0.14 } else { -0.14 });
    });
    assert!(chequered.spread < 1e-4 && chequered.global > 1e-3, "{chequered:?}");
    // With the same seeds on both sides the images hardly differ.
    let shared = images(WIDTH, &made_up(1001, |_, p| p[0] += 1e-9), &sound);
    assert!(shared.spread < FAMILY && shared.p() < FAMILY, "{shared:?}");
    // Blocks without spread must be equal.
    let flat = vec![vec![[1.0; 3]; PIXELS]; 4];
    let mut off = flat.clone();
    off.iter_mut().for_each(|p| p[5][1] += 1e-12);
    assert_eq!(images(WIDTH, &flat, &flat).blocks, 1.0);
    assert_eq!(images(WIDTH, &off, &flat).p(), 0.0);
}

/// Half a percent of the light is missing everywhere. No block shows it, but the image's mean does, with the stated
/// power.
#[test]
fn an_image_shows_a_leak_of_half_a_percent() {
    let images_of = |leak: f64, seed: u64| -> Vec<Vec<[f64; 3]>> {
        let mut noise = Noise(seed);
        let mut pixel = || [0; 3].map(|_| (0..64).map(|_| furnace(&mut noise, leak)).sum::<f64>() / 64.0);
        (0..64).map(|_| (0..32 * 32).map(|_| pixel()).collect()).collect()
    };
    let [sound, other, leaking] = [(0.0, 4), (0.0, 5), (HALF_A_PERCENT, 6)].map(|(leak, seed)| images_of(leak, seed));
    let error = (2.0 * 0.5_f64 / 64.0 / 64.0 / 1024.0).sqrt();
    let power = power(0.005 / error, sidak(FAMILY, 3 * 4), 126.0);
    assert!(power > 0.999, "{power}");
    assert!(images(32, &sound, &other).p() > FAMILY);
    let seen = images(32, &leaking, &other);
    assert!(seen.global < FAMILY && seen.p() < FAMILY && seen.blocks > FAMILY, "{seen:?}");
}

#[test]
fn samples_of_another_density_fail_the_chi_square_test() {
    // The density 2x on the unit interval, sampled as sqrt(u).
    let expected: Vec<f64> = (0..50).map(|i| 1e4 * f64::from(2 * i + 1) / 2500.0).collect();
    let drawn = |noise: &mut Noise, power: f64| {
        let mut counts = vec![0u64; 50];
        (0..10_000).for_each(|_| counts[(noise.uniform().powf(power) * 50.0) as usize] += 1);
        chi_square(&counts, &expected)
    };
    let mut noise = Noise(7);
    let low = (0..1000).filter(|_| drawn(&mut noise, 0.5) < 0.05).count();
    assert!(is_rate(low, 1000, 0.05), "{low}");
    // Negative controls: another density, and a sample where the density is 0.
    assert!(drawn(&mut noise, 0.45) < FAMILY);
    assert_eq!(chi_square(&[1, 10], &[0.0, 11.0]), 0.0);
    assert!((integrate(&|x, y| x * x * y, [0.0, 1.0], [0.0, 2.0], 1e-9, 8) - 2.0 / 3.0).abs() < 1e-9);
}

const P: f64 = 0.1;

fn lit(sampler: &mut dyn Sampler, side: u32, spp: u64) -> Film {
    let frame = Frame::new(side, side).expect("a frame");
    let limits = Limits::samples(spp * frame.pixels() as u64);
    Render::new(frame, &limits).run(&mut Bernoulli(P as f32), sampler).expect("a film")
}

fn alone(policy: PilotPolicy, seed: u64) -> Adaptive<Independent> {
    let options = VarianceOptions::default().policy(policy).radius(0).pilot(4);
    Adaptive::variance_with_options(Independent::new(seed), options).expect("sound options")
}

#[test]
fn the_naive_rule_is_rejected_as_biased() {
    let closed = kept(P, 4, 64);
    assert!((closed - 0.038_575).abs() < 1e-6 && (kept(0.01, 16, 256) - 0.002_017_58).abs() < 1e-8);
    assert!((refined(0.2, 2) - (3.0 * 0.04 - 2.0 * 0.008)).abs() < 1e-12, "3 p^2 - 2 p^3");
    let films = |make: &dyn Fn(u64) -> Box<dyn Sampler>| -> (Mean, Vec<Pixels>) {
        let films: Vec<Film> = (0..64).map(|seed| lit(&mut *make(seed), 32, 64)).collect();
        (films.iter().map(image_mean).collect(), films.iter().map(Pixels::of).collect())
    };
    let (mean, pixels) = films(&|seed| Box::new(BiasedSampler { points: Independent::new(seed), pilot: 4, total: 64 }));
    assert!(mean.against(P).p() < 1e-12, "{mean:?}");
    assert!(mean.against(closed).p() > FAMILY, "{mean:?} for {closed}");
    assert!(two_sided(count_trend(&pixels)) < 1e-12, "counts tell of values");
    // The power for a twentieth of the bias.
    let power = power(0.05 * (closed - P) / mean.standard_error(), 1e-6, 63.0);
    assert!(power > 0.999, "{power}, standard error {}", mean.standard_error());
    for policy in [PilotPolicy::Discard, PilotPolicy::Cross] {
        let (mean, pixels) = films(&|seed| Box::new(alone(policy, 1000 + seed)));
        assert!(mean.against(f64::from(P as f32)).p() > FAMILY, "{policy:?}: {mean:?}");
        let trend = count_trend(&pixels);
        // If each half decides the other's count, a half's samples correlate with the other half's count, which is part of the
        // sum.
        assert!(policy == PilotPolicy::Cross || two_sided(trend) > FAMILY, "{policy:?}: {trend}");
    }
    let (_, pixels) = films(&|seed| Box::new(Uniform::new(Independent::new(2000 + seed))));
    assert_eq!(count_trend(&pixels), 0.0, "counts that never differ");
}

/// Scaling by a power of two scales every bit of the image; scaling by another number does not.
#[test]
fn scaling_by_a_power_of_two_scales_every_bit() {
    struct Scaled(f32);
    impl dapple_core::Integrator for Scaled {
        fn estimate(&self, draws: &dapple_core::Draws<'_>, _: &mut dapple_core::Worker) -> dapple_core::Estimate {
            let [u, v, ..] = draws.block(dapple_core::Block::new(0));
            dapple_core::Estimate::new([u, u * v, v].map(|x| self.0 * x))
        }
    }
    let film = |scale: f32, seed: u64| {
        let frame = Frame::new(9, 7).expect("a frame");
        let sampler = &mut Uniform::new(Independent::new(seed));
        let limits = Limits::samples(1000);
        Render::new(frame, &limits).run(&mut Scaled(scale), sampler).expect("a film")
    };
    let scaled =
        |by: f64, film: &Film| -> Vec<[u64; 3]> { (0..63).map(|i| film.mean(i).map(|x| (x * by).to_bits())).collect() };
    let plain = film(1.0, 1);
    for k in [-30, -1, 7, 30] {
        let by = f64::from(k).exp2();
        assert_eq!(scaled(1.0, &film(by as f32, 1)), scaled(by, &plain), "2^{k}");
    }
    assert_ne!(scaled(1.0, &film(3.0, 1)), scaled(3.0, &plain));
    assert_eq!(dapple_conformance::bits(&film(1.0, 1)), dapple_conformance::bits(&plain));
    assert_ne!(dapple_conformance::bits(&film(1.0, 2)), dapple_conformance::bits(&plain));
}
