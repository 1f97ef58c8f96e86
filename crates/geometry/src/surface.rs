//! Points on surfaces, and rays that leave and reach them without meeting them again.

use crate::safeguards::{All, Safeguards};
use crate::{PrimitiveId, Ray};
use glam::Vec3;

/// A point on a surface with a bound on its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point, recomputed on the surface (not `origin + t direction`).
    pub position: Vec3,
    /// A bound on the distance from `position` to the exact surface, per axis.
    pub error: Vec3,
    /// The unit geometric normal. It is on the side from which a triangle's corners run counter-clockwise, outward for
    /// a sphere, and the transformed +z side for a disk.
    pub normal: Vec3,
    /// The triangle that contains the point; [`PrimitiveId::NONE`] on spheres and disks.
    pub primitive: PrimitiveId,
}

/// Moves a point off its surface to the side of `direction`, by little more than its error.
///
/// `error` bounds the point's error per axis and `normal` is the surface's unit normal. The step along the normal is
/// `error . |normal|`. The sum is moved on by the rounding of its last place, away from the surface [after Pharr 2023,
/// section 6.8.6].
#[inline(always)]
#[must_use]
pub fn offset_origin(position: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    offset_origin_with::<All>(position, error, normal, direction)
}

#[inline(always)]
fn offset_origin_with<S: Safeguards>(position: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let side = 1.0_f32.copysign(normal.dot(direction));
    if !S::OFFSETS {
        return position + normal * (FIXED * side);
    }
    let step = normal * (error.dot(normal.abs()) * (SLACK * side));
    let moved = position + step;
    // At least one unit in the last place, at most two.
    let away = (moved.abs() * f32::EPSILON).copysign(step);
    moved + Vec3::select(step.cmpeq(Vec3::ZERO), Vec3::ZERO, away)
}

/// The offset of [`WithoutOffsets`](crate::safeguards::WithoutOffsets), in place of the bound on the error.
const FIXED: f32 = 1e-4;

/// Factor that allows for the rounding of a unit normal, of the dot product with it and of the step: a few ulps of f32.
const SLACK: f32 = 1.0 + 1.0 / (1u64 << 19) as f32;

/// A ray that leaves a surface and does not meet it again at its start. The direction stays unchanged.
#[inline]
#[must_use]
pub fn spawn_ray(from: &SurfacePoint, direction: Vec3) -> Ray {
    spawn_ray_with::<All>(from, direction)
}

#[inline(always)]
pub(crate) fn spawn_ray_with<S: Safeguards>(from: &SurfacePoint, direction: Vec3) -> Ray {
    let origin = offset_origin_with::<S>(from.position, from.error, from.normal, direction);
    Ray { ends: [from.primitive, PrimitiveId::NONE], ..Ray::new(origin, direction) }
}

/// A ray between two surfaces that meets neither of them at its ends. `t` runs from 0 to 1.
///
/// Both ends are moved towards each other by their errors, the far one also by the rounding of `direction`.
#[inline(always)]
#[must_use]
pub fn spawn_ray_to(from: &SurfacePoint, to: &SurfacePoint) -> Ray {
    let error = to.error + aim_error(to.position, from.position);
    let target = offset_origin(to.position, error, to.normal, from.position - to.position);
    Ray { ends: [from.primitive, to.primitive], ..aim(from, target, 1.0) }
}

/// A ray from a surface to a point in space. `t` runs from 0 to just below 1.
#[inline]
#[must_use]
pub fn spawn_ray_to_point(from: &SurfacePoint, target: Vec3) -> Ray {
    aim(from, target, 1.0_f32.next_down())
}

/// A ray from a surface to a point in space, up to `tmax`. If the point is nearer to the surface's plane than the
/// offset, the ray runs along the plane and not back into it.
#[inline(always)]
fn aim(from: &SurfacePoint, target: Vec3, tmax: f32) -> Ray {
    let wanted = target - from.position;
    let origin = offset_origin(from.position, from.error, from.normal, wanted);
    let direction = target - origin;
    let back = from.normal.dot(direction);
    let turned = (back < 0.0) != (from.normal.dot(wanted) < 0.0);
    let direction = if turned { direction - from.normal * back } else { direction };
    Ray { origin, direction, tmin: 0.0, tmax, ends: [from.primitive, PrimitiveId::NONE] }
}

/// The largest distance of a ray's end from its target: `target - origin` is rounded once per axis.
#[inline(always)]
fn aim_error(target: Vec3, origin: Vec3) -> Vec3 {
    (target - origin).abs() * f32::EPSILON
}
