//! Statistical tests: Sidak's correction, chi-square against a density, equivalence (TOST).
//!
//! Each integration test that uses this says `mod statistics;`; not every one uses all of it.
#![allow(dead_code, unreachable_pub)]

pub mod directions;

/// False-alarm rate of a whole family of tests.
pub const FAMILY: f64 = 1e-6;

/// The level at which each of `tests` tests errs, for a family rate `alpha` (Sidak).
pub fn sidak(alpha: f64, tests: usize) -> f64 {
    -((-alpha).ln_1p() / tests as f64).exp_m1()
}

/// `ln Gamma(x)` for x > 0, by Stirling's series after shifting x above 15; error below 1e-14.
pub fn ln_gamma(x: f64) -> f64 {
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

/// The upper regularised incomplete gamma function Q(a, x): by series of P below a + 1, else by Legendre's
/// continued fraction (modified Lentz), so that small tails keep their digits.
pub fn gamma_q(a: f64, x: f64) -> f64 {
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

/// p-value of observed counts against expected ones: cells expecting fewer than 5 are pooled in ascending
/// order; a count in a pool that expects less than 1e-9 is impossible and gives 0.
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

/// Integral of `f` over a rectangle by adaptive subdivision of a 3 x 3 Simpson rule, to about the absolute
/// tolerance `tolerance`, down to `depth` halvings of both sides.
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

/// What an equivalence test found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The claim holds at the level asked for.
    Pass,
    /// The claim is refuted at that level.
    Fail,
    /// Neither: more samples are needed.
    Undecided,
}

/// Mean and its standard error, by Welford's recurrence.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    /// How many.
    pub n: u64,
    /// Their mean.
    pub mean: f64,
    m2: f64,
}

impl Mean {
    /// Takes in one value.
    pub fn add(&mut self, x: f64) {
        self.n += 1;
        let d = x - self.mean;
        self.mean += d / self.n as f64;
        self.m2 += d * (x - self.mean);
    }

    /// Standard error of the mean.
    pub fn standard_error(&self) -> f64 {
        (self.m2 / (self.n - 1) as f64 / self.n as f64).sqrt()
    }

    /// Whether the mean is below `bound`, with `z` standard errors to spare.
    pub fn below(&self, bound: f64, z: f64) -> Verdict {
        let slack = z * self.standard_error();
        if self.mean + slack < bound {
            Verdict::Pass
        } else if self.mean - slack > bound {
            Verdict::Fail
        } else {
            Verdict::Undecided
        }
    }

    /// Whether the mean lies within `delta` of `reference` (two one-sided tests).
    pub fn equals(&self, reference: f64, delta: f64, z: f64) -> Verdict {
        let slack = z * self.standard_error();
        let distance = (self.mean - reference).abs();
        if distance + slack < delta {
            Verdict::Pass
        } else if distance - slack > delta {
            Verdict::Fail
        } else {
            Verdict::Undecided
        }
    }
}

/// One-sided critical value of the normal distribution: `P(Z > z) = alpha`, by bisection on [`normal_tail`].
pub fn critical(alpha: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..100 {
        let z = 0.5 * (low + high);
        if normal_tail(z) > alpha { low = z } else { high = z }
    }
    0.5 * (low + high)
}

/// `P(Z > z)` for z >= 0.
pub fn normal_tail(z: f64) -> f64 {
    0.5 * gamma_q(0.5, 0.5 * z * z)
}
