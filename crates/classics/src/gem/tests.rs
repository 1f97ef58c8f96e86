use super::*;
use crate::support::{VARIANCE, next_counts, noisy_film, squared_error};
use dapple_core::Filter as _;
use dapple_low_discrepancy::Sobol;

fn planned(film: &Film, total: u64, max_spp: u32) -> Vec<u32> {
    next_counts(&mut Gem::new(Sobol::new(1)), film, total, [1, max_spp])
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
fn receiving_pixels_follow_the_kernel() {
    let bank = Bank::between_rounds();
    let kernels = Kernels::new(&bank, [64, 64]);
    let (middle, draws) = (32 * 64 + 32, 100_000u64);
    for (scale, sigma) in [(1, 1.0), (3, 4.0)] {
        let mut square = 0.0;
        for j in 0..draws {
            let at = kernels.draw(middle, scale, mix(9).wrapping_add(j << 8)) as f64;
            square += (at % 64.0 - 32.0).powi(2) / draws as f64;
        }
        // Less 2 % for the cut at 3 standard deviations; 1 % is 2 standard errors.
        assert!((square / (sigma * sigma) - 0.98).abs() < 0.025, "{scale}: {square}");
    }
    assert_eq!(kernels.draw(middle, 0, 1), middle as usize);
    assert!((0..1000u64).all(|j| kernels.draw(0, 4, j << 8) < 4096), "the corner's kernel is half outside");
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

fn white_noise(seed: u64) -> Film {
    noisy_film([64, 64], 8, VARIANCE, seed, |_, _| 10.0, |_, _| 1.0)
}

/// The share of flags, before they are smoothed, at a step of a bank on white noise.
fn share_of_flags(seed: u64, bank: &Bank, step: usize, gamma: f64) -> f64 {
    let film = white_noise(seed);
    let finest = || Level::finest(&film, &variances_of_means(&film));
    let blurred = |step: usize| finest().blurred([64, 64], bank.sigmas[step]);
    let fine = step.checked_sub(1).map_or_else(finest, blurred);
    let coarse = blurred(step);
    let flag = |i| compare(&fine, &coarse, bank.beta(step), strictness(gamma), i).flag;
    (0..4096).map(flag).sum::<f64>() / 4096.0
}

#[test]
fn gamma_is_the_share_of_false_stops_on_white_noise() {
    assert!((strictness(0.2) - 0.7022).abs() < 5e-5);
    for bank in [Bank::between_rounds(), Bank::of_image()] {
        for step in 0..bank.sigmas.len() {
            let share = |gamma| (0..8).map(|seed| share_of_flags(seed, &bank, step, gamma)).sum::<f64>() / 8.0;
            let [share, wide] = [0.2, 0.4].map(share);
            assert!((0.18..0.23).contains(&share), "step {step}: {share}");
            assert!(wide > 1.5 * share, "step {step}: a larger gamma makes {wide} of {share}");
        }
    }
}

#[test]
fn white_noise_ends_at_the_coarsest_scale() {
    for (bank, least) in [(Bank::between_rounds(), 0.96), (Bank::of_image(), 0.99)] {
        let coarsest = bank.sigmas.len() as u8;
        let share = |seed| {
            let scales = select(&white_noise(seed), &bank, 0.2);
            scales.iter().filter(|pixel| pixel.scale == coarsest).count() as f64 / scales.len() as f64
        };
        let mean = (0..8).map(share).sum::<f64>() / 8.0;
        assert!(mean > least, "only {mean} of the pixels are at the coarsest scale");
    }
}

#[test]
fn variances_fall_by_the_energy_of_the_kernel() {
    let finest = Level::finest(&white_noise(1), &[2.0; 64 * 64]);
    for sigma in [1.0, 2.0, 8.0] {
        let energy: f64 = gaussian_taps(sigma).iter().map(|tap| tap * tap).sum();
        let blurred = finest.blurred([64, 64], sigma);
        let middle = blurred.variances[32 * 64 + 32];
        assert!((middle / (2.0 * energy * energy) - 1.0).abs() < 1e-5, "{sigma}: {middle}");
        assert!(blurred.variances[0] > 2.0 * middle, "a corner averages fewer pixels");
    }
}

#[test]
fn beta_turns_differences_of_means_into_those_of_squared_biases_on_a_quadratic() {
    let size = [101, 101];
    let image = |x: u32, y: u32| {
        let [x, y] = [x, y].map(|x| f64::from(x) - 50.0);
        1e4 + 2.0 * x * x + 0.5 * x * y - 7.0 * x + y * y
    };
    let film = noisy_film(size, 2, VARIANCE, 1, image, |_, _| 0.0);
    let finest = Level::finest(&film, &vec![1.0; 101 * 101]);
    let (middle, truth) = (50 * 101 + 50, image(50, 50));
    let bank = Bank::of_image();
    for step in 1..bank.sigmas.len() {
        let [fine, coarse] =
            [bank.sigmas[step - 1], bank.sigmas[step]].map(|sigma| finest.blurred(size.map(|n| n as usize), sigma));
        let [f, c] = [&fine, &coarse].map(|level| level.means[middle][0] - truth);
        let (loss, wanted) = (bank.beta(step) * (f - c) * (f - c), c * c - f * f);
        assert!((loss / wanted - 1.0).abs() < 0.05, "step {step}: {loss}, not {wanted}");
    }
    assert!((bank.beta(1) - 3.0).abs() < 1e-12 && (Bank::between_rounds().beta(2) - 5.0 / 3.0).abs() < 1e-12);
}

#[test]
fn pixels_at_an_edge_stop_at_once_and_a_larger_gamma_is_never_coarser() {
    let film = noisy_film([64, 32], 16, VARIANCE, 3, |x, _| if x < 32 { 10.0 } else { 20.0 }, |_, _| 0.5);
    let bank = Bank::of_image();
    let scales = |gamma| select(&film, &bank, gamma).iter().map(|pixel| pixel.scale).collect::<Vec<_>>();
    let [loose, strict] = [0.2, 0.4].map(scales);
    for y in 0..32 {
        assert_eq!([loose[y * 64 + 31], loose[y * 64 + 32]], [0, 0], "row {y}");
        assert!(loose[y * 64 + 3] > 4, "row {y}: the flat part is at scale {}", loose[y * 64 + 3]);
    }
    assert!(strict.iter().zip(&loose).all(|(strict, loose)| strict <= loose) && strict != loose);
}

#[test]
fn pixels_without_samples_are_filled() {
    let mut film = noisy_film([9, 9], 0, VARIANCE, 0, |_, _| 1.0, |_, _| 0.0);
    for i in (0..81).filter(|i| i % 9 != 4) {
        (0..4).for_each(|s| film.push(i, 0, [1.0 + 0.1 * s as f32; 3]));
    }
    let selection = select(&film, &Bank::of_image(), 0.2);
    for y in 0..9 {
        let Selected { mean: [red, ..], error, scale, .. } = selection[9 * y + 4];
        assert!((red - 1.15).abs() < 1e-6 && error > 0.0 && scale > 0, "{red}");
    }
}
