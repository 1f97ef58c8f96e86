//! Photons: closed forms, agreement with the path tracer, the same bits everywhere.

#[path = "../../src/photons/map.rs"]
#[allow(dead_code, reason = "the library uses more of it")]
mod map;

use crate::support::*;
use map::{Photon, PhotonMap, shrunk};

/// A floor seen from above under a light at height 2. With `pane`, the light is behind a pane of index 1, which changes no
/// light, but hides the light from light sampling.
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

/// Only photons find a point light behind glass, since paths cannot hit it.
#[test]
fn light_through_clear_panes_is_that_without_them() {
    let falloff = SpotFalloff::Smoothstep;
    let kinds = [
        None,
        Some(LightKind::Point { intensity: [3.0; 3] }),
        Some(LightKind::Spot { intensity: [3.0; 3], cone: 50.0, falloff_start: 40.0, falloff }),
        Some(LightKind::Distant { irradiance: [2.0; 3] }),
    ];
    for kind in &kinds[..thorough(2, 4)] {
        let expected = means(&floor(kind.clone(), false), "path", 32, 0..8);
        let pane = floor(kind.clone(), true);
        // A radius of 5 % of the height blurs less than a thousandth.
        let found = means(&pane, "photons:photons=4000,radius=0.1,small=0.1", 4, 0..16);
        assert_near(&format!("{kind:?}"), &found, &expected, 0.0, 0.01);
        let is_point = matches!(kind, Some(LightKind::Point { .. }));
        assert!(!is_point || means(&pane, "path", 16, 0..2).mean == 0.0);
    }
}

/// A glass sphere between a floor and a lamp of radius 0.5, which paths can find. The camera sees only the caustic, since the
/// lamp's reflection in the sphere would add noise.
fn ball() -> Scene {
    let mut scene = scene([16, 16], 12.0, DVec3::new(-2.5, -1.0, 1.2), DVec3::new(-0.4, 0.0, 0.0));
    let grey = add_material(&mut scene, diffuse(0.5));
    let clear = add_material(&mut scene, glass(1.5));
    add(&mut scene, rectangle(DVec3::ZERO, 3.0 * DVec3::X, 3.0 * DVec3::Y), DAffine3::IDENTITY, grey, None);
    add_sphere(&mut scene, DVec3::new(0.0, 0.0, 1.0), 0.7, clear, 0.0);
    add_sphere(&mut scene, DVec3::new(1.0, 0.0, 3.5), 0.5, grey, 10.0);
    scene
}

/// Negative control: without the caustic, the floor is darker.
#[test]
fn caustics_of_a_glass_ball_are_those_of_path_tracing() {
    let expected = means(&ball(), "path", 256, 0..8);
    for request in ["photons:photons=4000,radius=0.05,small=10", "photons:photons=20000,radius=0.05,what=all"] {
        assert_near(request, &means(&ball(), request, 32, 10..18), &expected, 0.005, 0.005);
    }
    let without = means(&ball(), "photons:photons=1,radius=0.001,small=10", 64, 0..4).mean / expected.mean;
    assert!(without < 0.95, "the caustic is {without} of the light");
}

/// The lamp is in an absorbing medium, and the camera outside. Negative control: light that the medium does not absorb.
#[test]
fn photons_of_a_lamp_in_a_medium_are_absorbed_there() {
    let mut scene = ball();
    let ink = Medium { name: "ink".into(), absorption: [5.0; 3], scattering: [0.0; 3], g: 0.0, source: line(500) };
    scene.media.push(ink);
    let border = add_material(&mut scene, MaterialKind::Interface);
    add_sphere(&mut scene, DVec3::new(1.0, 0.0, 3.5), 0.7, border, 0.0);
    let media = MediumInterface { inside: Some(MediumId(0)), outside: None };
    scene.shapes.last_mut().expect("the border").media = Some(media);
    let expected = means(&scene, "path", 256, 0..4);
    let found = means(&scene, "photons:photons=4000,radius=0.05,small=10", 16, 10..18);
    assert_near("ink", &found, &expected, 0.005, 0.02);
    let bright = means(&ball(), "path", 64, 0..2).mean / expected.mean;
    assert!(bright > 1.5, "ink takes light: {bright}");
}

/// The part of a sphere within distance r of one of its points has area pi r^2, so density estimation has no bias. The images
/// without photons differ by rounding only.
#[test]
fn furnaces_have_their_radiance() {
    let cases = [(0.5, None), (0.8, Some(3)), (0.8, None), (0.8, Some(1))];
    for &(rho, depth) in &cases[..thorough(2, 4)] {
        let (scene, expected) = furnace(rho, depth, false);
        for request in ["what=all", "what=all,gather=1", "what=caustics"] {
            let request = format!("photons:photons=2000,radius=0.3,{request}");
            let name = format!("{request}, albedo {rho}, depth {depth:?}");
            assert_near(&name, &means(&scene, &request, 16, 0..8), &expected, 5e-6, 0.01);
        }
    }
}

#[test]
fn photons_have_the_same_bits_on_any_threads_and_resumed_within_a_pass() {
    for request in ["photons:small=10", "photons:what=all"] {
        let (film, samples) = with_the_same_bits_on_any_threads_and_resumed(&ball(), request);
        assert!(film.record().passes == 3 && film.record().prepare_rays > 5000);
        assert!(samples.iter().any(|samples| !samples.is_multiple_of(48 * 40)), "a slice ends within a pass");
    }
}

/// Rejected are radii that do not fit the scene, motion, and unknown kinds of light.
#[test]
fn what_photons_lack_is_refused() {
    let mut moving = ball();
    moving.shapes[1].moves_to = Some(DAffine3::from_translation(2.0 * DVec3::Z));
    moving.camera.shutter = [0.0, 1.0];
    let [moving, still, floor] = [moving, ball(), floor(None, true)].map(|scene| world(&scene));
    let motion = "photons: the scene has motion blur, which photons do not support; use integrator \"path\"";
    let mut cases = vec![
        (&moving, "photons".to_owned(), motion),
        (
            &still,
            "photons:what=nothing".to_owned(),
            "photons: what = \"nothing\" is not valid; use \"caustics\" or \"all\"",
        ),
    ];
    let radius = |radius: &str| format!("photons:radius={radius}");
    cases.extend(["1e-30", "1e-9", "100", "1e30"].map(|r| (&floor, radius(r), "does not fit the scene")));
    for (world, request, expected) in cases {
        let error = make_integrator(&request, world).err().expect("refused").to_string();
        assert!(error.contains(expected), "{request}: {error}");
    }
    for r in ["0", "1e-3", "1"] {
        made(&radius(r), &floor);
    }
}

#[test]
fn radii_shrink_as_published() {
    // r_N^2 is about N^(alpha - 1) / Gamma(1 + alpha): with alpha = 2/3 it is 0.1108 of the first after 1000 passes.
    assert!((shrunk(2.0 / 3.0, 999) - 0.1108).abs() < 5e-5, "{}", shrunk(2.0 / 3.0, 999));
    assert_eq!(shrunk(1.0, 1000), 1.0);
    assert!((shrunk(0.0, 999) - 1e-3).abs() < 1e-12, "without alpha the area falls as 1/N");
}

fn photon(position: Vec3) -> Photon {
    let flux = Vec3::splat(1.0);
    Photon { position, from: Vec3::Z, normal: Vec3::Z, flux, bounces: 1, is_caustic: true }
}

#[test]
fn a_look_up_finds_each_photon_within_the_radius_once() {
    // A Weyl sequence in the cube [-1, 1]^3.
    let place = |i: u32| {
        Vec3::new(0.754_877_7, 0.569_840_3, 0.321_927_4)
            .map(|a| 2.0 * (f64::from(i) * f64::from(a)).fract() as f32 - 1.0)
    };
    let photons: Vec<Photon> = (0..5000).map(|i| photon(place(i))).collect();
    for radius in [0.01, 0.1, 0.35, 3.0] {
        let map = PhotonMap::new(&photons, 5000, radius);
        for at in (0..200).map(|i| place(7 * i + 100_000)) {
            let mut found = 0;
            map.near(at, |_| found += 1);
            let expected = photons.iter().filter(|p| p.position.distance(at) <= radius).count();
            assert_eq!(found, expected, "around {at} within {radius}");
        }
    }
    PhotonMap::new(&[], 0, 1.0).near(Vec3::ZERO, |_| panic!("there are no photons"));
}
