//! Weights for multiple importance sampling.

/// Returns the weight of a sample by the power heuristic with exponent 2 [Veach 1997, sec. 9.2.4]. `pdf` is the
/// density of the strategy that generated the sample, and `other` the density of another strategy. Each strategy takes
/// one sample.
///
/// The result is in `[0, 1]` for non-negative densities. `power_heuristic(a, b) + power_heuristic(b, a)` is 1 within
/// rounding, unless both are 0. The ratio is squared, not the densities, so nothing overflows. Two infinite densities
/// give 0.5; a `pdf` of 0 or NaN gives 0.
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

/// Returns [`power_heuristic`] divided by `pdf`, with one division less. `pdf` must be finite and above 0.
#[inline]
pub(crate) fn power_heuristic_over_pdf(pdf: f32, other: f32) -> f32 {
    let ratio = other / pdf;
    // If the square of the ratio overflows, the result is 0.
    1.0 / (pdf + pdf * ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_division_less_changes_nothing_but_the_last_digits() {
        // Where the longer form's squares neither over- nor underflow.
        let densities = (-30..=30).step_by(3).map(|e| 2_f32.powi(e) * 1.37);
        for pdf in densities.clone() {
            for other in densities.clone().chain([0.0, pdf]) {
                let (short, long) = (power_heuristic_over_pdf(pdf, other), power_heuristic(pdf, other) / pdf);
                assert!(
                    (short - long).abs() <= long * 1e-6 || short.max(long) < 1e-30,
                    "{pdf} {other}: {short} {long}"
                );
            }
        }
    }
}
