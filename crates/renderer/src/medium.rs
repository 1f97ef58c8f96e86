//! Homogeneous media that absorb and scatter light.

// `!(x > 0.0)` is intended: it rejects NaN too.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use crate::SceneError;
use crate::shading::ShadingFrame;
use crate::shading::trigonometry::sin_cos_turn;
use dapple_scene as scene;
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

/// The event at which sampling of a ray in a medium ends. The path's throughput must be multiplied by the event's weight.
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

    /// Returns the medium with index `number`, as held by [`scene::MediumId`].
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
                let remedy = "use finite numbers of at least 0";
                return wrong(format!("the {what} {value:?} of medium \"{name}\" is invalid; {remedy}"));
            }
        }
        let g = medium.g;
        if !(-1.0 < g && g < 1.0) {
            let remedy = "use a number above -1 and below 1";
            return wrong(format!("the asymmetry g = {g} of medium \"{name}\" is invalid; {remedy}"));
        }
        // Coefficients are per unit of length, so they are divided by the scale of lengths.
        let [absorption, scattering] =
            [medium.absorption, medium.scattering].map(|c| Vec3::from_array(c).as_dvec3() / scale);
        let (extinction, scattering) = ((absorption + scattering).as_vec3(), scattering.as_vec3());
        if !extinction.is_finite() {
            let remedy = "use smaller coefficients";
            return wrong(format!("medium \"{name}\" is too dense for a scene of this size; {remedy}"));
        }
        let scatters = scattering != Vec3::ZERO;
        Ok(Self { extinction, scattering, scatters, phase: HenyeyGreenstein::new(g) })
    }

    /// Returns true if the scattering coefficient is above 0 in some channel.
    ///
    /// A medium that does not scatter needs no sampling: a path is weighted by the [`transmittance`](Self::transmittance).
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
    /// `u_channel` selects a channel in proportion to the path's `throughput`, and `u_distance` samples a distance by this
    /// channel's extinction. The event's weight uses the balance heuristic over the channels [Veach 1997, sec. 9.2.2; after
    /// Wilkie et al. 2014]. In each channel, `weight * throughput` is at most 1.002 times the sum of `throughput` over all
    /// channels. In a gray medium, the weight is the albedo for [`MediumEvent::Scatter`] and 1 for [`MediumEvent::Pass`].
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
            // T cancels, so nothing can underflow. The sum of the shares is assumed to be 1.
            return value / density.x;
        }
        let of = |k: usize| {
            if !(value[k] > 0.0) {
                return 0.0;
            }
            // Transmittances are divided by the channel's transmittance, so that its term in the sum is at least its share.
            // This avoids 0/0; if the sum overflows, the weight is 0.
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

/// The phase function of [Henyey and Greenstein 1941]: `(1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2))`, with the cosine between
/// the directions of travel before and after scattering.
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

    /// Returns the phase function per steradian for a path that travels along `travel` and scatters into `wi`, both unit
    /// vectors. It is also the density with which [`sample`](Self::sample) samples `wi`.
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

    /// Samples the direction of travel after scattering. `travel` is the unit direction of travel before scattering, and `u`
    /// are random numbers in `[0, 1)^2`.
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

/// Returns `exp(x)` with a relative error below 2e-7. The result is 0 below -87.3 (near the end of `f32`'s range) and
/// infinity above 88.7.
#[inline]
fn exp(x: f32) -> f32 {
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
fn depth_of(u: f32) -> f32 {
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
            // Below 2^-30, 1 - u loses precision in f32. Point sets return no such number except 0.
            assert!((found - exact).abs() <= 2e-7 * exact.abs() + 1e-16, "{u}: {found} {exact}");
        }
        assert_eq!(depth_of(0.0), 0.0);
    }
}
