//! The exponential function of weights.

use super::*;

#[test]
fn exponentials_are_accurate() {
    for k in 0..80_000 {
        let x = k as f32 * 1e-3;
        let (got, wanted) = (f64::from(exp_minus(x)), (-f64::from(x)).exp());
        // Rounding x * log2 e costs another x * 6e-8.
        assert!((got / wanted - 1.0).abs() < 4e-6 + 2e-7 * f64::from(x), "{x}: {got}, not {wanted}");
    }
    assert_eq!(exp_minus(0.0), 1.0);
    assert!(exp_minus(f32::INFINITY) < 1e-34 && exp_minus(1e9) > 0.0);
}
