//! Bidirectional paths have the path tracer's light and closed forms.
#![allow(clippy::print_stderr, reason = "figures of tests")]

use crate::support::*;
use dapple_transport::{Bdpt, BdptOptions};

fn bdpt<'w>(world: &'w World, options: &str) -> Box<dyn Integrator + 'w> {
    made(&format!("bdpt:{options}"), world)
}

/// The inside of a large sphere, seen by `camera`, with a small sphere of the material `middle`.
fn hall(camera: Camera, middle: MaterialKind, lamp: bool) -> Scene {
    let mut scene = Scene { max_depth: Some(3), camera, ..Scene::default() };
    scene.film.resolution = [8; 2];
    let [wall, bulb, middle] = [diffuse(0.6), diffuse(0.2), middle].map(|kind| add_material(&mut scene, kind));
    add_sphere(&mut scene, DVec3::ZERO, 3.0, wall, 0.0);
    add_sphere(&mut scene, DVec3::new(-0.4, -0.3, 1.4), 0.5, middle, 0.0);
    if lamp {
        add_sphere(&mut scene, DVec3::new(0.9, 0.8, 0.9), 0.6, bulb, 10.0);
    }
    scene
}

/// Rough glass, which scales radiance and importance differently.
fn rough_glass() -> MaterialKind {
    let (roughness, white) = (Roughness::constant(0.5, 0.5, false), Color::Constant([1.0; 3]));
    MaterialKind::Dielectric { eta: 1.5, roughness, reflectance: white, transmittance: white }
}

fn cameras() -> [(&'static str, Camera); 3] {
    let to_world = DAffine3::from_mat3_translation(DMat3::from_rotation_y(0.1), DVec3::new(0.1, 0.0, -1.5));
    let pinhole = Camera { to_world, projection: Projection::Perspective { fov: 60.0 }, ..Camera::default() };
    let lens = Camera { lens_radius: 0.3, focal_distance: 2.0, ..pinhole.clone() };
    let to_world = DAffine3::from_scale_rotation_translation(DVec3::splat(0.8), glam::DQuat::IDENTITY, DVec3::Z * -1.0);
    let orthographic = Camera { to_world, projection: Projection::Orthographic, ..Camera::default() };
    [("pinhole", pinhole), ("lens", lens), ("orthographic", orthographic)]
}

/// Asserts that the mean equals the path tracer's, with and without splats and for each number of scattering events. The noise
/// is low enough to detect 5 % more light.
fn has_the_path_tracers_light(name: &str, scene: &Scene, spp: u64) {
    let mut world = world(scene);
    for events in 1..=2 {
        world.set_max_depth(events);
        let expected = means_by(&mut *integrator(&world), [8; 2], spp, 100..112);
        for options in ["splat=0", "splat=1"] {
            let found = means_by(&mut *bdpt(&world, options), [8; 2], spp, 0..12);
            assert_near(&format!("{name}, {events} events, {options}"), &found, &expected, 0.0, 0.009);
        }
    }
}

/// The scene is seen through a lens. The thorough test adds all cameras, rough glass, and a point light, which no ray can hit.
#[test]
fn light_in_a_hall_is_the_path_tracers() {
    let [pinhole, lens, orthographic] = cameras();
    for (name, camera) in &[lens, pinhole.clone(), orthographic][..thorough(1, 3)] {
        has_the_path_tracers_light(name, &hall(camera.clone(), diffuse(0.7), true), thorough(32, 64));
    }
    if thorough(false, true) {
        has_the_path_tracers_light("rough glass", &hall(pinhole.1.clone(), rough_glass(), true), 64);
        let mut scene = hall(pinhole.1, diffuse(0.7), false);
        let (to_world, source) = (DAffine3::from_translation(DVec3::new(0.5, 0.6, 0.3)), line(200));
        scene.lights.push(Light { kind: LightKind::Point { intensity: [5.0; 3] }, to_world, source });
        has_the_path_tracers_light("point", &scene, 64);
    }
}

/// A sphere in front of two disks that face each other at an angle, lit by an environment and a distant light.
#[test]
fn light_from_infinity_is_the_path_tracers() {
    let [(_, camera), ..] = cameras();
    let mut scene = hall(camera, diffuse(0.7), false);
    scene.shapes.remove(0);
    for (turn, x) in [(-0.9, -0.8), (0.9, 0.8)] {
        let disk = Geometry::Disk { height: 0.0, radius: 1.5, inner_radius: 0.0 };
        let to_world = DAffine3::from_mat3_translation(DMat3::from_rotation_y(turn), DVec3::new(x, 0.0, 1.8));
        add(&mut scene, disk, to_world, MaterialId(0), None);
    }
    let sky = LightKind::Infinite { radiance: EnvironmentRadiance::Constant([0.7; 3]) };
    for (name, kind) in [("sky", sky), ("sun", LightKind::Distant { irradiance: [2.0; 3] })] {
        scene.lights = vec![Light { kind, to_world: DAffine3::from_rotation_x(2.0), source: line(200) }];
        has_the_path_tracers_light(name, &scene, thorough(32, 256));
    }
}

/// Returns images rendered by an integrator with independent seeds.
pub(crate) fn replicates(integrator: &mut dyn Integrator, size: [u32; 2], spp: u64, seed: u64) -> Vec<Vec<[f64; 3]>> {
    (0..16).map(|i| pixels(&film_by(integrator, size, spp, seed + i))).collect()
}

const SIZE: [u32; 2] = [24, 16];

/// Returns the p-value for equal expected images, and the largest deviation of the image means in standard errors of the
/// difference. Images are 24 pixels wide.
pub(crate) fn compared(a: &[Vec<[f64; 3]>], b: &[Vec<[f64; 3]>]) -> (f64, f64) {
    let mean = |set: &[Vec<[f64; 3]>], c: usize| -> Mean {
        set.iter().map(|image| image.iter().map(|p| p[c]).sum::<f64>() / image.len() as f64).collect()
    };
    let z = (0..3).map(|c| mean(a, c).against_estimate(&mean(b, c)).z().abs()).fold(0.0, f64::max);
    (images(24, a, b).p(), z)
}

/// Images agree at a level of 1e-6 over all scenes, and means agree within 3 standard errors of the difference. With other
/// seeds, the second test alone fails with probability 0.03 for six scenes. Negative control: 5 % more light.
#[test]
fn means_are_the_path_tracers() {
    for name in &["cornell", "lens", "teapot", "motion", "room", "plates"][..thorough(2, 6)] {
        let mut world = bundle(name, SIZE);
        world.set_max_depth(world.max_depth().min(6));
        let by_path = replicates(&mut *integrator(&world), SIZE, 16, 100);
        for options in ["splat=0", "splat=1"] {
            let mut found = replicates(&mut *bdpt(&world, options), SIZE, 8, 200);
            let (p, z) = compared(&found, &by_path);
            eprintln!("{name}, {options}: p {p:.2e}, {z:.2} standard errors");
            assert!(p > sidak(FAMILY, 12) && z < 3.0, "{name}, {options}: p {p:e}, {z} standard errors");
            found.iter_mut().flatten().flatten().for_each(|light| *light *= 1.05);
            let (p, z) = compared(&found, &by_path);
            assert!(*name != "cornell" || p < sidak(FAMILY, 12) || z > 3.0, "the test sees nothing: p {p:e}, {z}");
        }
    }
}

/// The closed form is a geometric series. It does not depend on the strategies.
#[test]
fn furnaces_have_their_closed_form() {
    for (depth, rho) in [(Some(0), 0.5), (Some(1), 0.5), (Some(2), 0.8), (Some(5), 0.8), (None, 0.5)] {
        let (scene, expected) = furnace(rho, depth, false);
        let world = world(&scene);
        for options in ["splat=0", "splat=1"] {
            let mean = means_by(&mut *bdpt(&world, options), [8; 2], 8, 0..16);
            assert_near(&format!("depth {depth:?}, {options}"), &mean, &expected, 5e-6, 0.02);
        }
    }
}

#[test]
fn media_and_transparency_are_refused_with_their_object() {
    let refused =
        Bdpt::new(&bundle("glass", SIZE), &BdptOptions::default()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(refused.contains("scene.pbrt:") && refused.contains("--without"), "{refused}");
}

/// A window shows the same light as the whole image in that place, including splats.
#[test]
fn a_window_shows_the_light_of_the_whole_image() {
    let size = [32, 24];
    let world = bundle("caustic", size);
    let whole = Frame::new(size[0], size[1]).expect("not empty");
    let window = whole.crop(15, 12, 23, 20).expect("inside");
    for request in ["bdpt", "metropolis:length=64"] {
        let mean = |frame: Frame, spp: u64| -> Mean {
            let limits = Limits::samples(spp * frame.pixels() as u64);
            let of = |seed| {
                let mut integrator = made(request, &world);
                let film = Render::new(frame, &limits).run(&mut *integrator, &mut Uniform::new(Sobol::new(seed)));
                let image = pixels(&film.unwrap_or_else(|e| panic!("{e}")));
                let [x, y] = [0, 1].map(|axis| (window.origin()[axis] - frame.origin()[axis]) as usize);
                let row = |row: usize| &image[(y + row) * frame.size()[0] as usize + x..][..8];
                (0..8).flat_map(|i| row(i).iter()).map(|p| p[1]).sum::<f64>() / 64.0
            };
            (0..thorough(8, 16)).map(of).collect()
        };
        // Both have about the same number of light paths.
        let (expected, found) = (mean(whole, 8), mean(window, 96));
        let test = found.against_estimate(&expected);
        assert!(test.standard_error < 0.1 * expected.mean, "{request}: too noisy a test: {found:?}, {expected:?}");
        assert!(test.p() > sidak(FAMILY, 2), "{request}: {found:?} in the window, {expected:?} in the image");
    }
}

/// Films with splats are bit-identical for any number of threads, and when resumed.
#[test]
fn bits_do_not_depend_on_threads_or_interruptions() {
    let scene = bundled::files("cornell").expect("bundled").read().expect("it reads");
    for request in ["bdpt", "metropolis:length=16"] {
        with_the_same_bits_on_any_threads_and_resumed(&scene, request);
    }
}

/// A glass sphere focuses the light of a lamp of 1/100 of its radius. Two methods that share no strategy weights with the path
/// tracer agree on the focus, which the path tracer misses.
#[test]
fn splats_and_chains_find_the_light_of_a_tiny_lamp_through_glass() {
    let size = [32, 24];
    let world = bundle("caustic", size);
    let focus = |request: &str| -> Mean {
        let mean = |seed| {
            let image = pixels(&film(&world, request, size, 12, seed));
            (14..17).flat_map(|y| (17..21).map(move |x| y * 32 + x)).map(|i: usize| image[i][1]).sum::<f64>() / 12.0
        };
        (0..16).map(mean).collect()
    };
    let [path, bdpt, chains] = ["path", "bdpt", "metropolis"].map(focus);
    let test = bdpt.against_estimate(&chains);
    eprintln!("path {path:?}, bdpt {bdpt:?}, metropolis {chains:?}");
    assert!(test.p() > FAMILY && test.standard_error < 0.1 * chains.mean, "bdpt {bdpt:?}, metropolis {chains:?}");
    assert!(path.mean < 0.2 * chains.mean, "path {path:?}, metropolis {chains:?}");
}

/// Errors of the caustic's image at equal samples; see docs/results/transport-bidirectional.md.
#[test]
#[ignore = "minutes: cargo test --release -p dapple-transport --test transport errors_of_the_caustic -- --ignored --nocapture"]
fn errors_of_the_caustic() {
    let size = [48, 36];
    let world = bundle("caustic", size);
    let image = |request: &str, spp, seed| {
        let film = film(&world, request, size, spp, seed);
        (pixels(&film), film.record().rays as f64 / film.record().samples as f64)
    };
    let [(chains, _), (bdpt, _)] = ["metropolis", "bdpt"].map(|request| image(request, 4096, 99));
    for (name, reference) in [("metropolis", &chains), ("bdpt", &bdpt)] {
        for spp in [16, 256] {
            for request in ["path", "bdpt:splat=0", "bdpt", "metropolis"] {
                let (found, rays) = image(request, spp, 1);
                let squared = |(a, b): (&[f64; 3], &[f64; 3])| (a[1] - b[1]).powi(2) / (b[1] * b[1] + 0.01);
                let error = found.iter().zip(reference).map(squared).sum::<f64>() / found.len() as f64;
                eprintln!("beside {name}, {spp} spp, {request}: relMSE {error:.5}, {rays:.1} rays a sample");
            }
        }
    }
}

/// `depth=` limits paths like the scene's own limit, and a scene without lights is black.
#[test]
fn depth_limits_paths_and_a_dark_scene_is_black() {
    let [(_, camera), ..] = cameras();
    let mut lit = world(&hall(camera.clone(), diffuse(0.7), true));
    let image = |world: &World, options: &str| pixels(&film_by(&mut *bdpt(world, options), [8; 2], 4, 1));
    let limited = image(&lit, "depth=2");
    lit.set_max_depth(2);
    assert_eq!(limited, image(&lit, ""));
    lit.set_max_depth(3);
    assert_ne!(limited, image(&lit, ""));
    let dark = world(&hall(camera, diffuse(0.7), false));
    assert!(image(&dark, "").iter().all(|p| *p == [0.0; 3]));
}

/// The same random numbers give the same first hit, features and emission with and without light. Paths end before Russian
/// roulette, which is not used for features alone.
#[test]
fn features_without_light_are_those_of_whole_samples() {
    const SIZE: [u32; 2] = [40, 30];
    let points = Sobol::new(3);
    for (name, fewest) in [("cornell", 0), ("caustic", 400)] {
        let mut world = bundle(name, SIZE);
        world.set_max_depth(4);
        for request in ["bdpt", "bdpt:depth=1", "metropolis"] {
            let integrator = made(request, &world);
            let (mut behind, mut lit, mut worker) = (0, 0, Worker::default());
            for i in 0..4 * SIZE[0] * SIZE[1] {
                let id = SampleId::new([i % 40, i / 40 % 30], streams::WHOLE, u64::from(i / 1200));
                let draws = Draws::for_film(&points, id, Needs::none().with_features().with_emission());
                let whole = integrator.estimate(&draws, &mut worker);
                let alone = integrator.features_alone(&draws).expect("paths have features");
                let told = || format!("{name}, {request}, {id:?}");
                assert_eq!((alone.first_hit, alone.features), (whole.first_hit, whole.features), "{}", told());
                assert!(alone.cost <= whole.cost && alone.radiance == [0.0; 3], "{}", told());
                assert_eq!(alone.emission, whole.emission, "{}", told());
                lit += u32::from(alone.emission != [0.0; 3]);
                behind += u32::from(alone.features.is_some());
            }
            assert!(lit > 20, "{name}, {request}: {lit} samples see a lamp");
            assert!(behind >= fewest, "{name}, {request}: {behind} samples see something behind glass or in a mirror");
        }
    }
}
