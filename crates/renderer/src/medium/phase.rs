//! Phase functions: the distribution of directions after scattering in a medium.

use crate::shading::ShadingFrame;
use crate::shading::trigonometry::sin_cos_turn;
use glam::Vec3;
use std::f32::consts::PI;

/// The phase function of [Henyey and Greenstein 1941]: `(1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2))`. The cosine is
/// between the directions of travel before and after scattering.
///
/// A `g` above 0 means forward scattering. Values and samples are computed from `1 - cos` rather than from the cosine.
/// No digits are then lost if g is near 0 (nothing is divided by g) or near 1 or -1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HenyeyGreenstein {
    /// The absolute value of the asymmetry, in `[0, 1)`.
    g: f32,
    /// The sign of the asymmetry: 1 for forward scattering, -1 for backward scattering.
    side: f32,
}

/// A direction sampled from a phase function. The density equals the function's value, so the sample has weight 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseSample {
    /// The unit direction of travel after scattering.
    pub wi: Vec3,
    /// The solid-angle density, equal to the phase function's value.
    pub pdf: f32,
}

impl HenyeyGreenstein {
    /// Makes the phase function with mean cosine (asymmetry) `g`, clamped to the open interval from -1 to 1.
    pub fn new(g: f32) -> Self {
        let largest = 1.0_f32.next_down();
        Self { g: g.abs().min(largest), side: 1.0_f32.copysign(g) }
    }

    /// Returns the mean cosine between the directions of travel before and after scattering.
    pub fn g(&self) -> f32 {
        self.g * self.side
    }

    /// Returns the phase function per steradian for scattering from the unit direction of travel `travel` into the
    /// unit direction `wi`. It is also the density with which [`sample`](Self::sample) samples `wi`.
    #[inline]
    pub fn evaluate(&self, travel: Vec3, wi: Vec3) -> f32 {
        // 1 - cos of the angle to the lobe's axis, computed from the chord.
        self.at(0.5 * (wi - travel * self.side).length_squared())
    }

    /// Returns the phase function at the angle from the lobe's axis whose `1 - cos` is `height`.
    #[inline]
    fn at(&self, height: f32) -> f32 {
        let g = self.g;
        let below = 1.0 - g;
        // 1 + g^2 - 2 g cos.
        let squared = below * below + 2.0 * g * height;
        below * (1.0 + g) / (4.0 * PI * squared * squared.sqrt())
    }

    /// Samples the direction of travel after scattering by `u` in `[0, 1)^2`. `travel` is the unit direction of travel
    /// before.
    #[inline]
    pub fn sample(&self, travel: Vec3, u: [f32; 2]) -> PhaseSample {
        let g = self.g;
        // The inverse of the cumulative distribution [Pharr et al. 2023, eq. 11.22], solved for 1 - cos: with d = 1 +
        // g - 2 g u, 1 - cos = 2 (1 - g)^2 u (1 + g - g u) / d^2.
        let divisor = (1.0 - g) + 2.0 * g * (1.0 - u[0]);
        let share = (1.0 - g) / divisor;
        let height = (2.0 * share * share * u[0] * (1.0 + g * (1.0 - u[0]))).clamp(0.0, 2.0);
        let across = (height * (2.0 - height)).sqrt();
        let (sin, cos) = sin_cos_turn(u[1]);
        let frame = ShadingFrame::from_normal(travel * self.side);
        let wi = frame.to_world(Vec3::new(across * cos, across * sin, 1.0 - height)).normalize();
        PhaseSample { wi, pdf: self.at(height) }
    }
}
