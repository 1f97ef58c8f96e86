//! The weights of the Gaussian filter along one axis: the kernel integrated over each pixel.

use std::f64::consts::PI;

/// The share of the total weight below which a weight is dropped. It would change no `f64` sum, and its square could
/// underflow to zero and meet an infinite variance.
const NEGLIGIBLE: f64 = 1e-18;

/// The weights of the pixels `k = -n ..= n` along one axis: the integrals of `max(0, exp(-alpha x^2) - exp(-alpha
/// radius^2))` over `k - 1/2 .. k + 1/2`, divided by their sum.
///
/// The result is symmetric bit for bit. It has at least one entry, none of them zero.
/// `alpha` and `radius` must be finite and positive.
pub(crate) fn gaussian_weights(alpha: f64, radius: f64) -> Vec<f64> {
    let reach = (radius + 0.5).ceil() as usize - 1;
    let mut half: Vec<f64> = (0..=reach)
        .map(|k| {
            let start = (k as f64 - 0.5).max(0.0);
            let end = (k as f64 + 0.5).min(radius);
            let mass = mass(alpha, radius, start, end).max(0.0);
            if k == 0 { 2.0 * mass } else { mass }
        })
        .collect();
    let total = half[0] + 2.0 * half[1..].iter().sum::<f64>();
    half.iter_mut().for_each(|w| *w /= total);
    let kept = half.iter().rposition(|w| *w >= NEGLIGIBLE).unwrap_or(0);
    half.truncate(kept + 1);
    half[1..].iter().rev().chain(&half).copied().collect()
}

/// The integral of the kernel `exp(-alpha x^2) - exp(-alpha radius^2)` over `start .. end`, `0 <= start <= end <=
/// radius`, up to a factor that depends only on `alpha` and `radius`.
fn mass(alpha: f64, radius: f64, start: f64, end: f64) -> f64 {
    let root = alpha.sqrt();
    let drop = (root * radius) * (root * radius);
    if drop < 1.0 {
        // The Gaussian is nearly flat, so differences of erf would cancel. With u = x / radius the kernel is
        // exp(-drop) drop (exp(drop (1 - u^2)) - 1) / drop. The last factor tends to 1 - u^2 and equals it to
        // all digits long before drop reaches 1e-30.
        let drop = drop.max(1e-30);
        gauss_legendre(start / radius, end / radius, |u| (drop * (1.0 - u * u)).exp_m1() / drop)
    } else {
        let gaussian = (erfc(root * start) - erfc(root * end)) * (0.5 * PI.sqrt() / root);
        gaussian - (-drop).exp() * (end - start)
    }
}

/// Eight-point Gauss-Legendre quadrature, exact for polynomials of degree 15. Nodes and weights after [Abramowitz and
/// Stegun 1964, table 25.4].
fn gauss_legendre(start: f64, end: f64, f: impl Fn(f64) -> f64) -> f64 {
    const NODES: [[f64; 2]; 4] = [
        [0.183_434_642_495_649_8, 0.362_683_783_378_362],
        [0.525_532_409_916_329, 0.313_706_645_877_887_3],
        [0.796_666_477_413_626_7, 0.222_381_034_453_374_48],
        [0.960_289_856_497_536_3, 0.101_228_536_290_376_26],
    ];
    let (middle, half) = (0.5 * (start + end), 0.5 * (end - start));
    half * NODES.iter().map(|[x, w]| w * (f(middle - half * x) + f(middle + half * x))).sum::<f64>()
}

/// The complementary error function of `x >= 0`. Its error is about 1e-15 absolute and, where the value is small, 1e-13
/// relative.
fn erfc(x: f64) -> f64 {
    let gaussian = (-x * x).exp();
    if x < 3.0 {
        // After [Abramowitz and Stegun 1964, eq. 7.1.6]: all terms are positive, so nothing cancels.
        let (mut term, mut sum, mut n) = (x, x, 0.0);
        while term > sum * 1e-17 {
            n += 1.0;
            term *= 2.0 * x * x / (2.0 * n + 1.0);
            sum += term;
        }
        1.0 - 2.0 / PI.sqrt() * gaussian * sum
    } else {
        // After [Abramowitz and Stegun 1964, eq. 7.1.14], from the inside out. 40 levels reach the last digit at 3;
        // larger x need fewer.
        let tail = (1..=40).rev().fold(x, |tail, k| x + 0.5 * f64::from(k) / tail);
        gaussian / (PI.sqrt() * tail)
    }
}

#[cfg(test)]
mod tests {
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
        let extreme =
            [[f64::MIN_POSITIVE, 64.0], [f64::MAX, 64.0], [1.0, f64::MIN_POSITIVE], [1e-12, 3.0], [1e12, 3.0]];
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
}
