//! Glossy reflection above diffuse reflection, by the models of pbrt-v3's `plastic` and `substrate` materials.
//!
//! The functions of both models expect directions on the side `z > 0`.

use super::fresnel;
use super::microfacet::{TrowbridgeReitz, half_angle_cosine};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI};

/// The index of refraction of [`Plastic`]'s glossy reflection.
const PLASTIC_ETA: f32 = 1.5;

/// The sum of Lambertian reflection and a rough dielectric's reflection, as pbrt-v3's `plastic`. More light than
/// arrives may be reflected, since the glossy part does not reduce the diffuse one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plastic {
    /// The fraction of light reflected diffusely, per channel.
    pub diffuse: Vec3,
    /// The factor of the glossy reflection, per channel, which multiplies the Fresnel reflectance for an index of 1.5.
    pub specular: Vec3,
    /// The microfacet distribution of the glossy reflection.
    pub microfacets: TrowbridgeReitz,
}

impl Plastic {
    /// Returns the probability of sampling the glossy lobe: approximately its fraction of the light reflected to `wo`.
    #[inline]
    pub(super) fn chance(&self, wo: Vec3) -> f32 {
        let glossy = self.specular.element_sum() * fresnel::dielectric(wo.z, PLASTIC_ETA);
        share(glossy, self.diffuse.element_sum())
    }

    /// Returns `f` and the density. `chance` is the probability of sampling the glossy lobe at `wo`.
    #[inline]
    pub(super) fn evaluate_above(&self, wo: Vec3, wi: Vec3, chance: f32) -> (Vec3, f32) {
        let h = wo + wi;
        let reflectance = fresnel::dielectric(half_angle_cosine(h), PLASTIC_ETA);
        let glossy = self.specular * (reflectance * self.microfacets.reflection(wo, wi, h));
        let pdf = chance * self.microfacets.reflection_pdf(wo, h) + (1.0 - chance) * (wi.z * FRAC_1_PI);
        (self.diffuse * FRAC_1_PI + glossy, pdf)
    }

    /// Returns the approximate fraction of light reflected at normal incidence, per channel.
    pub(super) fn albedo(&self) -> Vec3 {
        self.diffuse + self.specular * fresnel::dielectric(1.0, PLASTIC_ETA)
    }
}

/// A glossy coat over a diffuse base [Ashikhmin and Shirley 2000] with a Trowbridge-Reitz (GGX) microfacet
/// distribution, as pbrt-v3's `substrate`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Substrate {
    /// The reflectance of the base, per channel.
    pub diffuse: Vec3,
    /// The reflectance of the coat at normal incidence, per channel.
    pub specular: Vec3,
    /// The microfacet distribution of the coat.
    pub microfacets: TrowbridgeReitz,
}

impl Substrate {
    /// Returns the probability of sampling the coat's lobe: approximately its fraction of the light reflected to `wo`.
    #[inline]
    pub(super) fn chance(&self, wo: Vec3) -> f32 {
        let diffuse = self.diffuse * (Vec3::ONE - self.specular);
        share(schlick(self.specular, wo.z).element_sum(), diffuse.element_sum())
    }

    /// Returns `f` and the density [Ashikhmin and Shirley 2000, eq. 4 and 5; the coat's lobe after Pharr et al. 2016,
    /// sec. 8.5]. `chance` is the probability of sampling the coat's lobe at `wo`.
    #[inline]
    pub(super) fn evaluate_above(&self, wo: Vec3, wi: Vec3, chance: f32) -> (Vec3, f32) {
        // The factor 28 / 23 normalises the two powers, so that energy is conserved.
        const SCALE: f32 = 28.0 / (23.0 * PI);
        let beyond = |cos: f32| 1.0 - fifth_power(1.0 - 0.5 * cos);
        let diffuse = self.diffuse * (Vec3::ONE - self.specular) * (SCALE * beyond(wi.z) * beyond(wo.z));
        let h = wo + wi;
        let cos = half_angle_cosine(h);
        let lobe = self.microfacets.normals(h) / (4.0 * cos * wi.z.max(wo.z));
        let pdf = chance * self.microfacets.reflection_pdf(wo, h) + (1.0 - chance) * (wi.z * FRAC_1_PI);
        (diffuse + schlick(self.specular, cos) * lobe, pdf)
    }

    /// Returns the approximate fraction of light reflected at normal incidence, per channel.
    pub(super) fn albedo(&self) -> Vec3 {
        self.specular + self.diffuse * (Vec3::ONE - self.specular)
    }
}

/// Returns Schlick's approximation of the Fresnel reflectance at a cosine, from the one at normal incidence [Schlick
/// 1994, eq. 15].
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
