//! Homogeneous media that absorb and scatter light.

// `!(x > 0.0)` is intended: it rejects NaN too.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod exponential;

use crate::SceneError;
use crate::shading::ShadingFrame;
use crate::shading::trigonometry::sin_cos_turn;
use dapple_scene as scene;
use exponential::{depth_of, exp};
use glam::Vec3;
use std::f32::consts::PI;

/// All media of a scene, with coefficients in the renderer's units of length.
#[derive(Clone, Debug, Default)]
pub struct Media {
    media: Vec<Medium>,
}

/// A homogeneous medium: absorption, scattering and phase function are the same everywhere.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    /// The extinction coefficient (absorption plus scattering) per channel and unit of length.
    extinction: Vec3,
    scattering: Vec3,
    scatters: bool,
    phase: HenyeyGreenstein,
}

/// The event that ends a ray's segment in a medium. The path's throughput must be multiplied by its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MediumEvent {
    /// The light is scattered before it reaches the limit.
    Scatter {
        /// The distance from the ray's origin to the scattering event, below the limit.
        t: f32,
        /// The scattering coefficient times the transmittance, divided by the density of `t`.
        weight: Vec3,
    },
    /// The light reaches the limit without being scattered.
    Pass {
        /// The transmittance divided by the probability of reaching the limit.
        weight: Vec3,
    },
}

impl Media {
    /// Prepares the media of a scene. `scale` is the factor from the scene's lengths to the renderer's
    /// ([`Space::scale`](crate::Space::scale)).
    ///
    /// # Errors
    ///
    /// One [`SceneError`] for each medium whose coefficients are negative, not finite or beyond single precision, or
    /// whose asymmetry is not above -1 and below 1.
    pub fn new(media: &[scene::Medium], scale: f64) -> Result<Self, Vec<SceneError>> {
        let (mut made, mut errors) = (Vec::with_capacity(media.len()), Vec::new());
        for medium in media {
            match Medium::new(medium, scale) {
                Ok(medium) => made.push(medium),
                Err(e) => errors.push(e),
            }
        }
        if errors.is_empty() { Ok(Self { media: made }) } else { Err(errors) }
    }

    /// Returns the number of media.
    pub fn len(&self) -> usize {
        self.media.len()
    }

    /// Returns true if there are no media.
    pub fn is_empty(&self) -> bool {
        self.media.is_empty()
    }

    /// Returns true if at least one medium scatters.
    pub fn scatter(&self) -> bool {
        self.media.iter().any(|m| m.scatters)
    }

    /// Returns the medium with this index, which [`scene::MediumId`] holds.
    ///
    /// # Panics
    ///
    /// Panics if `number` is not below [`len`](Self::len).
    #[inline]
    pub fn medium(&self, number: u32) -> &Medium {
        &self.media[number as usize]
    }
}

impl Medium {
    fn new(medium: &scene::Medium, scale: f64) -> Result<Self, SceneError> {
        let name = &medium.name;
        let wrong = |what: String| Err(SceneError::new(&medium.source, what));
        for (what, value) in [("absorption", medium.absorption), ("scattering", medium.scattering)] {
            if value.iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
                let remedy = "give finite numbers of at least 0";
                return wrong(format!("the {what} {value:?} of medium \"{name}\" is invalid; {remedy}"));
            }
        }
        let g = medium.g;
        if !(-1.0 < g && g < 1.0) {
            let remedy = "give a number above -1 and below 1";
            return wrong(format!("the asymmetry g = {g} of medium \"{name}\" is invalid; {remedy}"));
        }
        // Coefficients are per unit of length, so they are divided by the scale of lengths.
        let [absorption, scattering] =
            [medium.absorption, medium.scattering].map(|c| Vec3::from_array(c).as_dvec3() / scale);
        let (extinction, scattering) = ((absorption + scattering).as_vec3(), scattering.as_vec3());
        if !extinction.is_finite() {
            let remedy = "give smaller coefficients";
            return wrong(format!("medium \"{name}\" is too dense for a scene of this size; {remedy}"));
        }
        let scatters = scattering != Vec3::ZERO;
        Ok(Self { extinction, scattering, scatters, phase: HenyeyGreenstein::new(g) })
    }

    /// Returns true if the scattering coefficient is above 0 in some channel.
    ///
    /// A medium that does not scatter needs no sampling: its weight is the [`transmittance`](Self::transmittance).
    #[inline]
    pub fn scatters(&self) -> bool {
        self.scatters
    }

    /// Returns the medium's phase function.
    #[inline]
    pub fn phase(&self) -> &HenyeyGreenstein {
        &self.phase
    }

    /// Returns the fraction of light that crosses `distance` (0 to infinity) without being absorbed or scattered, per
    /// channel: `exp(-extinction distance)` [Beer 1852, Bouguer 1729].
    #[inline]
    pub fn transmittance(&self, distance: f32) -> Vec3 {
        // Without extinction, the product with an infinite distance would be NaN.
        let through = |extinction: f32| if extinction > 0.0 { exp(-extinction * distance) } else { 1.0 };
        let Vec3 { x, y, z } = self.extinction;
        if x == y && y == z {
            return Vec3::splat(through(x));
        }
        Vec3::new(through(x), through(y), through(z))
    }

    /// Samples the distance that light travels in a scattering medium, up to `limit` (above 0, may be infinite).
    ///
    /// `u_channel` selects a channel in proportion to the path's `throughput`, and `u_distance` samples a distance by
    /// that channel's extinction. The weight of the sample uses the balance heuristic over the channels [Veach 1997,
    /// sec. 9.2.2; after Wilkie et al. 2014], whose density is the channels' weighted mean. No channel of the product
    /// of weight and throughput exceeds the sum of the throughput by more than 0.2 %. In a gray medium, the weight is
    /// the albedo or 1.
    #[inline]
    pub fn sample(&self, limit: f32, u_channel: f32, u_distance: f32, throughput: Vec3) -> MediumEvent {
        let share = shares(throughput);
        let channel = usize::from(u_channel >= share.x) + usize::from(u_channel >= share.x + share.y);
        // The distance is infinite if the channel has no extinction.
        let t = depth_of(u_distance) / self.extinction[channel.min(2)];
        if !(t < limit) {
            return MediumEvent::Pass { weight: self.balance(share, limit, Vec3::ONE, Vec3::ONE) };
        }
        MediumEvent::Scatter { t, weight: self.balance(share, t, self.scattering, self.extinction) }
    }

    /// Returns `value T / sum(share density T)` per channel, with the transmittance `T` to `t`; 0 in channels where
    /// `value` is 0.
    #[inline]
    fn balance(&self, share: Vec3, t: f32, value: Vec3, density: Vec3) -> Vec3 {
        let Vec3 { x, y, z } = self.extinction;
        if x == y && y == z {
            // T cancels, so nothing can underflow. The sum of the shares is taken as 1.
            return value / density.x;
        }
        let of = |k: usize| {
            if !(value[k] > 0.0) {
                return 0.0;
            }
            // Transmittances are divided by the channel's own, whose term is then at least its share. This avoids 0/0;
            // a sum that overflows gives weight 0.
            let term = |c: usize| {
                let more = self.extinction[k] - self.extinction[c];
                match share[c] * density[c] {
                    full if more == 0.0 || full == 0.0 => full,
                    full => full * exp(more * t),
                }
            };
            value[k] / (term(0) + term(1) + term(2))
        };
        Vec3::new(of(0), of(1), of(2))
    }
}

/// The smallest selection probability of a channel relative to the largest, so that weights of nearly dark channels do
/// not overflow.
const LEAST_SHARE: f32 = 1.0 / 1024.0;

/// Returns the probabilities with which the color channels are selected, in proportion to a throughput.
#[inline]
fn shares(throughput: Vec3) -> Vec3 {
    let largest = throughput.max_element();
    if !(largest > 0.0 && largest < f32::INFINITY) {
        return Vec3::splat(1.0 / 3.0);
    }
    // Divided by the largest first, since the sum of a throughput might overflow.
    let relative = (throughput / largest).max(Vec3::splat(LEAST_SHARE));
    relative / relative.element_sum()
}

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
