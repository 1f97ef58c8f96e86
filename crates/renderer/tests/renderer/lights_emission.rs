//! Light that leaves the lights: its mean is the known power of each, and its densities are those reported.

use crate::statistics::{FAMILY, Mean, critical, sidak};
use crate::support::*;
use dapple_renderer::World;
use dapple_renderer::light::{EmittedLight, LightSelection, Target};
use dapple_scene::image::Image;
use dapple_scene::{Emission, EnvironmentRadiance, Geometry, Light, LightKind, Scene, SpotFalloff};
use glam::{DAffine3, DVec3, Vec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;
use std::sync::Arc;

const SAMPLES: u32 = 100_000;
/// Lights in this file; with the other 1 %, the false-alarm rate of all tests together is `FAMILY`.
const TESTS: usize = 16;

/// Rays of a world's lights, and the numbers that were rejected.
fn rays(world: &World, seed: u64) -> impl Iterator<Item = Option<EmittedLight>> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    (0..SAMPLES).map(move |_| {
        let u: [f32; 5] = std::array::from_fn(|_| rng.random::<f32>());
        world.lights().sample_emission(u[0], [u[1], u[2]], [u[3], u[4]])
    })
}

/// The mean flux in the scene's units of length, as a deviation from `expected` in standard errors.
fn deviation(scene: &Scene, expected: f64, seed: u64) -> f64 {
    let world = world(scene);
    let scale = world.space().scale();
    let mut mean = Mean::default();
    for ray in rays(&world, seed) {
        let flux = ray.map_or(0.0, |ray| f64::from(ray.flux().y) / (scale * scale));
        mean.add(flux);
    }
    let (value, error) = (mean.mean, mean.standard_error());
    // A light without variance has rounding only.
    (value - expected) / error.max(2e-6 * expected)
}

fn limit() -> f64 {
    critical(sidak(FAMILY, TESTS))
}

/// A floor of half width 1 that only bounds the scene: its sphere has the radius sqrt(2) around the origin.
fn floor() -> Scene {
    let mut scene = scene([4, 4], 60.0, DVec3::new(0.0, -4.0, 1.0), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y), DAffine3::IDENTITY, grey, None);
    scene
}

fn with_light(kind: LightKind) -> Scene {
    let mut scene = floor();
    let to_world = DAffine3::from_rotation_x(0.7) * DAffine3::from_rotation_y(0.4);
    scene.lights.push(Light { kind, to_world: DAffine3::from_translation(DVec3::Z) * to_world, source: line(200) });
    scene
}

fn with_lamp(geometry: Geometry, two_sided: bool) -> Scene {
    let mut scene = floor();
    let number = add(&mut scene, geometry, DAffine3::from_scale(DVec3::splat(1.5)), dapple_scene::MaterialId(0), None);
    scene.shapes[number].emission = Some(Emission { radiance: [2.0; 3], two_sided });
    scene
}

#[test]
fn emitted_rays_carry_the_power_of_each_lamp() {
    // An area A of radiance L has the power pi A L on each side; all lengths are 1.5 times those given.
    let rectangle = || rectangle(DVec3::Z, 0.3 * DVec3::X, 0.2 * DVec3::Y);
    let power = 2.0 * PI * 2.25;
    let disk = Geometry::Disk { height: 0.3, radius: 0.5, inner_radius: 0.2 };
    for (i, (scene, expected)) in [
        (with_lamp(rectangle(), false), power * 0.24),
        (with_lamp(rectangle(), true), 2.0 * power * 0.24),
        (with_lamp(Geometry::Sphere { radius: 0.5 }, false), power * PI),
        (with_lamp(disk, false), power * PI * 0.21),
    ]
    .into_iter()
    .enumerate()
    {
        let found = deviation(&scene, expected, i as u64);
        assert!(found.abs() < limit(), "lamp {i}: {found} standard errors");
        assert!(deviation(&scene, 1.02 * expected, i as u64).abs() > limit(), "lamp {i}: the test sees no 2 %");
    }
}

#[test]
fn emitted_rays_carry_the_power_of_lights_without_shape() {
    let spot = |falloff, start| LightKind::Spot { intensity: [3.0; 3], cone: 40.0, falloff_start: start, falloff };
    let cap = |degrees: f64| 2.0 * PI * (1.0 - degrees.to_radians().cos());
    // The mean of both falloffs over the cosine between the two cones is 1/2 and 1/5.
    let of_spot = |mean: f64, start: f64| 3.0 * (cap(start) + mean * (cap(40.0) - cap(start)));
    // The disk has the radius of the scene's sphere, sqrt(2) and the padding of its box.
    let disk = PI * f64::from(world(&floor()).lights().scene_sphere().1).powi(2);
    assert!((disk / (2.0 * PI) - 1.0).abs() < 1e-3, "{disk}");
    let sky = |[width, height]: [u32; 2], equal| {
        let pixels: Vec<_> = (0..width * height).map(|i| [((i * 7) % 5) as f32; 3]).collect();
        let image = Arc::new(Image { size: [width, height], pixels, alpha: Vec::new() });
        match equal {
            true => EnvironmentRadiance::EqualArea { image, scale: 0.5 },
            false => EnvironmentRadiance::LatLong { image, scale: 0.5 },
        }
    };
    // Equal areas have the mean of 16 texels; in latitude and longitude, rows count by the sines' integral.
    let mean_equal = (0..16).map(|i| f64::from((i * 7) % 5)).sum::<f64>() / 16.0 * 0.5;
    let row = |r: u32| (0..8).map(|c| f64::from(((8 * r + c) * 7) % 5)).sum::<f64>() / 8.0 * 0.5;
    let weight = |r: u32| ((f64::from(r) * PI / 4.0).cos() - (f64::from(r + 1) * PI / 4.0).cos()) / 2.0;
    let mean_long: f64 = (0..4).map(|r| row(r) * weight(r)).sum();
    let constant = EnvironmentRadiance::Constant([0.7; 3]);
    for (i, (kind, expected)) in [
        (LightKind::Point { intensity: [3.0; 3] }, 4.0 * PI * 3.0),
        (spot(SpotFalloff::Smoothstep, 20.0), of_spot(0.5, 20.0)),
        (spot(SpotFalloff::Quartic, 0.0), of_spot(0.2, 0.0)),
        (LightKind::Distant { irradiance: [3.0; 3] }, 3.0 * disk),
        (LightKind::Infinite { radiance: constant }, 4.0 * PI * 0.7 * disk),
        (LightKind::Infinite { radiance: sky([4, 4], true) }, 4.0 * PI * mean_equal * disk),
        (LightKind::Infinite { radiance: sky([8, 4], false) }, 4.0 * PI * mean_long * disk),
    ]
    .into_iter()
    .enumerate()
    {
        let scene = with_light(kind);
        let found = deviation(&scene, expected, 100 + i as u64);
        assert!(found.abs() < limit(), "light {i}: {found} standard errors");
        assert!(deviation(&scene, 1.03 * expected, 100 + i as u64).abs() > limit(), "light {i}: sees no 3 %");
    }
}

#[test]
fn several_lights_emit_their_sum_and_report_their_densities() {
    for selection in [LightSelection::Power, LightSelection::Learned] {
        let mut scene = with_lamp(Geometry::Sphere { radius: 0.5 }, true);
        scene.lights = room([4, 4]).lights;
        let pixels: Vec<_> = (0..64).map(|i| [((i * 7) % 5) as f32; 3]).collect();
        let radiance = EnvironmentRadiance::EqualArea {
            image: Arc::new(Image { size: [8, 8], pixels, alpha: Vec::new() }),
            scale: 0.5,
        };
        let kind = LightKind::Infinite { radiance };
        scene.lights.push(Light { kind, to_world: DAffine3::IDENTITY, source: line(201) });
        let mut world = world(&scene);
        world.set_light_selection(selection);
        for ray in rays(&world, 9).flatten().take(2000) {
            let normal = match &ray.source {
                Target::Surface(point) => point.normal,
                _ => Vec3::ZERO,
            };
            let found = world.lights().emission_pdf(ray.light, normal, ray.direction);
            let close = |a: f32, b: f32| (a / b - 1.0).abs() < 1e-3;
            assert!(close(found.position, ray.pdf.position), "{found:?} {ray:?}");
            assert!(close(found.direction, ray.pdf.direction), "{found:?} {ray:?}");
            let pmf = world.lights().pmf(ray.light);
            assert_eq!(pmf, ray.pmf, "the light was selected with another probability");
            if let Target::Far = ray.source {
                let sum = world.lights().environment_emission_pdf(-ray.direction);
                assert!(sum >= 0.99 * found.direction * pmf, "the sum over environments contains each");
            }
        }
    }
}
