//! A watertight test of eight triangles against one ray.
//!
//! The inside test is that of Woop, Benthin and Wald [2013]. Corners are moved relative to the ray's origin and sheared so
//! that the ray runs along an axis. A point is inside if the three edge functions have the same sign. Two triangles that share
//! an edge always compute the same sign for it, for three reasons:
//!
//! * A corner is rounded in the same way for every triangle that contains it.
//! * A rounded product is monotone in its factors.
//! * If an edge function is 0 in f32, it is computed again in f64, where products of two f32 are exact.
//!
//! The ray parameter `t` is computed in f32 if that is precise enough. It is computed in f64 for triangles seen nearly
//! edge-on, and near `tmin` and `tmax`, where a rounding error could produce a hit on the surface that the ray has just left.
//! The choice depends only on the ray and the triangle, never on the order of traversal.

use crate::lanes::{Lanes, WIDTH};
use crate::leaf::Leaf;
use crate::ray::PreparedRay;
use glam::Vec3;

/// A triangle counts as thin if its sheared area is below this fraction of its squared extent. Thin triangles are intersected
/// again in f64.
const THIN: f32 = 1.0 / 32.0;
/// The sheared area below which products of f32 lose bits to underflow.
const TINY: f32 = f32::MIN_POSITIVE * (1u64 << 26) as f32;
/// A bound on the rounding error of `t`, relative to the magnitudes of its operands: sixteen times the rounding unit of f32.
/// Each sheared coordinate has three roundings, the interpolation six.
const T_ERROR: f32 = 1.0 / (1u64 << 20) as f32;

/// Returns the largest magnitude of three values, per lane.
#[inline(always)]
fn largest<L: Lanes>([a, b, c]: &[L; 3]) -> L {
    a.abs().max(b.abs()).max(c.abs())
}

/// Returns the index of the lowest set bit in a mask of lanes.
#[inline(always)]
pub(crate) fn lowest(mask: u32) -> usize {
    mask.trailing_zeros() as usize & (WIDTH - 1)
}

/// The hits of one ray among eight triangles. `mask` has a bit per triangle hit, and `t` holds the ray parameters.
pub(crate) struct Hits {
    pub(crate) mask: u32,
    pub(crate) t: [f32; WIDTH],
    /// The barycentric weights of the second and of the third corner.
    pub(crate) weights: [[f32; WIDTH]; 2],
}

/// The corners of eight triangles relative to the ray's origin, sheared: x and y are perpendicular to the ray, z is along it.
/// The z coordinate is not yet divided by the direction's longest component.
struct Sheared<L> {
    x: [L; 3],
    y: [L; 3],
    z: [L; 3],
}

impl Leaf<'_> {
    /// Returns the hits with `tmin < t < tmax` and `t <= limit`, or `None` if no triangle is hit. Skips the triangles
    /// on which the ray starts or ends (`Ray::ends`).
    #[inline(always)]
    pub(crate) fn intersect<L: Lanes>(&self, token: L::Token, prepared: &PreparedRay, limit: f32) -> Option<Hits> {
        let s = self.shear::<L>(token, prepared);
        // Each edge function belongs to the opposite corner and is that corner's unnormalised weight.
        let u = s.x[2] * s.y[1] - s.y[2] * s.x[1];
        let v = s.x[0] * s.y[2] - s.y[0] * s.x[2];
        let w = s.x[1] * s.y[0] - s.y[1] * s.x[0];
        let zero = L::splat(token, 0.0);
        let inside = (zero.at_most(u.min(v).min(w)) | u.max(v).max(w).at_most(zero)) & self.mask();
        // Most triangles are missed. Returning here avoids fetching the keys.
        if inside == 0 {
            return None;
        }
        // Most hits left are the triangles on which the ray starts or ends. The ray cannot meet a flat triangle again.
        let [from, to] = prepared.ray.ends;
        let wanted = inside & !(self.equal::<L>(token, from.0) | self.equal::<L>(token, to.0));
        if wanted == 0 { None } else { self.finish::<L>(token, prepared, limit, wanted, &s, [u, v, w]) }
    }

    #[inline(always)]
    fn shear<L: Lanes>(&self, token: L::Token, prepared: &PreparedRay) -> Sheared<L> {
        let [kx, ky, kz] = prepared.axes;
        let z = self.relative::<L>(token, prepared, kz);
        Sheared {
            x: self.across(token, prepared, kx, prepared.shear[0], &z),
            y: self.across(token, prepared, ky, prepared.shear[1], &z),
            z,
        }
    }

    /// Returns the corners' coordinates along an axis, relative to the ray's origin.
    #[inline(always)]
    fn relative<L: Lanes>(&self, token: L::Token, prepared: &PreparedRay, axis: usize) -> [L; 3] {
        let [a, b, c] = self.along(axis);
        let origin = L::splat(token, prepared.origin[axis & 3]);
        [L::load(token, a) - origin, L::load(token, b) - origin, L::load(token, c) - origin]
    }

    #[inline(always)]
    fn across<L: Lanes>(&self, token: L::Token, prepared: &PreparedRay, axis: usize, shear: f32, z: &[L; 3]) -> [L; 3] {
        let [a, b, c] = self.relative::<L>(token, prepared, axis);
        let shear = L::splat(token, shear);
        [a - shear * z[0], b - shear * z[1], c - shear * z[2]]
    }

    /// Computes `t` and the barycentric weights of the `wanted` lanes, in which the three edge functions have the same sign.
    #[inline(always)]
    fn finish<L: Lanes>(
        &self,
        token: L::Token,
        prepared: &PreparedRay,
        limit: f32,
        wanted: u32,
        s: &Sheared<L>,
        edges: [L; 3],
    ) -> Option<Hits> {
        let [u, v, w] = edges;
        let determinant = u + v + w;
        let reciprocal = L::splat(token, 1.0) / determinant;
        let (second, third) = (v * reciprocal, w * reciprocal);
        let (to_second, to_third) = (s.z[1] - s.z[0], s.z[2] - s.z[0]);
        // Interpolates differences to the first corner: they are exactly 0 for a triangle perpendicular to the axis,
        // however the weights are rounded.
        let t = (s.z[0] + (second * to_second + third * to_third)) * L::splat(token, prepared.shear[2]);

        let (tmin, tmax) = (L::splat(token, prepared.ray.tmin), L::splat(token, prepared.ray.tmax));
        let within = tmin.less(t) & t.at_most(L::splat(token, limit)) & t.less(tmax);
        let weights = [second.to_array(), third.to_array()];
        let extent = largest(&s.x).max(largest(&s.y));
        let size = determinant.abs();
        let sound = (extent * extent * L::splat(token, THIN)).max(L::splat(token, TINY)).at_most(size)
            & L::splat(token, 0.0).less(u.abs().min(v.abs()).min(w.abs()));
        let distance = largest(&s.z);
        let slope = (to_second.abs() + to_third.abs()) * (extent * reciprocal.abs());
        let error = (distance + (distance + extent) * slope) * L::splat(token, prepared.shear[2].abs() * T_ERROR);
        let clear = error.less((t - tmin).abs()) & error.less((t - tmax).abs());

        let settled = sound & clear;
        let mut hits = Hits { mask: settled & within & wanted, t: t.to_array(), weights };
        let unsettled = wanted & !settled;
        if unsettled != 0 {
            self.settle(prepared, limit, unsettled, sound, &mut hits);
        }
        (hits.mask != 0).then_some(hits)
    }

    /// Intersects the triangles in the `unsettled` lanes in f64 and adds their hits. In the `sound` lanes, only `t` is
    /// uncertain, so it is enough to compare the limits with the triangle's plane first.
    #[inline(never)]
    fn settle(&self, prepared: &PreparedRay, limit: f32, mut unsettled: u32, sound: u32, hits: &mut Hits) {
        while unsettled != 0 {
            let lane = lowest(unsettled);
            unsettled &= unsettled - 1;
            let corners = self.corners(lane);
            let plane = Plane::new(prepared, &corners);
            if sound >> lane & 1 == 1 && !plane.within(prepared) {
                continue;
            }
            let Some((t, weights)) = settle(prepared, &corners, &plane) else { continue };
            let rounded = t as f32;
            let (tmin, tmax) = (prepared.ray.tmin, prepared.ray.tmax);
            let within = t > f64::from(tmin) && t < f64::from(tmax) && rounded > tmin && rounded < tmax;
            if within && rounded <= limit {
                hits.mask |= 1 << lane;
                hits.t[lane] = rounded;
                hits.weights[0][lane] = weights[0] as f32;
                hits.weights[1][lane] = weights[1] as f32;
            }
        }
    }
}

/// The plane of a triangle relative to a ray, computed from exact corners in f64.
struct Plane {
    /// The dot product of the unnormalised normal with the vector from the ray's origin to the plane. The ray crosses the
    /// plane at `t = height / slant`.
    height: f64,
    slant: f64,
}

impl Plane {
    #[inline(always)]
    fn new(prepared: &PreparedRay, corners: &[Vec3; 3]) -> Self {
        let [a, b, c] = [corners[0].as_dvec3(), corners[1].as_dvec3(), corners[2].as_dvec3()];
        let normal = (b - a).cross(c - a);
        let height = normal.dot(a - prepared.ray.origin.as_dvec3());
        Self { height, slant: normal.dot(prepared.ray.direction.as_dvec3()) }
    }

    /// Returns true if the ray crosses the plane at `tmin < t < tmax`.
    #[inline(always)]
    fn within(&self, prepared: &PreparedRay) -> bool {
        let (height, slant) = if self.slant > 0.0 { (self.height, self.slant) } else { (-self.height, -self.slant) };
        height > slant * f64::from(prepared.ray.tmin) && height < slant * f64::from(prepared.ray.tmax)
    }
}

/// Intersects one triangle in f64. The corners are sheared by the same f32 operations as in `Triangles8`, so that
/// neighbours agree on shared edges. Returns `t` and the barycentric weights of the second and third corner; `None`
/// without a hit.
#[inline(never)]
fn settle(prepared: &PreparedRay, corners: &[Vec3; 3], plane: &Plane) -> Option<(f64, [f64; 2])> {
    let [kx, ky, kz] = prepared.axes;
    let origin = prepared.ray.origin;
    // The same f32 operations as in `shear`, so that neighbours agree on a shared corner.
    let sheared = corners.map(|corner| {
        let along = corner[kz] - origin[kz];
        let across = |axis: usize, shear: f32| f64::from((corner[axis] - origin[axis]) - shear * along);
        [across(kx, prepared.shear[0]), across(ky, prepared.shear[1])]
    });
    // Products of two f32 are exact in f64 and their difference is rounded once, so the signs are correct.
    let edge = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let [a, b, c] = sheared;
    let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
    let determinant = u + v + w;
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    if !inside || determinant == 0.0 {
        return None;
    }
    let weights = [v / determinant, w / determinant];

    let direction = f64::from(prepared.ray.direction[kz]);
    let z = corners.map(|corner| (f64::from(corner[kz]) - f64::from(origin[kz])) / direction);
    let t = z[0] + weights[0] * (z[1] - z[0]) + weights[1] * (z[2] - z[0]);

    let extent = sheared.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
    let distance = z.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let (low, high) = (z[0].min(z[1]).min(z[2]), z[0].max(z[1]).max(z[2]));
    let across = distance * direction.abs() + extent;
    let error = (distance + 2.0 * (high - low) * across * (extent / determinant.abs())) * f64::from(T_ERROR);
    let near = |limit: f32| (t - f64::from(limit)).abs() <= error;
    if !near(prepared.ray.tmin) && !near(prepared.ray.tmax) {
        return Some((t, weights));
    }
    // Near a limit, `t` comes from the unsheared plane, free of the shear's rounding in f32.
    (plane.slant != 0.0).then(|| ((plane.height / plane.slant).clamp(low, high), weights))
}
