//! Photons: closed forms, agreement with the path tracer, the same bits everywhere.

use crate::support::*;
use dapple_renderer::World;
use dapple_scene::{Light, LightKind, MaterialKind, Medium, MediumId, MediumInterface, Scene, SpotFalloff};
use dapple_transport::make_integrator;
use glam::{DAffine3, DVec3};

/// The largest deviation in standard errors that all tests of this file together exceed once in 10^6 runs.
const LIMIT: f64 = 5.5;

/// A floor seen from above under a light at height 2, behind a pane of index 1 if `pane`: the pane changes no light, but
/// hides the light from light sampling.
fn floor(kind: Option<LightKind>, pane: bool) -> Scene {
    let mut scene = scene([16, 16], 30.0, DVec3::new(0.0, -2.0, 1.2), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, 3.0 * DVec3::X, 3.0 * DVec3::Y), DAffine3::IDENTITY, grey, None);
    if pane {
        let clear = add_material(&mut scene, glass(1.0));
        let height = DVec3::new(0.0, 0.0, 1.8);
        add(&mut scene, rectangle(height, 3.0 * DVec3::X, 3.0 * DVec3::Y), DAffine3::IDENTITY, clear, None);
    }
    match kind {
        Some(kind) => {
            // Lights shine along +z, a distant one comes from there.
            let turn = if matches!(kind, LightKind::Spot { .. }) { std::f64::consts::PI } else { 0.1 };
            let to_world = DAffine3::from_translation(DVec3::new(0.0, 0.0, 2.0)) * DAffine3::from_rotation_x(turn);
            scene.lights.push(Light { kind, to_world, source: line(200) });
        }
        None => add_sphere(&mut scene, DVec3::new(0.0, 0.0, 2.0), 0.05, grey, 100.0),
    }
    scene
}

#[test]
fn a_radius_that_does_not_fit_the_scene_is_refused() {
    let world = World::new(&floor(None, true)).expect("a world");
    let make = |radius: &str| make_integrator(&format!("photons:radius={radius}"), &world).map(|_| ());
    for radius in ["1e-30", "1e-9", "100", "1e30"] {
        let error = make(radius).expect_err("no look-up has this radius").to_string();
        assert!(error.contains("does not fit the scene"), "{radius}: {error}");
    }
    for radius in ["0", "1e-3", "1"] {
        make(radius).expect("a radius");
    }
}

#[test]
fn light_of_balls_and_points_through_clear_panes_is_that_without_them() {
    check_panes(&[None, Some(LightKind::Point { intensity: [3.0; 3] })]);
}

#[test]
#[ignore = "9 s: four kinds of lights; two are tested always"]
fn light_through_clear_panes_is_that_without_them() {
    let falloff = SpotFalloff::Smoothstep;
    let spot = LightKind::Spot { intensity: [3.0; 3], cone: 50.0, falloff_start: 40.0, falloff };
    check_panes(&[
        None,
        Some(LightKind::Point { intensity: [3.0; 3] }),
        Some(spot),
        Some(LightKind::Distant { irradiance: [2.0; 3] }),
    ]);
}

/// The point light is the second kind.
fn check_panes(kinds: &[Option<LightKind>]) {
    for (i, kind) in kinds.iter().enumerate() {
        let expected = means(&floor(kind.clone(), false), "path", 64, 0..8);
        let photons = "photons:photons=4000,radius=0.1,small=0.1";
        let found = means(&floor(kind.clone(), true), photons, 16, 0..16);
        let z = found.against_estimate(&expected).z();
        // A radius of 5 % of the height blurs less than a thousandth.
        assert!(z.abs() < LIMIT, "light {i}: {} instead of {}, {z} standard errors", found.mean, expected.mean);
        let error = found.standard_error() / expected.mean;
        assert!(error < 0.01, "light {i}: the test sees no 6 %, {error}");
        if i == 1 {
            let dark = means(&floor(kind.clone(), true), "path", 16, 0..2).mean;
            assert_eq!(dark, 0.0, "a path tracer cannot find a point through glass");
        }
    }
}

/// A ball of glass over a floor under a lamp of radius 0.5, which paths can find. The camera sees the caustic alone: the
/// lamp's reflection in the ball would be noise.
fn ball() -> Scene {
    let mut scene = scene([16, 16], 12.0, DVec3::new(-2.5, -1.0, 1.2), DVec3::new(-0.4, 0.0, 0.0));
    let grey = add_material(&mut scene, diffuse(0.5));
    let clear = add_material(&mut scene, glass(1.5));
    add(&mut scene, rectangle(DVec3::ZERO, 3.0 * DVec3::X, 3.0 * DVec3::Y), DAffine3::IDENTITY, grey, None);
    add_sphere(&mut scene, DVec3::new(0.0, 0.0, 1.0), 0.7, clear, 0.0);
    add_sphere(&mut scene, DVec3::new(1.0, 0.0, 3.5), 0.5, grey, 10.0);
    scene
}

#[test]
fn caustics_of_a_glass_ball_are_those_of_path_tracing() {
    let scene = ball();
    let expected = means(&scene, "path", 1024, 0..8);
    for request in ["photons:photons=4000,radius=0.05,small=10", "photons:photons=20000,radius=0.05,what=all"] {
        let found = means(&scene, request, 32, 10..18);
        let bias = found.mean / expected.mean - 1.0;
        let error = (found.standard_error().hypot(expected.standard_error())) / expected.mean;
        assert!(bias.abs() < 0.005 + LIMIT * error, "{request}: {bias:+.4} +- {error:.4}");
        assert!(error < 0.005, "{request}: the test sees no 4 %, {error}");
    }
    // Negative control: without the caustic, the floor is darker.
    let without = means(&scene, "photons:photons=1,radius=0.001,small=10", 64, 0..4).mean / expected.mean;
    assert!(without < 0.95, "the caustic is {without} of the light");
}

/// The lamp alone lies in ink, which the camera is not in.
#[test]
fn photons_of_a_lamp_in_a_medium_are_absorbed_there() {
    let mut scene = ball();
    let ink = Medium { name: "ink".into(), absorption: [5.0; 3], scattering: [0.0; 3], g: 0.0, source: line(500) };
    scene.media.push(ink);
    let border = add_material(&mut scene, MaterialKind::Interface);
    add_sphere(&mut scene, DVec3::new(1.0, 0.0, 3.5), 0.7, border, 0.0);
    let media = MediumInterface { inside: Some(MediumId(0)), outside: None };
    scene.shapes.last_mut().expect("the border").media = Some(media);
    let expected = means(&scene, "path", 1024, 0..4);
    let found = means(&scene, "photons:photons=4000,radius=0.05,small=10", 32, 10..18);
    let bias = found.mean / expected.mean - 1.0;
    let error = (found.standard_error().hypot(expected.standard_error())) / expected.mean;
    assert!(bias.abs() < 0.005 + LIMIT * error && error < 0.02, "{bias:+.4} +- {error:.4}");
    // Negative control: light that the ink does not absorb.
    let bright = means(&ball(), "path", 64, 0..2).mean / expected.mean;
    assert!(bright > 1.5, "ink takes light: {bright}");
}

/// The inside of a sphere that reflects `rho` and emits 1.
fn furnace(rho: f32, depth: Option<u32>) -> Scene {
    let mut scene = scene([8, 8], 70.0, DVec3::new(0.2, 0.3, -0.1), DVec3::new(-0.9, 0.5, 0.4));
    let wall = add_material(&mut scene, diffuse(rho));
    add_sphere(&mut scene, DVec3::ZERO, 1.0, wall, 1.0);
    scene.shapes[0].reversed = true;
    scene.max_depth = depth;
    scene
}

#[test]
fn two_furnaces_have_their_radiance() {
    check_furnaces(&[(0.5, None), (0.8, Some(3))]);
}

#[test]
#[ignore = "7 s: four furnaces; two are tested always"]
fn a_furnace_has_its_radiance() {
    check_furnaces(&[(0.5, None), (0.8, None), (0.8, Some(1)), (0.8, Some(3))]);
}

/// A ball of radius r around a point of a sphere covers pi r^2 of it, so density estimation has no bias.
fn check_furnaces(cases: &[(f32, Option<u32>)]) {
    for &(rho, depth) in cases {
        for request in ["what=all", "what=all,gather=1", "what=caustics"] {
            let found = means(&furnace(rho, depth), &format!("photons:photons=2000,radius=0.3,{request}"), 16, 0..8);
            let lost = depth.map_or(0.0, |d| f64::from(rho).powi(d as i32 + 1));
            let expected = (1.0 - lost) / (1.0 - f64::from(rho));
            let error = found.standard_error() / expected;
            // Without photons nothing but rounding is left.
            let z = (found.mean / expected - 1.0) / error.max(1e-6);
            assert!(z.abs() < LIMIT, "{request}, albedo {rho}, depth {depth:?}: {} of {expected}, {z}", found.mean);
            assert!(error < 0.01, "{request}: {error}");
        }
    }
}

#[test]
fn photons_have_the_same_bits_on_any_threads_and_resumed_within_a_pass() {
    for request in ["photons:small=10", "photons:what=all"] {
        assert_eq!(with_the_same_bits_on_any_threads_and_resumed(&ball(), request).record().passes, 3);
    }
}

#[test]
fn scenes_that_photons_lack_are_refused() {
    let mut moving = ball();
    moving.shapes[1].moves_to = Some(DAffine3::from_translation(2.0 * DVec3::Z));
    moving.camera.shutter = [0.0, 1.0];
    let world = World::new(&moving).expect("a world");
    let error = make_integrator("photons", &world).err().expect("refused").to_string();
    assert!(error.starts_with("photons: the scene has motion blur, and photons have no time; use \"path\""), "{error}");
    let world = World::new(&ball()).expect("a world");
    let error = make_integrator("photons:what=nothing", &world).err().expect("refused").to_string();
    assert_eq!(error, "photons: what = \"nothing\"; give \"caustics\" or \"all\"");
}
