//! Sampling of triangles uniformly by solid angle.
//!
//! Uses f64, since near a lamp differences of nearly equal numbers decide.

use glam::DVec3;
use std::f64::consts::PI;

/// The part of the unit sphere around a point that a triangle covers.
#[derive(Clone, Copy, Debug)]
pub(super) struct SphericalTriangle {
    /// Unit vectors from the point to the corners.
    corners: [DVec3; 3],
    /// The triple product `a . (b x c)` of the corners: above 0 if they are counterclockwise, seen from the point.
    triple: f64,
    pub(super) solid_angle: f64,
}

/// Solid angle in steradians below which area sampling is as good; pbrt-v4 has 3e-4.
const LEAST: f64 = 1e-3;
/// Distance from the triangle's plane, in edge lengths, below which the side of a point is uncertain. Coordinates are
/// rounded to 24 bits.
const FLAT: f64 = 1e-9;

impl SphericalTriangle {
    /// Makes the triangle with these corners, relative to the point from which it is seen.
    ///
    /// `None` if the solid angle is tiny, or the point lies in the triangle's plane.
    pub(super) fn new(corners: [DVec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(DVec3::normalize_or_zero);
        let triple = a.dot(b.cross(c));
        // tan(half the solid angle) [Van Oosterom and Strackee 1983].
        let solid_angle = 2.0 * libm::atan2(triple.abs(), 1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        // Where a corner is at the origin, the triple product is 0.
        (triple.abs() > FLAT && solid_angle > LEAST).then_some(Self { corners: [a, b, c], triple, solid_angle })
    }

    /// Returns true if the normal `(b - a) x (c - a)` points to the side of the origin.
    pub(super) fn seen_from_above(&self) -> bool {
        self.triple < 0.0
    }

    /// Samples a unit direction uniformly by solid angle [Arvo 1995]. `u[0]` cuts the triangle by an arc through the
    /// second corner, and `u[1]` selects a point along the arc.
    pub(super) fn sample(&self, u: [f64; 2]) -> DVec3 {
        let [a, b, c] = self.corners;
        let (ab, ac) = (a.cross(b), a.cross(c));
        let lengths = ab.length() * ac.length();
        // The angle between the arcs at `a`, and the cosine of the arc from `a` to `b`.
        let (sin_alpha, cos_alpha) = (self.triple.abs() / lengths, (ab.dot(ac) / lengths).clamp(-1.0, 1.0));
        let cos_arc = a.dot(b);
        let area = (u[0] * self.solid_angle).min(2.0 * PI);
        let (sin_area, cos_area) = (libm::sin(area), libm::cos(area));
        let s = sin_area * cos_alpha - cos_area * sin_alpha;
        let t = cos_area * cos_alpha + sin_area * sin_alpha;
        let (p, q) = (t - cos_alpha, s + sin_alpha * cos_arc);
        let cos_side = ((q * t - p * s) * cos_alpha - q) / ((q * s + p * t) * sin_alpha);
        // NaN where nothing is cut off.
        let cos_side = if cos_side.is_finite() { cos_side.clamp(-1.0, 1.0) } else { 1.0 };
        let third = towards(a, c, cos_side);
        let z = 1.0 - u[1] * (1.0 - third.dot(b));
        towards(b, third, z)
    }
}

/// Returns the unit vector at an angle of this cosine from `from`, towards `to`.
fn towards(from: DVec3, to: DVec3, cosine: f64) -> DVec3 {
    from * cosine + (to - from * to.dot(from)).normalize_or_zero() * (1.0 - cosine * cosine).max(0.0).sqrt()
}
