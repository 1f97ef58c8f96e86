//! The price of unused effects: the specialised integrator beside a hand-written loop for the simplest scene.
#![allow(clippy::print_stderr)]

#[path = "renderer/statistics/mod.rs"]
mod statistics;
#[path = "renderer/support/mod.rs"]
mod support;

use dapple_core::{Draws, Integrator, PointSet, SampleId, Worker};
use dapple_geometry::{Ray, spawn_ray, spawn_ray_to};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::blocks;
use dapple_renderer::camera::{Lens, Pinhole};
use dapple_renderer::light::Target;
use dapple_renderer::shading::{ShadingFrame, power_heuristic, warp};
use dapple_renderer::{World, integrator};
use dapple_scene::{PixelFilter, Scene};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;
use std::hint::black_box;
use std::process::Command;
use support::*;

const SIZE: [u32; 2] = [32, 32];
const ALBEDO: f32 = 0.6;
/// The index of the lamp's shape.
const LAMP: u32 = 2;

/// Pinhole, diffuse surfaces, one light, direct light: two rectangles under a lamp.
fn simplest() -> Scene {
    let mut scene = scene(SIZE, 45.0, DVec3::new(0.0, -4.0, 2.0), DVec3::new(0.0, 0.0, 0.5));
    scene.max_depth = Some(1);
    scene.film.pixel_filter = PixelFilter::default();
    let grey = add_material(&mut scene, diffuse(ALBEDO));
    let black = add_material(&mut scene, diffuse(0.0));
    let floor = rectangle(DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 3.0);
    let wall = rectangle(DVec3::new(0.0, 1.5, 1.0), DVec3::X * 2.0, DVec3::Z);
    let lamp = rectangle(DVec3::new(0.0, 0.0, 2.5), DVec3::X * 0.5, DVec3::NEG_Y * 0.5);
    add(&mut scene, floor, DAffine3::IDENTITY, grey, None);
    add(&mut scene, wall, DAffine3::IDENTITY, grey, None);
    add(&mut scene, lamp, DAffine3::IDENTITY, black, Some(5.0));
    scene
}

/// The same estimator, reduced to the needs of this scene. Its lamp's triangles are those of the world's geometry, and
/// the numbers are added in the same order.
#[inline(never)]
fn by_hand(world: &World, draws: &Draws<'_>) -> [f32; 3] {
    let (geometry, lights, view) = (world.geometry(), world.lights(), world.camera());
    let u = draws.block(blocks::CAMERA);
    let ray = Pinhole::ray(view, view.place(draws.pixel(), Vec2::new(u[0] - 0.5, u[1] - 0.5)), [u[2], u[3]]);
    let shone = |ray: &Ray, normal: Vec3| lights.lamp(0).map_or(Vec3::ZERO, |l| l.radiance(-normal.dot(ray.direction)));
    let Some(hit) = geometry.closest(&ray) else { return [0.0; 3] };
    let at = geometry.surface(&ray, &hit);
    if hit.shape == LAMP {
        return shone(&ray, at.normal).to_array();
    }
    let frame = ShadingFrame::from_normal(at.normal);
    let outside = -at.normal.dot(ray.direction);
    let u = draws.block(blocks::scatter(0));
    let mut radiance = Vec3::ZERO;
    if let Some(light) = lights.sample(at.position, 0.0, [u[0], u[1]])
        && at.normal.dot(light.wi) * outside > 0.0
        && let Target::Surface(point) = &light.target
        && !geometry.occluded(&spawn_ray_to(&at, point))
    {
        let cosine = light.wi.dot(frame.normal).abs();
        let weight = power_heuristic(light.pdf, cosine * FRAC_1_PI) / light.pdf;
        radiance += Vec3::splat(ALBEDO * FRAC_1_PI) * light.radiance * (cosine * weight);
    }
    let side = if outside > 0.0 { 1.0 } else { -1.0 };
    let local = warp::cosine_hemisphere([u[2], u[3]]);
    let wi = frame.to_world(side * local);
    if !(local.z > 0.0 && at.normal.dot(wi) * outside > 0.0) {
        return radiance.to_array();
    }
    let next = spawn_ray(&at, wi);
    if let Some(hit) = geometry.closest(&next)
        && hit.shape == LAMP
    {
        let point = geometry.surface(&next, &hit);
        let found = shone(&next, point.normal);
        if found != Vec3::ZERO {
            let pdf = lights.pdf(0, at.position, &point);
            radiance += ALBEDO * found * power_heuristic(local.z * FRAC_1_PI, pdf);
        }
    }
    radiance.to_array()
}

fn walk(samples: u64, mut estimate: impl FnMut(&Draws<'_>) -> [f32; 3]) {
    let points = Sobol::new(3);
    for index in 0..samples {
        let pixel = [index as u32 % SIZE[0], index as u32 / SIZE[0] % SIZE[1]];
        let draws = Draws::new(&points, SampleId::new(pixel, 0, index / 1024));
        black_box(estimate(&draws));
    }
}

fn ours(integrator: &dyn Integrator, draws: &Draws<'_>) -> [f32; 3] {
    integrator.estimate(draws, &mut Worker::default()).radiance
}

#[test]
fn the_hand_written_loop_is_the_same_estimator_l14() {
    let world = World::new(&simplest()).expect("sound");
    let integrator = integrator(&world);
    let points: &dyn PointSet = &Sobol::new(3);
    let mut bright = 0;
    for index in 0..16 {
        for pixel in (0..SIZE[0] * SIZE[1]).map(|i| [i % SIZE[0], i / SIZE[0]]) {
            let draws = Draws::new(points, SampleId::new(pixel, 0, index));
            let (hand, ours) = (by_hand(&world, &draws), ours(&*integrator, &draws));
            assert!((hand[0] - ours[0]).abs() <= 1e-5 * hand[0].max(1e-3), "{pixel:?} {index}: {hand:?} {ours:?}");
            bright += u32::from(hand[0] > 0.0);
        }
    }
    assert!(bright > 5000, "{bright} samples see light");
}

/// The environment variable with the loop that this process runs under callgrind, and the number of times.
const ROLE: &str = "DAPPLE_L14";

/// Instructions per sample, without the start of the process.
fn instructions(role: &str) -> Option<f64> {
    const SAMPLES: u64 = 20_000;
    let counted = |samples: u64| {
        let test = "idle_effects_cost_at_most_one_percent_l14";
        let output = Command::new("valgrind")
            .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
            .arg(std::env::current_exe().ok()?)
            .args([test, "--exact", "--ignored", "--test-threads=1"])
            .env(ROLE, format!("{role}:{samples}"))
            .output()
            .ok()?;
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let line = text.lines().find(|l| l.contains("Collected"))?;
        line.rsplit(' ').next()?.trim().parse::<f64>().ok()
    };
    Some((counted(2 * SAMPLES)? - counted(SAMPLES)?) / SAMPLES as f64)
}

#[test]
#[ignore = "needs valgrind: cargo test --release -p dapple-renderer --test l14_cost -- --ignored --nocapture"]
fn idle_effects_cost_at_most_one_percent_l14() {
    let world = World::new(&simplest()).expect("sound");
    let integrator = integrator(&world);
    if let Ok(role) = std::env::var(ROLE) {
        let (name, samples) = role.split_once(':').expect("name:samples");
        let samples: u64 = samples.parse().expect("a number");
        match name {
            "hand" => walk(samples, |draws| by_hand(&world, draws)),
            _ => walk(samples, |draws| ours(&*integrator, draws)),
        }
        return;
    }
    let Some((hand, ours)) = instructions("hand").zip(instructions("ours")) else {
        eprintln!("skipped: valgrind does not run");
        return;
    };
    eprintln!("instructions a sample: {hand:.0} by hand, {ours:.0} specialised, ratio {:.4}", ours / hand);
    assert!(ours <= 1.01 * hand, "{ours} against {hand}");
}
