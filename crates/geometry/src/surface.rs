//! Points on surfaces, and rays that leave and reach them without meeting them again.

use crate::safeguards::{All, Safeguards};
use crate::{PrimitiveId, Ray};
use glam::Vec3;

/// A point on a surface, known to within an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point, recomputed on the surface (not `origin + t direction`).
    pub position: Vec3,
    /// Per axis, no less than the distance from `position` to the exact surface.
    pub error: Vec3,
    /// Unit geometric normal: of the side from which a triangle's corners run counter-clockwise, outward for a
    /// sphere, the transformed +z side for a disk.
    pub normal: Vec3,
    /// The triangle it lies on; nothing on spheres and disks.
    pub primitive: PrimitiveId,
}

/// Moves a point off its surface, to the side to which `direction` leads, by little more than its error asks for.
///
/// `error` bounds the point's error per axis and `normal` is the surface's unit normal; the step along the normal is
/// `error . |normal|`, and the sum is moved on by the rounding of its last place, away from the surface
/// [after Pharr 2023, section 6.8.6].
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

/// What is often taken in place of a bound.
const FIXED: f32 = 1e-4;

/// Covers the rounding of a unit normal, of the dot product with it and of the step, a few ulps of f32.
const SLACK: f32 = 1.0 + 1.0 / (1u64 << 19) as f32;

/// A ray that leaves a surface and does not meet it again where it started. The direction is kept as it is.
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

/// A ray between two surfaces that meets neither of them at its ends: `t` runs from 0 to 1.
///
/// Both ends are moved towards each other by their errors; the far one also by what the rounding of `direction`
/// can move it.
#[inline(always)]
#[must_use]
pub fn spawn_ray_to(from: &SurfacePoint, to: &SurfacePoint) -> Ray {
    let error = to.error + aim_error(to.position, from.position);
    let target = offset_origin(to.position, error, to.normal, from.position - to.position);
    Ray { ends: [from.primitive, to.primitive], ..aim(from, target, 1.0) }
}

/// A ray from a surface to a point in space: `t` runs from 0 to just below 1.
#[inline]
#[must_use]
pub fn spawn_ray_to_point(from: &SurfacePoint, target: Vec3) -> Ray {
    aim(from, target, 1.0_f32.next_down())
}

/// A ray from a surface to a point. If the point lies nearer to the surface's plane than the offset, the ray runs
/// along the plane instead of back into it.
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

/// How far the end of a ray can lie from where it was aimed: `target - origin` is rounded once per axis.
#[inline(always)]
fn aim_error(target: Vec3, origin: Vec3) -> Vec3 {
    (target - origin).abs() * f32::EPSILON
}
