//! Trigonometric functions of angles in turns, by polynomials that are bit-identical on every machine.
//!
//! The platform's `sin`, `cos` and `atan2` differ in the last bit between systems. The functions here use only
//! additions, multiplications and divisions, which IEEE 754 defines exactly. A turn is a full circle, so a random
//! number in `[0, 1)` is an angle without a multiplication by a rounded pi.

/// Returns the sine and cosine of `turn` full turns, with an error below 2e-7, for `|turn| <= 2^20`.
///
/// The reduction to an eighth of a turn is exact. The polynomials are those of sinf and cosf in Cephes [Moshier 1992].
#[inline]
pub(crate) fn sin_cos_turn(turn: f32) -> (f32, f32) {
    // Adding and subtracting 1.5 * 2^23 rounds to the nearest integer, ties to even. It avoids a call into libm on
    // processors without a rounding instruction in their baseline.
    let quarters = (turn * 4.0 + 12_582_912.0) - 12_582_912.0;
    let (sin, cos) = sin_cos_within_an_eighth((turn * 4.0 - quarters) * std::f32::consts::FRAC_PI_2);
    // Quarters 0 to 3 give (sin, cos), (cos, -sin), (-sin, -cos), (-cos, sin). They are selected by bit operations,
    // since branches on a random quarter would be mispredicted.
    let quarter = quarters as i32 as u32;
    let (sin, cos) = (sin.to_bits(), cos.to_bits());
    let change = (sin ^ cos) & 0_u32.wrapping_sub(quarter & 1);
    let negative = |quarters: u32| (quarters & 2) << 30;
    (f32::from_bits(sin ^ change ^ negative(quarter)), f32::from_bits(cos ^ change ^ negative(quarter.wrapping_add(1))))
}

/// Returns the sine and cosine of an angle in radians of at most an eighth of a turn (pi / 4).
#[inline(always)]
pub(super) fn sin_cos_within_an_eighth(x: f32) -> (f32, f32) {
    let z = x * x;
    let sin = ((-1.951_529_6e-4 * z + 8.332_161e-3) * z - 1.666_665_5e-1) * z * x + x;
    let cos = ((2.443_315_7e-5 * z - 1.388_731_6e-3) * z + 4.166_664_6e-2) * z * z - 0.5 * z + 1.0;
    (sin, cos)
}

/// Returns the angle of the point `(x, y)` in turns, in `[0, 1)`, with an error below 1e-7; 0 at the origin.
///
/// Uses the polynomial of Cephes' `atanf` [Moshier 1992].
#[inline]
pub fn turn_of(y: f32, x: f32) -> f32 {
    let (near, far) = (x.abs().min(y.abs()), x.abs().max(y.abs()));
    if !(far > 0.0) {
        return 0.0;
    }
    // atan(t) = pi/4 + atan((t - 1) / (t + 1)) keeps the polynomial's argument below tan(pi/8).
    let (offset, t) = if near > 0.414_213_57 * far { (0.125, (near - far) / (near + far)) } else { (0.0, near / far) };
    let z = t * t;
    let atan = (((8.053_744_5e-2 * z - 1.387_768_6e-1) * z + 1.997_771_1e-1) * z - 3.333_295e-1) * z * t + t;
    let eighth = offset + atan * (0.5 / std::f32::consts::PI);
    let quarter = if y.abs() > x.abs() { 0.25 - eighth } else { eighth };
    let half = if x < 0.0 { 0.5 - quarter } else { quarter };
    let turn = if y < 0.0 { 1.0 - half } else { half };
    if turn < 1.0 { turn.max(0.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_f64() {
        for i in 0..=(1 << 20) {
            let turn = i as f32 / (1 << 20) as f32;
            let (sin, cos) = sin_cos_turn(turn);
            let (s, c) = (f64::from(turn) * std::f64::consts::TAU).sin_cos();
            assert!((f64::from(sin) - s).abs() < 2e-7 && (f64::from(cos) - c).abs() < 2e-7, "{turn}: {sin} {cos}");
            let back = f64::from(turn_of(sin, cos)) - f64::from(turn);
            assert!((back - back.round()).abs() < 1e-7, "{turn}: off by {back}");
        }
    }

    #[test]
    fn axes_are_exact() {
        let axes = [0.0, 0.25, 0.5, -0.25].map(sin_cos_turn);
        assert_eq!(axes, [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)]);
        let nan = f32::NAN;
        for (y, x, turn) in [(0.0, 0.0, 0.0), (-0.0, 1.0, 0.0), (1.0, 0.0, 0.25), (-1e-30, 1.0, 0.0), (0.0, -1.0, 0.5)]
        {
            assert_eq!(turn_of(y, x), turn, "{y} {x}");
        }
        assert_eq!(turn_of(nan, nan), 0.0);
    }
}
