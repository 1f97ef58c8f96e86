//! Sampling of triangles uniformly by solid angle.
//!
//! Computations use f64, since near a light they subtract nearly equal numbers.

use glam::DVec3;
use std::f64::consts::PI;

/// A spherical triangle: the projection of a triangle on the unit sphere around a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct SphericalTriangle {
    /// The unit vectors from the point to the corners.
    corners: [DVec3; 3],
    /// The triple product `a . (b x c)` of the corners. It is positive if they run counter-clockwise as seen from the
    /// point.
    triple: f64,
    pub(super) solid_angle: f64,
}

/// The solid angle in steradians below which sampling by area is as good; pbrt-v4 uses 3e-4.
const LEAST: f64 = 1e-3;
/// The triple product of the unit vectors to the corners at or below which the point counts as in the triangle's
/// plane, because of rounding.
const FLAT: f64 = 1e-9;

impl SphericalTriangle {
    /// Makes the spherical triangle of a triangle whose corners are given relative to the point.
    ///
    /// Returns `None` if the solid angle is tiny or the point lies in the triangle's plane.
    pub(super) fn new(corners: [DVec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(DVec3::normalize_or_zero);
        let triple = a.dot(b.cross(c));
        // The arctangent gives half the solid angle [Van Oosterom and Strackee 1983].
        let solid_angle = 2.0 * libm::atan2(triple.abs(), 1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        // If a corner coincides with the point, the triple product is 0.
        (triple.abs() > FLAT && solid_angle > LEAST).then_some(Self { corners: [a, b, c], triple, solid_angle })
    }

    /// Returns true if the point is on the side of the normal `(b - a) x (c - a)`.
    pub(super) fn seen_from_above(&self) -> bool {
        self.triple < 0.0
    }

    /// Samples a unit direction uniformly by solid angle [Arvo 1995]. `u[0]` selects an arc through the second corner,
    /// and `u[1]` a point on the arc.
    pub(super) fn sample(&self, u: [f64; 2]) -> DVec3 {
        let [a, b, c] = self.corners;
        let (ab, ac) = (a.cross(b), a.cross(c));
        let lengths = ab.length() * ac.length();
        // The angle between the two arcs at `a`, and the cosine of the arc from `a` to `b`.
        let (sin_alpha, cos_alpha) = (self.triple.abs() / lengths, (ab.dot(ac) / lengths).clamp(-1.0, 1.0));
        let cos_arc = a.dot(b);
        let area = (u[0] * self.solid_angle).min(2.0 * PI);
        let (sin_area, cos_area) = (libm::sin(area), libm::cos(area));
        let s = sin_area * cos_alpha - cos_area * sin_alpha;
        let t = cos_area * cos_alpha + sin_area * sin_alpha;
        let (p, q) = (t - cos_alpha, s + sin_alpha * cos_arc);
        let cos_side = ((q * t - p * s) * cos_alpha - q) / ((q * s + p * t) * sin_alpha);
        // NaN if the sub-triangle is empty.
        let cos_side = if cos_side.is_finite() { cos_side.clamp(-1.0, 1.0) } else { 1.0 };
        let third = towards(a, c, cos_side);
        let z = 1.0 - u[1] * (1.0 - third.dot(b));
        towards(b, third, z)
    }
}

/// Returns the unit vector on the arc from `from` towards `to`, at an angle of this cosine from `from`.
fn towards(from: DVec3, to: DVec3, cosine: f64) -> DVec3 {
    from * cosine + (to - from * to.dot(from)).normalize_or_zero() * (1.0 - cosine * cosine).max(0.0).sqrt()
}
