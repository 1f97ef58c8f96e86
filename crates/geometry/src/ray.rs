use crate::prepared_ray::PreparedRay;
use glam::Vec3;

/// A half-line or a segment: the points `origin + t direction` with `tmin < t < tmax`.
///
/// `direction` need not have unit length; `t` is measured in lengths of `direction`. A negative `tmin` counts as 0.
///
/// A ray is invalid and hits nothing if
///
/// * its direction is zero,
/// * one of its numbers is NaN, or its origin or direction is infinite,
/// * a coordinate of the origin exceeds 2^60, or
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
    /// The triangles on which the ray starts and ends, which are skipped, or [`PrimitiveId::NONE`]. Hits are the same
    /// without them, but skipping them saves a test in f64 against `tmin` and `tmax`.
    pub ends: [PrimitiveId; 2],
}

/// The identity of a triangle in a scene (shape number and index in the mesh), or [`NONE`](Self::NONE).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrimitiveId(pub(crate) u64);

impl PrimitiveId {
    /// The identity that stands for no triangle, as for points on spheres and disks.
    pub const NONE: Self = Self(u64::MAX);

    /// Returns the identity of triangle number `primitive` of shape number `shape`. Spheres and disks use
    /// [`NONE`](Self::NONE), since a ray may hit them again.
    #[inline]
    #[must_use]
    pub const fn triangle(shape: u32, primitive: u32) -> Self {
        Self((shape as u64) << 32 | primitive as u64)
    }

    /// Returns the triangle's index in its mesh; meaningless for [`NONE`](Self::NONE).
    #[inline]
    #[must_use]
    pub const fn number(self) -> u32 {
        self.0 as u32
    }
}

impl Ray {
    /// Makes a ray along the half-line from `origin`, with `t` from 0 to infinity.
    #[inline]
    #[must_use]
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
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.direction.is_finite() && (PreparedRay::ordinary(self).is_some() || PreparedRay::rescaled(self).is_some())
    }

    /// Returns the point `origin + t direction`. For a hit, [`Geometry::surface`](crate::Geometry::surface) is more
    /// exact.
    #[inline]
    #[must_use]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// The closest intersection of a ray with a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The ray parameter of the hit, in lengths of the ray's direction.
    pub t: f32,
    /// The number of the shape hit: its index in the list given to [`Geometry::build`](crate::Geometry::build), or a
    /// later number for the shape of an instance.
    pub shape: u32,
    /// The triangle's index in its mesh; 0 for spheres and disks.
    pub primitive: u32,
    /// The barycentric weights of the triangle's second and third corner, each in `[0, 1]`. The first corner's weight
    /// is 1 minus their sum. Both are 0 for spheres and disks.
    pub barycentrics: [f32; 2],
}
