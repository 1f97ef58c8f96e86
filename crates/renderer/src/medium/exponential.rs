//! The exponential function and the logarithm, by polynomials that give the same bits on every machine, as
//! [`trigonometry`](crate::shading::trigonometry) does for angles.

/// Returns `exp(x)` with a relative error below 2e-7. The result is 0 below -87.3 (near the end of `f32`'s range) and
/// infinity above 88.7.
#[inline]
pub fn exp(x: f32) -> f32 {
    if !(x > -87.3) {
        return if x.is_nan() { x } else { 0.0 };
    }
    if x > 88.7 {
        return f32::INFINITY;
    }
    // x = n ln 2 + r. Adding and subtracting 1.5 * 2^23 rounds to the nearest integer.
    let n = (x * std::f32::consts::LOG2_E + 12_582_912.0) - 12_582_912.0;
    // ln 2 is split in two parts. The first has so few digits that its product with n is exact [after Cody and Waite
    // 1980].
    let r = (x - n * 0.693_359_4) + n * 2.121_944_4e-4;
    // The polynomial is the one of expf in Cephes [Moshier 1992].
    let p = ((((1.987_569_2e-4 * r + 1.398_199_9e-3) * r + 8.333_452e-3) * r + 4.166_579_6e-2) * r + 1.666_666_5e-1)
        * r
        + 0.5;
    let power = |n: i32| f32::from_bits(((n + 127) as u32) << 23);
    // Multiplied in two steps, since 2^128 is not an f32.
    let half = n as i32 / 2;
    (p * r * r + r + 1.0) * power(half) * power(n as i32 - half)
}

/// Returns `-ln(1 - u)` for `u` in `[0, 1)`, within 2e-7: the optical depth that light crosses with probability `1 -
/// u`.
#[inline]
pub fn depth_of(u: f32) -> f32 {
    // 1 - u = 2^n m, with m near 1. The subtraction is exact in f64.
    let rest = 1.0 - f64::from(u);
    let bits = rest.to_bits();
    let above = u64::from(bits & 0x000f_ffff_ffff_ffff > 0x0006_a09e_667f_3bcd);
    let n = (bits >> 52) as i64 - 1023 + above as i64;
    let m = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | ((1023 - above) << 52));
    // ln m = 2 artanh(s) for s = (m - 1) / (m + 1), |s| < 0.172. The first omitted term is below 1e-9 of the first
    // term.
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let series = 1.0 + z * (1.0 / 3.0 + z * (1.0 / 5.0 + z * (1.0 / 7.0 + z * (1.0 / 9.0 + z / 11.0))));
    -(n as f64 * std::f64::consts::LN_2 + 2.0 * s * series) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_agrees_with_f64() {
        for i in -870_000..=880_000 {
            let x = i as f32 * 1e-4;
            let (found, exact) = (f64::from(exp(x)), f64::from(x).exp());
            assert!((found / exact - 1.0).abs() < 2e-7, "{x}: {found} {exact}");
        }
        assert_eq!([exp(0.0), exp(-0.0), exp(-1e-30)], [1.0; 3]);
        assert_eq!(
            [exp(-1e30), exp(f32::NEG_INFINITY), exp(90.0), exp(f32::INFINITY)],
            [0.0, 0.0, f32::INFINITY, f32::INFINITY]
        );
        assert!(exp(f32::NAN).is_nan());
    }

    #[test]
    fn depths_agree_with_f64() {
        let lattice = (0..1 << 24).step_by(37).map(|i| i as f32 / (1 << 24) as f32);
        let small = (-100_i16..0).map(f32::from).map(|e: f32| e.exp2());
        for u in lattice.chain(small).chain([1.0 - 0.5 * f32::EPSILON]) {
            let (found, exact) = (f64::from(depth_of(u)), -(-f64::from(u)).ln_1p());
            // Below 2^-30 single precision in 1 - u would be lost; no point set goes there but 0.
            assert!((found - exact).abs() <= 2e-7 * exact.abs() + 1e-16, "{u}: {found} {exact}");
        }
        assert_eq!(depth_of(0.0), 0.0);
    }
}
