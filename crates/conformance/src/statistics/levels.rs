//! Significance levels, critical values and tail probabilities, accurate for p-values of 1e-6 and far below.

use dapple_metrics::student_t_quantile;

/// The false-alarm probability of a whole family of tests.
pub const FAMILY: f64 = 1e-6;

/// The significance level of each of `tests` tests, at which the probability of any false alarm is `alpha` (Sidak).
pub fn sidak(alpha: f64, tests: usize) -> f64 {
    -((-alpha).ln_1p() / tests as f64).exp_m1()
}

/// `ln Gamma(x)` for x > 0, by Stirling's series after shifting x above 15; the error is below 1e-14.
pub(crate) fn ln_gamma(x: f64) -> f64 {
    let mut shift = 0.0;
    let mut x = x;
    while x < 15.0 {
        shift += x.ln();
        x += 1.0;
    }
    let z = 1.0 / (x * x);
    let series = (1.0 / 12.0 - z * (1.0 / 360.0 - z * (1.0 / 1260.0 - z * (1.0 / 1680.0 - z / 1188.0)))) / x;
    (x - 0.5) * x.ln() - x + 0.5 * std::f64::consts::TAU.ln() + series - shift
}

/// The upper regularised incomplete gamma function Q(a, x). Uses the series of P below a + 1, else Legendre's continued
/// fraction (modified Lentz), so that small tails keep their digits.
pub(crate) fn gamma_q(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut k) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-16 {
            k += 1.0;
            term *= x / k;
            sum += term;
        }
        return 1.0 - front * sum;
    }
    let mut b = x + 1.0 - a;
    let mut c = 1e300;
    let mut d = 1.0 / b;
    let mut h = d;
    for i in 1..100_000 {
        let i = f64::from(i);
        let an = -i * (i - a);
        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * h
}

/// The one-sided critical value `z` of the standard normal distribution, `P(Z > z) = alpha`, by bisection on
/// [`normal_tail`].
pub fn critical(alpha: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..100 {
        let z = 0.5 * (low + high);
        if normal_tail(z) > alpha { low = z } else { high = z }
    }
    0.5 * (low + high)
}

/// The upper tail probability `P(Z > z)` of the standard normal distribution, for z >= 0.
pub fn normal_tail(z: f64) -> f64 {
    0.5 * gamma_q(0.5, 0.5 * z * z)
}

/// The upper tail probability `P(T > t)` of Student's t distribution for t >= 0, computed from its quantile. The
/// relative error is 1e-10 down to 1e-300. Infinite degrees of freedom give the normal tail.
pub fn student_tail(t: f64, degrees_of_freedom: f64) -> f64 {
    if t.is_nan() || t <= 0.0 {
        return if t <= 0.0 { 0.5 } else { f64::NAN };
    }
    // In logarithms, since levels have any size, by the Illinois variant of false position.
    let excess = |log_p: f64| -student_t_quantile(log_p.exp(), degrees_of_freedom) / t - 1.0;
    let (mut low, mut high) = ((-690.0, excess(-690.0)), (-0.7, excess(-0.7)));
    if low.1 <= 0.0 {
        return 0.0;
    }
    if high.1 >= 0.0 {
        // Closer to the middle than e^-0.7: linear there.
        return 0.5 - (0.5 - (-0.7_f64).exp()) / (1.0 + high.1);
    }
    while high.0 - low.0 > 1e-11 {
        let share = (low.1 / (low.1 - high.1)).clamp(0.01, 0.99);
        let middle = low.0 + share * (high.0 - low.0);
        let found = excess(middle);
        if found.abs() < 1e-13 {
            return middle.exp();
        }
        if found > 0.0 {
            low = (middle, found);
            high.1 *= 0.5;
        } else {
            high = (middle, found);
            low.1 *= 0.5;
        }
    }
    (0.5 * (low.0 + high.0)).exp()
}

/// The two-sided p-value of a standard normal deviate.
pub fn two_sided(z: f64) -> f64 {
    2.0 * normal_tail(z.abs())
}

/// The p-value of the smallest of `tests` p-values: the probability that one of `tests` is as small by chance (Sidak).
pub fn adjusted(smallest: f64, tests: usize) -> f64 {
    if smallest >= 1.0 { 1.0 } else { -(tests as f64 * (-smallest).ln_1p()).exp_m1() }
}

/// The probability that a two-sided t-test at level `alpha` detects a shift of `shift` standard errors [after
/// Abramowitz and Stegun 1964, 26.7.10].
pub fn power(shift: f64, alpha: f64, degrees_of_freedom: f64) -> f64 {
    let v = degrees_of_freedom;
    let limit = student_t_quantile(1.0 - 0.5 * alpha, v);
    let z = (shift.abs() - limit * (1.0 - 0.25 / v)) / (1.0 + 0.5 * limit * limit / v).sqrt();
    if z >= 0.0 { 1.0 - normal_tail(z) } else { normal_tail(-z) }
}
