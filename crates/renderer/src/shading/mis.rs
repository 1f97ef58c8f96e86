//! Multiple importance sampling.

/// Weight of a sample from the strategy with density `pdf` against another with density `other`, by the
/// power heuristic with exponent 2 [Veach 1997, sec. 9.2.4]; each strategy takes one sample.
///
/// In `[0, 1]` for any two non-negative densities, and `power_heuristic(a, b) + power_heuristic(b, a)` is 1
/// within rounding unless both are 0. Ratios are squared, never densities, so nothing overflows. Two
/// infinite densities share equally; a density of 0 has weight 0, and so has one that is not a number.
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    if !(pdf > 0.0) {
        return 0.0;
    }
    if !(other > 0.0) {
        return 1.0;
    }
    let ratio = if pdf == other { 1.0 } else { other / pdf };
    1.0 / (1.0 + ratio * ratio)
}

/// [`power_heuristic`] over `pdf`, with one division less; `pdf` must be above 0.
#[inline]
pub(crate) fn power_heuristic_over_pdf(pdf: f32, other: f32) -> f32 {
    let ratio = other / pdf;
    // An infinite ratio gives 0, and so does an infinite density.
    1.0 / (pdf + pdf * ratio * ratio)
}
