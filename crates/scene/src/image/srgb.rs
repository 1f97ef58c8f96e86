//! The sRGB transfer curve, computed by IEEE-exact operations only, so that results are bitwise the same on every
//! machine.

/// Returns the linear intensity of an sRGB value in 0..=1 [IEC 61966-2-1]. Values outside are clamped; NaN becomes 0.
pub fn srgb_decode(encoded: f64) -> f64 {
    let s = unit(encoded);
    if s <= 0.04045 {
        return s / 12.92;
    }
    // x^2.4 = x^2 * (x^(1/5))^2
    let x = (s + 0.055) / 1.055;
    let fifth_root = root::<5>(x);
    x * x * fifth_root * fifth_root
}

/// Returns the sRGB value of a linear intensity in 0..=1 [IEC 61966-2-1]. Values outside are clamped; NaN becomes 0.
pub fn srgb_encode(linear: f64) -> f64 {
    let x = unit(linear);
    if x <= 0.003_130_8 {
        return 12.92 * x;
    }
    // 1.055 - 0.055 is not 1 in f64.
    if x == 1.0 {
        return 1.0;
    }
    // x^(1/2.4) = x^(5/12)
    let twelfth_root = root::<3>(x.sqrt().sqrt());
    1.055 * twelfth_root.powi(5) - 0.055
}

/// Returns `x` clamped to 0..=1; NaN becomes 0.
fn unit(x: f64) -> f64 {
    if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) }
}

/// Returns the `N`th root of `x` in [0.08, 1], by Newton's iteration from above. libm's `pow` differs between
/// platforms.
fn root<const N: i32>(x: f64) -> f64 {
    let n = f64::from(N);
    let mut y = (x + n - 1.0) / n;
    for _ in 0..6 {
        y -= (y - x / y.powi(N - 1)) / n;
    }
    y
}

/// Returns the linear intensities of all 256 8-bit sRGB codes, in order.
pub(super) fn decode_table_8() -> Vec<f32> {
    (0..256).map(|i| srgb_decode(f64::from(i) / 255.0) as f32).collect()
}

/// Returns the linear intensities of all 65536 16-bit sRGB codes, in order.
pub(super) fn decode_table_16() -> Vec<f32> {
    (0..65536).map(|i| srgb_decode(f64::from(i) / 65535.0) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_the_standards_within_1e_14() {
        for i in 0..=100_000 {
            let x = f64::from(i) / 100_000.0;
            let decoded = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
            let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
            assert!((srgb_decode(x) - decoded).abs() < 1e-14, "decode {x}: {} {decoded}", srgb_decode(x));
            assert!((srgb_encode(x) - encoded).abs() < 1e-14, "encode {x}: {} {encoded}", srgb_encode(x));
        }
    }

    #[test]
    fn out_of_range_is_clamped() {
        for f in [srgb_decode, srgb_encode] {
            assert_eq!(
                [f(f64::NAN), f(-1.0), f(f64::NEG_INFINITY), f(7.0), f(f64::INFINITY)],
                [0.0, 0.0, 0.0, 1.0, 1.0]
            );
        }
    }
}
