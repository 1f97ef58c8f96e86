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
    /// Asymmetry without its sign, in `[0, 1)`.
    g: f32,
    /// 1 if it scatters forwards, -1 backwards.
    side: f32,
}

/// A direction drawn from a phase function, whose value is its density: the weight is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseSample {
    /// The direction after the event, unit length.
    pub wi: Vec3,
    /// The density in solid angle, and the phase function's value.
    pub pdf: f32,
}

impl HenyeyGreenstein {
    /// The phase function of mean cosine `g`, clamped above -1 and below 1.
    pub fn new(g: f32) -> Self {
        let largest = 1.0_f32.next_down();
        Self { g: g.abs().min(largest), side: 1.0_f32.copysign(g) }
    }

    /// The mean cosine.
    pub fn g(&self) -> f32 {
        self.g * self.side
    }

    /// The value for a path that came along the unit direction `travel` and goes on along `wi`, per steradian: also
    /// the density with which [`sample`](Self::sample) draws `wi`.
    #[inline]
    pub fn evaluate(&self, travel: Vec3, wi: Vec3) -> f32 {
        // 1 - cos of the angle to the lobe's axis, from the chord.
        self.at(0.5 * (wi - travel * self.side).length_squared())
    }

    /// The value where the cosine to the lobe's axis is `1 - height`.
    #[inline]
    fn at(&self, height: f32) -> f32 {
        let g = self.g;
        let below = 1.0 - g;
        // 1 + g^2 - 2 g cos.
        let squared = below * below + 2.0 * g * height;
        below * (1.0 + g) / (4.0 * PI * squared * squared.sqrt())
    }

    /// Draws the direction in which a path goes on that came along the unit direction `travel`.
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
