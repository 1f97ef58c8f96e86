//! Points on surfaces, and rays that start or end at such points without hitting the same surface again.

use crate::{PrimitiveId, Ray};
use glam::Vec3;

/// A point on a surface with a bound on the rounding error of its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The position in world space. It is computed from the shape, which is more exact than `origin + t direction`.
    pub position: Vec3,
    /// A bound on the distance from `position` to the exact surface, per axis, in scene units.
    pub error: Vec3,
    /// The unit geometric normal. A triangle's normal is on the side from which its corners run counter-clockwise. A
    /// sphere's normal points outwards. A disk's normal is the transformed +z axis of its own space.
    pub normal: Vec3,
    /// The triangle that contains the point; [`PrimitiveId::NONE`] on spheres and disks.
    pub primitive: PrimitiveId,
}

/// Returns a point moved off its surface, to the side of `direction`, by little more than the error of its position.
///
/// `error` bounds the position's error per axis and `normal` is the surface's unit normal. The step along the normal
/// has the length `error . |normal|`. The moved point is then shifted by at most two units in the last place, away
/// from the surface [after Pharr 2023, section 6.8.6].
#[inline(always)]
pub fn offset_origin(position: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let side = 1.0_f32.copysign(normal.dot(direction));
    let step = normal * (error.dot(normal.abs()) * (SLACK * side));
    let moved = position + step;
    // At least one unit in the last place, at most two.
    let away = (moved.abs() * f32::EPSILON).copysign(step);
    moved + Vec3::select(step.cmpeq(Vec3::ZERO), Vec3::ZERO, away)
}

/// A factor on the step off a surface that allows for the rounding of the unit normal, the dot product and the step.
const SLACK: f32 = 1.0 + 1.0 / (1u64 << 19) as f32;

/// Returns a ray that leaves a surface in the given direction, starting far enough off the surface not to hit it at
/// once.
#[inline]
pub fn spawn_ray(from: &SurfacePoint, direction: Vec3) -> Ray {
    let origin = offset_origin(from.position, from.error, from.normal, direction);
    Ray { ends: [from.primitive, PrimitiveId::NONE], ..Ray::new(origin, direction) }
}

/// Returns a ray between two surface points that hits neither surface at its ends. `t` runs from 0 to 1.
///
/// Both ends are moved off their surfaces by the error bounds; the far bound includes the rounding of `direction`.
#[inline(always)]
pub fn spawn_ray_to(from: &SurfacePoint, to: &SurfacePoint) -> Ray {
    let error = to.error + aim_error(to.position, from.position);
    let target = offset_origin(to.position, error, to.normal, from.position - to.position);
    Ray { ends: [from.primitive, to.primitive], ..aim(from, target, 1.0) }
}

/// Returns a ray from a surface point to a point in space. `t` runs from 0 to just below 1.
#[inline]
pub fn spawn_ray_to_point(from: &SurfacePoint, target: Vec3) -> Ray {
    aim(from, target, 1.0_f32.next_down())
}

/// Returns a ray from a surface point towards a point in space, with `t` up to `tmax`. If the target is nearer to the
/// surface's plane than the offset origin, the ray runs parallel to the plane and not back into it.
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

/// A bound per axis on the distance between a ray's end and its target: `target - origin` is rounded once per axis.
#[inline(always)]
fn aim_error(target: Vec3, origin: Vec3) -> Vec3 {
    (target - origin).abs() * f32::EPSILON
}
