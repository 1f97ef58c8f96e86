use super::*;
use crate::test_films::{noisy_film, normal};
use dapple_core::{BudgetLeft, Progress, Sampler as _};
use dapple_low_discrepancy::Sobol;

const NEEDS: Needs = Needs::none().with_variance();

fn mean_difference(film: &Film, options: &PerceptualOptions) -> f64 {
    let all = visible_differences(film, options);
    all.iter().sum::<f64>() / all.len() as f64
}

#[test]
fn without_noise_nothing_is_visible() {
    let film = noisy_film([37, 20], 4, NEEDS, 1, |x, y| f64::from(x * y % 7), |_, _| 0.0);
    assert!(visible_differences(&film, &PerceptualOptions::default()).iter().all(|d| *d == 0.0));
}

#[test]
fn more_noise_is_more_visible_and_more_samples_are_less() {
    let of = |spp: u64, noise: f64| {
        mean_difference(&noisy_film([64, 64], spp, NEEDS, 1, |_, _| 10.0, |_, _| noise), &PerceptualOptions::default())
    };
    let [quiet, loud, long] = [of(8, 0.5), of(8, 1.0), of(32, 1.0)];
    // Noise masks itself a little, so that the ratio is below 2.
    assert!((1.8..2.0).contains(&(loud / quiet)), "{quiet} {loud}");
    assert!((1.8..2.0).contains(&(loud / long)), "{loud} {long}");
}

#[test]
fn texture_masks_noise() {
    // A contrast of 0.5 around the same mean, in all bands, and the same noise.
    let grey = noisy_film([64, 64], 8, NEEDS, 1, |_, _| 10.0, |_, _| 0.5);
    let texture = |x: u32, y: u32| 10.0 + 5.0 * normal(u64::from(64 * y + x)).signum();
    let texture = noisy_film([64, 64], 8, NEEDS, 1, texture, |_, _| 0.5);
    let options = PerceptualOptions::default().adapt(10.0);
    let [grey, texture] = [grey, texture].map(|film| mean_difference(&film, &options));
    assert!(texture < 0.8 * grey, "{texture} in the texture, {grey} on grey");
}

#[test]
fn exposure_has_no_effect_if_the_eye_adapts() {
    let of = |k: f64, adapt: f64| {
        let film = noisy_film([32, 32], 8, NEEDS, 1, |x, _| k * (10.0 + f64::from(x)), |_, _| k);
        visible_differences(&film, &PerceptualOptions::default().adapt(adapt))
    };
    for (a, b) in [(of(1.0, 0.0), of(1024.0, 0.0)), (of(1.0, 5.0), of(0.125, 0.625))] {
        assert!(a.iter().zip(&b).all(|(a, b)| (a / b - 1.0).abs() < 1e-6));
    }
    assert!(of(1.0, 5.0) != of(1.0, 10.0));
}

#[test]
fn the_error_of_a_contrast_is_that_of_many_draws() {
    // The response is nearly linear for this noise.
    const DRAWS: u64 = 400;
    let size = [13, 11];
    let (mut squares, mut predicted) = ([[0.0; 3]; BANDS], [[0.0; 3]; BANDS]);
    let places = [[5, 6], [12, 3], [0, 10]];
    let mut means = [[0.0; 3]; BANDS];
    for draw in 0..DRAWS {
        let film = noisy_film([13, 11], 2, NEEDS, 77 + draw, |_, _| 100.0, |_, _| 1.0);
        let response = responses(&film, 100.0);
        let exact = response.iter().map(|[mean, _]| [*mean, (1.0f64 / 200.0).powi(2) / 2.0]).collect();
        let pyramid = Pyramid::new(size, exact);
        for (band, place) in (0..BANDS).flat_map(|band| (0..3).map(move |place| (band, place))) {
            let [_, error] = pyramid.contrast(band, places[place]);
            let [fine, coarse] = [band, band + 1].map(|level| pyramid.block(level, places[place])[0]);
            let [below, _] = pyramid.block((band + 2).min(BANDS), places[place]);
            let contrast = (fine - coarse) / below;
            means[band][place] += contrast / DRAWS as f64;
            squares[band][place] += contrast * contrast / DRAWS as f64;
            predicted[band][place] += error * error / DRAWS as f64;
        }
    }
    for (band, place) in (0..BANDS).flat_map(|band| (0..3).map(move |place| (band, place))) {
        let (got, wanted) = (squares[band][place], predicted[band][place]);
        // Four standard errors of 400 squares.
        assert!((got - wanted).abs() <= 0.29 * wanted + 1e-12, "band {band}, place {place}: {got}, not {wanted}");
    }
    assert!(
        predicted[0][0] > 3.0 * predicted[1][0] && predicted[5][0] == 0.0,
        "the image is smaller than the last blocks"
    );
}

#[test]
fn sensitivity_peaks_at_four_cycles_per_degree() {
    let all = sensitivities(67.0, 100.0);
    assert!(all.iter().all(|s| *s <= 100.0) && all[2] > 90.0 && all[0] < all[1] && all[5] < all[4], "{all:?}");
    let peak = sensitivities(8.0 * std::f64::consts::SQRT_2, 100.0)[0];
    assert!((peak - 100.0).abs() < 1e-9, "{peak}");
}

#[test]
fn thresholds_stop_converged_pixels_and_at_most_double_others() {
    let film = noisy_film([64, 32], 8, NEEDS, 5, |_, _| 10.0, |x, _| if x < 32 { 1e-4 } else { 3.0 });
    let options = PerceptualOptions::default().mode(Stopping::Threshold);
    let mut plan = Plan::empty(2048);
    let seen = Feedback::new(1, &film, BudgetLeft::new(1 << 20).with_spent(8 * 2048));
    let mut sampler = Perceptual::with_options(Sobol::new(1), options).expect("in range");
    assert!(matches!(sampler.next_round(&seen, &mut plan), Ok(Progress::Trace)));
    for (i, n) in plan.counts.iter().enumerate() {
        let expected = match i % 64 {
            0..24 => 0,
            40.. => 8,
            _ => continue, // windows and blocks reach across
        };
        assert_eq!(*n, expected, "pixel {i}");
    }
}
