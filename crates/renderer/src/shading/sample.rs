//! Samples of BSDFs, and the weights of multiple importance sampling.

use glam::Vec3;

/// A direction sampled from a [`Bsdf`](super::Bsdf).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The sampled direction towards the light, in the shading frame. For transmission, its z has the opposite sign of
    /// `wo`'s.
    pub wi: Vec3,
    /// The factor `f |cos| / pdf` by which the path's throughput is multiplied.
    pub weight: Vec3,
    /// The solid-angle density of `wi`, equal to [`Bsdf::pdf`](super::Bsdf::pdf). For a specular sample, the probability of choosing its
    /// lobe.
    pub pdf: f32,
    /// True if the lobe has no direction but `wi`. [`Bsdf::evaluate`](super::Bsdf::evaluate) and [`Bsdf::pdf`](super::Bsdf::pdf) do not include such a lobe,
    /// and light sampling cannot find it.
    pub specular: bool,
    /// The index of refraction on the side of `wi` relative to the side of `wo`; 1 except for refraction. `weight`
    /// includes a division by `eta^2`, which is undone when the path leaves the glass. Russian roulette should
    /// therefore multiply the throughput by the product of `eta^2` along the path [Pharr et al. 2023, sec. 14.2.3].
    pub eta: f32,
}

/// Returns `w` mirrored about the unit vector `m`.
#[inline]
pub(super) fn mirror(w: Vec3, m: Vec3) -> Vec3 {
    2.0 * w.dot(m) * m - w
}

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
