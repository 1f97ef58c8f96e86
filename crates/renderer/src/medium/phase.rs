//! Phase functions.

use crate::shading::ShadingFrame;
use crate::shading::trigonometry::sin_cos_turn;
use glam::Vec3;
use std::f32::consts::PI;

/// The phase function of [Henyey and Greenstein 1941]:
/// `(1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2))`, the cosine between the directions before and after.
///
/// Forward scattering has g above 0. Values and samples go by `1 - |cos|`-like heights rather than cosines, so that
/// no digits are lost for g near 0 (no division by it) or near 1 and -1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HenyeyGreenstein {
    /// Absolute value of the asymmetry, in `[0, 1)`.
    g: f32,
    /// 1 for forward scattering, -1 for backward.
    side: f32,
}

/// A direction sampled from a phase function. The function's value is the density, so that the weight is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseSample {
    /// Unit direction after the event.
    pub wi: Vec3,
    /// Density in solid angle, equal to the phase function's value.
    pub pdf: f32,
}

impl HenyeyGreenstein {
    /// Makes the phase function with mean cosine `g`, clamped to between -1 and 1.
    pub fn new(g: f32) -> Self {
        let largest = 1.0_f32.next_down();
        Self { g: g.abs().min(largest), side: 1.0_f32.copysign(g) }
    }

    /// Returns the mean cosine.
    pub fn g(&self) -> f32 {
        self.g * self.side
    }

    /// Returns the phase function per steradian for a path from unit direction `travel` into unit direction `wi`. This
    /// is also the density with which [`sample`](Self::sample) draws `wi`.
    #[inline]
    pub fn evaluate(&self, travel: Vec3, wi: Vec3) -> f32 {
        // 1 - cos of the angle to the lobe's axis, from the chord.
        self.at(0.5 * (wi - travel * self.side).length_squared())
    }

    /// Returns the value at a cosine of `1 - height` from the lobe's axis.
    #[inline]
    fn at(&self, height: f32) -> f32 {
        let g = self.g;
        let below = 1.0 - g;
        // 1 + g^2 - 2 g cos.
        let squared = below * below + 2.0 * g * height;
        below * (1.0 + g) / (4.0 * PI * squared * squared.sqrt())
    }

    /// Samples the direction after the event, for a path that travels along the unit direction `travel`.
    #[inline]
    pub fn sample(&self, travel: Vec3, u: [f32; 2]) -> PhaseSample {
        let g = self.g;
        // The inverse of the distribution function [Pharr et al. 2023, eq. 11.22], solved for 1 - cos: with
        // d = 1 + g - 2 g u, 1 - cos = 2 (1 - g)^2 u (1 + g - g u) / d^2.
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
