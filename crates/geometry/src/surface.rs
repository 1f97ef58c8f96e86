//! Points on surfaces, and rays that leave and reach them without meeting them again.

use crate::Ray;
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
}

/// Moves a point off its surface, to the side to which `direction` leads, by no more than its error asks for.
///
/// `error` bounds the point's error per axis and `normal` is the surface's unit normal; the step along the normal is
/// `error . |normal|`, and the sum is rounded away from the surface [Pharr 2023, section 6.8.6].
#[inline]
#[must_use]
pub fn offset_origin(position: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let side = if normal.dot(direction) < 0.0 { -1.0 } else { 1.0 };
    let distance = f64::from(error.dot(normal.abs())) * SLACK;
    let away = |position: f32, normal: f32| {
        let step = distance * side * f64::from(normal);
        let exact = f64::from(position) + step;
        let rounded = exact as f32;
        if step > 0.0 && f64::from(rounded) <= exact {
            rounded.next_up()
        } else if step < 0.0 && f64::from(rounded) >= exact {
            rounded.next_down()
        } else {
            rounded
        }
    };
    Vec3::new(away(position.x, normal.x), away(position.y, normal.y), away(position.z, normal.z))
}

/// Covers the rounding of a unit normal and of the dot product with it, a few ulps of f32.
const SLACK: f64 = 1.0 + 1.0 / (1u64 << 20) as f64;

/// A ray that leaves a surface and does not meet it again where it started. The direction is kept as it is.
#[inline]
#[must_use]
pub fn spawn_ray(from: &SurfacePoint, direction: Vec3) -> Ray {
    Ray::new(offset_origin(from.position, from.error, from.normal, direction), direction)
}

/// A ray between two surfaces that meets neither of them at its ends: `t` runs from 0 to 1.
///
/// Both ends are moved towards each other by their errors; the far one also by what the rounding of `direction`
/// can move it.
#[inline]
#[must_use]
pub fn spawn_ray_to(from: &SurfacePoint, to: &SurfacePoint) -> Ray {
    let error = to.error + aim_error(to.position, from.position);
    let target = offset_origin(to.position, error, to.normal, from.position - to.position);
    aim(from, target, 1.0)
}

/// A ray from a surface to a point in space: `t` runs from 0 to just below 1.
#[inline]
#[must_use]
pub fn spawn_ray_to_point(from: &SurfacePoint, target: Vec3) -> Ray {
    aim(from, target, 1.0_f32.next_down())
}

/// A ray from a surface to a point. If the point lies nearer to the surface's plane than the offset, the ray runs
/// along the plane instead of back into it.
#[inline]
fn aim(from: &SurfacePoint, target: Vec3, tmax: f32) -> Ray {
    let wanted = target - from.position;
    let origin = offset_origin(from.position, from.error, from.normal, wanted);
    let direction = target - origin;
    let back = from.normal.dot(direction);
    let turned = (back < 0.0) != (from.normal.dot(wanted) < 0.0);
    Ray { origin, direction: if turned { direction - from.normal * back } else { direction }, tmin: 0.0, tmax }
}

/// How far the end of a ray can lie from where it was aimed: `target - origin` is rounded once per axis.
#[inline]
fn aim_error(target: Vec3, origin: Vec3) -> Vec3 {
    (target - origin).abs() * f32::EPSILON
}
