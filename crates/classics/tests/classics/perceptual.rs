//! Samples where noise is visible.

use crate::support::{ANY, VARIANCE, next_counts, noisy_film, normal, sobol};
use dapple_classics::{Perceptual, PerceptualOptions, SamplingMethod as _};
use dapple_core::Film;
use dapple_core::plan::{BudgetLeft, Feedback, Plan, Stopping};

/// The next counts of pixels whose visible difference exceeds the threshold.
fn planned(film: &Film, options: PerceptualOptions) -> Vec<u32> {
    let budget = BudgetLeft::new(1 << 40).with_spent(film.record().samples);
    let mut plan = Plan::empty(film.frame().pixels());
    let options = options.mode(Stopping::Threshold);
    options.refine(&Feedback::new(1, film, budget), 1, &mut None, &mut plan).unwrap();
    plan.counts
}

/// The median over the pixels of the visible difference: the threshold at which half of them stop.
fn median_difference(film: &Film, options: PerceptualOptions) -> f64 {
    let (mut low, mut high) = (-10.0, 10.0);
    for _ in 0..16 {
        let middle: f64 = 0.5 * (low + high);
        let open = planned(film, options.threshold(middle.exp2())).iter().filter(|&&n| n > 0).count();
        (low, high) = if 2 * open > film.frame().pixels() { (middle, high) } else { (low, middle) };
    }
    low.exp2()
}

#[test]
fn without_noise_nothing_is_visible() {
    let film = noisy_film([37, 20], 4, VARIANCE, 1, |x, y| f64::from(x * y % 7), |_, _| 0.0);
    assert!(planned(&film, PerceptualOptions::default().threshold(1e-12)).iter().all(|&n| n == 0));
}

#[test]
fn more_noise_is_more_visible_and_more_samples_are_less() {
    let of = |spp: u64, noise: f64| {
        let film = noisy_film([64, 64], spp, VARIANCE, 1, |_, _| 10.0, |_, _| noise);
        median_difference(&film, PerceptualOptions::default())
    };
    let [quiet, loud, long] = [of(8, 0.5), of(8, 1.0), of(32, 1.0)];
    // Noise masks itself a little, so that the ratio is below 2.
    assert!((1.8..2.0).contains(&(loud / quiet)), "{quiet} {loud}");
    assert!((1.8..2.0).contains(&(loud / long)), "{loud} {long}");
}

#[test]
fn texture_masks_noise() {
    // A contrast of 0.5 around the same mean, in all bands, and the same noise.
    let grey = noisy_film([64, 64], 8, VARIANCE, 1, |_, _| 10.0, |_, _| 0.5);
    let texture = |x: u32, y: u32| 10.0 + 5.0 * normal(u64::from(64 * y + x)).signum();
    let texture = noisy_film([64, 64], 8, VARIANCE, 1, texture, |_, _| 0.5);
    let options = PerceptualOptions::default().adapt(10.0);
    let [grey, texture] = [grey, texture].map(|film| median_difference(&film, options));
    assert!(texture < 0.8 * grey, "{texture} in the texture, {grey} on grey");
}

#[test]
fn exposure_has_no_effect_if_the_eye_adapts() {
    let film = |k: f64| noisy_film([32, 32], 8, VARIANCE, 1, |x, _| k * (10.0 + f64::from(x)), |_, _| k);
    let options = PerceptualOptions::default();
    let threshold = median_difference(&film(1.0), options);
    let of = |k: f64, adapt: f64| planned(&film(k), options.adapt(adapt).threshold(threshold));
    let plans = [of(1.0, 0.0), of(1.0, 5.0), of(1.0, 10.0)];
    assert_eq!(plans[..2], [of(1024.0, 0.0), of(0.125, 0.625)]);
    assert!(plans[1] != plans[2] && plans.iter().flatten().any(|n| (1..8).contains(n)));
}

#[test]
fn thresholds_stop_converged_pixels_and_at_most_double_others() {
    let film = noisy_film([64, 32], 8, VARIANCE, 5, |_, _| 10.0, |x, _| if x < 32 { 1e-4 } else { 3.0 });
    let options = PerceptualOptions::default().mode(Stopping::Threshold);
    let mut sampler = Perceptual::with_options(sobol(1), options).expect("in range");
    for (i, n) in next_counts(&mut sampler, &film, 1 << 20, ANY).iter().enumerate() {
        let expected = match i % 64 {
            0..24 => 0,
            40.. => 8,
            _ => continue, // windows and blocks reach across
        };
        assert_eq!(*n, expected, "pixel {i}");
    }
}
