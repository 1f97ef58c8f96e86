//! The sRGB transfer curve, computed with IEEE-exact operations only: the same bits on every machine.

/// Converts a finite linear intensity, clamped to 0..=1, to an sRGB value in 0..=1 [IEC 61966-2-1].
pub(crate) fn srgb_encode(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    if x <= 0.003_130_8 {
        return 12.92 * x;
    }
    // x^(1/2.4) = ((x^(1/4))^(1/3))^5, the cube root of t in 0.23..=1 by Newton's iteration. `pow` of the platform's
    // libm would differ between machines.
    let t = x.sqrt().sqrt();
    let mut root = (t + 2.0) / 3.0;
    for _ in 0..6 {
        root -= (root - t / (root * root)) / 3.0;
    }
    1.055 * root.powi(5) - 0.055
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_matches_the_standard_within_1e_14() {
        for i in -10..=100_010 {
            let x = f64::from(i) / 100_000.0;
            let c = x.clamp(0.0, 1.0);
            let expected = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
            assert!((srgb_encode(x) - expected).abs() < 1e-14, "{x}");
        }
    }
}
