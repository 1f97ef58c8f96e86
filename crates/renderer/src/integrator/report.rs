//! What a path tracer tells samplers and filters of a first hit.

use crate::World;
use crate::material::Surface;
use crate::world::{Interaction, NO_LIGHT};
use dapple_core::FirstHit;
use dapple_geometry::Ray;

/// Outlined, since most renders ask for no first hits; by value, so that the caller's stay in registers.
#[inline(never)]
pub(super) fn report(world: &World, ray: Ray, at: Interaction<'_>, surface: &Surface) -> FirstHit {
    let bsdf = world.bsdf(&at, surface);
    let side = if at.point.normal.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
    let shading = world.frame(&at, surface).normal;
    let shines = at.part.light != NO_LIGHT;
    let depth = (at.point.position - ray.origin).length();
    FirstHit::new(at.point.position.to_array(), (at.point.normal * side).to_array(), depth)
        .with_shading_normal((shading * side).to_array())
        .with_albedo(if shines { [1.0; 3] } else { bsdf.albedo().to_array() })
        .with_footprint(world.camera.footprint(depth))
        .with_roughness(bsdf.roughness())
        .with_material(at.part.material)
        .with_shape(at.hit.shape)
        .with_primitive(at.hit.primitive)
}
