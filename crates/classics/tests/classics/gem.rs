//! Greedy error minimisation: Gaussians of selected scales, and samples where the error is largest.

use crate::support::{VARIANCE, image, next_counts, noisy_film, sobol, squared_error};
use crate::windows::{convolve, gaussian_taps};
use dapple_classics::{Gem, GemFilter, GemFilterOptions};
use dapple_core::{Film, Filter as _, Filtered};

fn planned(film: &Film, total: u64, max_spp: u32) -> Vec<u32> {
    next_counts(&mut Gem::new(sobol(1)), film, total, [1, max_spp])
}

/// Noise in the right half only.
fn half_noisy(size: [u32; 2]) -> Film {
    noisy_film(size, 4, VARIANCE, 5, |_, _| 10.0, |x, _| if x < size[0] / 2 { 0.1 } else { 2.0 })
}

#[test]
fn samples_go_where_the_error_is_and_each_round_spends_its_share() {
    let film = half_noisy([64, 64]);
    let counts = planned(&film, 16 * 4096, u32::MAX);
    assert_eq!(counts.iter().sum::<u32>(), 12 * 4096 / 8, "an eighth of what the pilot left");
    let right: u32 = counts.iter().enumerate().filter(|(i, _)| i % 64 >= 32).map(|(_, n)| n).sum();
    // Kernels at the edge reach up to 24 pixels into the quiet half.
    assert!(f64::from(right) > 0.8 * 6144.0, "{right} of 6144 samples");
    // Where noise is white, scales are coarse, so that picks spread over the whole half.
    let fed = counts.iter().filter(|n| **n > 0).count();
    assert!(fed > 1000, "{fed} pixels receive samples");
}

#[test]
fn what_exceeds_the_ceiling_goes_to_other_pixels() {
    let film = half_noisy([16, 16]);
    let [free, close] = [10, 5].map(|max_spp| planned(&film, 9 * 256, max_spp));
    for counts in [&free, &close] {
        assert_eq!(counts.iter().sum::<u32>(), 5 * 256 / 8, "the ceiling moves samples, and loses none");
    }
    assert!(free.iter().any(|n| *n > 1) && close.iter().all(|n| *n <= 1));
}

#[test]
fn predicted_errors_add_up_to_the_true_error() {
    type Image = fn(u32, u32) -> f64;
    let images: [Image; 4] = [
        |_, _| 10.0,
        |x, y| 10.0 + 0.05 * f64::from(x) + 0.02 * f64::from(y),
        |x, y| if x + y / 2 < 40 { 10.0 } else { 16.0 },
        |x, y| 12.0 + libm::sin(0.3 * f64::from(x)) * libm::sin(0.2 * f64::from(y)),
    ];
    for (k, image) in images.into_iter().enumerate() {
        let film = noisy_film([64, 64], 8, VARIANCE, 7 + k as u64, image, |_, _| 1.0);
        let filtered = GemFilter::default().apply(&film).expect("a film with variance");
        let truth = |i: usize| image(i as u32 % 64, i as u32 / 64);
        let wrong = 4096.0 * squared_error(&filtered.radiance, truth);
        let predicted: f64 = filtered.error.expect("an error").iter().map(|e| f64::from(*e)).sum();
        let unfiltered = 4096.0 / 8.0;
        assert!(wrong < 0.3 * unfiltered, "image {k}: the filter leaves {wrong}");
        let is_near = predicted > 0.5 * wrong && predicted < 2.0 * wrong + 0.1 * unfiltered;
        assert!(is_near, "image {k}: {predicted}, {wrong}");
    }
}

#[test]
fn white_noise_ends_at_the_coarsest_scale() {
    let share = |gamma: f64| {
        let filter = GemFilter::with_options(GemFilterOptions::default().gamma(gamma)).unwrap();
        let of = |seed| {
            let film = noisy_film([64, 64], 8, VARIANCE, seed, |_, _| 10.0, |_, _| 1.0);
            let means: Vec<_> = (0..4096).map(|i| [film.mean(i)[0], 1.0]).collect();
            let coarsest = convolve([64, 64], &gaussian_taps(8.0), &means);
            let filtered = image(&filter, &film);
            let is_coarsest =
                |(x, [sum, weight]): (&[f32; 3], &[f64; 2])| (f64::from(x[0]) - sum / weight).abs() < 1e-6;
            filtered.iter().zip(&coarsest).filter(|pair| is_coarsest(*pair)).count() as f64 / 4096.0
        };
        (0..4).map(of).sum::<f64>() / 4.0
    };
    let [published, strict] = [0.2, 0.5].map(share);
    assert!(published > 0.99 && strict < published, "only {published} and {strict} of the pixels are");
}

#[test]
fn pixels_at_an_edge_stay_and_the_flat_parts_are_blurred() {
    let film = noisy_film([64, 32], 16, VARIANCE, 3, |x, _| if x < 32 { 10.0 } else { 20.0 }, |_, _| 0.5);
    let image = image(&GemFilter::default(), &film);
    let mut square = 0.0;
    for y in 0..32 {
        for i in [y * 64 + 31, y * 64 + 32] {
            assert_eq!(image[i][0], film.mean(i)[0] as f32, "row {y}");
        }
        square += (f64::from(image[y * 64 + 3][0]) - 10.0).powi(2) / 32.0;
    }
    // The samples leave 0.125, and a Gaussian of two pixels 0.018.
    assert!(square.sqrt() < 0.015, "{}", square.sqrt());
}

#[test]
fn pixels_without_samples_are_filled() {
    let mut film = noisy_film([9, 9], 0, VARIANCE, 0, |_, _| 1.0, |_, _| 0.0);
    for i in (0..81).filter(|i| i % 9 != 4) {
        (0..4).for_each(|s| film.push(i, 0, [1.0 + 0.1 * s as f32; 3]));
    }
    let Filtered { radiance, error, .. } = GemFilter::default().apply(&film).unwrap();
    let error = error.unwrap();
    assert!((0..9).map(|y| 9 * y + 4).all(|i| (radiance[i][0] - 1.15).abs() < 1e-6 && error[i] > 0.0), "{radiance:?}");
}
