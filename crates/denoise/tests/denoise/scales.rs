//! Coarse scales of `cluster-regression`: less noise of low frequency, the same edges, the same light.

use crate::support::Noise;
use dapple_core::{Estimate, Film, Filter, FirstHit, Frame, Needs, OptionValue as _, Options as _};
use dapple_denoise::{ClusterRegression, ClusterRegressionOptions, Scales};

const NEEDS: Needs = Needs::none().with_halves().with_variance().with_features();

fn regression(scales: Scales) -> ClusterRegression {
    ClusterRegression::with_options(ClusterRegressionOptions::default().scales(scales)).unwrap()
}

/// A film of two walls that meet in column `corner`, with `count` samples in a pixel and `value` for a random number.
fn walls(
    [width, height]: [u32; 2],
    seed: u64,
    corner: u32,
    count: impl Fn(u32, u32) -> usize,
    value: impl Fn(u32, u32, f32) -> f32,
) -> Film {
    let mut film = Film::new(Frame::new(width, height).unwrap(), NEEDS);
    let mut noise = Noise::new(seed);
    for i in 0..film.frame().pixels() {
        let [x, y] = [i as u32 % width, i as u32 / width];
        let normal = if x < corner { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
        let hit =
            FirstHit::new([x as f32, y as f32, 0.0], normal, 100.0).with_shading_normal(normal).with_albedo([0.5; 3]);
        for k in 0..count(x, y) {
            let estimate = Estimate::new([value(x, y, noise.next()); 3]).with_first_hit(Some(hit.with_footprint(1.0)));
            film.push_estimate(i, k & 1, &estimate);
        }
    }
    film
}

/// Light of 20 that one sample in 20 finds.
fn rare(noise: f32) -> f32 {
    if noise < 0.05 { 20.0 } else { 0.0 }
}

fn mean(image: &[[f32; 3]]) -> f64 {
    image.iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / image.len() as f64
}

/// Rare light on a plain wall. Windows of 41x41 pixels leave patches; means over 16x16 pixels show them.
#[test]
fn coarse_scales_take_patches_off_a_plain_wall() {
    let mut errors = [[0.0f64; 2]; 2];
    for seed in 1..=3 {
        let film = walls([256, 192], seed, 0, |_, _| 8, |_, _, noise| rare(noise));
        for (k, scales) in [Scales::Fixed(0), Scales::Fixed(3)].into_iter().enumerate() {
            let image = regression(scales).apply(&film).unwrap().radiance;
            let level = mean(&image);
            let patch = |x: usize, y: usize| {
                let rows = (16 * y..16 * (y + 1)).flat_map(|row| &image[256 * row + 16 * x..][..16]);
                rows.map(|pixel| f64::from(pixel[0])).sum::<f64>() / 256.0 - level
            };
            errors[0][k] += (0..12 * 16).map(|i| patch(i % 16, i / 16).powi(2)).sum::<f64>();
            errors[1][k] += image.iter().map(|pixel| (f64::from(pixel[0]) - level).powi(2)).sum::<f64>();
        }
    }
    for [without, with] in errors {
        assert!(with < 0.5 * without, "{with} with scales, {without} without");
    }
}

/// A bright noisy wall beside a dark one with a tenth of its light; they meet in an odd column.
#[test]
fn coarse_scales_leave_no_halo_at_a_corner() {
    let bright = |x: u32| if x < 101 { 1.0 } else { 0.1 };
    let mut off = 0.0f64;
    for seed in 1..=4 {
        let film = walls([192, 96], seed, 101, |_, _| 8, |x, _, noise| bright(x) * rare(noise));
        let image = regression(Scales::Fixed(3)).apply(&film).unwrap().radiance;
        let beside = (0..96).flat_map(|y| [101, 102].map(|x| f64::from(image[192 * y + x][0])));
        off += beside.map(|value| (value / 0.1 - 1.0).powi(2)).sum::<f64>() / (4.0 * 192.0);
    }
    assert!(off.sqrt() < 0.128, "{}", off.sqrt());
}

/// Bright stripes under noise that hides them, with three times the samples of dark ones. Weights by counts over wide
/// windows would make the image brighter.
#[test]
fn coarse_scales_keep_the_mean_if_counts_follow_light() {
    let bright = |x: u32| (x / 6).is_multiple_of(2);
    let count = |x: u32, _: u32| if bright(x) { 12 } else { 4 };
    let value = |x: u32, _: u32, noise: f32| if bright(x) { 1.4 * rare(noise) } else { rare(noise) };
    for seed in 1..=2 {
        let film = walls([192, 144], seed, 0, count, value);
        let ratio = |scales| mean(&regression(scales).apply(&film).unwrap().radiance) / mean(&film.image());
        assert!((ratio(Scales::Fixed(3)) - 1.0).abs() < 0.015, "{}", ratio(Scales::Fixed(3)));
    }
}

/// A texture that no feature shows stays at every number of scales, and at many samples an image stays what it is.
#[test]
fn coarse_scales_keep_what_both_halves_see() {
    let truth = |x: u32, y: u32| 1.0 + 0.5 * f32::from(u8::from((x / 5 + y / 7).is_multiple_of(2)));
    let film = walls([96, 80], 3, 0, |_, _| 64, |x, y, noise| truth(x, y) * (0.9 + 0.2 * noise));
    for scales in [1, 3, 8] {
        let image = regression(Scales::Fixed(scales)).apply(&film).unwrap().radiance;
        let error =
            (0..96 * 80).map(|i| f64::from(image[i][0] - truth(i as u32 % 96, i as u32 / 96)).powi(2)).sum::<f64>()
                / (96.0 * 80.0);
        assert!(error < 2e-4, "{scales}: {error}");
    }
}

/// Pixels without samples, pixels with one half only, and images of one row or one pixel.
#[test]
fn coarse_scales_bridge_pixels_without_samples() {
    let count = |x: u32, y: u32| [0, 1, 8, 8][((x / 2 + y / 2) % 4) as usize];
    for size in [[70, 50], [33, 1], [1, 9], [1, 1]] {
        let film = walls(size, 5, 0, count, |_, _, noise| 0.5 + 0.5 * noise);
        let image = regression(Scales::Fixed(8)).apply(&film).unwrap().radiance;
        let bounds = |pixel: &[f32; 3]| (0.0..1.1).contains(&pixel[0]);
        assert!(image.iter().all(bounds), "{size:?}");
        let near = |pixel: &&[f32; 3]| (pixel[0] - 0.75).abs() < 0.2;
        let share = image.iter().filter(near).count() as f32 / image.len() as f32;
        assert!(size != [70, 50] || share > 0.95, "{share}");
    }
}

#[test]
fn the_number_of_scales_is_auto_or_at_most_eight() {
    let parse = |text: &str| Scales::parse_as("scales", text, Some("auto, or 0 (none) to 8 scales"));
    assert_eq!((parse("auto").unwrap(), parse("3").unwrap()), (Scales::Auto, Scales::Fixed(3)));
    for text in ["many", "-1", "1.5", ""] {
        assert!(parse(text).unwrap_err().to_string().contains("auto, or 0 (none) to 8 scales"), "{text}");
    }
    let options = |scales| ClusterRegressionOptions::default().scales(scales);
    assert!(ClusterRegression::with_options(options(Scales::Fixed(9))).is_err());
    assert!(ClusterRegression::with_options(options(Scales::Fixed(Scales::MOST))).is_ok());
    assert!(options(Scales::Fixed(2)).describe().ends_with("scales=2"));
}
