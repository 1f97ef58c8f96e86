//! Critical values of Student's t distribution, with the same bits on every machine.

use std::f64::consts::{FRAC_PI_2, SQRT_2};

/// The value that `|t|` exceeds with probability `level`, for `freedom` degrees of freedom [after Hill 1970].
///
/// `level` lies in `(0, 1)`. Degrees of freedom need not be whole; those below 1 count as 1. The relative error is
/// below 1e-4.
pub(crate) fn two_sided_critical(level: f64, freedom: f64) -> f64 {
    let n = freedom.max(1.0);
    if n == 1.0 {
        return libm::cos(level * FRAC_PI_2) / libm::sin(level * FRAC_PI_2);
    }
    if n == 2.0 {
        return (2.0 / (level * (2.0 - level)) - 2.0).sqrt();
    }
    let a = 1.0 / (n - 0.5);
    let b = 48.0 / (a * a);
    let c = ((20_700.0 * a / b - 98.0) * a - 16.0) * a + 96.36;
    let d = ((94.5 / (b + c) - 3.0) / b + 1.0) * (a * FRAC_PI_2).sqrt() * n;
    let y = libm::pow(d * level, 2.0 / n);
    let ratio = if y > 0.05 + a {
        // Around the normal distribution.
        let x = -normal_critical(level);
        let y = x * x;
        let c = if n < 5.0 { c + 0.3 * (n - 4.5) * (x + 0.6) } else { c };
        let c = (((0.05 * d * x - 5.0) * x - 7.0) * x - 2.0) * x + b + c;
        let y = (((((0.4 * y + 6.3) * y + 36.0) * y + 94.5) / c - y - 3.0) / b + 1.0) * x;
        libm::expm1(a * y * y)
    } else {
        // The far tail.
        let inner = 1.0 / (((n + 6.0) / (n * y) - 0.089 * d - 0.822) * (n + 2.0) * 3.0) + 0.5 / (n + 4.0);
        (inner * y - 1.0) * (n + 1.0) / (n + 2.0) + 1.0 / y
    };
    (n * ratio).sqrt()
}

/// The value that the absolute value of a standard normal number exceeds with probability `level`, by Newton's
/// iteration on the logarithm of the tail.
pub(crate) fn normal_critical(level: f64) -> f64 {
    // A start above the root: the tail is below exp(-z^2 / 2).
    let mut z = (-2.0 * libm::log(level)).sqrt();
    for _ in 0..12 {
        let tail = libm::erfc(z / SQRT_2);
        let slope = (2.0 / std::f64::consts::PI).sqrt() * libm::exp(-0.5 * z * z) / tail;
        z = (z + libm::log(tail / level) / slope).max(0.0);
    }
    z
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_conformance::statistics::{normal_tail, student_tail};

    #[test]
    fn critical_values_have_their_probability() {
        for level in [0.3, 0.1, 0.05, 0.01, 0.005, 1e-3] {
            let found = 2.0 * normal_tail(normal_critical(level));
            assert!((found / level - 1.0).abs() < 1e-10, "{level}: {found}");
            for freedom in [1.0, 2.0, 2.5, 3.0, 4.0, 4.7, 5.0, 7.0, 11.3, 30.0, 254.0, 1e5] {
                let t = two_sided_critical(level, freedom);
                // Compared as values of t: a step of 1e-4 to either side brackets the level.
                let [above, below] = [0.9999, 1.0001].map(|k| 2.0 * student_tail(k * t, freedom));
                assert!(below < level && level < above, "{level}, {freedom}: {t} has {above} .. {below}");
            }
        }
    }
}
