//! Under Monte Carlo noise nearly every pixel is refined: 67 to 89 % with the parameters of [Lan 2016].

use crate::common::*;
use dapple_core::Limits;
use dapple_mitchell::{PilotPolicy, Stopping};

/// Noise between 0.5 and 1.5 of its mean: a relative deviation of 29 %.
fn noise(_: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    [0.5 + u[0]; 3]
}

/// The fraction of pixels whose green contrast exceeds 0.3 after `n` such samples: the largest is `y`, and not all
/// others lie above `0.7 / 1.3 y`. By the midpoint rule, to about 1e-6.
fn share(n: i32) -> f64 {
    let steps = 100_000;
    let flat = |y: f64| f64::from(n) * (y - (0.7 / 1.3 * y).max(0.5)).powi(n - 1);
    1.0 - (0..steps).map(|k| flat(0.5 + (f64::from(k) + 0.5) / f64::from(steps))).sum::<f64>() / f64::from(steps)
}

#[test]
fn under_noise_nearly_everything_is_refined_and_more_samples_make_it_worse() {
    let size = frame(100, 100);
    let mut before = 0.0;
    for (radius, initial, window) in [(0, 2, 2), (0, 4, 4), (0, 12, 12), (0, 16, 16), (1, 4, 36)] {
        let options = alone(initial, 1, Stopping::Threshold, PilotPolicy::Keep).radius(radius);
        let film = run(&mut Field(noise), &mut mitchell(options, 1), size, &Limits::samples(100 * 10_000));
        let refined = film.counts().iter().filter(|&&n| n > u64::from(initial)).count() as f64 / 1e4;
        let expected = share(window);
        // 5 standard deviations, and 3x3 windows at the border are smaller.
        let allowed = 5.0 * (expected * (1.0 - expected) / 1e4).sqrt() + if radius > 0 { 1e-3 } else { 1e-9 };
        assert!((refined - expected).abs() < allowed, "{initial} samples, radius {radius}: {refined} for {expected}");
        assert!(expected > before, "contrast never falls");
        before = expected;
    }
    // The numbers of the crate's front page.
    assert!((share(2) - 0.18).abs() < 0.005 && (share(16) - 0.994).abs() < 0.0005 && share(36) > 0.9999);
}
