//! Images of published scenes beside pbrt-v4's (`shared/references`, `-rgb`): same size, depth and box filter.
//!
//! Noise is that between renders with different seeds, and the reference's own from its README.
#![allow(clippy::print_stderr)]

use crate::statistics::{FAMILY, Mean, critical, sidak};
use crate::support::*;
use dapple_core::Film;
use dapple_low_discrepancy::Sobol;
use dapple_metrics::{Pixels, block_ratios, compare};
use dapple_renderer::World;
use dapple_scene::image::{Encoding, Image, read_image};
use dapple_scene::pbrt::{ReadOptions, read_scene};
use dapple_scene::{PixelFilter, Scene};
use std::path::PathBuf;

/// A scene with its reference.
struct Case {
    scene: Scene,
    reference: Image,
    /// The reference's relative standard errors, of its mean and of 10x10 blocks (median), and its samples per
    /// pixel (its README).
    mean_noise: f64,
    block_noise: f64,
    spp: f64,
    /// The tolerance of means.
    bound: f64,
}

/// Name; the reference's noise of the mean and of blocks, its samples per pixel, and the tolerance of the mean.
const CASES: [(&str, f64, f64, f64, f64); 3] = [
    ("cornell-box", 1e-4, 4.0e-3, 384.0, 5e-3),
    ("veach-mis", 2.1e-3, 5.0e-3, 128.0, 1e-2),
    ("teapot", 4e-4, 3.3e-3, 128.0, 5e-3),
];

fn case(name: &str) -> Option<Case> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let scenes = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from);
    let file = scenes.join(format!("pbrt-v4/{name}/scene-v4.pbrt"));
    let image = scenes.join(format!("../references/{name}-rgb.exr"));
    if let Some(missing) = [&file, &image].into_iter().find(|p| !p.exists()) {
        eprintln!("skipped: {} is not there", missing.display());
        return None;
    }
    let mut scene = read_scene(&file, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let bytes = std::fs::read(&image).expect("it is there");
    let reference = read_image(&bytes, name, Encoding::Auto).unwrap_or_else(|e| panic!("{e}"));
    name.clone_into(&mut scene.name);
    scene.film.resolution = reference.size;
    scene.film.pixel_filter = PixelFilter::default();
    let &(_, mean_noise, block_noise, spp, bound) = CASES.iter().find(|c| c.0 == name).expect("a case");
    Some(Case { scene, reference, mean_noise, block_noise, spp, bound })
}

/// The result: per channel the ratio of means, its standard error, and ratios of 10x10 blocks.
struct Found {
    ratio: [f64; 3],
    error: [f64; 3],
    percentiles: [[f64; 3]; 5],
    /// Median and 95th percentile of the blocks' deviations in standard errors of both images.
    deviations: [f64; 2],
    relmse_trimmed: f64,
}

const PERCENTS: [f64; 5] = [1.0, 5.0, 50.0, 95.0, 99.0];

fn render(case: &Case, replicates: u64, spp: u64) -> Found {
    let world = World::new(&case.scene).unwrap_or_else(|e| panic!("{e}"));
    let size = case.reference.size;
    let films: Vec<Film> = (0..replicates).map(|seed| film_of(&world, size, spp, Sobol::new(500 + seed))).collect();
    assert!(films.iter().all(|f| f.record().rejected == 0), "{}", case.scene.name);
    let pixels: Vec<[f32; 3]> = (0..films[0].frame().pixels())
        .map(|i| {
            let sum = films.iter().fold([0.0; 3], |s: [f64; 3], f| std::array::from_fn(|c| s[c] + f.mean(i)[c]));
            sum.map(|x| (x / replicates as f64) as f32)
        })
        .collect();
    let [ours, theirs] = [&pixels, &case.reference.pixels].map(|p| Pixels::new(size, p).expect("as many as its size"));
    let all = compare(ours, theirs).expect("of one size");
    let blocks = block_ratios(ours, theirs, [10, 10]).expect("blocks fit");
    let error = std::array::from_fn(|c| {
        let mut means = Mean::default();
        films.iter().for_each(|f| means.add(mean(f)[c]));
        let own = means.standard_error() / means.mean;
        own.hypot(case.mean_noise)
    });
    let percentiles = PERCENTS.map(|p| blocks.percentile(p));
    let deviations = deviations(case, &films, spp);
    let ratio = all.channel_ratios;
    let found = Found { ratio, error, percentiles, deviations, relmse_trimmed: all.rel_mse_trimmed };
    let three = |x: [f64; 3]| format!("{:.4} {:.4} {:.4}", x[0], x[1], x[2]);
    eprintln!("{}, {replicates} x {spp} spp: means {} +- {}", case.scene.name, three(found.ratio), three(found.error));
    for (percent, ratios) in PERCENTS.iter().zip(found.percentiles) {
        eprintln!("  blocks, {percent:>2} %: {}", three(ratios));
    }
    let [median, high] = found.deviations;
    eprintln!("  blocks off by {median:.2} standard errors (median), {high:.2} (95 %)");
    eprintln!("  relMSE without the worst 0.1 %: {:.5}", found.relmse_trimmed);
    found
}

/// The deviation of 8x8 blocks in standard errors. Dapple's is that between replicates. The reference's is assumed
/// alike for its number of samples, and at least its README's (for 10x10 blocks).
fn deviations(case: &Case, films: &[Film], spp: u64) -> [f64; 2] {
    let size = case.reference.size.map(|n| n as usize);
    let pixels: Vec<[f64; 3]> = case.reference.pixels.iter().map(|p| p.map(f64::from)).collect();
    let theirs = block_means_of(size, &pixels);
    let ours: Vec<Vec<[f64; 3]>> = films.iter().map(block_means).collect();
    let share = films.len() as f64 * spp as f64 / case.spp;
    let mut found = Vec::new();
    for (b, theirs) in theirs.iter().enumerate() {
        for c in 0..3 {
            let (mean, variance, _) = summary(ours.iter().map(|r| r[b][c]));
            if variance > 0.0 {
                let stated = (10.0 / 8.0 * case.block_noise * theirs[c]).powi(2);
                found.push((mean - theirs[c]).abs() / (variance + stated.max(variance * share)).sqrt());
            }
        }
    }
    found.sort_by(f64::total_cmp);
    [found[found.len() / 2], found[found.len() * 95 / 100]]
}

/// True if the deviation exceeds the tolerance and the noise together (one family of 1e-6), so that a failure with few
/// samples is a bug.
fn refuted(case: &Case, found: &Found) -> bool {
    // 5 degrees of freedom and non-normal noise: twice the quantile of the normal distribution.
    let z = 2.0 * critical(sidak(FAMILY, 9) / 2.0);
    (0..3).any(|c| (found.ratio[c] - 1.0).abs() > case.bound + z * found.error[c])
}

#[test]
fn references_are_not_refuted() {
    for (name, ..) in CASES {
        let Some(case) = case(name) else { continue };
        let found = render(&case, 6, 1);
        assert!(!refuted(&case, &found), "{name}: {:?}", found.ratio);
        for c in 0..3 {
            let median = found.percentiles[2][c];
            assert!((median - 1.0).abs() < 0.02, "{name}, channel {c}: the median block is {median} of its reference");
        }
    }
}

/// Negative control: lamps brighter by 6 % are refuted even with few samples.
#[test]
fn references_refute_a_brighter_lamp() {
    let Some(mut case) = case("cornell-box") else { return };
    for shape in &mut case.scene.shapes {
        if let Some(emission) = &mut shape.emission {
            emission.radiance = emission.radiance.map(|x| 1.06 * x);
        }
    }
    let found = render(&case, 6, 1);
    assert!(refuted(&case, &found), "{:?}", found.ratio);
}

/// The means lie within the tolerances themselves.
#[test]
#[ignore = "minutes: cargo test --release -p dapple-renderer --test renderer references_pbrt:: -- --ignored --nocapture"]
fn means_match_pbrt_within_their_tolerances() {
    let mut wrong = Vec::new();
    for (name, ..) in CASES {
        let Some(case) = case(name) else { continue };
        // The edge of a small lamp of radiance 3040 decides veach-mis' mean: more samples there.
        let found = render(&case, 8, if name == "veach-mis" { 128 } else { 32 });
        for c in 0..3 {
            if found.ratio[c].is_nan() || (found.ratio[c] - 1.0).abs() >= case.bound {
                wrong.push(format!("{name}, channel {c}: means {:.4} +- {:.4}", found.ratio[c], found.error[c]));
            }
            let [_, low, _, high, _] = found.percentiles.map(|p| p[c]);
            if name == "teapot" && !(low > 0.98 && high < 1.02) {
                wrong.push(format!("{name}, channel {c}: 90 % of block means lie between {low:.4} and {high:.4}"));
            }
        }
        // Student's t with 7 degrees of freedom: 0.71 and 2.36; half as much again for the assumption above.
        if !(found.deviations[0] < 1.07 && found.deviations[1] < 3.55) {
            wrong.push(format!("{name}: blocks are off by {:?} standard errors", found.deviations));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
