//! Rays, hits, surface points and rays that leave them, and rays prepared for traversal.

use glam::{Vec3, Vec4};

/// A half-line or a segment: the points `origin + t direction` with `tmin < t < tmax`.
///
/// `direction` need not have unit length; `t` is in units of the length of `direction`. A negative `tmin` counts as 0.
///
/// A ray is invalid and hits nothing if
///
/// * its direction is zero,
/// * one of its numbers is NaN, or its origin or direction is infinite,
/// * a coordinate of the origin exceeds 2^60 in magnitude, or
/// * `tmin >= tmax` or `tmax <= 0`.
///
/// ```
/// use dapple_geometry::Ray;
/// use glam::Vec3;
///
/// let ray = Ray::new(Vec3::ZERO, Vec3::X).with_limits(0.0, 10.0);
/// assert_eq!(ray.at(2.0), Vec3::new(2.0, 0.0, 0.0));
/// assert!(ray.is_valid() && !Ray::new(Vec3::ZERO, Vec3::ZERO).is_valid());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The point at which the ray starts, `t` = 0.
    pub origin: Vec3,
    /// The direction of the ray. Its length is not 0 and is the unit of `t`.
    pub direction: Vec3,
    /// The lower limit of hits: only hits with `t > tmin` count. Negative values count as 0.
    pub tmin: f32,
    /// The upper limit of hits: only hits with `t < tmax` count. It may be infinite.
    pub tmax: f32,
    /// The triangles on which the ray starts and ends, or [`PrimitiveId::NONE`]. The ray never hits these triangles.
    pub ends: [PrimitiveId; 2],
}

/// The identity of a triangle in a scene (shape number and index in the mesh), or [`NONE`](Self::NONE).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrimitiveId(pub(crate) u64);

impl PrimitiveId {
    /// The identity for no triangle, used by points on spheres and disks.
    pub const NONE: Self = Self(u64::MAX);

    /// Returns the identity of triangle number `primitive` of shape number `shape`. Spheres and disks use
    /// [`NONE`](Self::NONE), since a ray may hit them again.
    #[inline]
    pub const fn triangle(shape: u32, primitive: u32) -> Self {
        Self((shape as u64) << 32 | primitive as u64)
    }

    /// Returns the triangle's index in its mesh; meaningless for [`NONE`](Self::NONE).
    #[inline]
    pub const fn number(self) -> u32 {
        self.0 as u32
    }
}

impl Ray {
    /// Makes a ray from `origin` with `t` from 0 to infinity.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, tmin: 0.0, tmax: f32::INFINITY, ends: [PrimitiveId::NONE; 2] }
    }

    /// Returns the ray with other limits: only hits with `tmin < t < tmax` count.
    #[inline]
    #[must_use]
    pub const fn with_limits(self, tmin: f32, tmax: f32) -> Self {
        Self { tmin, tmax, ..self }
    }

    /// Returns true if the direction is finite and not 0, the origin's coordinates are at most 2^60 in magnitude,
    /// `tmin < tmax` and `tmax > 0`. Other rays hit nothing.
    #[inline]
    pub fn is_valid(&self) -> bool {
        self.direction.is_finite() && (PreparedRay::ordinary(self).is_some() || PreparedRay::rescaled(self).is_some())
    }

    /// Returns the point `origin + t direction`. For a hit, [`Geometry::surface`](crate::Geometry::surface) is more precise.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// The closest intersection of a ray with a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The ray parameter of the hit, in units of the length of the ray's direction.
    pub t: f32,
    /// The number of the shape that was hit: its index in the list given to [`Geometry::build`](crate::Geometry::build), or a
    /// larger number for a shape of an instance.
    pub shape: u32,
    /// The triangle's index in its mesh; 0 for spheres and disks.
    pub primitive: u32,
    /// The barycentric weights of the triangle's second and third corner, each in `[0, 1]`. The first corner's weight
    /// is 1 minus their sum. Both are 0 for spheres and disks.
    pub barycentrics: [f32; 2],
}

impl Hit {
    /// Returns the surface point of a hit on a triangle, from its position, error and normal.
    #[inline(always)]
    pub(crate) fn on_triangle(&self, (position, error, normal): (Vec3, Vec3, Vec3)) -> SurfacePoint {
        SurfacePoint { position, error, normal, primitive: PrimitiveId::triangle(self.shape, self.primitive) }
    }
}

/// A point on a surface with a bound on the rounding error of its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The position in world space. It is computed from the shape, which is more precise than `origin + t direction`.
    pub position: Vec3,
    /// A bound on the distance from `position` to the exact surface, per axis, in scene units.
    pub error: Vec3,
    /// The unit geometric normal. A triangle's normal points to the side from which its corners appear counter-clockwise. A
    /// sphere's normal points outwards. A disk's normal is the +z axis of its object space, in world space.
    pub normal: Vec3,
    /// The triangle that contains the point; [`PrimitiveId::NONE`] on spheres and disks.
    pub primitive: PrimitiveId,
}

/// Returns a point moved off its surface to the side of `direction`, by slightly more than the error of its position.
///
/// `error` bounds the position's error per axis and `normal` is the surface's unit normal. The step along the normal has the
/// length `dot(error, abs(normal))`. The moved point is then shifted by at most two units in the last place, away from the
/// surface [after Pharr 2023, section 6.8.6].
#[inline(always)]
pub fn offset_origin(position: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let side = 1.0_f32.copysign(normal.dot(direction));
    let step = normal * (error.dot(normal.abs()) * (SLACK * side));
    let moved = position + step;
    // At least one unit in the last place, at most two.
    let away = (moved.abs() * f32::EPSILON).copysign(step);
    moved + Vec3::select(step.cmpeq(Vec3::ZERO), Vec3::ZERO, away)
}

/// A factor on the step off a surface, which covers the rounding of the unit normal, the dot product and the step.
const SLACK: f32 = 1.0 + 1.0 / (1u64 << 19) as f32;

/// Returns a ray that leaves a surface in the given direction. It starts far enough off the surface not to hit it again
/// immediately.
#[inline]
pub fn spawn_ray(from: &SurfacePoint, direction: Vec3) -> Ray {
    let origin = offset_origin(from.position, from.error, from.normal, direction);
    Ray { ends: [from.primitive, PrimitiveId::NONE], ..Ray::new(origin, direction) }
}

/// Returns a ray between two surface points that hits neither surface at its ends. `t` runs from 0 to 1.
///
/// Both ends are moved off their surfaces by their error bounds. The bound at `to` includes the rounding of `direction`.
#[inline(always)]
pub fn spawn_ray_to(from: &SurfacePoint, to: &SurfacePoint) -> Ray {
    // `target - origin` is rounded once per axis.
    let error = to.error + (to.position - from.position).abs() * f32::EPSILON;
    let target = offset_origin(to.position, error, to.normal, from.position - to.position);
    Ray { ends: [from.primitive, to.primitive], ..aim(from, target, 1.0) }
}

/// Returns a ray from a surface point to a point in space. `t` runs from 0 to just below 1.
#[inline]
pub fn spawn_ray_to_point(from: &SurfacePoint, target: Vec3) -> Ray {
    aim(from, target, 1.0_f32.next_down())
}

/// Returns a ray from a surface point towards a point in space, with `t` up to `tmax`. If the target is closer to the
/// surface's plane than the offset origin, the ray runs parallel to the plane instead of back into it.
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

/// The largest absolute coordinate of a valid ray's origin; rays from farther away hit nothing.
const FARTHEST: f32 = (1u64 << 60) as f32;
/// The limit of ordinary directions. A direction whose largest component is outside `1/DIRECTION..DIRECTION` is first scaled
/// by a power of two.
const DIRECTION: f32 = 1024.0;

/// A valid ray with precomputed constants for the tests against boxes (slabs) and against triangles (a shear) [after Woop,
/// Benthin and Wald 2013].
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedRay {
    /// The ray, with a non-negative `tmin` and a direction whose largest component lies between 1/1024 and 1024.
    pub(crate) ray: Ray,
    /// The ray's origin. A fourth entry, 0, keeps every axis index below four in range without a check.
    pub(crate) origin: [f32; 4],
    /// The reciprocals of the direction's components. They are finite and keep the components' signs; the fourth entry
    /// is 1.
    pub(crate) inverse: [f32; 4],
    /// Per axis, the side of a box that the ray crosses first: 0 for the lower bound, 1 for the upper bound.
    pub(crate) near: [usize; 3],
    /// A permutation of the three axes. The last one is the axis of the direction's longest component.
    pub(crate) axes: [usize; 3],
    /// The constants of the shear: the direction's components along `axes[0]` and `axes[1]`, both divided by the
    /// longest one, and the reciprocal of the longest one.
    pub(crate) shear: [f32; 3],
}

impl PreparedRay {
    /// Prepares a valid ray whose direction has its largest component between 1/1024 and 1024. The parameter `t` is unchanged.
    /// Returns `None` for any other ray.
    #[inline(always)]
    pub(crate) fn ordinary(ray: &Ray) -> Option<Self> {
        let longest = ray.direction.abs().max_element();
        let moderate = (1.0 / DIRECTION..=DIRECTION).contains(&longest);
        if moderate && is_sane(ray) { Some(Self::prepare(ray)) } else { None }
    }

    /// Prepares a ray with a very short or very long direction. Returns `None` if the ray is invalid.
    ///
    /// The direction is scaled by a power of two, which is exact unless `t` leaves the range of f32. The second value is the
    /// factor from the prepared ray's `t` to the `t` of `ray`.
    #[cold]
    pub(crate) fn rescaled(ray: &Ray) -> Option<(Self, f32)> {
        let longest = ray.direction.abs().max_element();
        // If no f32 lies between the limits, nothing can be hit.
        let room = ray.tmin.max(0.0).next_up() < ray.tmax;
        if !is_sane(ray) || !ray.direction.is_finite() || longest == 0.0 || !room {
            return None;
        }
        // Denormal components are first scaled up, since 2^149 is not an f32.
        let lift = if longest < f32::MIN_POSITIVE { (1u32 << 30) as f32 } else { 1.0 };
        let exponent = ((longest * lift).to_bits() >> 23) as i32 - 127;
        let scale = power_of_two(-exponent);
        let factor = f64::from(scale) * f64::from(lift);
        let scaled = |t: f32| (f64::from(t) / factor) as f32;
        let (tmin, tmax) = (scaled(ray.tmin), scaled(ray.tmax));
        let scaled = Ray { direction: ray.direction * lift * scale, tmin, tmax, ..*ray };
        is_sane(&scaled).then(|| (Self::prepare(&scaled), factor as f32))
    }

    #[inline(always)]
    fn prepare(ray: &Ray) -> Self {
        let ray = Ray { tmin: ray.tmin.max(0.0), ..*ray };
        let d = ray.direction;
        let size = d.abs();
        let longest = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let axes = [NEXT[longest], NEXT[NEXT[longest]], longest];
        let components = d.to_array();
        let direction = d.extend(1.0);
        // A component of 0, or one whose reciprocal overflows, gets the largest finite reciprocal with its sign. Boxes
        // are padded enough that this loses no triangle (`build::LEAST`).
        let inverse = (Vec4::ONE / direction).clamp(Vec4::splat(-f32::MAX), Vec4::splat(f32::MAX)).to_array();
        let over_longest = (direction / Vec4::splat(components[longest])).to_array();
        Self {
            ray,
            origin: ray.origin.extend(0.0).to_array(),
            inverse,
            near: [sign(inverse[0]), sign(inverse[1]), sign(inverse[2])],
            axes,
            shear: [over_longest[axes[0]], over_longest[axes[1]], inverse[longest]],
        }
    }
}

const NEXT: [usize; 3] = [1, 2, 0];

/// Returns true if the origin's coordinates are at most `FARTHEST`, `tmin < tmax` and `tmax > 0`.
#[inline(always)]
fn is_sane(ray: &Ray) -> bool {
    // Written so that NaN fails.
    let Vec3 { x, y, z } = ray.origin.abs();
    x <= FARTHEST && y <= FARTHEST && z <= FARTHEST && ray.tmin < ray.tmax && ray.tmax > 0.0
}

#[inline(always)]
fn sign(x: f32) -> usize {
    (x.to_bits() >> 31) as usize
}

/// Returns 2^`exponent`, for an `exponent` from -127 (a denormal) to 127.
fn power_of_two(exponent: i32) -> f32 {
    if exponent <= -127 { f32::MIN_POSITIVE / 2.0 } else { f32::from_bits(((exponent + 127) as u32) << 23) }
}
