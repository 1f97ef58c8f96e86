//! Homogeneous media: transmittance, distances, the phase function, single scattering and a white furnace, all against closed
//! forms. In images, the Beer-Lambert law on the way to the camera, to a lamp and between them.
#![allow(clippy::print_stderr)]

use crate::densities::Cone;
use crate::support::*;
use dapple_renderer::medium::{HenyeyGreenstein, Media, Medium, MediumEvent};

const TESTS: usize = 256;

fn medium(absorption: [f32; 3], scattering: [f32; 3], g: f32) -> Medium {
    *Media::new(&[fog(absorption, scattering, g)], 1.0).expect("sound").medium(0)
}

/// Tests equivalence with the reference, at a one-sided level of 1e-6 over all tests of this file.
fn equals(found: &Mean, reference: f64, delta: f64) -> Verdict {
    found.equals(reference, delta, critical(sidak(FAMILY, TESTS)))
}

fn check(name: &str, found: &Mean, reference: f64, delta: f64) {
    assert_eq!(equals(found, reference, delta), Verdict::Pass, "{name}: {found:?} {reference}");
}

#[test]
fn transmittance_is_exact() {
    let (absorption, scattering) = ([0.1, 1.0, 0.0], [0.3, 20.0, 0.0]);
    for exponent in [-20, -1, 0, 3, 30] {
        let scale = f64::from(exponent).exp2();
        let media = Media::new(&[fog(absorption, scattering, 0.0)], scale).expect("sound");
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

/// Fractions of light that pass, scatter in the first half and scatter in the second half have closed forms per channel.
#[test]
fn distances_add_up() {
    let limit = 1.3_f32;
    for (number, (name, absorption, scattering, throughput)) in [
        ("gray", [0.5; 3], [1.0; 3], Vec3::ONE),
        ("chromatic", [0.1, 0.5, 0.0], [0.2, 1.5, 4.0], Vec3::ONE),
        ("chromatic, reddish path", [0.1, 0.5, 0.0], [0.2, 1.5, 4.0], Vec3::new(1.0, 0.05, 1e-6)),
        ("one channel clear", [0.0, 1.0, 0.3], [0.0, 1.0, 0.0], Vec3::new(0.5, 1.0, 2.0)),
        ("one channel dark", [0.2; 3], [0.5, 2.0, 1.0], Vec3::new(0.0, 3.0, 1.0)),
    ]
    .into_iter()
    .enumerate()
    {
        let medium = medium(absorption, scattering, 0.0);
        assert!(medium.scatters());
        let mut random = Pcg32::seed_from_u64(number as u64);
        let mut means = [[Mean::default(); 3]; 3];
        for _ in 0..500_000 {
            let event = medium.sample(limit, random.random(), random.random(), throughput);
            let (part, weight) = match event {
                MediumEvent::Pass { weight } => (2, weight),
                MediumEvent::Scatter { t, weight } => {
                    assert!((0.0..limit).contains(&t), "{t}");
                    (usize::from(t > 0.5 * limit), weight)
                }
            };
            assert!(weight.is_finite() && weight.min_element() >= 0.0, "{name}: {event:?}");
            assert!((weight * throughput).max_element() <= 1.003 * throughput.element_sum(), "{name}: {event:?}");
            let expected = if part == 2 { 1.0 } else { 1.0 / 1.5 };
            assert!(name != "gray" || (weight - expected).abs().max_element() < 3e-7, "{event:?}");
            for (i, mean) in means.iter_mut().enumerate() {
                (0..3).for_each(|c| mean[c].add(if i == part { f64::from(weight[c] * throughput[c]) } else { 0.0 }));
            }
        }
        for c in 0..3 {
            let [a, s] = [absorption[c], scattering[c]].map(f64::from);
            let albedo = if a + s > 0.0 { s / (a + s) } else { 0.0 };
            let [half, whole] = [0.5, 1.0].map(|share| (-(a + s) * f64::from(limit) * share).exp());
            let expected = [albedo * (1.0 - half), albedo * (half - whole), whole];
            for (mean, expected) in means.iter().map(|mean| mean[c]).zip(expected) {
                let expected = f64::from(throughput[c]) * expected;
                if mean.standard_error() == 0.0 {
                    assert!((mean.mean - expected).abs() < 1e-6, "{name}, {c}: {mean:?} {expected}");
                } else {
                    check(name, &mean, expected, 0.01 * f64::from(throughput.element_sum()));
                }
            }
        }
    }
}

/// Distances are finite for extreme limits, random numbers and throughputs.
#[test]
fn distances_at_the_ends() {
    let ends = [0.0, 1e-30, 0.5, BELOW_ONE];
    let coefficients = [[0.0; 3], [1e-30, 1.0, 1e30], [1e30; 3], [0.0, 1e-38, 3e37], [5.0, 0.0, 0.0]];
    let throughputs = [Vec3::ONE, Vec3::ZERO, Vec3::new(1e-38, 1.0, 1e38), Vec3::new(0.0, 0.0, 1.0)];
    for (absorption, scattering) in coefficients.into_iter().flat_map(|a| coefficients.map(|b| (a, b))) {
        let medium = medium(absorption, scattering, 0.3);
        for (limit, throughput) in
            [1e-30, 1.0, 1e30, f32::INFINITY].into_iter().flat_map(|l| throughputs.map(|t| (l, t)))
        {
            for (u, v) in ends.into_iter().flat_map(|u| ends.map(|v| (u, v))) {
                let event = medium.sample(limit, u, v, throughput);
                let (MediumEvent::Pass { weight } | MediumEvent::Scatter { weight, .. }) = event;
                assert!(!matches!(event, MediumEvent::Scatter { t, .. } if t.is_nan() || t >= limit), "{event:?}");
                assert!(weight.is_finite() && weight.min_element() >= 0.0, "{medium:?} {limit} {event:?}");
            }
        }
    }
}

/// Returns Henyey and Greenstein's density for the cosine between the directions of travel before and after scattering.
fn density(g: f64, cosine: f64) -> f64 {
    (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5))
}

/// Parallel light enters a slab at a slant on the same side as the ray, and scatters once. Its closed form is `s p (1 - exp(-e
/// L (1 + 1/mu))) / (e (1 + 1/mu))`. Negative control: 5 % more.
#[test]
fn single_scattering_in_a_slab() {
    let (absorption, scattering, g) = ([0.1, 0.5, 0.0], [0.2, 1.5, 4.0], 0.4);
    let (length, mu) = (1.7_f64, 0.6_f64);
    let medium = medium(absorption, scattering, g);
    // Towards the light, which lies before the slab.
    let wi = Vec3::new((1.0 - mu * mu).sqrt() as f32, 0.0, -mu as f32);
    let mut random = Pcg32::seed_from_u64(4);
    let mut means = [Mean::default(); 3];
    for _ in 0..1_000_000 {
        let value = match medium.sample(length as f32, random.random(), random.random(), Vec3::ONE) {
            MediumEvent::Pass { .. } => Vec3::ZERO,
            MediumEvent::Scatter { t, weight } => {
                weight * medium.transmittance(t / mu as f32) * medium.phase().evaluate(Vec3::Z, wi)
            }
        };
        (0..3).for_each(|c| means[c].add(f64::from(value[c])));
    }
    for c in 0..3 {
        let [a, s] = [absorption[c], scattering[c]].map(f64::from);
        // The cosine between light and ray is mu: the light comes from the front and scatters backwards.
        let phase = density(f64::from(g), -mu);
        let depth = (a + s) * (1.0 + 1.0 / mu);
        let closed = s * phase * (1.0 - (-depth * length).exp()) / depth;
        check("slab", &means[c], closed, 0.01 * closed);
        assert_eq!(equals(&means[c], 1.05 * closed, 0.01 * closed), Verdict::Fail, "a control");
    }
}

/// Returns the brightness of paths that leave a sphere of a medium, starting anywhere inside. Without absorption it is 1.
fn furnace(scattering: [f32; 3], absorption: [f32; 3], g: f32, seed: u64) -> [Mean; 3] {
    let medium = medium(absorption, scattering, g);
    let mut random = Pcg32::seed_from_u64(seed);
    let mut means = [Mean::default(); 3];
    for _ in 0..150_000 {
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

/// Negative control: an albedo of 0.97 is detected.
#[test]
fn white_furnace_in_a_medium() {
    for (seed, g) in [0.0, 0.7, -0.5].into_iter().enumerate() {
        let gray = furnace([3.0; 3], [0.0; 3], g, seed as u64);
        assert!(gray.iter().all(|m| (m.mean - 1.0).abs() < 1e-6 && m.standard_error() < 1e-6), "{gray:?}");
        let chromatic = furnace([0.5, 1.0, 3.0], [0.0; 3], g, 10 + seed as u64);
        chromatic.iter().for_each(|mean| check(&format!("g = {g}"), mean, 1.0, 0.02));
    }
    let lossy = furnace([0.97, 1.94, 2.91], [0.03, 0.06, 0.09], 0.0, 20);
    assert!(lossy.iter().skip(1).all(|m| equals(m, 1.0, 0.02) == Verdict::Fail), "{lossy:?}");
}

/// Values equal the formula. Samples pass a chi-square test and have the right mean cosine. Negative control: another
/// asymmetry.
#[test]
fn henyey_greenstein_is_its_formula_and_samples_it() {
    let travel = DVec3::new(0.3, -0.5, 0.8).normalize();
    let asymmetries = [0.0, -0.0, 1e-8, -1e-4, 1e-3, 0.5, -0.5, 0.9, -0.9, 0.99, -0.99_f32];
    for (seed, g) in asymmetries.into_iter().enumerate() {
        let phase = HenyeyGreenstein::new(g);
        assert_eq!(phase.g(), g);
        for i in 0..=1000 {
            let angle = f64::from(i) / 1000.0 * PI;
            let wi = DVec3::new(angle.sin(), 0.0, angle.cos()).as_vec3();
            let exact = density(f64::from(g), f64::from(wi.z) / wi.as_dvec3().length());
            let found = f64::from(phase.evaluate(Vec3::Z, wi));
            assert!((found / exact - 1.0).abs() < 2e-3, "{g} {angle}: {found} {exact}");
        }
        // A narrow lobe is tested near its axis and as a whole.
        let lobe = 4.0 * (1.0 - f64::from(g.abs()));
        for angle in [PI, lobe].into_iter().take(if lobe < 1.0 { 2 } else { 1 }) {
            let cone = Cone { axis: travel * f64::from(1.0_f32.copysign(g)), angle };
            let masses = cone.masses(|w| phase.evaluate(travel.as_vec3(), w));
            let test = |seed: usize, phase: &HenyeyGreenstein, cosines: &mut Mean| {
                let (mut random, from) = (Pcg32::seed_from_u64(seed as u64), travel.as_vec3());
                let draw = || {
                    let sample = phase.sample(from, [random.random(), random.random()]);
                    cosines.add(sample.wi.as_dvec3().dot(travel));
                    if cosines.n.is_multiple_of(5) {
                        let again = phase.evaluate(from, sample.wi);
                        assert!(sample.pdf > 0.0 && sample.pdf.is_finite() && (sample.wi.length() - 1.0).abs() < 3e-7);
                        assert!((again / sample.pdf - 1.0).abs() < 2e-3, "{g}: {sample:?} {again}");
                    }
                    Some(sample.wi)
                };
                cone.test(600_000, draw, &masses)
            };
            let (mut cosines, integral) = (Mean::default(), masses.iter().sum::<f64>());
            let p = test(seed, &phase, &mut cosines);
            let off = if g.abs() < 0.5 { g + 0.02 } else { 0.98 * g };
            let wrong = test(100 + seed, &HenyeyGreenstein::new(off), &mut Mean::default());
            let level = sidak(FAMILY, TESTS);
            assert!(p > level && wrong < level, "{g} to {angle}: p = {p:e}, taken for {off} {wrong:e}");
            assert!(integral <= 1.0 + 1e-3 && (angle < PI || (integral - 1.0).abs() < 2e-3), "{g}: {integral}");
            check("cosine", &cosines, f64::from(g), 0.01);
        }
    }
}

#[test]
fn henyey_greenstein_at_the_ends() {
    let ends = [0.0, 1e-30, 0.25, 0.5, BELOW_ONE];
    for g in [0.0, 1e-45, 0.999, -0.999, 1.0_f32.next_down(), (-1.0_f32).next_up(), 1.0, -1.0] {
        let phase = HenyeyGreenstein::new(g);
        for travel in [Vec3::Z, Vec3::NEG_Z, Vec3::new(0.6, -0.8, 0.0)] {
            for u in ends.into_iter().flat_map(|a| ends.map(|b| [a, b])) {
                let sample = phase.sample(travel, u);
                assert!((sample.wi.length() - 1.0).abs() < 3e-7 && sample.pdf > 0.0, "{g} {u:?}: {sample:?}");
                assert!(sample.pdf.is_finite(), "{g} {u:?}: {sample:?}");
            }
            let values = [travel, -travel].map(|wi| phase.evaluate(travel, wi));
            assert!(values.iter().all(|value| *value > 0.0 && value.is_finite()), "{g}: {values:?}");
        }
    }
}

#[test]
fn invalid_media_are_refused_all_at_once() {
    let sound = fog([0.1; 3], [0.2; 3], 0.5);
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let wrong = fog([0.1, bad, 0.1], [0.2; 3], 0.5);
        let fogs = [wrong, sound.clone(), fog([0.1; 3], [0.2, 0.2, bad], 0.5), fog([0.1; 3], [0.2; 3], bad)];
        let errors = Media::new(&fogs, 1.0).expect_err("three are invalid");
        let messages: Vec<String> = errors.iter().map(ToString::to_string).collect();
        let is_named = |m: &String| m.starts_with("made.pbrt:500: the ") && m.contains("\"fog\"");
        assert!(messages.len() == 3 && messages.iter().all(is_named), "{messages:?}");
    }
    assert!([1.0, -1.0].into_iter().all(|g| Media::new(&[fog([0.1; 3], [0.2; 3], g)], 1.0).is_err()));
    assert!(Media::new(std::slice::from_ref(&sound), 1e-45).is_err(), "beyond single precision");
    let media = Media::new(&[fog([0.1; 3], [0.0; 3], 0.0), sound], 1.0).expect("sound");
    assert!(media.len() == 2 && !media.is_empty() && media.scatter() && !Media::default().scatter());
    assert!(!media.medium(0).scatters() && media.medium(1).scatters());
}

/// Fills all space with an absorbing medium. Adds a border without a medium on either side, which no ray hits, but which shadow
/// rays must test.
fn fill(scene: &mut Scene, absorption: [f32; 3], border: Option<DVec3>) {
    scene.media.push(fog(absorption, [0.0; 3], 0.0));
    scene.camera.medium = Some(MediumId(0));
    if let Some(at) = border {
        let material = add_material(scene, MaterialKind::Interface);
        ball(scene, at, 0.1, material, None);
    }
}

#[test]
fn light_through_an_absorbing_medium_is_beer_and_lamberts() {
    let absorption = [0.05, 0.3, 1.2];
    for border in [None, Some(-60.0 * DVec3::Y)] {
        // A shell of radiance 1 around the camera: one leg of 2.5.
        let mut shell = scene([8, 8], 70.0, DVec3::ZERO, DVec3::Y);
        let black = add_material(&mut shell, diffuse(0.0));
        let number = ball(&mut shell, DVec3::ZERO, 2.5, black, Some(1.0));
        shell.shapes[number].reversed = true;
        // Two legs, to a point lamp at a slant and to the camera, which sees a millionth of a floor.
        let (lamp, eye) = (DVec3::new(1.5, 0.0, 2.0), 1.25);
        let mut floor = scene([8, 8], 1e-3, DVec3::new(0.0, 0.0, eye), DVec3::ZERO);
        let grey = add_material(&mut floor, diffuse(0.5));
        plate(&mut floor, [DVec3::ZERO, 20.0 * DVec3::X, 20.0 * DVec3::Y], grey, None);
        add_light(&mut floor, LightKind::Point { intensity: [3.0; 3] }, DAffine3::from_translation(lamp));
        fill(&mut shell, absorption, border);
        fill(&mut floor, absorption, border);
        let [shell, floor] = [shell, floor].map(|scene| image(&scene, 16, 3));
        for (c, sigma) in absorption.map(f64::from).into_iter().enumerate() {
            let verdict = |film, reference: f64, delta| equals(&pixel_mean(film, c), reference, delta * reference);
            assert_eq!(verdict(&shell, (-sigma * 2.5).exp(), 1e-5), Verdict::Pass, "shell, channel {c}, {border:?}");
            let legs = lamp.length() + eye;
            let arrives = 0.5 / PI * 3.0 * lamp.z / lamp.length().powi(3);
            let lit = arrives * (-sigma * legs).exp();
            assert_eq!(verdict(&floor, lit, 1e-4), Verdict::Pass, "floor, channel {c}, {border:?}");
            // The controls: one leg forgotten, and 1 % more of the medium.
            for wrong in [arrives * (-sigma * lamp.length()).exp(), arrives * (-1.01 * sigma * legs).exp()] {
                assert_eq!(verdict(&floor, wrong, 1e-4), Verdict::Fail, "floor, channel {c}, {border:?}");
            }
        }
    }
}

/// The scene has all kinds of lights, glossy surfaces and several bounces in an absorbing medium. The longer walk, which looks
/// for transparent surfaces, gives the same image. Negative control: 10 % more of the medium is detected.
#[test]
fn the_short_way_through_a_medium_gives_the_image_of_the_longer_walk() {
    let inked = |border: Option<DVec3>, by: f32, seed: u64| {
        let mut scene = room([32, 24]);
        // On an unbounded way no light remains: the sky would be black.
        scene.lights.clear();
        fill(&mut scene, [0.02, 0.1, 0.3].map(|a| by * a), border);
        replicates(&world(&scene), [32, 24], 4, seed).iter().map(pixels).collect::<Vec<_>>()
    };
    // Within the box of metal, so that the scene's bounds, which normalise it, stay.
    let border = Some(DVec3::new(-1.0, 0.3, 0.4));
    let (short, long) = (inked(None, 1.0, 0), inked(border, 1.0, 0));
    // The same seeds give the same paths, with lengths that differ by rounding.
    let pairs = short.iter().flatten().flatten().zip(long.iter().flatten().flatten());
    pairs.for_each(|(x, y)| assert!((x - y).abs() <= 1e-5 * (x + y), "{x} {y}"));
    let [same, thicker] = [(1.0, 200), (1.1, 100)].map(|(by, seed)| images(32, &short, &inked(border, by, seed)).p());
    assert!(same > FAMILY && thicker < FAMILY, "{same:e}, {thicker:e} with more of the medium");
}
