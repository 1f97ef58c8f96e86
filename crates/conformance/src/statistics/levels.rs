//! Significance levels, critical values and tail probabilities, accurate for p-values of 1e-6 and far below, and the
//! chi-square test of sample counts against a density.

use dapple_metrics::student_t_quantile;
pub use dapple_metrics::student_t_tail as student_tail;

/// The probability that any of a group of related tests gives a false alarm.
pub const FAMILY: f64 = 1e-6;

/// The significance level at which to run each of `tests` tests, so that the probability of any false alarm is `alpha` (Sidak).
pub fn sidak(alpha: f64, tests: usize) -> f64 {
    -((-alpha).ln_1p() / tests as f64).exp_m1()
}

/// The upper regularised incomplete gamma function Q(a, x). Uses the series of P for x below a + 1, else Legendre's continued
/// fraction (modified Lentz), so that small tails are accurate.
pub(super) fn gamma_q(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - libm::lgamma(a)).exp();
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

/// The one-sided critical value `z` of the standard normal distribution, `P(Z > z) = alpha`.
pub fn critical(alpha: f64) -> f64 {
    -student_t_quantile(alpha, f64::INFINITY)
}

/// The upper tail probability `P(Z > z)` of the standard normal distribution, for z >= 0.
pub fn normal_tail(z: f64) -> f64 {
    student_tail(z, f64::INFINITY)
}

/// The two-sided p-value of a standard normal deviate.
pub fn two_sided(z: f64) -> f64 {
    2.0 * normal_tail(z.abs())
}

/// The p-value of the smallest of `tests` p-values: the probability that at least one of `tests` p-values is as small by chance
/// (Sidak).
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

/// The p-value of the chi-square test of `observed[i]` samples in cell `i` against `expected[i]`, for slices of equal length.
/// Use it for independent samples only: low-discrepancy points are too even.
///
/// Cells with fewer than 5 expected samples are pooled, in ascending order. A sample in a cell with less than 1e-9 expected
/// samples counts as impossible: the p-value is then 0.
pub fn chi_square(observed: &[u64], expected: &[f64]) -> f64 {
    assert_eq!(observed.len(), expected.len());
    let mut order: Vec<usize> = (0..expected.len()).collect();
    order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));
    let (mut statistic, mut cells) = (0.0, 0usize);
    let (mut pool_seen, mut pool_due) = (0.0, 0.0);
    for i in order {
        let (seen, due) = (observed[i] as f64, expected[i]);
        if due < 1e-9 {
            if seen > 0.0 {
                return 0.0;
            }
        } else if due < 5.0 || (pool_due > 0.0 && pool_due < 5.0) {
            pool_seen += seen;
            pool_due += due;
        } else {
            statistic += (seen - due).powi(2) / due;
            cells += 1;
        }
    }
    if pool_due > 0.0 {
        statistic += (pool_seen - pool_due).powi(2) / pool_due;
        cells += 1;
    }
    if cells < 2 { 1.0 } else { gamma_q(0.5 * (cells - 1) as f64, 0.5 * statistic) }
}

/// The integral of `f` over the rectangle `x` by `y`, to about the absolute error `tolerance`. Uses a 3x3 Simpson rule,
/// and halves both sides adaptively at most `depth` times.
pub fn integrate(f: &dyn Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], tolerance: f64, depth: u32) -> f64 {
    let (xm, ym) = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]));
    let whole = simpson(f, x, y);
    let quarters =
        [([x[0], xm], [y[0], ym]), ([xm, x[1]], [y[0], ym]), ([x[0], xm], [ym, y[1]]), ([xm, x[1]], [ym, y[1]])];
    let parts: f64 = quarters.iter().map(|&(x, y)| simpson(f, x, y)).sum();
    if depth == 0 || (parts - whole).abs() <= 15.0 * tolerance {
        return parts + (parts - whole) / 15.0;
    }
    quarters.iter().map(|&(x, y)| integrate(f, x, y, 0.25 * tolerance, depth - 1)).sum()
}

fn simpson(f: &dyn Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2]) -> f64 {
    const WEIGHTS: [f64; 3] = [1.0, 4.0, 1.0];
    let mut sum = 0.0;
    for (i, a) in WEIGHTS.iter().enumerate() {
        for (j, b) in WEIGHTS.iter().enumerate() {
            sum += a * b * f(x[0] + 0.5 * i as f64 * (x[1] - x[0]), y[0] + 0.5 * j as f64 * (y[1] - y[0]));
        }
    }
    sum * (x[1] - x[0]) * (y[1] - y[0]) / 36.0
}
