//! Bundled scenes: closed forms, idle code, and committed images of them, made with another point set, other seeds and 4096
//! samples per pixel (`tests/references` at the repository's root).
//!
//! After an intended change of images, delete the committed images. Missing ones are rendered by `cargo test --release -p
//! dapple-renderer --test renderer -- --ignored bundled_scenes::generate`
#![allow(clippy::print_stderr)]

use crate::support::*;
use dapple_conformance::statistics::MeanTest;
use dapple_renderer::{code, integrator_with};
use dapple_scene::image::{Layer, Plane, encode_exr, read_channels, write_file};
use std::path::PathBuf;

/// All bundled scenes are read without a warning, and small images of them have valid light.
#[test]
fn bundled_scenes_render() {
    for name in bundled::names() {
        let scene = bundle(name);
        assert!(scene.notices.iter().all(|n| n.message.starts_with("Sampler")), "{name}: {:?}", scene.notices);
        let world = small(&scene, [64; 2]);
        let film = film_of(&world, [64; 2], 1, Sobol::new(9300));
        assert_eq!((film.record().rejected, world.dropped_triangles()), (0, 0), "{name}");
        assert!(film.image().iter().flatten().all(|&x| x.is_finite() && x >= 0.0), "{name}");
        assert!(mean(&film).iter().all(|&m| m > 0.01), "{name}: {:?}", mean(&film));
    }
    use Effect::*;
    for (name, effects) in [
        ("lens", &[DepthOfField, SeveralLights][..]),
        ("motion", &[MotionBlur]),
        ("tea", &[Refraction, Glossy, AbsorbingMedia]),
        ("cabin", &[SeveralLights, Glossy]),
        ("many-lights", &[SeveralLights, Glossy]),
        ("caustic", &[Refraction, SeveralLights]),
        ("chess", &[DepthOfField, SoftShadows]),
        ("penumbra", &[SoftShadows]),
        ("glass", &[Refraction, Glossy, Transparency, AbsorbingMedia, ScatteringMedia]),
    ] {
        let found = Effects::of(&bundle(name));
        assert!(effects.iter().all(|&e| found.has(e)), "{name}: {found:?}");
    }
}

/// The integral of a function over `[0, 1]`, by Simpson's rule.
fn integral(f: impl Fn(f64) -> f64) -> f64 {
    let n = 20_000;
    let weight = |i: i32| if i == 0 || i == n { 1.0 } else { f64::from(2 + i % 2 * 2) };
    (0..=n).map(|i| weight(i) * f(f64::from(i) / f64::from(n))).sum::<f64>() / f64::from(3 * n)
}

/// The plate's mean reflectance: `sin(a + b) = sin a cos b + cos a sin b` makes it `0.5 + 0.9 s c`, with the Fresnel integrals
/// `s` and `c` of `k = 80 pi`. Negative control: the mean without rings differs by twice the tolerance.
#[test]
fn the_zone_plate_has_the_mean_of_its_closed_form() {
    let k = 80.0 * PI;
    let wanted = 0.5 + 0.9 * integral(|t| (k * t * t).sin()) * integral(|t| (k * t * t).cos());
    let found = mean(&image(&bundle("zone-plate"), 8, 12_300));
    assert!((wanted - 0.5).abs() > 1.2e-3, "the control is as good");
    assert!(found.iter().all(|m| (m - wanted).abs() < 6e-4), "{found:?}, not {wanted}");
}

/// Returns the irradiance at a horizontal surface from a horizontal rectangle of radiance 1 at this height. One corner is above
/// the surface point, and the opposite one at offset `(x, y)`. This is Lambert's formula for a corner.
fn corner(x: f64, y: f64, height: f64) -> f64 {
    let [a, b] = [x, y].map(|c| (c * c + height * height).sqrt());
    0.5 * (x / a * (y / a).atan() + y / b * (x / b).atan())
}

/// Returns the radiance of the floor at `(x, y)`. A card at height 2 to the left of `edge` hides the part of the lamp below `2
/// edge - x` along x.
fn floor(x: f64, y: f64, edge: f64) -> f64 {
    let from = (2.0 * edge - x).clamp(-0.6, 0.6);
    let part = |u: f64, v: f64| corner(u - x, v - y, 4.0);
    let irradiance = part(0.6, 0.6) - part(0.6, -0.6) - part(from, 0.6) + part(from, -0.6);
    0.8 / PI * 40.0 * irradiance
}

/// Each of 60 column means is within 0.6 % of the largest radiance from the closed form. Negative control: a card 0.02 further
/// to the right is detected.
#[test]
fn the_penumbra_has_its_closed_form() {
    let size = [60, 60];
    let film = film_of(&small(&bundle("penumbra"), size), size, 64, Sobol::new(12_300));
    let [found, wrong] = [0.0, 0.02].map(|edge: f64| {
        let deviation = |column: usize| {
            let found: f64 = (0..60).map(|row| film.mean(row * 60 + column)[1]).sum::<f64>() / 60.0;
            // Four places along each axis of a pixel.
            let place = |k: usize| -2.0 + 4.0 * (k as f64 + 0.5) / 240.0;
            let places = (0..4).flat_map(|i| (0..240).map(move |j| (4 * column + i, j)));
            (found - places.map(|(i, j)| floor(place(i), place(j), edge)).sum::<f64>() / 960.0).abs()
        };
        (0..60).map(deviation).fold(0.0, f64::max) / floor(1.0, 0.0, 0.0)
    });
    assert!(found < 6e-3 && wrong > 0.02, "largest deviation {found:.5}, with a wrong card {wrong:.5}");
}

/// Code for effects that a scene does not need changes no bit and requests no random numbers.
#[test]
fn idle_code_changes_no_bit_l14() {
    use code::*;
    let all = SEVERAL_LIGHTS | ENVIRONMENT | ROULETTE | TRANSMISSION | RARE | VARIED;
    let codes = [0, SEVERAL_LIGHTS, ENVIRONMENT, ROULETTE, TRANSMISSION, RARE, VARIED, LEARNED_SELECTION, all];
    let frame = Frame::new(24, 16).expect("not empty");
    let limits = Limits::samples(2 * frame.pixels() as u64);
    for name in bundled::names() {
        let world = small(&bundle(name), frame.size());
        let rendered = |idle: u32, seed: u64| {
            let mut integrator = integrator_with(&world, idle);
            let film = Render::new(frame, &limits).run(&mut *integrator, &mut Uniform::new(Sobol::new(seed)));
            let film = film.expect("it renders");
            (hash(&film), film.record().blocks, film.record().rays)
        };
        let expected = rendered(0, 1);
        for idle in codes {
            assert_eq!(rendered(idle, 1), expected, "{name} with the code {idle:b}");
        }
        assert!(rendered(0, 2).0 != expected.0, "negative control: the hash depends on the samples of {name}");
    }
}

fn path(name: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/references")).join(format!("{name}.exr"))
}

/// Returns the bundled scene at a width of 64 pixels with a box filter.
fn reduced(name: &str) -> Scene {
    let mut scene = bundle(name);
    let [w, h] = scene.film.resolution;
    (scene.film.resolution, scene.film.pixel_filter) = ([64, 64 * h / w], PixelFilter::default());
    scene
}

#[test]
#[ignore = "makes what tests/references lacks, minutes: see the top of this file"]
fn generate() {
    for name in bundled::names().iter().filter(|name| !path(name).exists()) {
        let scene = reduced(name);
        let size = scene.film.resolution;
        let film = film_with(&world(&scene), size, 4096, Needs::none().with_variance(), Random::new(20_261_121));
        assert_eq!(film.record().rejected, 0, "{name}");
        let variance = (0..film.frame().pixels()).map(|i| {
            let moments = film.moments(i);
            moments.variance().expect("many samples").map(|v| (v / moments.count as f64) as f32)
        });
        let variance = Image::new(size, variance.collect()).expect("as many as its size");
        let mean = Image::new(size, film.image()).expect("as many as its size");
        let layers = [Layer::of_image("", &mean), Layer::of_image("variance", &variance)];
        let commit = std::process::Command::new("git").args(["rev-parse", "HEAD"]).output();
        let commit = commit.map_or_else(|_| "unknown".into(), |o| String::from_utf8_lossy(&o.stdout).trim().to_owned());
        let made = [
            ("scene", (*name).to_owned()),
            ("points", "random:seed=20261121".to_owned()),
            ("spp", "4096".to_owned()),
            ("commit", commit),
            ("variance", "of the pixel's mean".to_owned()),
        ];
        let made = made.map(|(key, value)| (format!("dapple:{key}"), value));
        let bytes = encode_exr(size, &layers, &made).unwrap_or_else(|e| panic!("{e}")).bytes;
        write_file(&path(name), &bytes).unwrap_or_else(|e| panic!("{e}"));
    }
}

/// Means of 8x8 blocks of the committed image, and their variances.
fn reference(name: &str, size: [u32; 2]) -> [Vec<[f64; 3]>; 2] {
    let bytes = std::fs::read(path(name)).unwrap_or_else(|e| panic!("{}: {e}", path(name).display()));
    let channels = read_channels(&bytes, name).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(channels.size, size, "{name}");
    let [means, mut variances] = ["", "variance."].map(|prefix| {
        let [r, g, b] = ["R", "G", "B"].map(|c| match channels.plane(&format!("{prefix}{c}")) {
            Some(Plane::F32(values)) => values.to_vec(),
            other => panic!("{name} has {other:?} for {prefix}{c}"),
        });
        let pixels: Vec<[f64; 3]> = (0..r.len()).map(|i| [r[i], g[i], b[i]].map(f64::from)).collect();
        block_means(size, &pixels)
    });
    // The variance of a mean of n pixels is the mean of their variances, divided by n.
    let side = |n: u32, at: u32| f64::from((at + 8).min(n) - at);
    let [w, h] = size;
    let counts = (0..h).step_by(8).flat_map(|y| (0..w).step_by(8).map(move |x| side(w, x) * side(h, y)));
    variances.iter_mut().zip(counts).for_each(|(v, n)| *v = v.map(|x| x / n));
    [means, variances]
}

/// Returns the largest deviation of a block or the whole image, divided by the allowed one. The level is 1e-6 for all scenes
/// together, corrected by Sidak over blocks and channels.
fn deviation(scene: &Scene, [means, variances]: &[Vec<[f64; 3]>; 2], spp: u64) -> f64 {
    let ours = blocks_of(&replicates(&world(scene), scene.film.resolution, spp, 0));
    let alpha = FAMILY / bundled::names().len() as f64;
    // Thousands of random samples are as good as known variances.
    let test = |own: &Mean, mean: f64, variance: f64, tests: usize| {
        let (a, difference) = (own.standard_error().powi(2), own.mean - mean);
        if a + variance <= 1e-24 * (own.mean * own.mean + mean * mean) {
            // Without variance: equal except for storage in 24 bits and summation in f32.
            return if difference.abs() <= 1e-6 * own.mean.abs() { 0.0 } else { f64::INFINITY };
        }
        let degrees_of_freedom = (a + variance).powi(2) / (a * a / (own.n - 1) as f64 + variance * variance / 1e6);
        let test = MeanTest { difference, standard_error: (a + variance).sqrt(), degrees_of_freedom };
        test.z().abs() / critical(sidak(alpha / 2.0, tests) / 2.0)
    };
    let mut worst = 0.0_f64;
    for c in 0..3 {
        for b in 0..means.len() {
            let own: Mean = ours.iter().map(|r| r[b][c]).collect();
            worst = worst.max(test(&own, means[b][c], variances[b][c], 3 * means.len()));
        }
        let own: Mean = ours.iter().map(|r| r.iter().map(|m| m[c]).sum()).collect();
        let [total, variance] = [means, variances].map(|blocks| blocks.iter().map(|b| b[c]).sum());
        worst = worst.max(test(&own, total, variance, 3));
    }
    eprintln!("{}: {worst:.3} of what is allowed", scene.name);
    worst
}

/// A t-test compares image means of replicates, at a level of 1e-6 for all scenes together. The short test uses every second
/// scene. Negative control: one lamp 1 % brighter.
#[test]
fn own_scenes_look_as_they_did() {
    for name in bundled::names().iter().step_by(thorough(2, 1)) {
        let scene = reduced(name);
        let found = deviation(&scene, &reference(name, scene.film.resolution), thorough(2, 4));
        assert!(found < 1.0, "{name}: {found} of what is allowed");
    }
    let mut scene = reduced("cornell");
    for emission in scene.shapes.iter_mut().filter_map(|s| s.emission.as_mut()) {
        emission.radiance = emission.radiance.map(|x| 1.01 * x);
    }
    let found = deviation(&scene, &reference("cornell", scene.film.resolution), 16);
    assert!(found > 1.0, "{found} of what is allowed");
}
