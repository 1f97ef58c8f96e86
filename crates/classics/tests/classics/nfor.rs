//! First-order regression on features.

use crate::support::{frame, image};
use dapple_classics::{Nfor, NforOptions};
use dapple_core::{Estimate, Film, Filter as _, FirstHit, PointSet as _, SampleId};

const SIDE: usize = 40;

/// A nearly normal number of mean 0 and variance 1, a sum of twelve uniform ones, named by `seed` and `k`.
fn near_normal(seed: u64, k: u64) -> f64 {
    let points = dapple_low_discrepancy::Random::new(seed);
    let block = |b: u32| points.block(SampleId::new([k as u32, 0], 0, k >> 32), b).map(|u| f64::from(u) - 0.5);
    (0..3).flat_map(block).sum()
}

/// A film of 16 samples per pixel, of deviation 0.1 about `truth`, whose features are exact.
fn film(truth: impl Fn(usize) -> f64, hit: impl Fn(usize) -> FirstHit) -> Film {
    let mut film = Film::new(frame([SIDE as u32; 2]), Nfor::default().needs());
    for i in 0..SIDE * SIDE {
        for k in 0..16 {
            let value = truth(i) + 0.1 * near_normal(7, (i * 16 + k) as u64);
            film.push_estimate(i, k, &Estimate::new([value as f32; 3]).with_first_hit(hit(i)));
        }
    }
    film
}

/// The mean squared error of the filtered image, away from the border, relative to that of the samples.
fn relative_error(options: NforOptions, film: &Film, truth: impl Fn(usize) -> f64) -> f64 {
    let image = image(&Nfor::with_options(options).unwrap(), film);
    let inner = |i: &usize| (8..SIDE - 8).contains(&(i % SIDE)) && (8..SIDE - 8).contains(&(i / SIDE));
    let pixels: Vec<usize> = (0..SIDE * SIDE).filter(inner).collect();
    let error = |value: &dyn Fn(usize) -> f64| pixels.iter().map(|&i| (value(i) - truth(i)).powi(2)).sum::<f64>();
    error(&|i| f64::from(image[i][0])) / error(&|i| film.mean(i)[0])
}

/// An albedo that differs from pixel to pixel.
fn albedo(i: usize) -> [f64; 3] {
    [0, 1, 2].map(|c| 0.5 + 0.02 * near_normal(3, (3 * i + c) as u64))
}

fn wall(albedo: [f64; 3]) -> FirstHit {
    FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0).with_albedo(albedo.map(|a| a as f32))
}

#[test]
fn images_that_are_affine_in_features_are_reproduced() {
    let truth = |i: usize| 0.3 + albedo(i)[0] - 0.5 * albedo(i)[2];
    let found = relative_error(NforOptions::default(), &film(truth, |i| wall(albedo(i))), truth);
    // The control: without the albedo, the texture is not in the features.
    let without = relative_error(NforOptions::default(), &film(truth, |_| wall([0.5; 3])), truth);
    assert!(found < 0.006 && without > 0.5, "{found} {without}");
}

#[test]
fn noise_on_constant_features_is_averaged_over_windows() {
    let flat = film(|_| 0.5, |_| wall([0.5; 3]));
    let speckled = film(|_| 0.5, |i| wall(albedo(i)));
    let of = |film: &Film, second| relative_error(NforOptions::default().second(second), film, |_| 0.5);
    // A fit of 4 unknowns to 361 pixels alone leaves 4 / 361; fits of all windows around a pixel are averaged.
    for (found, limit) in [
        (of(&flat, false), 0.0007),
        (of(&flat, true), 0.0005),
        (of(&speckled, false), 0.006),
        (of(&speckled, true), 0.003),
    ] {
        assert!(found < limit && limit < 4.0 / 361.0, "{found} {limit}");
    }
    // The control: a window of one pixel to each side removes less.
    assert!(relative_error(NforOptions::default().window(1).second(false), &flat, |_| 0.5) > 0.02);
}
