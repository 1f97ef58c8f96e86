//! Homogeneous media that absorb and scatter.

// `!(x > 0.0)` is meant: NaN is rejected, too.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod exponential;
mod phase;

pub use phase::{HenyeyGreenstein, PhaseSample};

use dapple_scene as scene;
use exponential::{depth_of, exp};
use glam::Vec3;

/// A medium that cannot be made.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MediumError {
    /// A coefficient is negative or not finite.
    #[error("{at}: the {what} {value:?} of medium \"{name}\" is invalid; give finite numbers of at least 0")]
    Coefficient {
        /// The line of the scene file that defines the medium.
        at: scene::Source,
        /// The name of the medium.
        name: String,
        /// The name of the coefficient.
        what: &'static str,
        /// The value.
        value: [f32; 3],
    },
    /// A coefficient overflows single precision at the scene's size.
    #[error("{at}: medium \"{name}\" is too dense for a scene of this size; give smaller coefficients")]
    Beyond {
        /// The line of the scene file that defines the medium.
        at: scene::Source,
        /// The name of the medium.
        name: String,
    },
    /// The phase function's asymmetry is out of range.
    #[error("{at}: the asymmetry g = {g} of medium \"{name}\" is invalid; give a number above -1 and below 1")]
    Asymmetry {
        /// The line of the scene file that defines the medium.
        at: scene::Source,
        /// The name of the medium.
        name: String,
        /// The value.
        g: f32,
    },
}

/// The media of a scene, in the renderer's units of length.
#[derive(Clone, Debug, Default)]
pub struct Media {
    media: Vec<Medium>,
}

/// A homogeneous medium.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    /// Extinction coefficient (absorption plus scattering) per unit of length.
    extinction: Vec3,
    scattering: Vec3,
    scatters: bool,
    phase: HenyeyGreenstein,
}

/// The event at which a ray's passage through a medium ends. The path's throughput is multiplied by the weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MediumEvent {
    /// The light is scattered.
    Scatter {
        /// The distance from the ray's origin to the event, below the limit.
        t: f32,
        /// Scattering coefficient times transmittance, over the density of `t`.
        weight: Vec3,
    },
    /// The light reaches the limit without scattering.
    Pass {
        /// Transmittance over the probability of reaching the limit.
        weight: Vec3,
    },
}

impl Media {
    /// Makes the media of a scene. Lengths are multiplied by `scale` ([`Space::scale`](crate::Space::scale)).
    ///
    /// # Errors
    ///
    /// Every medium with a coefficient that is negative, not finite or beyond single precision, or with an asymmetry
    /// outside -1 to 1.
    pub fn new(media: &[scene::Medium], scale: f64) -> Result<Self, Vec<MediumError>> {
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

    /// Returns true if any medium scatters.
    pub fn scatter(&self) -> bool {
        self.media.iter().any(|m| m.scatters)
    }

    /// Returns the medium with this index, as counted by [`scene::MediumId`].
    ///
    /// # Panics
    ///
    /// If there is no such medium.
    #[inline]
    pub fn medium(&self, number: u32) -> &Medium {
        &self.media[number as usize]
    }
}

impl Medium {
    fn new(medium: &scene::Medium, scale: f64) -> Result<Self, MediumError> {
        let (at, name) = (&medium.source, &medium.name);
        for (what, value) in [("absorption", medium.absorption), ("scattering", medium.scattering)] {
            if value.iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
                return Err(MediumError::Coefficient { at: at.clone(), name: name.clone(), what, value });
            }
        }
        let g = medium.g;
        if !(-1.0 < g && g < 1.0) {
            return Err(MediumError::Asymmetry { at: at.clone(), name: name.clone(), g });
        }
        // Per unit of length: coefficients are divided by the scale of lengths.
        let [absorption, scattering] =
            [medium.absorption, medium.scattering].map(|c| Vec3::from_array(c).as_dvec3() / scale);
        let (extinction, scattering) = ((absorption + scattering).as_vec3(), scattering.as_vec3());
        if !extinction.is_finite() {
            return Err(MediumError::Beyond { at: at.clone(), name: name.clone() });
        }
        let scatters = scattering != Vec3::ZERO;
        Ok(Self { extinction, scattering, scatters, phase: HenyeyGreenstein::new(g) })
    }

    /// Returns true if the medium scatters.
    ///
    /// Otherwise light passes with [`transmittance`](Self::transmittance) as its weight, without a random number.
    #[inline]
    pub fn scatters(&self) -> bool {
        self.scatters
    }

    /// The phase function.
    #[inline]
    pub fn phase(&self) -> &HenyeyGreenstein {
        &self.phase
    }

    /// Returns the share of light that crosses `distance` (0 to infinity), per channel: `exp(-extinction distance)`
    /// [Beer 1852, Bouguer 1729].
    #[inline]
    pub fn transmittance(&self, distance: f32) -> Vec3 {
        // No extinction: the product with an infinite distance would be NaN.
        let through = |extinction: f32| if extinction > 0.0 { exp(-extinction * distance) } else { 1.0 };
        let Vec3 { x, y, z } = self.extinction;
        if x == y && y == z {
            return Vec3::splat(through(x));
        }
        Vec3::new(through(x), through(y), through(z))
    }

    /// Samples the distance that light travels in a scattering medium, up to `limit` (above 0, possibly infinite).
    ///
    /// Distances follow the extinction of one channel, selected by `u_channel` in proportion to the path's
    /// `throughput`; `u_distance` samples the distance. All channels then share the sample by the balance heuristic
    /// [Veach 1997, sec. 9.2.2; after Wilkie et al. 2014], whose density is the channels' mean. No channel of the
    /// product of weight and throughput exceeds the throughput's sum (and 0.2 %); in a gray medium the weight is the
    /// albedo, or 1.
    #[inline]
    pub fn sample(&self, limit: f32, u_channel: f32, u_distance: f32, throughput: Vec3) -> MediumEvent {
        let share = shares(throughput);
        let channel = usize::from(u_channel >= share.x) + usize::from(u_channel >= share.x + share.y);
        // Infinite in a channel without extinction.
        let t = depth_of(u_distance) / self.extinction[channel.min(2)];
        if !(t < limit) {
            return MediumEvent::Pass { weight: self.balance(share, limit, Vec3::ONE, Vec3::ONE) };
        }
        MediumEvent::Scatter { t, weight: self.balance(share, t, self.scattering, self.extinction) }
    }

    /// Returns `value T / sum(share density T)` per channel, `T` being the transmittance to `t`; 0 where `value` is 0.
    #[inline]
    fn balance(&self, share: Vec3, t: f32, value: Vec3, density: Vec3) -> Vec3 {
        let Vec3 { x, y, z } = self.extinction;
        if x == y && y == z {
            // T cancels, and with it all that may vanish. The shares' sum rounds.
            return value / density.x;
        }
        let of = |k: usize| {
            if !(value[k] > 0.0) {
                return 0.0;
            }
            // By ratios to the channel itself, whose term stays: nothing over nothing cannot come up, and a sum that
            // overflows is a weight that vanishes.
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

/// Smallest share of a channel relative to the largest, so that weights of nearly dark channels do not overflow.
const LEAST_SHARE: f32 = 1.0 / 1024.0;

/// Returns the probabilities with which the channels are selected.
#[inline]
fn shares(throughput: Vec3) -> Vec3 {
    let largest = throughput.max_element();
    if !(largest > 0.0 && largest < f32::INFINITY) {
        return Vec3::splat(1.0 / 3.0);
    }
    // Relative first: sums of throughputs might overflow.
    let relative = (throughput / largest).max(Vec3::splat(LEAST_SHARE));
    relative / relative.element_sum()
}
