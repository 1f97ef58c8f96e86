//! Points, spots and parallel light on a plane, against closed forms in the whole renderer; invalid lights; shadows.

use crate::support::*;
use dapple_low_discrepancy::Sobol;
use dapple_renderer::World;
use dapple_renderer::light::{LightSelection, Target};
use dapple_scene::{Light, LightKind, Scene, SpotFalloff};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::f64::consts::PI;

const RHO: f64 = 0.5;

fn add_light(scene: &mut Scene, kind: LightKind, to_world: DAffine3) {
    let source = line(200 + scene.lights.len() as u32);
    scene.lights.push(Light { kind, to_world, source });
}

/// A diffuse floor through `middle`, normal +z, seen by a camera of tiny view that looks at `middle`. All lengths are
/// times `unit`.
fn floor(middle: DVec3, unit: f64) -> Scene {
    let mut scene = scene([1, 1], 1e-5, middle + unit * DVec3::new(0.0, -3.0, 3.0), middle);
    let grey = add_material(&mut scene, diffuse(RHO as f32));
    let floor = rectangle(middle, unit * 4.0 * DVec3::X, unit * 4.0 * DVec3::Y);
    add(&mut scene, floor, DAffine3::IDENTITY, grey, None);
    scene.max_depth = Some(1);
    scene
}

/// The red irradiance at the floor's middle, from the image.
fn irradiance(scene: &Scene) -> f64 {
    mean(&image(scene, 4, 1))[0] * PI / RHO
}

fn near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= 2e-5 * expected, "{what}: {found} instead of {expected}");
}

/// The transform of a light: +z along `axis`, the origin at `at`.
fn aimed(at: DVec3, axis: DVec3) -> DAffine3 {
    let z = axis.normalize();
    let (x, y) = z.any_orthonormal_pair();
    DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: at }
}

/// Units of length and origins, which change nothing in the file's units.
fn frames() -> [(DVec3, f64); 5] {
    [
        (DVec3::ZERO, 1.0),
        (DVec3::new(3.0, -2.0, 7.0), 1.0),
        (DVec3::ZERO, 1000.0 / 3.0),
        (DVec3::splat(5e4), 0.02),
        (DVec3::ZERO, 1e12),
    ]
}

#[test]
fn point_light_on_a_plane_matches_its_closed_form_l03() {
    for (middle, unit) in frames() {
        for p in [DVec3::Z, DVec3::new(2.0, 1.0, 0.5), DVec3::new(-30.0, 0.0, 40.0), DVec3::new(0.0, 0.0, 1e-2)] {
            let mut scene = floor(middle, unit);
            // Scale and rotation of its transform have no effect.
            let to_world =
                DAffine3::from_translation(middle + unit * p) * DAffine3::from_scale(DVec3::new(9.0, 2.0, -3.0));
            add_light(&mut scene, LightKind::Point { intensity: [3.0, 2.0, 1.0] }, to_world);
            let expected = 3.0 * p.z / p.length().powi(3) / (unit * unit);
            near(irradiance(&scene), expected, &format!("{middle} {unit} {p}"));
        }
        // A light below the floor gives nothing.
        let mut scene = floor(middle, unit);
        add_light(
            &mut scene,
            LightKind::Point { intensity: [3.0; 3] },
            DAffine3::from_translation(middle - unit * DVec3::Z),
        );
        assert_eq!(irradiance(&scene), 0.0);
    }
}

#[test]
fn spot_light_on_a_plane_matches_its_closed_form_l03() {
    let position = DVec3::new(0.4, -0.3, 1.2);
    for (middle, unit) in frames() {
        for (cone, start) in [(30.0_f32, 10.0_f32), (20.0, 20.0), (120.0, 0.0), (2.0, 0.5), (180.0, 0.0)] {
            for falloff in [SpotFalloff::Smoothstep, SpotFalloff::Quartic] {
                for share in [0.0, 0.3, 0.7, 0.9, 0.999, 1.01] {
                    // An axis turned so that the floor's middle lies at this fraction of the cone.
                    let angle = f64::from(cone).to_radians() * share;
                    let towards = -position.normalize();
                    let (across, _) = towards.any_orthonormal_pair();
                    let axis = towards * angle.cos() + across * angle.sin();
                    let mut scene = floor(middle, unit);
                    let to_world = aimed(middle + unit * position, axis) * DAffine3::from_scale(DVec3::splat(-2.0));
                    let to_world = to_world * DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
                    let kind = LightKind::Spot { intensity: [3.0; 3], cone, falloff_start: start, falloff };
                    add_light(&mut scene, kind, to_world);
                    let [edge, core] = [cone, start].map(|a| f64::from(a).to_radians().cos());
                    let x = if start == cone {
                        f64::from(share <= 1.0)
                    } else {
                        ((angle.cos() - edge) / (core - edge)).clamp(0.0, 1.0)
                    };
                    let falls = if falloff == SpotFalloff::Smoothstep { x * x * (3.0 - 2.0 * x) } else { x.powi(4) };
                    let expected = 3.0 * falls * position.z / position.length().powi(3) / (unit * unit);
                    let found = irradiance(&scene);
                    let what = format!("{middle} {unit} {cone} {start} {falloff:?} {share}: {found} {expected}");
                    // Directions round to 6e-8, which matters beside the width of the cone.
                    let full = 3.0 * position.z / position.length().powi(3) / (unit * unit);
                    assert!(
                        angle > PI
                            || (found - expected).abs() <= 2e-5 * expected + full * 3e-7 / f64::from(cone).to_radians(),
                        "{what}"
                    );
                }
            }
        }
    }
}

#[test]
fn distant_light_on_a_plane_matches_its_closed_form_l03() {
    for (middle, unit) in frames() {
        for w in [DVec3::Z, DVec3::new(1.0, 2.0, 0.5), DVec3::new(-1.0, 0.0, 1e-3)] {
            let mut scene = floor(middle, unit);
            let to_world = aimed(DVec3::splat(77.0), w) * DAffine3::from_scale(DVec3::splat(5.0));
            add_light(&mut scene, LightKind::Distant { irradiance: [3.0; 3] }, to_world);
            near(irradiance(&scene), 3.0 * w.normalize().z, &format!("{middle} {unit} {w}"));
        }
    }
}

/// Objects between point and light cast a shadow; objects behind the light do not.
#[test]
fn lights_without_extent_cast_shadows_l03() {
    let kinds = [
        LightKind::Point { intensity: [1.0; 3] },
        LightKind::Spot { intensity: [1.0; 3], cone: 30.0, falloff_start: 30.0, falloff: SpotFalloff::Quartic },
    ];
    for kind in kinds {
        for (height, lit) in [(0.5, false), (1.0 - 1e-4, false), (1.0 + 1e-4, true), (3.0, true)] {
            let mut scene = floor(DVec3::ZERO, 1.0);
            let black = add_material(&mut scene, diffuse(0.0));
            let plate = rectangle(height * DVec3::Z, 0.2 * DVec3::X, 0.2 * DVec3::Y);
            add(&mut scene, plate, DAffine3::IDENTITY, black, None);
            add_light(&mut scene, kind.clone(), aimed(DVec3::Z, DVec3::NEG_Z));
            let found = irradiance(&scene);
            if lit { near(found, 1.0, "lit") } else { assert_eq!(found, 0.0, "{kind:?} under a plate at {height}") }
        }
    }
    let mut scene = floor(DVec3::ZERO, 1.0);
    let black = add_material(&mut scene, diffuse(0.0));
    add_light(&mut scene, LightKind::Distant { irradiance: [1.0; 3] }, DAffine3::IDENTITY);
    add(&mut scene, rectangle(1e3 * DVec3::Z, DVec3::X, DVec3::Y), DAffine3::IDENTITY, black, None);
    assert_eq!(irradiance(&scene), 0.0);
}

/// A light without extent is found by light sampling alone, and reports no density.
#[test]
fn lights_without_extent_are_found_by_light_sampling_only_l09() {
    let mut scene = floor(DVec3::ZERO, 1.0);
    add_light(&mut scene, LightKind::Distant { irradiance: [1.0; 3] }, DAffine3::IDENTITY);
    let world = world(&scene);
    let lights = world.lights();
    assert!(lights.has_delta() && !lights.has_environment());
    assert_eq!(lights.environment(Vec3::Z), Vec3::ZERO, "no ray meets it");
    let sample = lights.sample(Vec3::ZERO, 0.5, [0.5; 2]).expect("it shines");
    assert!(sample.delta && sample.pdf == 1.0 && sample.wi == Vec3::Z && matches!(sample.target, Target::Far));
    add_light(&mut scene, LightKind::Point { intensity: [1.0; 3] }, DAffine3::from_translation(DVec3::Z));
    add_sky(&mut scene, 1.0);
    let world = crate::support::world(&scene);
    assert!(world.lights().has_delta() && world.lights().has_environment());
    let places = (0..100).filter_map(|i| world.lights().sample(Vec3::ZERO, i as f32 / 100.0, [0.3; 2]));
    for sample in places {
        let chosen = [0, 1, 2].map(|i| world.lights().pmf(i));
        assert_eq!(sample.delta, chosen.contains(&sample.pdf), "{sample:?} {chosen:?}");
    }
    // At the point itself there is no direction, and no panic.
    let at = world.space().point(DVec3::Z).as_vec3();
    assert!(
        (0..100).filter_map(|i| world.lights().sample(at, i as f32 / 100.0, [0.3; 2])).all(|s| s.radiance.is_finite())
    );
}

/// Three kinds of lights add up in one image.
#[test]
fn lights_add_up_l03() {
    let mut scene = floor(DVec3::ZERO, 1.0);
    add_light(
        &mut scene,
        LightKind::Point { intensity: [3.0; 3] },
        DAffine3::from_translation(DVec3::new(1.0, 0.0, 2.0)),
    );
    add_light(&mut scene, LightKind::Distant { irradiance: [0.7; 3] }, aimed(DVec3::ZERO, DVec3::new(0.0, 1.0, 1.0)));
    let falloff = SpotFalloff::Smoothstep;
    let spot = LightKind::Spot { intensity: [2.0; 3], cone: 30.0, falloff_start: 10.0, falloff };
    add_light(&mut scene, spot, aimed(DVec3::new(0.0, 0.0, 1.5), DVec3::NEG_Z));
    add_sky(&mut scene, 0.2);
    let expected = 3.0 * 2.0 / 5.0_f64.powf(1.5) + 0.7 * 0.5_f64.sqrt() + 2.0 / 2.25 + 0.2 * PI;
    for choice in [LightSelection::Power, LightSelection::Uniform] {
        let mut world = world(&scene);
        world.set_light_selection(choice);
        let found = mean(&film_of(&world, [1, 1], 1 << 16, Sobol::new(3)))[0] * PI / RHO;
        assert!((found / expected - 1.0).abs() < 1e-3, "{choice:?}: {found} {expected}");
    }
}

#[test]
fn invalid_lights_without_extent_are_refused_l06() {
    let refused = |kind: LightKind, to_world: DAffine3| {
        let mut scene = floor(DVec3::ZERO, 1.0);
        add_light(&mut scene, kind, to_world);
        World::new(&scene).err().map(|e| e.to_string())
    };
    let spot = |cone: f32, falloff_start: f32| LightKind::Spot {
        intensity: [1.0; 3],
        cone,
        falloff_start,
        falloff: SpotFalloff::Smoothstep,
    };
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let value = [1.0, bad, 1.0];
        for kind in [LightKind::Point { intensity: value }, LightKind::Distant { irradiance: value }] {
            let message = refused(kind, DAffine3::IDENTITY).unwrap_or_default();
            assert!(message.starts_with("made.pbrt:200: the light's intensity"), "{message}");
        }
    }
    for (cone, start) in [(0.0, 0.0), (-5.0, -6.0), (30.0, 31.0), (181.0, 10.0), (f32::NAN, 1.0), (30.0, f32::NAN)] {
        let message = refused(spot(cone, start), DAffine3::IDENTITY).unwrap_or_default();
        assert!(message.starts_with("made.pbrt:200: the spot's cone"), "{cone} {start}: {message}");
    }
    let transforms = [
        DAffine3::from_mat3(DMat3::ZERO),
        DAffine3::from_mat3(DMat3::from_diagonal(DVec3::NAN)),
        DAffine3::from_translation(DVec3::NAN),
    ];
    for to_world in transforms {
        assert!(refused(spot(30.0, 10.0), to_world).is_some(), "{to_world}");
        if !to_world.matrix3.is_finite() || to_world.matrix3 == DMat3::ZERO {
            assert!(refused(LightKind::Distant { irradiance: [1.0; 3] }, to_world).is_some(), "{to_world}");
        } else {
            assert!(refused(LightKind::Point { intensity: [1.0; 3] }, to_world).is_some(), "{to_world}");
        }
    }
    let stretch = DAffine3::from_scale(DVec3::new(1.0, 1.0, 2.0));
    assert!(refused(spot(30.0, 10.0), stretch).is_some_and(|m| m.contains("transform")));
    assert_eq!(refused(LightKind::Point { intensity: [1.0; 3] }, stretch), None, "a point has no shape");
    let far = DAffine3::from_translation(DVec3::splat(1e25));
    assert!(refused(LightKind::Point { intensity: [1.0; 3] }, far).is_some_and(|m| m.contains("too far away")));
    // Too strong for a scene so small that its square is beyond single precision.
    let mut small = floor(DVec3::ZERO, 1e-25);
    add_light(&mut small, LightKind::Point { intensity: [1.0; 3] }, DAffine3::from_translation(1e-25 * DVec3::Z));
    assert!(World::new(&small).is_err());
    // Black lights are left out, and then there is no light.
    let mut scene = floor(DVec3::ZERO, 1.0);
    add_light(&mut scene, LightKind::Point { intensity: [0.0; 3] }, DAffine3::IDENTITY);
    add_light(&mut scene, LightKind::Distant { irradiance: [0.0; 3] }, DAffine3::IDENTITY);
    let world = world(&scene);
    assert!(world.lights().is_empty());
    assert_eq!(irradiance(&scene), 0.0);
}
