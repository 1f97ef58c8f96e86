//! Homogeneous media: transmittance, distances, the phase function, single scattering and a white furnace, all
//! against closed forms.
#![allow(clippy::print_stderr)]

use crate::statistics::directions::Cone;
use crate::statistics::{FAMILY, Mean, Verdict, critical, integrate, sidak};
use dapple_renderer::medium::{HenyeyGreenstein, Media, Medium, MediumEvent};
use dapple_scene as scene;
use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use std::f64::consts::PI;

const TESTS: usize = 256;

fn described(absorption: [f32; 3], scattering: [f32; 3], g: f32) -> scene::Medium {
    let source = scene::Source { file: std::sync::Arc::new("made.pbrt".into()), line: 9 };
    scene::Medium { name: "fog".into(), absorption, scattering, g, source }
}

fn medium(absorption: [f32; 3], scattering: [f32; 3], g: f32) -> Medium {
    *Media::new(&[described(absorption, scattering, g)], 1.0).expect("sound").medium(0)
}

/// Equivalence of a channel's mean, one-sided 1e-6 over all tests of this file.
fn check(name: &str, found: &Mean, reference: f64, delta: f64) {
    let verdict = found.equals(reference, delta, critical(sidak(FAMILY, TESTS)));
    eprintln!("{name}: {:.6} +- {:.1e} of {reference:.6}: {verdict:?}", found.mean, found.standard_error());
    assert_eq!(verdict, Verdict::Pass, "{name}: {found:?} {reference}");
}

#[test]
fn transmittance_is_exact() {
    let (absorption, scattering) = ([0.1, 1.0, 0.0], [0.3, 20.0, 0.0]);
    for exponent in [-20, -1, 0, 3, 30] {
        let scale = f64::from(exponent).exp2();
        let media = Media::new(&[described(absorption, scattering, 0.0)], scale).expect("sound");
        for length in [0.0, 1e-6, 0.03, 1.0, 2.5, 1e2, 1e9] {
            let found = media.medium(0).transmittance((length * scale) as f32);
            for c in 0..3 {
                let depth = (f64::from(absorption[c]) + f64::from(scattering[c])) * length;
                let exact = (-depth).exp();
                // The depth is rounded twice; the exponential itself is exact to 2e-7.
                let slack = exact * (2e-7 + 2e-7 * depth) + 1e-37;
                assert!((f64::from(found[c]) - exact).abs() <= slack, "{scale} {length} {c}: {found} {exact}");
            }
        }
        assert_eq!(media.medium(0).transmittance(f32::INFINITY), Vec3::Z);
    }
    let gray = medium([0.2; 3], [0.3; 3], 0.0);
    assert!((gray.transmittance(2.0) - Vec3::splat((-1.0_f32).exp())).abs().max_element() < 2e-7);
}

/// Fractions of distances that pass, scatter before the middle, and scatter after it, channel by channel.
#[test]
fn distances_add_up() {
    let cases = [
        ("gray", [0.5; 3], [1.0; 3], Vec3::ONE),
        ("chromatic", [0.1, 0.5, 0.0], [0.2, 1.5, 4.0], Vec3::ONE),
        ("chromatic, reddish path", [0.1, 0.5, 0.0], [0.2, 1.5, 4.0], Vec3::new(1.0, 0.05, 1e-6)),
        ("one channel clear", [0.0, 1.0, 0.3], [0.0, 1.0, 0.0], Vec3::new(0.5, 1.0, 2.0)),
        ("one channel dark", [0.2; 3], [0.5, 2.0, 1.0], Vec3::new(0.0, 3.0, 1.0)),
    ];
    let limit = 1.3_f32;
    for (number, (name, absorption, scattering, throughput)) in cases.into_iter().enumerate() {
        let medium = medium(absorption, scattering, 0.0);
        assert!(medium.scatters());
        let mut random = Pcg32::seed_from_u64(number as u64);
        let mut means = [[Mean::default(); 3]; 3];
        let bound = 1.003 * throughput.element_sum();
        for _ in 0..1_000_000 {
            let event = medium.sample(limit, random.random(), random.random(), throughput);
            let (part, weight) = match event {
                MediumEvent::Pass { weight } => (2, weight),
                MediumEvent::Scatter { t, weight } => {
                    assert!((0.0..limit).contains(&t), "{t}");
                    (usize::from(t > 0.5 * limit), weight)
                }
            };
            assert!(weight.is_finite() && weight.min_element() >= 0.0, "{name}: {event:?}");
            assert!((weight * throughput).max_element() <= bound, "{name}: {event:?}");
            if name == "gray" {
                let expected = if part == 2 { 1.0 } else { 1.0 / 1.5 };
                assert!((weight - Vec3::splat(expected)).abs().max_element() < 3e-7, "{event:?}");
            }
            for (i, mean) in means.iter_mut().enumerate() {
                (0..3).for_each(|c| mean[c].add(if i == part { f64::from(weight[c] * throughput[c]) } else { 0.0 }));
            }
        }
        for c in 0..3 {
            let [a, s] = [absorption[c], scattering[c]].map(f64::from);
            let through = |t: f64| (-(a + s) * t).exp();
            let albedo = if a + s > 0.0 { s / (a + s) } else { 0.0 };
            let [half, whole] = [0.5, 1.0].map(|share| through(f64::from(limit) * share));
            let expected = [albedo * (1.0 - half), albedo * (half - whole), whole];
            for (i, expected) in expected.into_iter().enumerate() {
                let beta = f64::from(throughput[c]);
                let slack = 0.01 * f64::from(throughput.element_sum());
                if means[i][c].standard_error() == 0.0 {
                    assert!((means[i][c].mean - beta * expected).abs() < 1e-6, "{name}, {i}, {c}");
                } else {
                    check(&format!("{name}, part {i}, channel {c}"), &means[i][c], beta * expected, slack);
                }
            }
        }
    }
}

/// Distances are finite for extreme limits, coordinates and throughputs.
#[test]
fn distances_at_the_ends() {
    let ends = [0.0, 1e-30, 0.5, 1.0 - 0.5 * f32::EPSILON];
    let coefficients = [[0.0; 3], [1e-30, 1.0, 1e30], [1e30; 3], [0.0, 1e-38, 3e37], [5.0, 0.0, 0.0]];
    for absorption in coefficients {
        for scattering in coefficients {
            let medium = medium(absorption, scattering, 0.3);
            for limit in [1e-30, 1.0, 1e30, f32::INFINITY] {
                for [u, v] in ends.into_iter().flat_map(|u| ends.map(|v| [u, v])) {
                    for throughput in [Vec3::ONE, Vec3::ZERO, Vec3::new(1e-38, 1.0, 1e38), Vec3::new(0.0, 0.0, 1.0)] {
                        let event = medium.sample(limit, u, v, throughput);
                        let weight = match event {
                            MediumEvent::Pass { weight } => weight,
                            MediumEvent::Scatter { t, weight } => {
                                assert!(t < limit);
                                weight
                            }
                        };
                        assert!(weight.is_finite() && weight.min_element() >= 0.0, "{medium:?} {limit} {event:?}");
                    }
                }
            }
        }
    }
}

/// Single scattering in a slab, of parallel light that enters where the ray does, at a slant. Its closed form is
/// `s p (1 - exp(-e L (1 + 1/mu))) / (e (1 + 1/mu))`.
#[test]
fn single_scattering_in_a_slab() {
    let (absorption, scattering, g) = ([0.1, 0.5, 0.0], [0.2, 1.5, 4.0], 0.4);
    let (length, mu) = (1.7_f64, 0.6_f64);
    let medium = medium(absorption, scattering, g);
    let travel = Vec3::Z;
    // Towards the light, which lies before the slab.
    let wi = Vec3::new((1.0 - mu * mu).sqrt() as f32, 0.0, -mu as f32);
    let mut random = Pcg32::seed_from_u64(4);
    let mut means = [Mean::default(); 3];
    for _ in 0..1_000_000 {
        let value = match medium.sample(length as f32, random.random(), random.random(), Vec3::ONE) {
            MediumEvent::Pass { .. } => Vec3::ZERO,
            MediumEvent::Scatter { t, weight } => {
                weight * medium.transmittance(t / mu as f32) * medium.phase().evaluate(travel, wi)
            }
        };
        (0..3).for_each(|c| means[c].add(f64::from(value[c])));
    }
    for c in 0..3 {
        let [a, s] = [absorption[c], scattering[c]].map(f64::from);
        // The cosine between light and ray is mu: the light comes from the front and scatters backwards.
        let cosine = -mu;
        let g = f64::from(0.4_f32);
        let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5));
        let depth = (a + s) * (1.0 + 1.0 / mu);
        let closed = s * phase * (1.0 - (-depth * length).exp()) / depth;
        let by_rule = |z: f64, _: f64| s * phase * (-depth * z).exp();
        let numeric = integrate(&by_rule, [0.0, length], [0.0, 1.0], 1e-10, 8);
        assert!((numeric / closed - 1.0).abs() < 1e-6, "{numeric} {closed}");
        check(&format!("slab, channel {c}"), &means[c], closed, 0.01 * closed);
        let z = critical(sidak(FAMILY, TESTS));
        assert_eq!(means[c].equals(1.05 * closed, 0.01 * closed, z), Verdict::Fail, "a control");
    }
}

/// Paths from anywhere in a ball of a medium that absorbs nothing leave it with their full brightness.
fn furnace(scattering: [f32; 3], absorption: [f32; 3], g: f32, seed: u64) -> [Mean; 3] {
    let medium = medium(absorption, scattering, g);
    let mut random = Pcg32::seed_from_u64(seed);
    let mut means = [Mean::default(); 3];
    for _ in 0..300_000 {
        let mut at = DVec3::new(0.0, 0.0, 0.9 * random.random::<f64>());
        let mut travel = Vec3::new(0.8, 0.0, 0.6);
        let mut throughput = Vec3::ONE;
        loop {
            let along = at.dot(travel.as_dvec3());
            let limit = -along + (along * along + 1.0 - at.length_squared()).max(0.0).sqrt();
            match medium.sample(limit as f32, random.random(), random.random(), throughput) {
                MediumEvent::Pass { weight } => {
                    throughput *= weight;
                    break;
                }
                MediumEvent::Scatter { t, weight } => {
                    throughput *= weight;
                    at += travel.as_dvec3() * f64::from(t);
                    travel = medium.phase().sample(travel, [random.random(), random.random()]).wi;
                }
            }
        }
        (0..3).for_each(|c| means[c].add(f64::from(throughput[c])));
    }
    means
}

#[test]
fn white_furnace_in_a_medium() {
    for (seed, g) in [0.0, 0.7, -0.5].into_iter().enumerate() {
        let gray = furnace([3.0; 3], [0.0; 3], g, seed as u64);
        assert!(gray.iter().all(|m| (m.mean - 1.0).abs() < 1e-6 && m.standard_error() < 1e-6), "{gray:?}");
        let chromatic = furnace([0.5, 1.0, 3.0], [0.0; 3], g, 10 + seed as u64);
        for (c, mean) in chromatic.iter().enumerate() {
            check(&format!("g = {g}, channel {c}"), mean, 1.0, 0.02);
        }
    }
    // Negative control: an albedo of 0.97 is detected.
    let z = critical(sidak(FAMILY, TESTS));
    let lossy = furnace([0.97, 1.94, 2.91], [0.03, 0.06, 0.09], 0.0, 20);
    assert!(lossy.iter().skip(1).all(|m| m.equals(1.0, 0.02, z) == Verdict::Fail), "{lossy:?}");
}

const ASYMMETRIES: [f32; 11] = [0.0, -0.0, 1e-8, -1e-4, 1e-3, 0.5, -0.5, 0.9, -0.9, 0.99, -0.99];

#[test]
fn henyey_greenstein_is_its_formula() {
    for g in ASYMMETRIES {
        let phase = HenyeyGreenstein::new(g);
        assert_eq!(phase.g(), g);
        for i in 0..=1000 {
            let angle = f64::from(i) / 1000.0 * PI;
            let wi = DVec3::new(angle.sin(), 0.0, angle.cos()).as_vec3();
            let (g, cosine) = (f64::from(g), f64::from(wi.z) / wi.as_dvec3().length());
            let exact = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5));
            let found = f64::from(phase.evaluate(Vec3::Z, wi));
            assert!((found / exact - 1.0).abs() < 2e-3, "{g} {angle}: {found} {exact}");
        }
    }
}

#[test]
fn chi_square_of_henyey_greenstein() {
    let travel = DVec3::new(0.3, -0.5, 0.8).normalize();
    for (seed, g) in ASYMMETRIES.into_iter().enumerate() {
        let phase = HenyeyGreenstein::new(g);
        // A narrow lobe is tested closely, and as a whole.
        let lobe = 4.0 * (1.0 - f64::from(g.abs()));
        for angle in [PI, lobe].into_iter().take(if lobe < 1.0 { 2 } else { 1 }) {
            let cone = Cone { axis: travel * f64::from(1.0_f32.copysign(g)), angle };
            let mut random = Pcg32::seed_from_u64(seed as u64);
            let mut cosines = Mean::default();
            let draw = || {
                let sample = phase.sample(travel.as_vec3(), [random.random(), random.random()]);
                assert!(sample.pdf > 0.0 && sample.pdf.is_finite() && (sample.wi.length() - 1.0).abs() < 3e-7);
                let again = phase.evaluate(travel.as_vec3(), sample.wi);
                assert!((again / sample.pdf - 1.0).abs() < 2e-3, "{g}: {sample:?} {again}");
                cosines.add(sample.wi.as_dvec3().dot(travel));
                Some(sample.wi)
            };
            let (p, integral) = cone.test(400_000, draw, |w| phase.evaluate(travel.as_vec3(), w));
            eprintln!("g = {g}, to {angle:.3}: p = {p:.2e}, integral {integral:.5}");
            assert!(p > sidak(FAMILY, TESTS), "{g} {angle}: p = {p:e}");
            assert!(integral <= 1.0 + 1e-3 && (angle < PI || (integral - 1.0).abs() < 2e-3), "{g}: {integral}");
            let z = critical(sidak(FAMILY, TESTS));
            assert_eq!(cosines.equals(f64::from(g), 0.01, z), Verdict::Pass, "{g}: {cosines:?}");
            // Negative control: another asymmetry, and the opposite one.
            let mut random = Pcg32::seed_from_u64(100 + seed as u64);
            let draw = || Some(phase.sample(travel.as_vec3(), [random.random(), random.random()]).wi);
            let off = if g.abs() < 0.5 { g + 0.02 } else { 0.98 * g };
            let other = HenyeyGreenstein::new(off);
            let (p, _) = cone.test(400_000, draw, |w| other.evaluate(travel.as_vec3(), w));
            assert!(p < sidak(FAMILY, TESTS), "{g} taken for {off}, to {angle}: p = {p:e}");
        }
    }
}

#[test]
fn henyey_greenstein_at_the_ends() {
    let ends = [0.0, 1e-30, 0.25, 0.5, 1.0 - 0.5 * f32::EPSILON];
    for g in [0.0, 1e-45, 0.999, -0.999, 1.0_f32.next_down(), (-1.0_f32).next_up(), 1.0, -1.0] {
        let phase = HenyeyGreenstein::new(g);
        for travel in [Vec3::Z, Vec3::NEG_Z, Vec3::new(0.6, -0.8, 0.0)] {
            for u in ends.into_iter().flat_map(|a| ends.map(|b| [a, b])) {
                let sample = phase.sample(travel, u);
                assert!((sample.wi.length() - 1.0).abs() < 3e-7 && sample.pdf > 0.0, "{g} {u:?}: {sample:?}");
                assert!(sample.pdf.is_finite(), "{g} {u:?}: {sample:?}");
            }
            for wi in [travel, -travel] {
                assert!(phase.evaluate(travel, wi) > 0.0 && phase.evaluate(travel, wi).is_finite(), "{g}");
            }
        }
    }
}

#[test]
fn invalid_media_are_refused_all_at_once() {
    let sound = described([0.1; 3], [0.2; 3], 0.5);
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let fogs = [
            described([0.1, bad, 0.1], [0.2; 3], 0.5),
            sound.clone(),
            described([0.1; 3], [0.2, 0.2, bad], 0.5),
            described([0.1; 3], [0.2; 3], bad),
        ];
        let errors = Media::new(&fogs, 1.0).expect_err("three are invalid");
        let messages: Vec<String> = errors.iter().map(ToString::to_string).collect();
        assert_eq!(messages.len(), 3, "all at once");
        assert!(messages.iter().all(|m| m.starts_with("made.pbrt:9: the ") && m.contains("\"fog\"")), "{messages:?}");
    }
    for g in [1.0, -1.0] {
        assert!(Media::new(&[described([0.1; 3], [0.2; 3], g)], 1.0).is_err());
    }
    assert!(Media::new(std::slice::from_ref(&sound), 1e-45).is_err(), "beyond single precision");
    let media = Media::new(&[described([0.1; 3], [0.0; 3], 0.0), sound], 1.0).expect("sound");
    assert!(media.len() == 2 && !media.is_empty() && media.scatter());
    assert!(!media.medium(0).scatters() && media.medium(1).scatters());
    assert!(!Media::default().scatter());
}
