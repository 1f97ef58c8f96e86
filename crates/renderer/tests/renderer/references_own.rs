//! Bundled scenes beside committed images of them, made with another point set, other seeds and 4096 samples per pixel
//! (`tests/references` at the repository's root).
//!
//! After a change that is meant to change images, delete these. Missing ones are made by
//! `cargo test --release -p dapple-renderer --test renderer -- --ignored references_own::generate`
#![allow(clippy::print_stderr)]

use crate::statistics::FAMILY;
use crate::support::*;
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, Needs, Render};
use dapple_low_discrepancy::{Random, Sobol};
use dapple_renderer::{World, integrator};
use dapple_scene::bundled;
use dapple_scene::image::{Image, Layer, Plane, encode_exr, read_channels, write_file};
use dapple_scene::{PixelFilter, Scene};
use std::path::PathBuf;

const WIDTH: u32 = 64;
const SPP: u64 = 4096;
const SEED: u64 = 20_261_121;

fn path(name: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/references")).join(format!("{name}.exr"))
}

/// The bundled scene, 64 pixels wide, box filter.
fn small(name: &str) -> Scene {
    let bundle = bundled::files(name).expect("bundled");
    let mut scene = bundle.read().unwrap_or_else(|e| panic!("{e}"));
    let [w, h] = scene.film.resolution;
    scene.film.resolution = [WIDTH, WIDTH * h / w];
    scene.film.pixel_filter = PixelFilter::default();
    scene
}

#[test]
#[ignore = "makes what tests/references lacks, minutes: see the top of this file"]
fn generate() {
    for name in bundled::names().iter().filter(|name| !path(name).exists()) {
        let scene = small(name);
        let world = world(&scene);
        let [w, h] = scene.film.resolution;
        let frame = Frame::new(w, h).expect("not empty");
        let limits = Limits::samples(SPP * frame.pixels() as u64);
        let mut sampler = Uniform::new(Random::new(SEED));
        let needs = Needs::none().with_variance();
        let film = Render::new(frame, &limits).needs(needs).run(&mut *integrator(&world), &mut sampler);
        let film = film.unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(film.record().rejected, 0, "{name}");
        let variance = (0..frame.pixels()).map(|i| {
            let moments = film.moments(i);
            moments.variance().expect("many samples").map(|v| (v / moments.count as f64) as f32)
        });
        let variance = Image::new([w, h], variance.collect()).expect("as many as its size");
        let mean = Image::new([w, h], film.image()).expect("as many as its size");
        let layers = [Layer::of_image("", &mean), Layer::of_image("variance", &variance)];
        let commit = std::process::Command::new("git").args(["rev-parse", "HEAD"]).output();
        let commit = commit.map_or_else(|_| "unknown".into(), |o| String::from_utf8_lossy(&o.stdout).trim().to_owned());
        let made = [
            ("dapple:scene", (*name).to_owned()),
            ("dapple:points", format!("random:seed={SEED}")),
            ("dapple:spp", SPP.to_string()),
            ("dapple:commit", commit),
            ("dapple:variance", "of the pixel's mean".to_owned()),
        ];
        let made = made.map(|(k, v)| (k.to_owned(), v));
        let bytes = encode_exr([w, h], &layers, &made).unwrap_or_else(|e| panic!("{e}")).bytes;
        write_file(&path(name), &bytes).unwrap_or_else(|e| panic!("{e}"));
        eprintln!("{name}: {w}x{h}, {} bytes, {:.1} s", bytes.len(), film.record().trace_seconds());
    }
}

/// Means of 8x8 blocks with their variances.
struct Reference {
    means: Vec<[f64; 3]>,
    variances: Vec<[f64; 3]>,
}

fn reference(name: &str, size: [u32; 2]) -> Reference {
    let bytes = std::fs::read(path(name)).unwrap_or_else(|e| panic!("{}: {e}", path(name).display()));
    let channels = read_channels(&bytes, name).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(channels.size, size, "{name}");
    let layer = |prefix: &str| {
        let plane = |c: &str| match channels.plane(&format!("{prefix}{c}")) {
            Some(Plane::F32(values)) => values.to_vec(),
            other => panic!("{name} has {other:?} for {prefix}{c}"),
        };
        let [r, g, b] = ["R", "G", "B"].map(plane);
        let pixels: Vec<[f64; 3]> = (0..r.len()).map(|i| [r[i], g[i], b[i]].map(f64::from)).collect();
        block_means_of(size.map(|n| n as usize), &pixels)
    };
    // The variance of a mean of n pixels is the mean of their variances over n.
    let pixels = block_sizes(size);
    let variances = layer("variance.").into_iter().zip(pixels).map(|(v, n)| v.map(|x| x / n));
    Reference { means: layer(""), variances: variances.collect() }
}

fn block_sizes([w, h]: [u32; 2]) -> Vec<f64> {
    let side = |n: u32, at: u32| f64::from((at + 8).min(n) - at);
    (0..h).step_by(8).flat_map(|y| (0..w).step_by(8).map(move |x| side(w, x) * side(h, y))).collect()
}

/// The largest deviations of a block and of the whole image, in standard errors of both images.
fn deviation(scene: &Scene, reference: &Reference, replicates: u64, spp: u64) -> Agreement {
    let world: World = world(scene);
    let films: Vec<Film> =
        (0..replicates).map(|seed| film_of(&world, scene.film.resolution, spp, Sobol::new(seed))).collect();
    let ours: Vec<Vec<[f64; 3]>> = films.iter().map(block_means).collect();
    // Thousands of random samples are as good as known variances.
    let freedom = 1e6;
    let (mut worst, mut whole, mut exact) = (0.0_f64, 0.0_f64, true);
    for c in 0..3 {
        for b in 0..reference.means.len() {
            let own = summary(ours.iter().map(|r| r[b][c]));
            match welch(own, (reference.means[b][c], reference.variances[b][c], freedom)) {
                Some(z) => worst = worst.max(z),
                // Without variance: equal except for storage in 24 bits and summation in f32.
                None => exact &= (own.0 - reference.means[b][c]).abs() <= 1e-6 * own.0.abs(),
            }
        }
        let own = summary(ours.iter().map(|r| r.iter().map(|m| m[c]).sum::<f64>()));
        let total: f64 = reference.means.iter().map(|m| m[c]).sum();
        let variance: f64 = reference.variances.iter().map(|v| v[c]).sum();
        whole = whole.max(welch(own, (total, variance, freedom)).unwrap_or(0.0));
    }
    let found = Agreement { worst, tests: 3 * reference.means.len(), whole, exact };
    eprintln!("{}: {found:?}", scene.name);
    found
}

/// The false-alarm rate of one scene: 1e-6 for all of them together.
fn level() -> f64 {
    FAMILY / bundled::names().len() as f64
}

#[test]
fn every_second_own_scene_looks_as_it_did() {
    check_own_scenes(2);
}

#[test]
#[ignore = "20 s: all scenes; every second one is tested always"]
fn own_scenes_look_as_they_did() {
    check_own_scenes(1);
}

/// A t-test of image means between replicates, for every `step`-th scene.
fn check_own_scenes(step: usize) {
    for name in bundled::names().iter().step_by(step) {
        let scene = small(name);
        let reference = reference(name, scene.film.resolution);
        let found = deviation(&scene, &reference, 16, 4);
        assert!(found.holds(level()), "{name}: {found:?}");
    }
}

/// Negative control: one lamp 1 % brighter.
#[test]
fn own_scenes_refute_a_lamp_1_percent_brighter() {
    let mut scene = small("cornell");
    let reference = reference("cornell", scene.film.resolution);
    for emission in scene.shapes.iter_mut().filter_map(|s| s.emission.as_mut()) {
        emission.radiance = emission.radiance.map(|x| 1.01 * x);
    }
    let found = deviation(&scene, &reference, 16, 16);
    assert!(!found.holds(level()), "{found:?}");
}
