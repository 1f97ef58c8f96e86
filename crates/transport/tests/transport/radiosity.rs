//! Radiosity: closed forms, the path tracer's image up to a bias that falls with smaller patches, the same bits.
#![allow(clippy::print_stderr, reason = "figures of a test")]

use crate::support::*;
use dapple_renderer::World;
use dapple_scene::{MaterialKind, Scene};
use dapple_transport::make_integrator;
use glam::{DAffine3, DVec3};

/// The largest deviation in standard errors that all tests of this file together exceed once in 10^6 runs.
const LIMIT: f64 = 5.5;

/// A diffuse room with a lamp below its ceiling, a ball on the floor, and a wall of this material.
fn chamber(wall: MaterialKind) -> Scene {
    let mut scene = scene([12, 12], 60.0, DVec3::new(0.0, -0.9, 0.2), DVec3::new(0.0, 0.5, -0.2));
    let grey = add_material(&mut scene, diffuse(0.6));
    let other = add_material(&mut scene, wall);
    scene.max_depth = Some(6);
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    for (centre, u, v) in [(-z, x, y), (z, y, x), (y, x, z), (-y, z, x), (-x, y, z), (x, z, y)] {
        let material = if centre == x { other } else { grey };
        add(&mut scene, rectangle(centre, u, v), DAffine3::IDENTITY, material, None);
    }
    add(&mut scene, rectangle(0.98 * z, 0.3 * y, 0.3 * x), DAffine3::IDENTITY, grey, Some(10.0));
    add_sphere(&mut scene, DVec3::new(-0.3, 0.4, -0.6), 0.4, grey, 0.0);
    scene
}

/// The root of the mean square of relative differences from `expected`, pixel by pixel in green.
fn difference(scene: &Scene, integrator: &str, spp: u64, expected: &[f64]) -> f64 {
    let world = World::new(scene).expect("a world");
    let found = film(&world, integrator, scene.film.resolution, spp, 40);
    let square = |(i, x): (usize, &f64)| (found.mean(i)[1] / x - 1.0).powi(2);
    (expected.iter().enumerate().map(square).sum::<f64>() / expected.len() as f64).sqrt()
}

#[test]
fn the_bias_falls_with_smaller_patches() {
    let scene = chamber(diffuse(0.6));
    let world = World::new(&scene).expect("a world");
    let reference = film(&world, "path", [12, 12], 4096, 3);
    let expected: Vec<f64> = (0..144).map(|i| reference.mean(i)[1]).collect();
    let at = |patches: u32, gather: u32| {
        let request = format!("radiosity:patches={patches},gather={gather},particles=40000");
        difference(&scene, &request, 32, &expected)
    };
    let shown = [8, 64, 512].map(|patches| at(patches, 0));
    let gathered = [8, 512].map(|patches| at(patches, 1));
    eprintln!("differences with 8, 64 and 512 patches: {shown:.4?}; gathered with 8 and 512: {gathered:.4?}");
    // The noise of 32 spp, with that of the reference, is part of all these.
    assert!(shown[0] > 2.0 * shown[1] && shown[1] > 1.3 * shown[2] && shown[2] < 0.03, "shown {shown:.4?}");
    // Negative control: patches as large as walls are no image.
    assert!(shown[0] > 0.1 && gathered[0] > 2.0 * gathered[1], "{shown:.4?}, {gathered:.4?}");
}

#[test]
fn means_are_the_path_tracers_beside_a_glossy_wall() {
    check_means(vec![("glossy", metal(0.3))]);
}

#[test]
#[ignore = "25 s: four walls; the glossy one is tested always"]
fn means_are_the_path_tracers() {
    // Glossy walls, mirrors and sheets that light passes have no bias of their own.
    let sheet = MaterialKind::DiffuseTransmission {
        reflectance: dapple_scene::Color::Constant([0.4; 3]),
        transmittance: dapple_scene::Color::Constant([0.3; 3]),
    };
    check_means(vec![("diffuse", diffuse(0.3)), ("mirror", metal(0.0)), ("glossy", metal(0.3)), ("sheet", sheet)]);
}

fn check_means(walls: Vec<(&str, MaterialKind)>) {
    for (name, wall) in walls {
        let scene = chamber(wall);
        let expected = means(&scene, "path", 256, 0..8);
        for gather in [0, 1] {
            let request = format!("radiosity:particles=4000,gather={gather}");
            let found = means(&scene, &request, 32, 10..18);
            let bias = found.mean / expected.mean - 1.0;
            let error = found.standard_error().hypot(expected.standard_error()) / expected.mean;
            assert!(bias.abs() < 0.005 + LIMIT * error, "{name}, gather {gather}: {bias:+.4} +- {error:.4}");
            assert!(error < 0.008, "{name}, gather {gather}: the test sees no 5 %, {error}");
        }
    }
    let direct = Scene { max_depth: Some(1), ..chamber(diffuse(0.3)) };
    let less = means(&direct, "path", 64, 0..4).mean / means(&chamber(diffuse(0.3)), "path", 64, 0..4).mean;
    assert!(less < 0.9, "negative control: indirect light is {} of all", 1.0 - less);
}

/// The inside of a sphere, or of a cube, that reflects `rho` and emits 1.
fn furnace(rho: f32, depth: u32, cubic: bool) -> Scene {
    let mut scene = scene([8, 8], 70.0, DVec3::new(0.2, 0.3, -0.1), DVec3::new(-0.9, 0.5, 0.4));
    let wall = add_material(&mut scene, diffuse(rho));
    scene.max_depth = Some(depth);
    if cubic {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        for (centre, u, v) in [(-z, x, y), (z, y, x), (y, x, z), (-y, z, x), (-x, y, z), (x, z, y)] {
            add(&mut scene, rectangle(centre, u, v), DAffine3::IDENTITY, wall, Some(1.0));
        }
    } else {
        add_sphere(&mut scene, DVec3::ZERO, 1.0, wall, 1.0);
        scene.shapes[0].reversed = true;
    }
    scene
}

#[test]
fn two_furnaces_have_their_radiance_and_keep_their_energy() {
    check_furnaces(&[(0.5, 20, false), (0.8, 5, true)]);
}

#[test]
#[ignore = "11 s: five furnaces; two are tested always"]
fn a_furnace_has_its_radiance_and_keeps_its_energy() {
    check_furnaces(&[(0.5, 20, false), (0.8, 5, false), (0.8, 1, true), (0.8, 5, true), (0.8, 30, true)]);
}

/// Albedos, depths, and whether the furnace is a cube.
fn check_furnaces(cases: &[(f32, u32, bool)]) {
    for &(rho, depth, cubic) in cases {
        for gather in [0, 1] {
            let request = format!("radiosity:patches=300,particles=4000,gather={gather}");
            let found = means(&furnace(rho, depth, cubic), &request, 16, 0..8);
            let expected = (1.0 - f64::from(rho).powi(depth as i32 + 1)) / (1.0 - f64::from(rho));
            let error = found.standard_error() / expected;
            // Cells of a sphere have its area to 2e-3.
            let off = (found.mean / expected - 1.0).abs() - if cubic { 1e-6 } else { 2e-3 };
            assert!(off < LIMIT * error, "albedo {rho}, depth {depth}: {} of {expected}", found.mean);
            assert!(error < 0.01, "{error}");
        }
    }
}

#[test]
fn patches_have_the_same_bits_on_any_threads_and_resumed() {
    with_the_same_bits_on_any_threads_and_resumed(&chamber(metal(0.3)), "radiosity:patches=500");
}

#[test]
fn scenes_that_patches_lack_are_refused() {
    let mut moving = chamber(diffuse(0.3));
    moving.shapes[1].moves_to = Some(DAffine3::from_translation(2.0 * DVec3::Z));
    moving.camera.shutter = [0.0, 1.0];
    let world = World::new(&moving).expect("a world");
    let error = make_integrator("radiosity", &world).err().expect("refused").to_string();
    assert_eq!(error, "radiosity: the scene has motion-blur, and patches stand still; use \"path\"");
    let world = World::new(&chamber(diffuse(0.3))).expect("a world");
    let error = make_integrator("radiosity:patches=0", &world).err().expect("refused").to_string();
    assert_eq!(error, "radiosity: patches = 0 is out of range: 1 to 1048576");
}
