//! Chi-square tests of every light's sampling, and environments in both layouts.
#![allow(clippy::print_stderr)]

use crate::statistics::directions::Cone;
use crate::statistics::{FAMILY, sidak};
use crate::support::*;
use dapple_geometry::Ray;
use dapple_renderer::World;
use dapple_renderer::light::{Environment, LightSelection, Target};
use dapple_scene::image::Image;
use dapple_scene::{EnvironmentRadiance, Geometry, Light, LightKind, MeshData, Scene, Source};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use std::f64::consts::PI;
use std::sync::Arc;

/// The largest number of chi-square tests in this file.
const TESTS: usize = 128;
/// Few enough samples to keep the file within seconds.
const SAMPLES: u64 = 200_000;

fn image_of(size: [u32; 2], value: impl Fn(u32, u32) -> f32) -> Arc<Image> {
    let pixels = (0..size[0] * size[1]).map(|i| [value(i % size[0], i / size[0]); 3]).collect();
    Arc::new(Image::new(size, pixels).expect("as many"))
}

fn lat_long(size: [u32; 2], value: impl Fn(u32, u32) -> f32) -> EnvironmentRadiance {
    EnvironmentRadiance::LatLong { image: image_of(size, value), scale: 0.5 }
}

fn equal_area(side: u32, value: impl Fn(u32, u32) -> f32) -> EnvironmentRadiance {
    EnvironmentRadiance::EqualArea { image: image_of([side; 2], value), scale: 0.5 }
}

fn add_infinite(scene: &mut Scene, radiance: EnvironmentRadiance, turn: DMat3) {
    let to_world = DAffine3::from_mat3(turn);
    scene.lights.push(Light { kind: LightKind::Infinite { radiance }, to_world, source: line(200) });
}

fn empty() -> Scene {
    scene([1, 1], 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO)
}

fn environments() -> Vec<(&'static str, EnvironmentRadiance)> {
    let bumpy = |x: u32, y: u32| ((7 * x + 3 * y) % 5) as f32;
    let edge = |x: u32, y: u32| if (x, y) == (0, 3) { 6.0 } else { ((x + y) % 3) as f32 * 0.2 };
    vec![
        ("constant", EnvironmentRadiance::Constant([0.5; 3])),
        ("lat-long, one texel", lat_long([1, 1], |_, _| 0.7)),
        ("lat-long, bright at the pole", lat_long([16, 8], |x, y| if (x, y) == (3, 0) { 300.0 } else { 0.1 })),
        ("lat-long, bright at the seam", lat_long([16, 8], |x, y| if (x, y) == (15, 4) { 9.0 } else { 0.3 })),
        ("lat-long, bumpy", lat_long([9, 5], bumpy)),
        ("equal-area, one texel", equal_area(1, |_, _| 0.7)),
        ("equal-area, bright in a corner", equal_area(8, |x, y| if (x, y) == (7, 0) { 50.0 } else { 0.2 })),
        ("equal-area, bright on an edge", equal_area(8, edge)),
        ("equal-area, bumpy", equal_area(7, bumpy)),
    ]
}

/// p-value and integral of a sky's sampling against `pdf`; the integral of a correct light is 1.
fn sky_test(
    radiance: &EnvironmentRadiance,
    turn: DMat3,
    pdf_turn: DMat3,
    choice: LightSelection,
    seed: u64,
) -> (f64, f64) {
    let mut scene = empty();
    add_infinite(&mut scene, radiance.clone(), turn);
    let mut world = world(&scene);
    world.set_light_selection(choice);
    let sky = Environment::new(radiance, pdf_turn, &Source::default()).expect("sound").expect("not black");
    let mut random = Pcg32::seed_from_u64(seed);
    let draw = || {
        let drawn = world.lights().sample(Vec3::ZERO, random.random(), [random.random(), random.random()])?;
        assert!(drawn.pdf > 0.0 && !drawn.delta && matches!(drawn.target, Target::Far));
        assert!((drawn.wi.length() - 1.0).abs() < 3e-7 && drawn.radiance != Vec3::ZERO);
        Some(drawn.wi)
    };
    // Around the image's pole, where the density of a lat-long image is unbounded.
    Cone::sphere((pdf_turn * DVec3::Z).normalize()).test(SAMPLES, draw, |w| sky.direction_pdf(w))
}

fn turn() -> DMat3 {
    DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(1.1)
}

fn mirrored() -> DMat3 {
    turn() * DMat3::from_diagonal(DVec3::new(2.0, -2.0, 2.0))
}

#[test]
fn mirrored_environment_samples_match_their_densities_l08() {
    check_environments(&[mirrored()]);
}

#[test]
#[ignore = "12 s: three maps; the mirrored one is tested always"]
fn environment_samples_match_their_densities_l08() {
    check_environments(&[DMat3::IDENTITY, turn(), mirrored()]);
}

fn check_environments(maps: &[DMat3]) {
    for (i, (name, radiance)) in environments().into_iter().enumerate() {
        for (j, &map) in maps.iter().enumerate() {
            // In one piece, and in parts whose sum is the whole.
            for choice in [LightSelection::Power, LightSelection::Learned] {
                let (p, integral) = sky_test(&radiance, map, map, choice, (10 * i + j) as u64);
                eprintln!("{name}, map {j}, {choice:?}: p = {p:.2e}, integral {integral:.5}");
                assert!((integral - 1.0).abs() < 1e-3, "{name}, map {j}, {choice:?}: {integral}");
                assert!(p > sidak(FAMILY, TESTS), "{name}, map {j}, {choice:?}: p = {p:e}");
            }
        }
    }
}

/// Negative controls: a sky turned by half a degree, mirrored, or read in the other layout is refuted.
#[test]
fn a_wrong_environment_density_is_refuted_l08() {
    let level = sidak(FAMILY, TESTS);
    let turn = DMat3::from_rotation_z(0.7);
    for (name, radiance) in environments().into_iter().filter(|(name, _)| name.contains("bright")) {
        let off = turn * DMat3::from_rotation_x(0.5_f64.to_radians());
        let (p, _) = sky_test(&radiance, turn, off, LightSelection::Power, 5);
        assert!(p < level, "{name}, off by half a degree: p = {p:e}");
        let other = turn * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let (p, _) = sky_test(&radiance, turn, other, LightSelection::Learned, 6);
        assert!(p < level, "{name}, mirrored: p = {p:e}");
    }
    let bumpy = image_of([8, 8], |x, y| ((7 * x + 3 * y) % 5) as f32);
    let mut scene = empty();
    add_infinite(&mut scene, EnvironmentRadiance::EqualArea { image: bumpy.clone(), scale: 1.0 }, turn);
    let world = world(&scene);
    let other = EnvironmentRadiance::LatLong { image: bumpy, scale: 1.0 };
    let other = Environment::new(&other, turn, &Source::default()).expect("sound").expect("not black");
    let mut random = Pcg32::seed_from_u64(7);
    let draw = || world.lights().sample(Vec3::ZERO, 0.0, [random.random(), random.random()]).map(|s| s.wi);
    assert!(Cone::sphere(DVec3::Z).test(SAMPLES, draw, |w| other.direction_pdf(w)).0 < level);
}

/// Samples have the radiance and density of their direction, except at texel borders, where directions round.
#[test]
fn environment_samples_match_radiance_and_density_l08() {
    let choices = [LightSelection::Power, LightSelection::Learned];
    for (name, radiance, choice) in
        environments().into_iter().flat_map(|(name, radiance)| choices.map(|choice| (name, radiance.clone(), choice)))
    {
        let turn = DMat3::from_rotation_y(0.3) * DMat3::from_rotation_x(1.1);
        let mut scene = empty();
        add_infinite(&mut scene, radiance.clone(), turn);
        let mut world = world(&scene);
        world.set_light_selection(choice);
        let sky = Environment::new(&radiance, turn, &Source::default()).expect("sound").expect("not black");
        let mut random = Pcg32::seed_from_u64(3);
        let (mut differ, samples) = (0, 200_000);
        for _ in 0..samples {
            let u = [random.random(), random.random()];
            let Some(drawn) = world.lights().sample(Vec3::ZERO, random.random(), u) else { continue };
            let same = drawn.radiance == sky.radiance(drawn.wi)
                && (drawn.pdf / sky.direction_pdf(drawn.wi) - 1.0).abs() < 1e-3;
            differ += i32::from(!same);
            // With one light, the weight is the power heuristic of the two densities.
            let all = world.lights().environment(drawn.wi);
            assert_eq!(all, sky.radiance(drawn.wi), "{name}");
            let even = world
                .lights()
                .environment_weighted(drawn.wi, sky.direction_pdf(drawn.wi), |light| world.lights().pmf(light));
            // Probabilities of parts are multiples of 2^-24, at most two off from a probability of 0.01 or more.
            let tolerance = if choice == LightSelection::Learned { 2e-5 } else { 1e-6 };
            assert!((even - 0.5 * all).abs().max_element() <= tolerance * all.max_element(), "{name}: {even} {all}");
        }
        assert!(differ < samples / 5_000, "{name}: {differ} of {samples}");
    }
}

/// The equal-area layout at places from pbrt-v4's definition: row 0 is at -y, the middle at +z.
#[test]
fn equal_area_texels_cover_equal_solid_angles_l08() {
    let sky = |at: [u32; 2]| {
        let radiance = equal_area(5, |x, y| if [x, y] == at { 2.0 } else { 0.0 });
        Environment::new(&radiance, DMat3::IDENTITY, &Source::default()).expect("sound").expect("not black")
    };
    for (at, w) in [
        ([2, 2], Vec3::Z),
        ([4, 2], Vec3::X),
        ([0, 2], Vec3::NEG_X),
        ([2, 4], Vec3::Y),
        ([2, 0], Vec3::NEG_Y),
        ([4, 4], Vec3::new(0.3, 0.3, -0.9)),
        ([0, 4], Vec3::new(-0.3, 0.3, -0.9)),
        ([4, 0], Vec3::new(0.3, -0.3, -0.9)),
        ([0, 0], Vec3::new(-0.3, -0.3, -0.9)),
    ] {
        assert_eq!(sky(at).radiance(w.normalize()).x, 1.0, "{at:?}");
        // A texel of 25 fills 4 pi / 25 at any place.
        let density = sky(at).direction_pdf(w.normalize());
        assert!((density * 4.0 * std::f32::consts::PI / 25.0 - 1.0).abs() < 1e-6, "{at:?}: {density}");
    }
}

#[test]
fn invalid_equal_area_images_are_refused_l08() {
    let make = |radiance: &EnvironmentRadiance| Environment::new(radiance, DMat3::IDENTITY, &line(7));
    for bad in [f32::NAN, f32::INFINITY, -1.0, f32::MAX] {
        let radiance = EnvironmentRadiance::EqualArea {
            image: image_of([4, 4], |x, y| if (x, y) == (2, 1) { bad } else { 1.0 }),
            scale: 2.0,
        };
        let message = make(&radiance).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(message.starts_with("made.pbrt:7: texel (2, 1)"), "{message}");
    }
    assert!(make(&equal_area(3, |_, _| 0.0)).expect("sound").is_none(), "black");
    let radiance = EnvironmentRadiance::EqualArea { image: image_of([4, 2], |_, _| 1.0), scale: 1.0 };
    assert!(make(&radiance).is_err_and(|e| e.what.contains("must be square, not 4 x 2;")));
    for scale in [f32::NAN, -1.0, f32::INFINITY] {
        let radiance = EnvironmentRadiance::EqualArea { image: image_of([2, 2], |_, _| 0.0), scale };
        assert!(make(&radiance).is_err(), "{scale}");
    }
    let bright = equal_area(4, |x, y| if (x, y) == (0, 0) { 1e30 } else { 1.0 });
    let sky = make(&bright).expect("sound").expect("not black");
    assert!(sky.direction_pdf(Vec3::NEG_Z).is_finite());
}

/// A flat square `[-1, 1]^2` at z = 0, facing down, of 32 uneven triangles.
fn uneven() -> Geometry {
    let at = [-1.0, -0.9, 0.1, 0.15, 1.0];
    let positions = (0..25).map(|i| DVec3::new(at[i % 5], at[i / 5], 0.0)).collect();
    let quads = (0..16u32).map(|i| i / 4 * 5 + i % 4);
    let triangles = quads.flat_map(|a| [[a, a + 5, a + 6], [a, a + 6, a + 1]]).collect();
    Geometry::Mesh(Arc::new(MeshData { positions, triangles, ..MeshData::default() }))
}

/// A lamp above the origin, its centre, and the radius that encloses it.
fn area_lamps() -> Vec<(&'static str, Geometry, DAffine3, DVec3, f64)> {
    let at = |x: f64, y: f64, z: f64| DAffine3::from_translation(DVec3::new(x, y, z));
    let down = DAffine3::from_rotation_x(PI);
    let (plate, ball) = (rectangle(DVec3::ZERO, DVec3::Y, DVec3::X), Geometry::Sphere { radius: 1.0 });
    let ring = |inner_radius| Geometry::Disk { height: 0.0, radius: 1.0, inner_radius };
    let triangle = polygon(&[DVec3::ZERO, DVec3::Y, DVec3::X]);
    let p = DVec3::new;
    let wide = DAffine3::from_scale(DVec3::new(3.0, 0.2, 1.0));
    vec![
        ("triangle", triangle.clone(), at(0.5, -0.3, 1.0), p(0.5, -0.3, 1.0), 1.0),
        // Near lamps are sampled by the solid angle: from below the inside, beside an edge, and at a slant.
        ("triangle, close", triangle.clone(), at(-0.3, -0.3, 0.05), p(-0.3, -0.3, 0.05), 1.0),
        ("triangle, beside", triangle.clone(), at(0.1, -0.4, 0.2), p(0.1, -0.4, 0.2), 1.0),
        ("triangle, narrow", triangle.clone(), at(0.0, 0.0, 0.3) * wide, p(0.0, 0.0, 0.3), 3.0),
        ("rectangle", plate.clone(), at(0.3, 0.2, 2.0), p(0.3, 0.2, 2.0), 1.5),
        ("rectangle, near", plate, at(0.3, 0.2, 0.5), p(0.3, 0.2, 0.5), 1.5),
        ("uneven mesh", uneven(), at(0.3, 0.2, 1.0), p(0.3, 0.2, 1.0), 1.5),
        ("sphere", ball.clone(), at(0.5, 0.5, 2.0), p(0.5, 0.5, 2.0), 1.0),
        ("sphere, near", ball.clone(), at(0.0, 0.0, 1.01), p(0.0, 0.0, 1.01), 1.0),
        ("sphere, far", ball, at(0.0, 300.0, 400.0), p(0.0, 300.0, 400.0), 1.0),
        ("disk", ring(0.0), at(0.4, 0.0, 1.0) * down, p(0.4, 0.0, 1.0), 1.0),
        ("ring", ring(0.6), at(0.4, 0.0, 1.0) * down, p(0.4, 0.0, 1.0), 1.0),
    ]
}

fn with_lamp(geometry: &Geometry, to_world: DAffine3) -> World {
    let mut scene = empty();
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, geometry.clone(), to_world, grey, Some(1.0));
    world(&scene)
}

/// The test of a lamp's sampling from the origin against the density in another world.
fn lamp_test(world: &World, other: &World, centre: DVec3, radius: f64, seed: u64) -> (f64, f64) {
    let from = |world: &World| world.space().point(DVec3::ZERO).as_vec3();
    let sine = radius / centre.length();
    let angle = if sine < 1.0 { 1.05 * sine.asin() } else { PI };
    let cone = Cone { axis: centre.normalize(), angle: angle.min(PI) };
    let mut random = Pcg32::seed_from_u64(seed);
    let draw = || {
        let u = [random.random(), random.random()];
        let drawn = world.lights().sample(from(world), random.random(), u)?;
        assert!(drawn.pdf > 0.0 && !drawn.delta && drawn.radiance.x == 1.0, "{drawn:?}");
        let Target::Surface(point) = &drawn.target else { panic!("on a surface") };
        // Both ways to the density agree.
        let again = world.lights().pdf(0, from(world), point);
        assert!((again / drawn.pdf - 1.0).abs() < 1e-3, "{} {again}", drawn.pdf);
        // At the limb of a sphere the direction is more exact than the point: 2e-4 of its radius.
        let to = point.position - from(world);
        let off = f64::from((to - drawn.wi * to.length()).length());
        assert!(off < 5e-4 * radius * world.space().scale(), "{to} {}", drawn.wi);
        Some(drawn.wi)
    };
    let pdf = |w: Vec3| match other.emitter(&Ray::new(from(other), w)) {
        Some(met) if met.radiance != Vec3::ZERO => other.lights().pdf(met.light, from(other), &met.point),
        _ => 0.0,
    };
    cone.test(SAMPLES, draw, pdf)
}

#[test]
fn samples_of_every_second_lamp_match_their_densities_l04() {
    check_lamps(2);
}

#[test]
#[ignore = "11 s: all lamps; every second one is tested always"]
fn area_light_samples_match_their_densities_l04() {
    check_lamps(1);
}

/// Every `step`-th lamp.
fn check_lamps(step: usize) {
    for (seed, (name, geometry, to_world, centre, radius)) in area_lamps().into_iter().enumerate().step_by(step) {
        let world = with_lamp(&geometry, to_world);
        let (p, integral) = lamp_test(&world, &world, centre, radius, seed as u64);
        eprintln!("{name}: p = {p:.2e}, integral {integral:.5}");
        assert!((integral - 1.0).abs() < 1e-3, "{name}: {integral}");
        assert!(p > sidak(FAMILY, TESTS), "{name}: p = {p:e}");
    }
}

#[test]
fn every_second_lamp_elsewhere_is_refuted_l04() {
    refute_lamps_elsewhere(2);
}

#[test]
#[ignore = "11 s: all lamps; every second one is tested always"]
fn a_lamp_elsewhere_is_refuted_l04() {
    refute_lamps_elsewhere(1);
}

/// Negative control: every `step`-th lamp moved by 2 % of its radius is refuted.
fn refute_lamps_elsewhere(step: usize) {
    for (seed, (name, geometry, to_world, centre, radius)) in area_lamps().into_iter().enumerate().step_by(step) {
        let moved = DAffine3::from_translation(-0.02 * radius * DVec3::new(0.6, -0.8, 0.3)) * to_world;
        let (lamp, other) = (with_lamp(&geometry, to_world), with_lamp(&geometry, moved));
        let (p, _) = lamp_test(&lamp, &other, centre, radius, seed as u64);
        eprintln!("{name}: p = {p:.2e}");
        assert!(p < sidak(FAMILY, TESTS), "{name}: p = {p:e}");
    }
}
