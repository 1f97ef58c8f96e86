//! Quantiles of Student's t and of the normal distribution.

use std::f64::consts::{FRAC_1_SQRT_2, LN_2, PI};

/// The number of degrees of freedom from which on an expansion around the normal quantile has full f64 accuracy.
const MANY_DEGREES: f64 = 1e5;

/// The quantile of Student's t: the value below which t lies with `probability`. It is -inf for `probability` 0, inf for 1.
///
/// `degrees_of_freedom` is any number above 0, infinity included. The relative error is below 1e-12, also near the median.
/// NaN for a probability outside 0..=1 or degrees of freedom not above 0. Infinite if the value exceeds the range of an f64,
/// which happens below one degree of freedom.
///
/// ```
/// assert!((dapple_metrics::student_t_quantile(0.975, 7.0) - 2.364_624_251_592_785).abs() < 1e-11);
/// ```
///
/// Below 1e5 degrees of freedom, Newton's iteration in logarithms inverts the incomplete beta function [after
/// AbramowitzStegun 1964, 26.5.8]. From 1e5 on, a series extends the normal quantile [after AbramowitzStegun 1964, 26.7.5].
pub fn student_t_quantile(probability: f64, degrees_of_freedom: f64) -> f64 {
    let [p, v] = [probability, degrees_of_freedom];
    if !(0.0..=1.0).contains(&p) || v.is_nan() || v <= 0.0 {
        return f64::NAN;
    }
    if v < MANY_DEGREES {
        let beta = Beta::new(v);
        return quantile(p, |side, u| beta.log_mass(side, u));
    }
    let z = normal_quantile(p);
    if z.is_infinite() {
        return z;
    }
    let s = z * z;
    let terms = [
        (s + 1.0) / 4.0,
        ((5.0 * s + 16.0) * s + 3.0) / 96.0,
        (((3.0 * s + 19.0) * s + 17.0) * s - 15.0) / 384.0,
        ((((79.0 * s + 776.0) * s + 1482.0) * s - 1920.0) * s - 945.0) / 92160.0,
    ];
    z + z * terms.iter().rev().fold(0.0, |sum, term| (sum + term) / v)
}

/// The probability that Student's t exceeds `t`. A negative `t` counts as 0, with probability 1/2.
///
/// Infinite `degrees_of_freedom` give the normal distribution. NaN if `t` is NaN or `degrees_of_freedom` is not above 0. The
/// relative error is below 1e-11 up to 1e8 degrees of freedom and at infinity, in far tails too.
///
/// ```
/// assert!((dapple_metrics::student_t_tail(2.364_624_251_592_785, 7.0) - 0.025).abs() < 1e-12);
/// ```
pub fn student_t_tail(t: f64, degrees_of_freedom: f64) -> f64 {
    if t.is_nan() || degrees_of_freedom.is_nan() || degrees_of_freedom <= 0.0 {
        return f64::NAN;
    }
    if t <= 0.0 || t.is_infinite() || degrees_of_freedom.is_infinite() {
        return 0.5 * libm::erfc(t.max(0.0) * FRAC_1_SQRT_2);
    }
    libm::exp(Beta::new(degrees_of_freedom).log_mass(Side::Tail, libm::log(t)).0)
}

/// The quantile of the standard normal distribution for a probability p in 0..=1; infinite at 0 and 1.
pub(super) fn normal_quantile(p: f64) -> f64 {
    quantile(p, |side, u| {
        let z = libm::exp(u);
        let mass = match side {
            Side::Tail => 0.5 * libm::erfc(z * FRAC_1_SQRT_2),
            Side::Centre => 0.5 * libm::erf(z * FRAC_1_SQRT_2),
        };
        let slope = z * libm::exp(-0.5 * z * z) / (2.0 * PI).sqrt() / mass;
        (libm::log(mass), slope)
    })
}

/// The probability that a standard normal number lies below z.
pub(super) fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z * FRAC_1_SQRT_2)
}

/// The probability from which the quantile t is computed: above t (`Tail`), or between 0 and t (`Centre`). The smaller of the
/// two keeps full precision, in far tails and near the median.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Tail,
    Centre,
}

/// The quantile of a symmetric distribution for the probability p. `log_mass(side, u)` returns the logarithm of the
/// probability of `side` at t = exp(u), and the absolute value of its derivative by u.
fn quantile(p: f64, log_mass: impl Fn(Side, f64) -> (f64, f64)) -> f64 {
    let sign = if p < 0.5 { -1.0 } else { 1.0 };
    let [tail, centre] = [p.min(1.0 - p), (p - 0.5).abs()];
    if tail == 0.0 || centre == 0.0 {
        return if centre == 0.0 { 0.0 } else { sign * f64::INFINITY };
    }
    let (side, target) = if tail < 0.25 { (Side::Tail, tail) } else { (Side::Centre, centre) };
    let target = libm::log(target);
    // Rises with u for either side.
    let excess = |u: f64| {
        let (mass, slope) = log_mass(side, u);
        (if side == Side::Tail { target - mass } else { mass - target }, slope)
    };
    sign * rising_root(excess).map_or(f64::INFINITY, libm::exp)
}

/// The natural logarithm of the largest f64.
const LARGEST: f64 = 709.78;

/// The zero of a rising function by Newton's iteration within a bracket; `None` if it is above [`LARGEST`].
fn rising_root(excess: impl Fn(f64) -> (f64, f64)) -> Option<f64> {
    let [mut low, mut high] = [-1.0, 1.0];
    while excess(high).0 < 0.0 {
        (low, high) = (high, 2.0 * high);
        if low > LARGEST {
            return None;
        }
    }
    while excess(low).0 > 0.0 && low > -LARGEST {
        (low, high) = (2.0 * low, low);
    }
    let mut u = 0.5 * (low + high);
    // Newton's iteration takes about 6; bisection from the widest bracket 64.
    for _ in 0..100 {
        let (excess, slope) = excess(u);
        if excess < 0.0 {
            low = u
        } else {
            high = u
        }
        let step = excess / slope;
        let next = if (low..=high).contains(&(u - step)) { u - step } else { 0.5 * (low + high) };
        let close = (next - u).abs() <= 2.0 * f64::EPSILON * u.abs().max(0.5);
        u = next;
        if close {
            break;
        }
    }
    Some(u)
}

/// The beta distribution of x = v / (v + t^2) for Student's t with v degrees of freedom: its parameters are a = v/2 and
/// b = 1/2.
struct Beta {
    v: f64,
    a: f64,
    log_beta: f64,
}

impl Beta {
    fn new(v: f64) -> Self {
        let a = 0.5 * v;
        Self { v, a, log_beta: 0.5 * libm::log(PI) - log_gamma_step(a) }
    }

    /// The logarithm of the probability of `side` at t = exp(u), and the absolute value of its derivative with respect
    /// to u, as [`quantile`] requires.
    fn log_mass(&self, side: Side, u: f64) -> (f64, f64) {
        // ln(t^2 / v), and from it ln x and ln(1 - x) without cancellation.
        let odds = 2.0 * u - libm::log(self.v);
        let [log_x, log_rest] = [-softplus(odds), -softplus(-odds)];
        let x = libm::exp(log_x);
        // t times the density of t.
        let density = 0.5 * log_rest + self.a * log_x - self.log_beta;
        // The fraction converges fast for one side, depending on x; the other side is the rest of 1/2.
        let (near, log_near) = if x < (self.a + 1.0) / (self.a + 2.5) {
            (Side::Tail, density + libm::log(fraction(x, self.a, 0.5) / self.a) - LN_2)
        } else {
            (Side::Centre, density + libm::log(fraction(libm::exp(log_rest), 0.5, self.a)))
        };
        let mass = if near == side { log_near } else { libm::log(0.5 - libm::exp(log_near)) };
        (mass, libm::exp(density - mass))
    }
}

/// ln(1 + e^x).
fn softplus(x: f64) -> f64 {
    x.max(0.0) + libm::log1p(libm::exp(-x.abs()))
}

/// ln Gamma(a + 1/2) - ln Gamma(a) without cancellation for large a: asymptotic from 20 on, where the first omitted term
/// is 2e-16 [after AbramowitzStegun 1964, 6.1.40].
fn log_gamma_step(a: f64) -> f64 {
    if a < 20.0 {
        return libm::lgamma(a + 0.5) - libm::lgamma(a);
    }
    let s = 1.0 / (a * a);
    let series = ((((31.0 / 18432.0 * -s + 17.0 / 14336.0) * s - 1.0 / 640.0) * s + 1.0 / 192.0) * s - 0.125) / a;
    0.5 * libm::log(a) + series
}

/// The continued fraction of the incomplete beta function [after AbramowitzStegun 1964, 26.5.8] by the modified Lentz
/// method [after Thompson 1986].
fn fraction(x: f64, a: f64, b: f64) -> f64 {
    // Replaces a 0 in a denominator.
    let guarded = |v: f64| if v.abs() < 1e-300 { 1e-300 } else { v };
    let mut c = 1.0;
    let mut d = 1.0 / guarded(1.0 - (a + b) * x / (a + 1.0));
    let mut value = d;
    // The number of steps grows with the square root of the larger parameter: below 1000 for 1e5 degrees of freedom.
    for m in 1..10_000 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let mut factor = 1.0;
        for coefficient in [even, odd] {
            d = 1.0 / guarded(1.0 + coefficient * d);
            c = guarded(1.0 + coefficient / c);
            factor = c * d;
            value *= factor;
        }
        if (factor - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    value
}
