//! Dielectrics (glass): reflection and refraction at the interface of two transparent media and at a thin pane, and
//! diffuse transmission.
//!
//! The normal +z points out of the glass, so `wo.z > 0` is outside. A `wo` inside is mirrored through the point, with
//! the reciprocal index of refraction. The functions below therefore work with `wo` above the surface; their `eta` is
//! the index below relative to the one above. Transmitted radiance is divided by `eta^2` [Pharr et al. 2023, sec.
//! 9.5.2].

use super::fresnel;
use super::microfacet::{TrowbridgeReitz, half_angle_cosine};
use super::{BsdfSample, mirror};
use glam::Vec3;

/// Color factors of the light that glass reflects and transmits; 1 for physical glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tint {
    /// The factor of reflected light, per channel.
    pub reflectance: Vec3,
    /// The factor of transmitted light, per channel.
    pub transmittance: Vec3,
}

impl Tint {
    /// The tint without effect, with both factors 1.
    pub const WHITE: Self = Self { reflectance: Vec3::ONE, transmittance: Vec3::ONE };

    /// Returns the probability of sampling reflection rather than transmission at a Fresnel reflectance of `reflectance`.
    #[inline]
    fn chance(&self, reflectance: f32) -> f32 {
        // With equal factors, Fresnel's reflectance as the probability gives every sample the same weight.
        if self.reflectance == self.transmittance {
            return reflectance;
        }
        let up = reflectance * self.reflectance.element_sum();
        let down = (1.0 - reflectance) * self.transmittance.element_sum();
        // Black glass scatters nothing, so any probability will do.
        if up + down > 0.0 { up / (up + down) } else { 0.0 }
    }
}

/// A smooth interface of glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothDielectric {
    /// The index of refraction inside relative to the one outside.
    pub eta: f32,
    /// The color factors of reflected and transmitted light.
    pub tint: Tint,
}

impl SmoothDielectric {
    /// Samples a direction as [`Bsdf::sample`](super::Bsdf::sample) does. Reflection and transmission are both
    /// specular.
    #[inline]
    pub(super) fn sample(&self, wo: Vec3, lobe: f32) -> Option<BsdfSample> {
        let (side, eta) = if wo.z > 0.0 { (1.0, self.eta) } else { (-1.0, 1.0 / self.eta) };
        let wo = side * wo;
        let transmitted = fresnel::transmitted_cosine(wo.z, eta);
        let reflectance = transmitted.map_or(1.0, |cos| fresnel::dielectric_between(wo.z, cos, eta));
        let chance = self.tint.chance(reflectance);
        match transmitted {
            Some(cos) if lobe >= chance => {
                let pdf = 1.0 - chance;
                let wi = side * Vec3::new(-wo.x / eta, -wo.y / eta, -cos);
                let weight = self.tint.transmittance * ((1.0 - reflectance) / (pdf * eta * eta));
                Some(BsdfSample { wi, weight, pdf, specular: true, eta })
            }
            _ if chance > 0.0 => {
                let wi = side * Vec3::new(-wo.x, -wo.y, wo.z);
                let weight = self.tint.reflectance * (reflectance / chance);
                Some(BsdfSample { wi, weight, pdf: chance, specular: true, eta: 1.0 })
            }
            _ => None,
        }
    }
}

/// A rough interface of glass [Walter et al. 2007].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughDielectric {
    /// The index of refraction inside relative to the one outside. A value of 1 is invalid; see [`SmoothDielectric`].
    pub eta: f32,
    /// The microfacet distribution of the interface.
    pub microfacets: TrowbridgeReitz,
    /// The color factors of reflected and transmitted light.
    pub tint: Tint,
}

impl RoughDielectric {
    /// Returns `f` and the density as [`Bsdf::evaluate_and_pdf`](super::Bsdf::evaluate_and_pdf) does.
    #[inline]
    pub(super) fn evaluate_and_pdf(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (side, eta) = if wo.z > 0.0 { (1.0, self.eta) } else { (-1.0, 1.0 / self.eta) };
        let (wo, wi) = (side * wo, side * wi);
        if wo.z > 0.0 && wi.z > 0.0 {
            self.reflected(wo, wi, eta)
        } else if wo.z > 0.0 && wi.z < 0.0 {
            self.transmitted(wo, wi, side > 0.0)
        } else {
            (Vec3::ZERO, 0.0)
        }
    }

    /// Samples a direction as [`Bsdf::sample`](super::Bsdf::sample) does.
    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: [f32; 2], lobe: f32) -> Option<BsdfSample> {
        let (side, eta) = if wo.z > 0.0 { (1.0, self.eta) } else { (-1.0, 1.0 / self.eta) };
        let wo = side * wo;
        let m = self.microfacets.sample_visible(wo, u);
        let cos = wo.dot(m);
        let transmitted = fresnel::transmitted_cosine(cos, eta);
        let reflectance = transmitted.map_or(1.0, |cos_t| fresnel::dielectric_between(cos.clamp(0.0, 1.0), cos_t, eta));
        let (wi, (f, pdf), eta) = match transmitted {
            Some(cos_t) if lobe >= self.tint.chance(reflectance) => {
                // Normalised again: if the index is far from 1, the terms exceed 1 and cancel.
                let wi = ((cos / eta - cos_t) * m - wo / eta).normalize();
                if !(wi.z < 0.0) {
                    return None;
                }
                (wi, self.transmitted(wo, wi, side > 0.0), eta)
            }
            _ => {
                let wi = mirror(wo, m);
                if !(wi.z > 0.0) {
                    return None;
                }
                (wi, self.reflected(wo, wi, eta), 1.0)
            }
        };
        (pdf > 0.0).then(|| {
            let weight = f * (wi.z.abs() / pdf);
            BsdfSample { wi: side * wi, weight, pdf, specular: false, eta }
        })
    }

    /// Returns `f` and the density for two directions with positive z.
    #[inline]
    fn reflected(&self, wo: Vec3, wi: Vec3, eta: f32) -> (Vec3, f32) {
        let h = wo + wi;
        let reflectance = fresnel::dielectric(half_angle_cosine(h), eta);
        let f = self.tint.reflectance * (reflectance * self.microfacets.reflection(wo, wi, h));
        (f, self.tint.chance(reflectance) * self.microfacets.reflection_pdf(wo, h))
    }

    /// Returns `f` and the density for `wo` above and `wi` below [Walter et al. 2007, eq. 16, 17 and 21, divided by
    /// `eta^2`]. `outside` is true if `wo` is outside the glass.
    ///
    /// The half vector is `h = a + eta b` for the direction `a` outside and `b` inside, in both directions of travel. The two
    /// values therefore differ only by the factor `eta^2`. The square root of the Jacobian's denominator is `|h|`, and the
    /// cosines of both directions cancel with those in the masking term.
    #[inline]
    fn transmitted(&self, wo: Vec3, wi: Vec3, outside: bool) -> (Vec3, f32) {
        let (a, b) = if outside { (wo, wi) } else { (wi, wo) };
        let h = a + self.eta * b;
        // The half vector is turned to the side of `wo`.
        let h = if h.z < 0.0 { -h } else { h };
        // Both cosines are multiplied by |h|. `wo` must see a facet from above, and `wi` from below.
        let (before, beyond) = (wo.dot(h), -wi.dot(h));
        if !(before > 0.0 && beyond > 0.0) {
            return (Vec3::ZERO, 0.0);
        }
        let square = h.length_squared();
        let inverse = 1.0 / square.sqrt();
        let (cos_a, cos_b) = if outside { (before, beyond) } else { (beyond, before) };
        let reflectance = fresnel::dielectric_between(cos_a * inverse, cos_b * inverse, self.eta);
        let common = 2.0 * self.microfacets.normals(h) * before * beyond / (square * square);
        let eta2 = self.eta * self.eta;
        let (radiance, density) = if outside { (common, common * eta2) } else { (common * eta2, common) };
        let (above, below) = (self.microfacets.stretched(wo), self.microfacets.stretched(wi));
        let f = self.tint.transmittance * ((1.0 - reflectance) * radiance / (above * -wi.z + below * wo.z));
        (f, (1.0 - self.tint.chance(reflectance)) * density / (wo.z + above))
    }
}

/// Samples a thin pane of glass as [`Bsdf::sample`](super::Bsdf::sample) does. Light is mirrored or passes without changing
/// its direction.
#[inline]
pub(super) fn sample_pane(eta: f32, wo: Vec3, lobe: f32) -> BsdfSample {
    let reflectance = fresnel::pane(wo.z.abs(), eta);
    let (wi, pdf) =
        if lobe < reflectance { (Vec3::new(-wo.x, -wo.y, wo.z), reflectance) } else { (-wo, 1.0 - reflectance) };
    BsdfSample { wi, weight: Vec3::ONE, pdf, specular: true, eta: 1.0 }
}

/// Lambertian reflection combined with Lambertian transmission to the other side, as by a sheet of paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffuseTransmission {
    /// The fraction of light reflected, per channel.
    pub reflectance: Vec3,
    /// The fraction of light transmitted to the other side, per channel.
    pub transmittance: Vec3,
}

impl DiffuseTransmission {
    /// Returns the probability of sampling the reflection: its fraction of the scattered light.
    #[inline]
    pub(super) fn chance(&self) -> f32 {
        let (up, down) = (self.reflectance.element_sum(), self.transmittance.element_sum());
        if up + down > 0.0 { up / (up + down) } else { 1.0 }
    }
}
