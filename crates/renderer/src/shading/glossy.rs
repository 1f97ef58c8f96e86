//! Glossy reflection on top of a diffuse one, by the two models of older scene files.
//!
//! Both work with directions on the side `z > 0`.

use super::fresnel;
use super::microfacet::{TrowbridgeReitz, half_angle_cosine};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI};

/// Index of refraction of [`Plastic`].
const PLASTIC_ETA: f32 = 1.5;

/// The sum of Lambert's reflection and a rough dielectric's, as pbrt-v3's `plastic`. The sum may exceed the incident
/// light: the diffuse part is not reduced by the glossy one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plastic {
    /// Share of light reflected diffusely, per channel.
    pub diffuse: Vec3,
    /// The factor of the glossy reflection, which is Fresnel's for an index of 1.5.
    pub specular: Vec3,
    /// Microfacets of the glossy reflection.
    pub microfacets: TrowbridgeReitz,
}

impl Plastic {
    /// Returns the probability of sampling the glossy lobe: nearly its share of the light from `wo`.
    #[inline]
    pub(super) fn chance(&self, wo: Vec3) -> f32 {
        let glossy = self.specular.element_sum() * fresnel::dielectric(wo.z, PLASTIC_ETA);
        share(glossy, self.diffuse.element_sum())
    }

    /// Returns `f` and density; `chance` is the probability of the glossy lobe at `wo`.
    #[inline]
    pub(super) fn evaluate_above(&self, wo: Vec3, wi: Vec3, chance: f32) -> (Vec3, f32) {
        let h = wo + wi;
        let reflectance = fresnel::dielectric(half_angle_cosine(h), PLASTIC_ETA);
        let glossy = self.specular * (reflectance * self.microfacets.reflection(wo, wi, h));
        let pdf = chance * self.microfacets.reflection_pdf(wo, h) + (1.0 - chance) * (wi.z * FRAC_1_PI);
        (self.diffuse * FRAC_1_PI + glossy, pdf)
    }

    /// Returns the share of light reflected at normal incidence, per channel.
    pub(super) fn albedo(&self) -> Vec3 {
        self.diffuse + self.specular * fresnel::dielectric(1.0, PLASTIC_ETA)
    }
}

/// A glossy coat over a diffuse base [Ashikhmin and Shirley 2000], with Trowbridge and Reitz' microfacets, as pbrt-v3's
/// `substrate`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Substrate {
    /// Reflectance of the base, per channel.
    pub diffuse: Vec3,
    /// Reflectance of the coat at normal incidence, per channel.
    pub specular: Vec3,
    /// Microfacets of the coat.
    pub microfacets: TrowbridgeReitz,
}

impl Substrate {
    /// Returns the probability of sampling the coat's lobe: nearly its share of the light from `wo`.
    #[inline]
    pub(super) fn chance(&self, wo: Vec3) -> f32 {
        let diffuse = self.diffuse * (Vec3::ONE - self.specular);
        share(schlick(self.specular, wo.z).element_sum(), diffuse.element_sum())
    }

    /// Returns `f` and density; `chance` is the probability of the coat's lobe at `wo` [Ashikhmin and Shirley 2000, eq.
    /// 4 and 5; the coat's lobe by Pharr et al. 2016, sec. 8.5].
    #[inline]
    pub(super) fn evaluate_above(&self, wo: Vec3, wi: Vec3, chance: f32) -> (Vec3, f32) {
        // 28 / 23 makes up for the two powers, so that no light is lost or made.
        const SCALE: f32 = 28.0 / (23.0 * PI);
        let beyond = |cos: f32| 1.0 - fifth_power(1.0 - 0.5 * cos);
        let diffuse = self.diffuse * (Vec3::ONE - self.specular) * (SCALE * beyond(wi.z) * beyond(wo.z));
        let h = wo + wi;
        let cos = half_angle_cosine(h);
        let lobe = self.microfacets.normals(h) / (4.0 * cos * wi.z.max(wo.z));
        let pdf = chance * self.microfacets.reflection_pdf(wo, h) + (1.0 - chance) * (wi.z * FRAC_1_PI);
        (diffuse + schlick(self.specular, cos) * lobe, pdf)
    }

    /// Returns nearly the share of light reflected at normal incidence, per channel.
    pub(super) fn albedo(&self) -> Vec3 {
        self.specular + self.diffuse * (Vec3::ONE - self.specular)
    }
}

/// Returns Schlick's approximation of the Fresnel reflectance [Schlick 1994, eq. 15].
#[inline]
fn schlick(normal: Vec3, cos: f32) -> Vec3 {
    normal + fifth_power(1.0 - cos.min(1.0)) * (Vec3::ONE - normal)
}

#[inline]
fn fifth_power(x: f32) -> f32 {
    (x * x) * (x * x) * x
}

/// Returns `a / (a + b)`; 0 if both are 0.
#[inline]
fn share(a: f32, b: f32) -> f32 {
    if a + b > 0.0 { a / (a + b) } else { 0.0 }
}
