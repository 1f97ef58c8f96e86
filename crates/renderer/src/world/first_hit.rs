//! The features of a camera ray's first hit and of the first rough surface, for samplers and denoisers.

use super::{Interaction, NO_LIGHT, World};
use crate::material::Surface;
use crate::shading::Bsdf;
use dapple_core::{FirstHit, SurfaceFeatures};
use dapple_geometry::Ray;
use glam::Vec3;

impl World {
    /// Returns the features of a camera ray's first hit that samplers and denoisers use.
    ///
    /// `u` in `[0, 1)` selects one material if the surface is a mix.
    pub fn first_hit(&self, ray: &Ray, at: &Interaction<'_>, u: f32) -> FirstHit {
        self.first_hit_of(*ray, *at, self.surface(at, u))
    }

    /// Returns the features of a first hit as [`Self::first_hit`] does, for a material that is known already.
    ///
    /// Not inlined, since most renders need no such features. Arguments are passed by value, so that the caller's
    /// copies stay in registers.
    #[inline(never)]
    pub(crate) fn first_hit_of(&self, ray: Ray, at: Interaction<'_>, surface: &Surface) -> FirstHit {
        let bsdf = self.bsdf_of(&at, surface);
        let side = side(&ray, &at);
        let depth = (at.point.position - ray.origin).length();
        FirstHit::new(at.point.position.to_array(), (at.point.normal * side).to_array(), depth)
            .with_shading_normal((self.frame_of(&at, surface).normal * side).to_array())
            .with_albedo(albedo(&at, &bsdf).to_array())
            .with_footprint(self.camera.footprint(depth))
            .with_roughness(bsdf.roughness())
            .with_material(at.part.material)
            .with_shape(at.hit.shape)
            .with_primitive(at.hit.primitive)
    }

    /// Returns the features of a surface that a path meets behind mirrors, glass or smooth coats.
    ///
    /// `u` in `[0, 1)` selects one material if the surface is a mix. `tint` is the share of light that the surfaces before
    /// pass on, and `length` the path's length up to the last of them.
    pub fn surface_features(
        &self,
        ray: &Ray,
        at: &Interaction<'_>,
        u: f32,
        tint: Vec3,
        length: f32,
    ) -> SurfaceFeatures {
        self.features_of(*ray, *at, self.surface(at, u), tint, length)
    }

    /// Returns the features of a surface that a path meets behind mirrors, glass or smooth coats, as filters use them.
    ///
    /// `tint` is the share of light that these pass on, and `length` the path's length up to the last of them. Not
    /// inlined, as [`Self::first_hit_of`].
    #[inline(never)]
    pub(crate) fn features_of(
        &self,
        ray: Ray,
        at: Interaction<'_>,
        surface: &Surface,
        tint: Vec3,
        length: f32,
    ) -> SurfaceFeatures {
        let normal = self.frame_of(&at, surface).normal * side(&ray, &at);
        let albedo = albedo(&at, &self.bsdf_of(&at, surface)) * tint;
        let depth = length + (at.point.position - ray.origin).length();
        SurfaceFeatures::new(at.point.position.to_array(), normal.to_array(), depth)
            .with_albedo(albedo.min(Vec3::ONE).to_array())
    }
}

/// Returns the factor, 1 or -1, that turns a surface's normals to the side that the ray came from.
fn side(ray: &Ray, at: &Interaction<'_>) -> f32 {
    if at.point.normal.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 }
}

/// Returns a surface's albedo: 1 for emitters.
fn albedo(at: &Interaction<'_>, bsdf: &Bsdf<'_>) -> Vec3 {
    if at.part.light == NO_LIGHT { bsdf.albedo() } else { Vec3::ONE }
}
