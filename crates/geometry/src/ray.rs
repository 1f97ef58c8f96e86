use crate::frame::Frame;
use glam::Vec3;

/// A half-line, or a piece of one: the points `origin + t direction` with `tmin < t < tmax`.
///
/// `direction` need not have unit length; `t` counts in its lengths. A ray is invalid, and hits nothing, if its
/// direction is zero, if a number of it is NaN or (but for `tmax`) infinite, if a coordinate of the origin exceeds
/// 2^60, or if `tmin >= tmax`. A negative `tmin` counts as 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Where it goes; any length but 0.
    pub direction: Vec3,
    /// Hits lie strictly beyond this parameter.
    pub tmin: f32,
    /// Hits lie strictly before this parameter; may be infinite.
    pub tmax: f32,
    /// Flat primitives that the ray starts or ends on and so cannot meet in between. They may be told, to spare
    /// deciding in f64 that they lie beyond `tmin` or `tmax`; hits are the same if they are not.
    pub ends: [PrimitiveId; 2],
}

/// A triangle of a scene, or nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrimitiveId(pub(crate) u64);

impl PrimitiveId {
    /// No primitive.
    pub const NONE: Self = Self(u64::MAX);

    /// Triangle `primitive` of shape `shape`. For spheres and disks take [`NONE`](Self::NONE): a ray may meet what
    /// it starts on again.
    #[inline]
    #[must_use]
    pub const fn triangle(shape: u32, primitive: u32) -> Self {
        Self((shape as u64) << 32 | primitive as u64)
    }

    /// The triangle's number in its mesh; nothing of use of [`NONE`](Self::NONE).
    #[inline]
    #[must_use]
    pub const fn number(self) -> u32 {
        self.0 as u32
    }
}

impl Ray {
    /// The whole half-line.
    #[inline]
    #[must_use]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, tmin: 0.0, tmax: f32::INFINITY, ends: [PrimitiveId::NONE; 2] }
    }

    /// Whether it is a ray at all; one that is not hits nothing. Whoever makes rays may want to count the others.
    #[inline]
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.direction.is_finite() && (Frame::ordinary(self).is_some() || Frame::rescaled(self).is_some())
    }

    /// The point at parameter `t`. Points on surfaces are better had from
    /// [`Geometry::surface`](crate::Geometry::surface).
    #[inline]
    #[must_use]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// Where a ray first meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Parameter along the ray, in lengths of its direction.
    pub t: f32,
    /// The shape's number: its place in the list given to [`Geometry::build`](crate::Geometry::build).
    pub shape: u32,
    /// The triangle's number in its mesh; 0 for spheres and disks.
    pub primitive: u32,
    /// Weights of the triangle's second and third corner, each in `[0, 1]`; the first has the rest.
    /// Zero for spheres and disks.
    pub barycentrics: [f32; 2],
}
