//! Virtual lights: the path tracer's mean in diffuse scenes.

use crate::support::*;
use dapple_conformance::bits;
use dapple_renderer::World;
use dapple_scene::Scene;
use glam::{DAffine3, DVec3};

/// A diffuse room with a lamp below its ceiling, and a mirror on a wall.
fn chamber(mirror: bool) -> Scene {
    let mut scene = scene([12, 12], 50.0, DVec3::new(0.0, -0.9, 0.2), DVec3::new(0.0, 0.5, -0.2));
    let grey = add_material(&mut scene, diffuse(0.6));
    let shiny = add_material(&mut scene, metal(0.0));
    scene.max_depth = Some(6);
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    for (centre, u, v) in [(-z, x, y), (z, y, x), (y, x, z), (-y, z, x), (-x, y, z), (x, z, y)] {
        let material = if mirror && centre == x { shiny } else { grey };
        add(&mut scene, rectangle(centre, u, v), DAffine3::IDENTITY, material, None);
    }
    add(&mut scene, rectangle(0.98 * z, 0.3 * y, 0.3 * x), DAffine3::IDENTITY, grey, Some(10.0));
    scene
}

#[test]
fn virtual_lights_make_the_path_tracers_mean() {
    for mirror in [false, true] {
        let scene = chamber(mirror);
        let expected = means(&scene, "path", 512, 0..8);
        let found = means(&scene, "instant:paths=16,clamp=inf", 32, 0..16);
        let z = found.against_estimate(&expected).z();
        let error = found.standard_error() / expected.mean;
        assert!(z.abs() < 5.5, "mirror {mirror}: {} instead of {}, {z}", found.mean, expected.mean);
        assert!(error < 0.015, "the test sees no 10 %: {error}");
        // Negative control: direct light alone is darker.
        let direct = Scene { max_depth: Some(1), ..scene.clone() };
        assert!(means(&direct, "path", 64, 0..4).mean < 0.8 * expected.mean);
    }
}

#[test]
fn virtual_lights_have_the_same_bits_on_any_threads() {
    let world = World::new(&chamber(true)).expect("a world");
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        bits(&pool.install(|| film(&world, "instant:paths=8", [12, 12], 5, 2)))
    };
    assert!(on(1) == on(3));
}
