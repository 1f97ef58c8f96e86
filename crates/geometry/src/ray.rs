use crate::prepared_ray::PreparedRay;
use glam::Vec3;

/// A half-line or a segment: the points `origin + t direction` with `tmin < t < tmax`.
///
/// `direction` need not have unit length; `t` counts in its lengths. A negative `tmin` counts as 0.
///
/// A ray is invalid and hits nothing if
///
/// * its direction is zero,
/// * one of its numbers is NaN or (except `tmax`) infinite,
/// * a coordinate of the origin exceeds 2^60, or
/// * `tmin >= tmax`.
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
    /// The direction of the ray, of any length but 0.
    pub direction: Vec3,
    /// Hits lie strictly beyond this parameter.
    pub tmin: f32,
    /// Hits lie strictly before this parameter. It may be infinite.
    pub tmax: f32,
    /// Flat primitives on which the ray starts or ends, so that it cannot meet them in between. Hits are the same
    /// without them, but they save the f64 test against `tmin` and `tmax`.
    pub ends: [PrimitiveId; 2],
}

/// The identity of a triangle in a scene (its shape and its index there), or [`NONE`](Self::NONE).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrimitiveId(pub(crate) u64);

impl PrimitiveId {
    /// The value for no triangle, as on spheres and disks.
    pub const NONE: Self = Self(u64::MAX);

    /// The identity of triangle `primitive` of shape number `shape`. Use [`NONE`](Self::NONE) for spheres and disks,
    /// which a ray may meet again.
    #[inline]
    #[must_use]
    pub const fn triangle(shape: u32, primitive: u32) -> Self {
        Self((shape as u64) << 32 | primitive as u64)
    }

    /// The triangle's index in its mesh; meaningless for [`NONE`](Self::NONE).
    #[inline]
    #[must_use]
    pub const fn number(self) -> u32 {
        self.0 as u32
    }
}

impl Ray {
    /// Makes a ray along the whole half-line, with `t` from 0 to infinity.
    #[inline]
    #[must_use]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, tmin: 0.0, tmax: f32::INFINITY, ends: [PrimitiveId::NONE; 2] }
    }

    /// Sets the limits: hits lie strictly between `tmin` and `tmax`.
    #[inline]
    #[must_use]
    pub const fn with_limits(self, tmin: f32, tmax: f32) -> Self {
        Self { tmin, tmax, ..self }
    }

    /// Returns true if the ray can hit anything: a bounded origin, a finite direction other than 0, `tmin < tmax`, and
    /// `tmax` above 0. Any other ray, one with a NaN included, hits nothing.
    #[inline]
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.direction.is_finite() && (PreparedRay::ordinary(self).is_some() || PreparedRay::rescaled(self).is_some())
    }

    /// The point at parameter `t`. [`Geometry::surface`](crate::Geometry::surface) is more exact for points on
    /// surfaces.
    #[inline]
    #[must_use]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// The first intersection of a ray with a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The ray parameter of the hit, in lengths of the ray's direction.
    pub t: f32,
    /// The shape's number: its index in the list given to [`Geometry::build`](crate::Geometry::build).
    pub shape: u32,
    /// The triangle's index in its mesh; 0 for spheres and disks.
    pub primitive: u32,
    /// The weights of the triangle's second and third corner, each in `[0, 1]`; the first has the rest. Zero for
    /// spheres and disks.
    pub barycentrics: [f32; 2],
}
