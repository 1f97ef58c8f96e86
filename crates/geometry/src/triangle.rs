//! Four triangles against one ray, watertight.
//!
//! Inside or outside is decided as Woop, Benthin and Wald [2013] do: corners are moved to the ray's origin, sheared so
//! that the ray runs along an axis, and the signs of the three edge functions decide. Rounding is the same for every
//! triangle at a corner, a product is monotone, and an edge function that comes out as 0 is computed again in f64, where
//! products of two f32 are exact. So two triangles that share an edge never disagree about it.
//!
//! The parameter `t` then comes from f32 unless that would not do: for triangles seen nearly from the side, and near
//! `tmin` and `tmax`, where a rounding error could turn the surface just left into a hit, it is computed in f64.
//! All of this depends on the ray and the triangle alone, never on the order of traversal.

use crate::frame::Frame;
use glam::{BVec4A, Vec3, Vec4};

/// Triangles with a sheared area below this share of the square of their extent are finished in f64.
const THIN: f32 = 1.0 / 32.0;
/// Below this area products of f32 lose bits to underflow.
const TINY: f32 = f32::MIN_POSITIVE * (1u64 << 26) as f32;
/// Sixteen times f32's rounding unit: bounds the error of `t` relative to the magnitudes that enter it
/// (three roundings per sheared coordinate, six in the interpolation).
const T_ERROR: f32 = 1.0 / (1u64 << 20) as f32;

/// Up to four triangles, corner by corner and axis by axis; places left over repeat the first.
///
/// Arrays, not vectors: a lane of an array is one load.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub(crate) struct Triangles4 {
    corners: [[[f32; 4]; 3]; 3],
}

/// The lanes that were hit within the ray's limits, and where.
pub(crate) struct Lanes {
    pub(crate) mask: u32,
    pub(crate) t: [f32; 4],
    /// Weights of the second and third corner.
    pub(crate) weights: [[f32; 4]; 2],
}

/// Corners relative to the origin and sheared: x and y across the ray, z along it (not yet divided).
struct Sheared {
    x: [Vec4; 3],
    y: [Vec4; 3],
    z: [Vec4; 3],
}

impl Triangles4 {
    /// Packs 1 to 4 triangles.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let lane = |lane: usize| if lane < triangles.len() { &triangles[lane] } else { &triangles[0] };
        let axis = |corner: usize, axis: usize| [0, 1, 2, 3].map(|i| lane(i)[corner][axis]);
        Self { corners: [0, 1, 2].map(|corner| [axis(corner, 0), axis(corner, 1), axis(corner, 2)]) }
    }

    /// The lanes hit at `tmin < t < tmax` and `t <= limit`.
    #[inline(always)]
    pub(crate) fn intersect(&self, frame: &Frame, limit: f32, keys: &[u64; 4]) -> Option<Lanes> {
        let s = self.shear(frame);
        // Each edge function belongs to the corner opposite, whose weight it is.
        let u = s.x[2] * s.y[1] - s.y[2] * s.x[1];
        let v = s.x[0] * s.y[2] - s.y[0] * s.x[2];
        let w = s.x[1] * s.y[0] - s.y[1] * s.x[0];
        let inside = u.min(v).min(w).cmpge(Vec4::ZERO) | u.max(v).max(w).cmple(Vec4::ZERO);
        let mut wanted = inside.bitmask();
        if wanted == 0 {
            return None;
        }
        // Most are the triangles that the ray leaves or is aimed at: flat, so they are not met in between.
        let [from, to] = frame.ray.ends;
        for (lane, &key) in keys.iter().enumerate() {
            wanted &= !(u32::from(key == from.0 || key == to.0) << lane);
        }
        if wanted == 0 { None } else { self.finish(frame, limit, wanted, &s, [u, v, w], inside) }
    }

    #[inline(always)]
    fn shear(&self, frame: &Frame) -> Sheared {
        let [kx, ky, kz] = frame.axes;
        let along = |corner: usize, axis: usize| Vec4::from_array(self.corners[corner][axis]) - frame.origin[axis];
        let z = [along(0, kz), along(1, kz), along(2, kz)];
        let across = |axis: usize, shear: Vec4| {
            [along(0, axis) - shear * z[0], along(1, axis) - shear * z[1], along(2, axis) - shear * z[2]]
        };
        Sheared { x: across(kx, frame.shear[0]), y: across(ky, frame.shear[1]), z }
    }

    /// `t` and weights of the lanes whose edge functions do not disagree.
    #[inline(always)]
    fn finish(
        &self,
        frame: &Frame,
        limit: f32,
        wanted: u32,
        s: &Sheared,
        edges: [Vec4; 3],
        inside: BVec4A,
    ) -> Option<Lanes> {
        let [u, v, w] = edges;
        let determinant = u + v + w;
        let reciprocal = Vec4::ONE / determinant;
        let (second, third) = (v * reciprocal, w * reciprocal);
        let (to_second, to_third) = (s.z[1] - s.z[0], s.z[2] - s.z[0]);
        // Differences to the first corner: exact for a triangle that faces the ray, whatever the weights' rounding.
        let t = (s.z[0] + (second * to_second + third * to_third)) * frame.shear[2];

        let largest = |a: &[Vec4; 3]| a[0].abs().max(a[1].abs()).max(a[2].abs());
        let extent = largest(&s.x).max(largest(&s.y));
        let size = determinant.abs();
        let sound = size.cmpge((extent * extent * THIN).max(Vec4::splat(TINY)))
            & u.abs().min(v.abs()).min(w.abs()).cmpgt(Vec4::ZERO);
        let distance = largest(&s.z);
        let slope = (to_second.abs() + to_third.abs()) * (extent * reciprocal.abs());
        let error = (distance + (distance + extent) * slope) * (frame.shear[2].abs() * T_ERROR);
        let clear = (t - frame.tmin).abs().cmpgt(error) & (t - Vec4::splat(frame.ray.tmax)).abs().cmpgt(error);

        let settled = inside & sound & clear;
        let within = t.cmpgt(frame.tmin) & t.cmple(Vec4::splat(limit)) & t.cmplt(Vec4::splat(frame.ray.tmax));
        let mut lanes = Lanes {
            mask: (settled & within).bitmask() & wanted,
            t: t.to_array(),
            weights: [second.to_array(), third.to_array()],
        };
        let unsettled = inside.bitmask() & !settled.bitmask() & wanted;
        if unsettled != 0 {
            self.settle(frame, limit, unsettled, (sound & inside).bitmask(), &mut lanes);
        }
        (lanes.mask != 0).then_some(lanes)
    }

    /// Finishes lanes in f64. Those in `sound` are here only because `t` is near a limit, and the side of the plane
    /// tells.
    #[inline(never)]
    fn settle(&self, frame: &Frame, limit: f32, mut unsettled: u32, sound: u32, lanes: &mut Lanes) {
        while unsettled != 0 {
            let lane = unsettled.trailing_zeros() as usize & 3;
            unsettled &= unsettled - 1;
            let corner = |i: usize| {
                let [x, y, z] = &self.corners[i];
                Vec3::new(x[lane], y[lane], z[lane])
            };
            let corners = [corner(0), corner(1), corner(2)];
            let plane = Plane::new(frame, &corners);
            if sound >> lane & 1 == 1 && !plane.within(frame) {
                continue;
            }
            let Some((t, weights)) = settle(frame, &corners, &plane) else { continue };
            let rounded = t as f32;
            let (tmin, tmax) = (frame.ray.tmin, frame.ray.tmax);
            let within = t > f64::from(tmin) && t < f64::from(tmax) && rounded > tmin && rounded < tmax;
            if within && rounded <= limit {
                lanes.mask |= 1 << lane;
                lanes.t[lane] = rounded;
                lanes.weights[0][lane] = weights[0] as f32;
                lanes.weights[1][lane] = weights[1] as f32;
            }
        }
    }
}

/// A triangle's plane as a ray meets it, from exact corners in f64.
struct Plane {
    /// Distance of the plane from the ray's origin along the (unnormalised) normal, and the direction's share of it.
    height: f64,
    slant: f64,
}

impl Plane {
    #[inline(always)]
    fn new(frame: &Frame, corners: &[Vec3; 3]) -> Self {
        let [a, b, c] = [corners[0].as_dvec3(), corners[1].as_dvec3(), corners[2].as_dvec3()];
        let normal = (b - a).cross(c - a);
        let height = normal.dot(a - frame.ray.origin.as_dvec3());
        Self { height, slant: normal.dot(frame.ray.direction.as_dvec3()) }
    }

    /// Whether the ray meets the plane within its limits.
    #[inline(always)]
    fn within(&self, frame: &Frame) -> bool {
        let (height, slant) = if self.slant > 0.0 { (self.height, self.slant) } else { (-self.height, -self.slant) };
        height > slant * f64::from(frame.ray.tmin) && height < slant * f64::from(frame.ray.tmax)
    }
}

/// Decides about one triangle in f64: by the same sheared corners as its neighbours, and `t` as exactly as it goes.
#[inline(never)]
fn settle(frame: &Frame, corners: &[Vec3; 3], plane: &Plane) -> Option<(f64, [f64; 2])> {
    let [kx, ky, kz] = frame.axes;
    let origin = frame.ray.origin;
    // The same operations in f32 as in `shear`, so that neighbours agree about a shared corner.
    let sheared = corners.map(|corner| {
        let along = corner[kz] - origin[kz];
        let across = |axis: usize, shear: Vec4| f64::from((corner[axis] - origin[axis]) - shear.x * along);
        [across(kx, frame.shear[0]), across(ky, frame.shear[1])]
    });
    // Products of two f32 are exact in f64 and their difference is rounded once, so the signs are right.
    let edge = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let [a, b, c] = sheared;
    let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
    let determinant = u + v + w;
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    if !inside || determinant == 0.0 {
        return None;
    }
    let weights = [v / determinant, w / determinant];

    let direction = f64::from(frame.ray.direction[kz]);
    let z = corners.map(|corner| (f64::from(corner[kz]) - f64::from(origin[kz])) / direction);
    let t = z[0] + weights[0] * (z[1] - z[0]) + weights[1] * (z[2] - z[0]);

    let extent = sheared.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
    let distance = z.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let (low, high) = (z[0].min(z[1]).min(z[2]), z[0].max(z[1]).max(z[2]));
    let across = distance * direction.abs() + extent;
    let error = (distance + 2.0 * (high - low) * across * (extent / determinant.abs())) * f64::from(T_ERROR);
    let near = |limit: f32| (t - f64::from(limit)).abs() <= error;
    if !near(frame.ray.tmin) && !near(frame.ray.tmax) {
        return Some((t, weights));
    }
    // On which side of the plane the end of the ray lies, free of the shear's rounding in f32.
    (plane.slant != 0.0).then(|| ((plane.height / plane.slant).clamp(low, high), weights))
}
