//! Triangle lights at any receiver, extreme mixes of lights, and light selection.
#![allow(clippy::print_stderr)]

use crate::support::*;
use dapple_renderer::World;
use dapple_renderer::light::{LightSelection, Target};
use dapple_renderer::shading::Discrete;
use dapple_scene::{Light, LightKind, Scene};
use glam::{DAffine3, DVec3, Vec3};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg32;

/// Coordinates of the point sets have 24 bits.
const LATTICE: u32 = 1 << 24;

/// A patch of ground amid point lights, and their positions.
fn points(intensities: &[f32]) -> (World, Vec<DVec3>) {
    let mut scene = ground();
    let mut random = Pcg32::seed_from_u64(17);
    let source = line(200);
    let mut positions = Vec::with_capacity(intensities.len());
    for &intensity in intensities {
        let p = DVec3::from([0, 1, 2].map(|_| random.random::<f64>() - 0.5)) + 1.5 * DVec3::Z;
        positions.push(p);
        let kind = LightKind::Point { intensity: [intensity; 3] };
        scene.lights.push(Light { kind, to_world: DAffine3::from_translation(p), source: source.clone() });
    }
    (world(&scene), positions)
}

/// Mixes with one light of nearly all power among the others, with one of nearly none, and with all magnitudes.
fn mixes(count: usize) -> [Vec<f32>; 3] {
    let one = |special: f32, at: usize| {
        let mut all = vec![1.0; count];
        all[at] = special;
        all
    };
    // 1 - 1e-9 of the power in one light; 1e-9 of it in one light; all magnitudes mixed.
    let all: Vec<f32> = (0..count).map(|i| 10_f32.powi((i % 41) as i32 - 20)).collect();
    [one(count as f32 * 1e9, count / 3), one(count as f32 * 1e-9, count / 3), all]
}

/// Every light has a probability, and they sum to 1. Over all values of a coordinate, each light's weighted
/// contributions add up to its light: none is lost, none is overweighted.
fn no_light_is_lost(intensities: &[f32]) {
    let (world, positions) = points(intensities);
    let lights = world.lights();
    assert_eq!(lights.len(), intensities.len());
    assert!((0..lights.len() as u32).all(|i| lights.pmf(i) > 0.0));
    let sum: f64 = (0..lights.len() as u32).map(|i| f64::from(lights.pmf(i))).sum();
    assert!((sum - 1.0).abs() < 1e-6, "{sum}");
    let middle = world.space().point(DVec3::ZERO).as_vec3();
    // Irradiance by light, in the file's units: the brightest apart from all others.
    let brightest = intensities.iter().copied().fold(0.0, f32::max);
    let irradiance = |i: usize| f64::from(intensities[i]) * positions[i].z / positions[i].length().powi(3);
    let [mut due, mut found] = [[0.0; 2]; 2];
    for i in 0..intensities.len() {
        due[usize::from(intensities[i] < brightest)] += irradiance(i);
    }
    let unit = world.space().scale().powi(2);
    // A light's radiance identifies the brightest one.
    let threshold = f64::from(brightest) * 0.5 * unit;
    for k in 0..LATTICE {
        let sample = lights.sample(middle, k as f32 / LATTICE as f32, [0.5; 2]).expect("all shine on it");
        assert!(sample.delta);
        let Target::Point(at) = sample.target else { panic!("a point") };
        let intensity = f64::from(sample.radiance.x) * f64::from((at - middle).length_squared());
        let value = f64::from(sample.radiance.x) * f64::from(sample.wi.z) / f64::from(sample.pdf);
        found[usize::from(intensity < threshold)] += value;
    }
    for (kind, (due, found)) in ["brightest", "others"].iter().zip(due.into_iter().zip(found)) {
        let found = found / f64::from(LATTICE) / unit;
        eprintln!("{} lights, the {kind}: {found:e} of {due:e}", intensities.len());
        assert!((found - due).abs() <= 1e-5 * due, "the {kind}: {found:e} instead of {due:e}");
    }
}

#[test]
fn extreme_mix_of_100_000_lights_keeps_the_weakest_l07() {
    mixes(100_000).iter().for_each(|mix| no_light_is_lost(mix));
}

#[test]
#[ignore = "nightly (T2): 10^6 lights"]
fn extreme_mix_of_1_000_000_lights_keeps_the_weakest_l07() {
    mixes(1_000_000).iter().for_each(|mix| no_light_is_lost(mix));
}

/// Negative control: with selection by power alone, 24 bits never choose most of the lights.
#[test]
fn power_alone_loses_lights_l07() {
    let mix = &mixes(100_000)[0];
    let choice = Discrete::new(mix).expect("sound");
    let mut seen = vec![false; mix.len()];
    (0..LATTICE).for_each(|k| seen[choice.sample(k as f32 / LATTICE as f32).expect("not empty").index] = true);
    let lost = seen.iter().filter(|s| !**s).count();
    assert!(lost > 99_000, "{lost}");
}

#[test]
fn lights_are_selected_by_power_or_uniformly_l07() {
    let (mut world, _) = points(&[1.0, 2.0, 5.0]);
    let pmf = |world: &World| [0, 1, 2].map(|i| world.lights().pmf(i));
    let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(pmf(&world), [0.125, 0.25, 0.625]), "{:?}", pmf(&world));
    world.set_light_selection(LightSelection::Uniform);
    assert!(near(pmf(&world), [1.0 / 3.0; 3]), "{:?}", pmf(&world));
    world.set_light_selection(LightSelection::Power);
    assert!(near(pmf(&world), [0.125, 0.25, 0.625]), "{:?}", pmf(&world));
}

/// Powers of all kinds of lights together, in watts computed by hand (over pi).
#[test]
fn each_kind_of_light_has_its_power_l07() {
    let mut scene = ground();
    let add_kind = |scene: &mut Scene, kind: LightKind| {
        scene.lights.push(Light { kind, to_world: DAffine3::from_translation(DVec3::Z), source: line(200) });
    };
    // The ground's half diagonal is sqrt(2).
    let r2 = 2.0;
    add_kind(&mut scene, LightKind::Point { intensity: [1.0; 3] });
    add_kind(&mut scene, LightKind::Distant { irradiance: [1.0; 3] });
    let falloff = dapple_scene::SpotFalloff::Quartic;
    add_kind(&mut scene, LightKind::Spot { intensity: [1.0; 3], cone: 90.0, falloff_start: 60.0, falloff });
    add_sky(&mut scene, 1.0);
    let white = add_material(&mut scene, diffuse(1.0));
    let lamp = rectangle(0.5 * DVec3::Z, 0.5 * DVec3::X, 0.5 * DVec3::Y);
    // Added last, so that the ground stays the largest shape; lamps come first among the lights.
    add(&mut scene, lamp, DAffine3::IDENTITY, white, Some(1.0));
    // With the lamp half a unit above the ground, the bounds' half diagonal is sqrt(2 + 1/16).
    let r2 = r2 + 1.0 / 16.0;
    let powers = [1.0, 4.0, r2, 2.0 * (0.5 + 0.5 / 5.0), 4.0 * std::f64::consts::PI * r2];
    let total: f64 = powers.iter().sum();
    let world = world(&scene);
    for (i, power) in powers.iter().enumerate() {
        let found = f64::from(world.lights().pmf(i as u32));
        // Bounds are enlarged a little.
        assert!((found / (power / total) - 1.0).abs() < 1e-3, "light {i}: {found} {}", power / total);
    }
}

fn ground() -> Scene {
    let mut scene = scene([1, 1], 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y), DAffine3::IDENTITY, grey, None);
    scene
}

/// A two-sided lamp of one triangle.
fn triangle_lamp(corners: [DVec3; 3]) -> World {
    let mut scene = scene([1, 1], 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    let lamp = add(&mut scene, polygon(&corners), DAffine3::IDENTITY, grey, Some(1.0));
    scene.shapes[lamp].emission.as_mut().expect("it shines").two_sided = true;
    world(&scene)
}

/// Solid angle of a triangle [Van Oosterom and Strackee 1983].
fn solid_angle(corners: [DVec3; 3], from: DVec3) -> f64 {
    let [a, b, c] = corners.map(|p| (p - from).normalize());
    let numerator = a.dot(b.cross(c)).abs();
    (2.0 * numerator.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))).abs()
}

fn corner(random: &mut impl Rng) -> DVec3 {
    DVec3::from([0, 1, 2].map(|_| 2.0 * random.random::<f64>() - 1.0))
}

/// Receivers of one triangle: at random, in its plane, on an edge, at a corner, very near, very far.
fn receivers([a, b, c]: [DVec3; 3], random: &mut Pcg32) -> Vec<DVec3> {
    let normal = (b - a).cross(c - a).normalize();
    let mut all = Vec::new();
    for _ in 0..15 {
        let [s, t] = [random.random::<f64>(), random.random::<f64>()];
        let inside = a + (b - a) * s * (1.0 - t) + (c - a) * t * s;
        let beside = a + (b - a) * (4.0 * s - 2.0) + (c - a) * (4.0 * t - 2.0);
        let anywhere = corner(random) * 3.0;
        all.extend([anywhere, beside, inside, a + (b - a) * s, inside + normal * 1e-6, beside + normal * 1e-6]);
        all.push(anywhere * 1e6);
    }
    all.extend([a, b, c]);
    all
}

fn triangle_samples_are_sound(triangles: u64, seed: u64) {
    let mut random = Pcg32::seed_from_u64(seed);
    let (mut pairs, mut none) = (0u64, 0u64);
    for _ in 0..triangles {
        let corners = [corner(&mut random), corner(&mut random), corner(&mut random)];
        let world = triangle_lamp(corners);
        let placed = corners.map(|c| world.space().point(c));
        for receiver in receivers(placed, &mut random) {
            let from = receiver.as_vec3();
            for u in [[random.random(), random.random()], [0.0, 0.0], [0.0, 1.0 - 0.5 * f32::EPSILON]] {
                pairs += 1;
                let Some(sample) = world.lights().sample(from, 0.5, u) else {
                    none += 1;
                    continue;
                };
                assert!(sample.pdf > 0.0 && sample.pdf.is_finite(), "{corners:?} {from} {u:?}: {sample:?}");
                assert!((sample.wi.length() - 1.0).abs() < 1e-6 && sample.radiance == Vec3::ONE, "{sample:?}");
                let Target::Surface(point) = &sample.target else { panic!("on a surface") };
                // Rounding decides the cosine of a grazing direction.
                if sample.wi.dot(point.normal).abs() > 1e-2 {
                    let again = world.lights().pdf(0, from, point);
                    assert!((again / sample.pdf - 1.0).abs() < 1e-3, "{from}: {again} {}", sample.pdf);
                }
            }
        }
    }
    eprintln!("{pairs} pairs, {none} without a direction");
    // In its own plane a triangle is no wider than rounding, and at its corners some samples have no distance.
    assert!(none < pairs / 4, "{none} of {pairs}");
}

#[test]
fn triangle_light_matches_its_closed_form_at_a_few_receivers_l05() {
    triangle_samples_are_sound(400, 1);
}

#[test]
#[ignore = "nightly (T2): 10^8 pairs"]
fn triangle_light_matches_its_closed_form_at_any_receiver_l05() {
    triangle_samples_are_sound(310_000, 2);
}

/// The mean of 1/pdf over a lattice of `side^2` coordinates, over the exact solid angle.
fn solid_angle_found(corners: [DVec3; 3], from: DVec3, side: u32) -> f64 {
    let world = triangle_lamp(corners);
    let at = world.space().point(from).as_vec3();
    let u = |i: u32| (i as f32 + 0.5) / side as f32;
    let one =
        |i: u32| world.lights().sample(at, 0.5, [u(i % side), u(i / side)]).map_or(0.0, |s| 1.0 / f64::from(s.pdf));
    (0..side * side).map(one).sum::<f64>() / f64::from(side * side) / solid_angle(corners, from)
}

#[test]
fn solid_angles_of_triangles_match_their_closed_form_l05() {
    let mut random = Pcg32::seed_from_u64(5);
    for _ in 0..200 {
        let corners = [corner(&mut random), corner(&mut random), corner(&mut random)];
        let from = corners[0] + corner(&mut random).normalize() * 10_f64.powf(3.0 * random.random::<f64>());
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let height = normal.dot(from - corners[0]).abs();
        // In the plane of the triangle the solid angle is nothing but rounding.
        if height < 1e-3 {
            continue;
        }
        let ratio = solid_angle_found(corners, from, 256);
        assert!((ratio - 1.0).abs() < 0.01, "{corners:?} {from}: {ratio}");
    }
    // Negative control: the solid angle of another triangle.
    let (corners, other) = ([DVec3::X, DVec3::Y, DVec3::Z], [DVec3::X, DVec3::Y, DVec3::Z + 0.1 * DVec3::X]);
    let wrong = solid_angle(corners, DVec3::ZERO) / solid_angle(other, DVec3::ZERO);
    assert!((solid_angle_found(corners, DVec3::ZERO, 256) * wrong - 1.0).abs() > 0.01);
}

/// Right above a triangle, few samples of its area matter (a ratio of 0.842 at a height of 1e-3). Its solid angle is
/// thus sampled.
#[test]
fn solid_angle_right_above_a_triangle_is_exact_l05() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
    for height in [1e-1, 1e-2, 1e-3, 1e-4, 1e-6] {
        let ratio = solid_angle_found(corners, DVec3::new(0.3, 0.3, height), 256);
        eprintln!("height {height:e}: {ratio}");
        assert!((ratio - 1.0).abs() < 0.01, "height {height:e}: {ratio}");
    }
}
