//! What a surface does with light at one point.

use super::Frame;
use super::coat::Coat;
use super::fresnel::ComplexIor;
use super::microfacet::{TrowbridgeReitz, half_angle_cosine};
use super::warp;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI};

/// The scattering of one surface point, with its textures already looked up.
///
/// A small `Copy` value, made afresh at each hit; what depends on the material alone is computed when the
/// material is made. Opaque surfaces scatter on both sides: a `wo` below the surface is mirrored through
/// the point, as pbrt-v4 does, and no light passes from one side to the other.
///
/// All directions are unit vectors in the shading frame, pointing away from the surface. The caller sees to
/// light leaking through the *geometric* surface where the shading normal differs.
#[derive(Clone, Copy, Debug)]
pub enum Bsdf<'m> {
    /// Lambert's reflection.
    Diffuse {
        /// Share of light reflected, per channel.
        reflectance: Vec3,
    },
    /// A rough metal.
    Conductor {
        /// Its Fresnel term.
        ior: ComplexIor,
        /// Its microfacets.
        microfacets: TrowbridgeReitz,
    },
    /// A mirror of metal.
    SmoothConductor {
        /// Its Fresnel term.
        ior: ComplexIor,
    },
    /// A dielectric coat, rough or smooth, over Lambert's reflection; made by [`Bsdf::coated_diffuse`].
    CoatedDiffuse {
        /// The coat.
        coat: &'m Coat,
        /// The base's `f`, all its reflections from below the coat included, but for the two passes
        /// through the coat.
        base: Vec3,
    },
}

/// A direction drawn from a [`Bsdf`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Where the light comes from, shading frame.
    pub wi: Vec3,
    /// `f |cos| / pdf`: what the path's throughput is multiplied by.
    pub weight: Vec3,
    /// Solid-angle density of `wi`, the same as [`Bsdf::pdf`]; for a specular sample the probability of its
    /// lobe.
    pub pdf: f32,
    /// Whether `wi` is the only direction its lobe can give, so that [`Bsdf::evaluate`] and [`Bsdf::pdf`]
    /// know nothing of it and light sampling cannot meet it.
    pub specular: bool,
}

impl<'m> Bsdf<'m> {
    /// The metal with these widths: rough, or smooth where
    /// [`TrowbridgeReitz::effectively_smooth`] says so.
    ///
    /// # Errors
    ///
    /// As [`TrowbridgeReitz::new`].
    pub fn conductor(ior: ComplexIor, alpha: [f32; 2]) -> Result<Self, super::Error> {
        let microfacets = TrowbridgeReitz::new(alpha)?;
        Ok(if TrowbridgeReitz::effectively_smooth(alpha) {
            Self::SmoothConductor { ior }
        } else {
            Self::Conductor { ior, microfacets }
        })
    }

    /// A coat over a diffuse base of this reflectance, clamped to `[0, 1]`.
    #[inline]
    pub fn coated_diffuse(coat: &'m Coat, reflectance: Vec3) -> Self {
        Self::CoatedDiffuse { coat, base: coat.base(reflectance.clamp(Vec3::ZERO, Vec3::ONE)) }
    }

    /// A world-space direction in the shading frame, as far as this scattering looks at it: of Lambert's only the
    /// cosine is filled in, the rest is 0.
    #[inline(always)]
    pub(crate) fn local(&self, frame: &Frame, v: Vec3) -> Vec3 {
        match self {
            Self::Diffuse { .. } => Vec3::new(0.0, 0.0, v.dot(frame.normal)),
            _ => frame.to_local(v),
        }
    }

    /// `f(wo, wi)` per steradian, without the cosine. 0 for specular lobes and for directions on different
    /// sides.
    #[inline]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        self.evaluate_and_pdf(wo, wi).0
    }

    /// Solid-angle density with which [`sample`](Self::sample) draws `wi`. 0 for specular lobes and for
    /// directions on different sides.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.evaluate_and_pdf(wo, wi).1
    }

    /// [`evaluate`](Self::evaluate) and [`pdf`](Self::pdf), their common work done once.
    #[inline(always)]
    pub fn evaluate_and_pdf(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        if let Self::Diffuse { reflectance } = self {
            // The most common, inlined: the same numbers as `evaluate_above`.
            let same_side = (wo.z > 0.0 && wi.z > 0.0) || (wo.z < 0.0 && wi.z < 0.0);
            return if same_side { (*reflectance * FRAC_1_PI, wi.z.abs() * FRAC_1_PI) } else { (Vec3::ZERO, 0.0) };
        }
        match to_upper_side(wo, wi) {
            Some((wo, wi)) => self.evaluate_above(wo, wi),
            None => (Vec3::ZERO, 0.0),
        }
    }

    /// Draws `wi` with density [`pdf`](Self::pdf): `lobe` in `[0, 1)` chooses the lobe, `u` in `[0, 1)^2`
    /// the direction in it. `None` where nothing is scattered: the sample counts, and is black.
    #[inline(always)]
    pub fn sample(&self, wo: Vec3, u: [f32; 2], lobe: f32) -> Option<BsdfSample> {
        let side = if wo.z > 0.0 { 1.0 } else { -1.0 };
        let wo = side * wo;
        if !(wo.z > 0.0) {
            return None;
        }
        let wi = match self {
            Self::Diffuse { reflectance } => {
                // The cosine cancels: nothing to divide.
                let wi = warp::cosine_hemisphere(u);
                return Some(BsdfSample {
                    wi: side * wi,
                    weight: *reflectance,
                    pdf: wi.z * FRAC_1_PI,
                    specular: false,
                });
            }
            Self::Conductor { microfacets, .. } => mirror(wo, microfacets.sample_visible(wo, u)),
            Self::SmoothConductor { ior } => {
                let wi = side * Vec3::new(-wo.x, -wo.y, wo.z);
                return Some(BsdfSample { wi, weight: ior.reflectance(wo.z), pdf: 1.0, specular: true });
            }
            Self::CoatedDiffuse { coat, base } => {
                let [transmittance, reflectance] = coat.transmittance_and_reflectance(wo.z);
                let chance = coat_chance(coat, *base, transmittance, reflectance);
                match coat.microfacets() {
                    _ if lobe >= chance => warp::cosine_hemisphere(u),
                    Some(microfacets) => mirror(wo, microfacets.sample_visible(wo, u)),
                    None => {
                        let wi = side * Vec3::new(-wo.x, -wo.y, wo.z);
                        let weight = Vec3::splat(coat.fresnel(wo.z) / chance);
                        return Some(BsdfSample { wi, weight, pdf: chance, specular: true });
                    }
                }
            }
        };
        if !(wi.z > 0.0) {
            return None;
        }
        let (f, pdf) = self.evaluate_above(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi: side * wi, weight: f * (wi.z / pdf), pdf, specular: false })
    }

    /// Whether every lobe is specular, so that light sampling is useless.
    #[inline]
    pub fn is_specular(&self) -> bool {
        matches!(self, Self::SmoothConductor { .. })
    }

    /// About the share of light reflected, per channel: a feature for filters, not for transport.
    pub fn albedo(&self) -> Vec3 {
        match self {
            Self::Diffuse { reflectance } => *reflectance,
            Self::Conductor { ior, .. } | Self::SmoothConductor { ior } => ior.reflectance(1.0),
            Self::CoatedDiffuse { coat, base } => {
                let [transmittance, reflectance] = coat.transmittance_and_reflectance(1.0);
                *base * (PI * transmittance * coat.average_transmittance()) + reflectance
            }
        }
    }

    /// Width of the widest lobe, 0 for a mirror and 1 for Lambert's: a feature, not for transport.
    pub fn roughness(&self) -> f32 {
        match self {
            Self::Diffuse { .. } | Self::CoatedDiffuse { .. } => 1.0,
            Self::Conductor { microfacets, .. } => {
                let [ax, ay] = microfacets.alpha();
                (ax * ay).sqrt()
            }
            Self::SmoothConductor { .. } => 0.0,
        }
    }

    /// `f` and density for two directions with positive z.
    #[inline]
    fn evaluate_above(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        match self {
            Self::Diffuse { reflectance } => (*reflectance * FRAC_1_PI, wi.z * FRAC_1_PI),
            Self::Conductor { ior, microfacets } => {
                let h = wo + wi;
                let f = ior.reflectance(half_angle_cosine(h)) * microfacets.reflection(wo, wi, h);
                (f, microfacets.reflection_pdf(wo, h))
            }
            Self::SmoothConductor { .. } => (Vec3::ZERO, 0.0),
            Self::CoatedDiffuse { coat, base } => {
                let [to, reflectance] = coat.transmittance_and_reflectance(wo.z);
                let [ti, _] = coat.transmittance_and_reflectance(wi.z);
                let chance = coat_chance(coat, *base, to, reflectance);
                let (f, pdf) = (*base * (to * ti), (1.0 - chance) * (wi.z * FRAC_1_PI));
                match coat.microfacets() {
                    Some(microfacets) => {
                        let h = wo + wi;
                        let coated = coat.fresnel(half_angle_cosine(h)) * microfacets.reflection(wo, wi, h);
                        (f + coated, pdf + chance * microfacets.reflection_pdf(wo, h))
                    }
                    None => (f, pdf),
                }
            }
        }
    }
}

/// Probability of sampling the coat's lobe rather than the base's: its share of the light reflected from
/// `wo`, whose transmittance and reflectance these are.
#[inline]
fn coat_chance(coat: &Coat, base: Vec3, transmittance: f32, reflectance: f32) -> f32 {
    let below = base.element_sum() / 3.0 * (PI * transmittance * coat.average_transmittance());
    let sum = reflectance + below;
    // Neither reflects: an index of 1 over a black base. Sample the base, which gives black.
    if sum > 0.0 { reflectance / sum } else { 0.0 }
}

/// Both directions on the side `z > 0`; `None` where they lie on different sides, along the surface, or are
/// not numbers.
#[inline]
fn to_upper_side(wo: Vec3, wi: Vec3) -> Option<(Vec3, Vec3)> {
    if wo.z > 0.0 && wi.z > 0.0 {
        Some((wo, wi))
    } else if wo.z < 0.0 && wi.z < 0.0 {
        Some((-wo, -wi))
    } else {
        None
    }
}

/// The mirror direction of `w` about the unit vector `m`.
#[inline]
fn mirror(w: Vec3, m: Vec3) -> Vec3 {
    2.0 * w.dot(m) * m - w
}
