//! The features of a camera ray's first hit, such as albedo and normal, for samplers and denoisers.

use super::{Interaction, NO_LIGHT, World};
use crate::material::Surface;
use dapple_core::FirstHit;
use dapple_geometry::Ray;

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
        let side = if at.point.normal.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
        let shading = self.frame_of(&at, surface).normal;
        let emits = at.part.light != NO_LIGHT;
        let depth = (at.point.position - ray.origin).length();
        FirstHit::new(at.point.position.to_array(), (at.point.normal * side).to_array(), depth)
            .with_shading_normal((shading * side).to_array())
            .with_albedo(if emits { [1.0; 3] } else { bsdf.albedo().to_array() })
            .with_footprint(self.camera.footprint(depth))
            .with_roughness(bsdf.roughness())
            .with_material(at.part.material)
            .with_shape(at.hit.shape)
            .with_primitive(at.hit.primitive)
    }
}
