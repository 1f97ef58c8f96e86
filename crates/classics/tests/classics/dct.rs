//! Cosines fitted to blocks of pixels: the sampler and its filter.

use crate::support::{
    Field, Made, Points, domain, film_at, film_points, image, mean_of_columns, random, render, run, squared_error, unit,
};
use dapple_classics::{CosineOptions, CosineScale, Dct, DctFilter, DctOptions};
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Limits};
use std::f64::consts::PI;

fn dct(seed: u64, options: DctOptions) -> Dct<Points> {
    Dct::new(random(seed), &domain(&[]), options, CosineOptions::default()).unwrap()
}

fn filter(points: Points) -> DctFilter {
    DctFilter::new(film_points(points, &[], None), CosineOptions::default()).unwrap()
}

#[test]
fn constant_and_black_images_get_equal_counts() {
    for (value, size) in [(0.0, [16, 16]), (0.7, [16, 16]), (0.0, [19, 11]), (0.7, [19, 11])] {
        let mut constant = Field(|_: [u32; 2], _: [f32; 4]| [value, 0.5 * value, 0.25 * value]);
        let film = run(&mut constant, &mut dct(2, DctOptions::default()), size, &Limits::spp(8.0));
        let (low, high) = film.counts().iter().fold((u64::MAX, 0), |(low, high), &n| (low.min(n), high.max(n)));
        // Counts of cells of one and two pixels are rounded.
        let spread = if size == [16, 16] { 0 } else { 2 };
        assert!(high - low <= spread, "{size:?}, {value}: {low} to {high}");
    }
}

fn mean_counts<const N: usize>(film: &Film, columns: [std::ops::Range<usize>; N]) -> [f64; N] {
    columns.map(|columns| mean_of_columns(film, columns, |i| film.count(i) as f64))
}

#[test]
fn what_low_frequencies_explain_takes_no_samples() {
    // From the left: a block of one cosine, a constant, an edge within the block.
    let scene: Made = |[x, y], _| match x as u32 / 8 {
        0 => 1.0 + 0.5 * (std::f32::consts::PI * y / 8.0).cos(),
        1 => 1.0,
        _ => f32::from(u8::from(x + 0.37 * y < 22.0)) + 0.5,
    };
    let film = render(scene, &mut dct(5, DctOptions::default()), [24, 24], 16.0);
    let [cosine, flat, edge] = mean_counts(&film, [0..8, 8..16, 16..24]);
    assert!(edge > 3.0 * cosine && cosine < 1.6 * flat, "{cosine}, {flat} and {edge} samples");
}

#[test]
fn bright_parts_get_fewer_samples_unless_nothing_masks_errors() {
    // Noise of equal deviation, on dark and on bright ground.
    let mut noise = Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 16 { 0.5 } else { 4.0 } + 0.5 * u[2]; 3]);
    let [masked, plain] = [0.65, 0.0].map(|masking| {
        let options = DctOptions::default().masking(masking);
        let [dark, bright] =
            mean_counts(&run(&mut noise, &mut dct(3, options), [32, 32], &Limits::spp(16.0)), [0..16, 16..32]);
        dark / bright
    });
    assert!(masked > 2.0 && (0.8..1.25).contains(&plain), "{masked} and {plain}");
}

/// The image of `made` in closed form: the mean over each pixel, by the midpoints of 32x32 parts.
fn exact(made: Made, width: usize) -> impl Fn(usize) -> f64 {
    move |i| {
        let part = |k: usize| (k as f32 + 0.5) / 32.0;
        let at = |k: usize| [(i % width) as f32 + part(k % 32), (i / width) as f32 + part(k / 32)];
        (0..1024).map(|k| f64::from(made(at(k), [0.0; 4]))).sum::<f64>() / 1024.0
    }
}

#[test]
fn the_filter_recovers_smooth_images_and_its_error_falls_with_the_count() {
    let smooth: Made = |[x, y]: [f32; 2], _| 2.0 + (0.21 * x).sin() + (0.17 * y + 0.05 * x).cos();
    let errors = [2.0, 8.0].map(|spp| {
        let film = render(smooth, &mut Uniform::new(random(4)), [20, 17], spp);
        let images = [image(&filter(random(4)), &film), film.image()];
        let found = images.map(|image| squared_error(&image, exact(smooth, 20)).sqrt());
        assert!(found[0] < 0.5 * found[1], "{spp} samples: {found:?}");
        found[0]
    });
    // Both fits have all 64 cosines. To them, higher frequencies are noise: four times the samples halve the error, about.
    assert!(errors[1] < 0.6 * errors[0], "{errors:?}");
}

#[test]
fn the_pilot_has_a_sample_in_each_cell_if_pixels_need_none() {
    let mut limits = Limits::samples(35);
    limits.min_spp = 0;
    let mut constant = Field(|_: [u32; 2], _: [f32; 4]| [1.0; 3]);
    let film = run(&mut constant, &mut dct(1, DctOptions::default()), [13, 10], &limits);
    let counts = |cell: usize| {
        let pixels = (0..130).filter(move |i| (i % 13 / 2, i / 13 / 2) == (cell % 7, cell / 7));
        pixels.map(|i| film.count(i))
    };
    assert!((0..35).all(|cell| counts(cell).sum::<u64>() == 1));
    // In large cells the sample is in any of the four pixels.
    let corners = (0..35).filter(|&cell| counts(cell).next() == Some(1)).count();
    assert!((6..25).contains(&corners), "{corners}");
}

type Pair = [u32; 2];

/// Half waves along x and y, from the lowest on, in blocks of 8x8 pixels, 8x3, and 1x7.
const FREQUENCIES: [(Pair, u64, &[Pair]); 4] = [
    ([8, 8], 12, &[[0, 0], [1, 0], [0, 1], [0, 2], [1, 1], [2, 0]]),
    ([8, 8], 40, &[[3, 0], [2, 1], [1, 2], [0, 3], [0, 4], [1, 3], [2, 2], [3, 1], [4, 0]]),
    ([8, 3], 12, &[[0, 0], [1, 0], [2, 0], [0, 1], [1, 1]]),
    ([1, 7], 12, &[[0, 0], [0, 1], [0, 2], [0, 3], [0, 4]]),
];

/// Of 12 samples, half as many cosines are fitted. A pixel is the mean of the fit over its area.
#[test]
fn a_block_that_is_one_function_is_recovered() {
    let options = CosineOptions::default().lambda(1e-6);
    for (size, count, frequencies) in FREQUENCIES {
        for &frequency in frequencies {
            let wave = |axis: usize, x: f64| (PI * f64::from(frequency[axis]) * x / f64::from(size[axis])).cos();
            let sample = |k: u64| {
                let at = [0, 1].map(|axis| unit((3 << 32) + 2 * k + axis) * size[axis as usize] as f32);
                (at, [(2.0 + wave(0, f64::from(at[0])) * wave(1, f64::from(at[1]))) as f32; 3])
            };
            let (film, points) = film_at(size, &(0..count).map(sample).collect::<Vec<_>>());
            let mean = |axis: usize, pixel: usize| {
                let k = PI * f64::from(frequency[axis]) / f64::from(size[axis]);
                let of = |x: usize| if k > 0.0 { (k * x as f64).sin() / k } else { x as f64 };
                of(pixel + 1) - of(pixel)
            };
            for (i, found) in image(&DctFilter::new(points, options).unwrap(), &film).iter().enumerate() {
                let expected = 2.0 + mean(0, i % size[0] as usize) * mean(1, i / size[0] as usize);
                assert!((f64::from(found[0]) - expected).abs() < 1e-4, "{size:?}, {frequency:?}, {i}: {found:?}");
            }
        }
    }
}

#[test]
fn colours_survive_opponent_space_on_both_scales() {
    for scale in [CosineScale::Linear, CosineScale::Log] {
        for rgb in [[0.0f32; 3], [0.3, 2.0, 7.0], [1e20, 0.0, 5.0]] {
            let (film, points) = film_at([1, 1], &[([0.5; 2], rgb)]);
            let found = image(&DctFilter::new(points, CosineOptions::default().scale(scale)).unwrap(), &film)[0];
            let largest = rgb.iter().copied().fold(1.0, f32::max);
            assert!((0..3).all(|c| (found[c] - rgb[c]).abs() <= 1e-6 * largest), "{rgb:?}: {found:?}");
        }
    }
}

#[test]
fn parameters_out_of_range_are_refused() {
    let of = |options, cosines| Dct::new(random(1), &domain(&[]), options, cosines).is_ok();
    let (options, cosines) = (DctOptions::default(), CosineOptions::default());
    assert!(of(options, cosines) && !of(options, cosines.share(2.0)) && !of(options.pilot(0), cosines));
}
