//! The weights of the Gaussian filter.

use super::*;

/// Composite Simpson rule over the pixel with 20,000 intervals.
fn by_simpson(alpha: f64, radius: f64, k: f64) -> f64 {
    let kernel = |x: f64| ((-alpha * x * x).exp() - (-alpha * radius * radius).exp()).max(0.0);
    let (a, b) = ((k - 0.5).max(-radius), (k + 0.5).min(radius));
    let n = 20_000;
    let h = (b - a) / f64::from(n);
    let inner: f64 = (1..n).map(|i| kernel(a + h * f64::from(i)) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
    h / 3.0 * (kernel(a) + inner + kernel(b))
}

const CASES: [[f64; 2]; 10] = [
    [0.5, 4.0],
    [0.5, 8.0],
    [2.0, 1.5],
    [2.0, 0.3],
    [0.01, 64.0],
    [1e-4, 20.0],
    [3.9, 0.5],
    [30.0, 2.0],
    [0.062, 4.0],
    [0.063, 4.0],
];

#[test]
fn weights_are_the_integrals_of_the_kernel_f08() {
    for [alpha, radius] in CASES {
        let weights = gaussian_weights(alpha, radius);
        let n = (weights.len() / 2) as i32;
        let reach = n + 5;
        let integrals: Vec<f64> = (-reach..=reach)
            .map(|k| if f64::from(k.abs()) - 0.5 < radius { by_simpson(alpha, radius, k.into()) } else { 0.0 })
            .collect();
        let total: f64 = integrals.iter().sum();
        for k in -reach..=reach {
            let got = if k.abs() <= n { weights[(k + n) as usize] } else { 0.0 };
            let wanted = integrals[(k + reach) as usize] / total;
            assert!((got - wanted).abs() < 1e-12, "alpha {alpha} radius {radius} pixel {k}: {got}, not {wanted}");
        }
    }
}

#[test]
fn weights_are_symmetric_positive_end_at_the_radius_and_sum_to_one_f08() {
    let extreme = [[f64::MIN_POSITIVE, 64.0], [f64::MAX, 64.0], [1.0, f64::MIN_POSITIVE], [1e-12, 3.0], [1e12, 3.0]];
    for [alpha, radius] in CASES.into_iter().chain(extreme) {
        let weights = gaussian_weights(alpha, radius);
        let n = weights.len() / 2;
        assert_eq!(weights.len() % 2, 1);
        assert!(n as f64 - 0.5 < radius, "alpha {alpha} radius {radius}: {n} pixels to a side");
        assert!(weights.iter().all(|w| *w >= NEGLIGIBLE && *w <= 1.0 + 1e-15), "alpha {alpha} radius {radius}");
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14, "alpha {alpha} radius {radius}");
        for k in 0..n {
            assert_eq!(weights[k].to_bits(), weights[2 * n - k].to_bits());
            assert!(weights[k] <= weights[k + 1]);
        }
    }
}

#[test]
fn a_flat_gaussian_is_a_parabola() {
    // The kernel tends to alpha (r^2 - x^2): over -1/2 .. 1/2 and the two parts up to r = 1.
    let weights = gaussian_weights(1e-200, 1.0);
    let centre = (1.0 - 1.0 / 12.0) / (4.0 / 3.0);
    assert!((weights[1] - centre).abs() < 1e-15, "{weights:?}");
}

#[test]
fn erfc_matches_published_values() {
    // [Abramowitz and Stegun 1964, table 7.1] for erf 0.5 and 1; at 3 series and fraction meet.
    assert!((erfc(0.5) - (1.0 - 0.520_499_877_8)).abs() < 1e-10);
    assert!((erfc(1.0) - (1.0 - 0.842_700_792_9)).abs() < 1e-10);
    assert_eq!(erfc(0.0), 1.0);
    let (below, above) = (erfc(3.0 - 1e-15), erfc(3.0));
    assert!((below - above).abs() < 1e-15, "{below} {above}");
    assert_eq!(erfc(1e200), 0.0);
}
