//! Eight triangles against one ray, watertight.
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
use crate::lanes::{Eight, Lanes, WIDTH};
use crate::moving::between;
use crate::safeguards::Safeguards;
use crate::traverse::Keys;
use glam::Vec3;

/// Triangles with a sheared area below this share of the square of their extent are finished in f64.
const THIN: f32 = 1.0 / 32.0;
/// Below this area products of f32 lose bits to underflow.
const TINY: f32 = f32::MIN_POSITIVE * (1u64 << 26) as f32;
/// Sixteen times f32's rounding unit: bounds the error of `t` relative to the magnitudes that enter it
/// (three roundings per sheared coordinate, six in the interpolation).
const T_ERROR: f32 = 1.0 / (1u64 << 20) as f32;

/// The largest magnitude of three.
#[inline(always)]
fn largest<L: Lanes>([a, b, c]: &[L; 3]) -> L {
    a.abs().max(b.abs()).max(c.abs())
}

/// Number of the lowest bit set in a mask of lanes.
#[inline(always)]
pub(crate) fn lowest(mask: u32) -> usize {
    mask.trailing_zeros() as usize & (WIDTH - 1)
}

/// Up to eight triangles, corner by corner and axis by axis; places left over repeat the first.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Triangles8 {
    corners: [[Eight; 3]; 3],
}

/// The lanes that were hit within the ray's limits, and where.
pub(crate) struct Hits {
    pub(crate) mask: u32,
    pub(crate) t: [f32; WIDTH],
    /// Weights of the second and third corner.
    pub(crate) weights: [[f32; WIDTH]; 2],
}

/// Corners relative to the origin and sheared: x and y across the ray, z along it (not yet divided).
struct Sheared<L> {
    x: [L; 3],
    y: [L; 3],
    z: [L; 3],
}

impl Triangles8 {
    /// Packs 1 to 8 triangles.
    #[cfg(test)]
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let mut packed = Self::default();
        for lane in 0..WIDTH {
            packed.put(lane, triangles[if lane < triangles.len() { lane } else { 0 }]);
        }
        packed
    }

    #[inline(always)]
    pub(crate) fn put(&mut self, lane: usize, triangle: [Vec3; 3]) {
        for (packed, corner) in self.corners.iter_mut().zip(triangle) {
            for axis in 0..3 {
                packed[axis].0[lane] = corner[axis];
            }
        }
    }

    /// On the way from here to `end`, at a time in `[0, 1]`.
    #[inline(always)]
    pub(crate) fn toward(&self, end: &Self, time: f32) -> Self {
        let mut there = *self;
        for corner in 0..3 {
            for axis in 0..3 {
                for lane in 0..WIDTH {
                    let to = end.corners[corner][axis].0[lane];
                    let coordinate = &mut there.corners[corner][axis].0[lane];
                    *coordinate = between(*coordinate, to, time);
                }
            }
        }
        there
    }

    /// The lanes hit at `tmin < t < tmax` and `t <= limit`.
    #[inline(always)]
    pub(crate) fn intersect<S: Safeguards, L: Lanes>(
        &self,
        token: L::Token,
        frame: &Frame,
        limit: f32,
        keys: &Keys,
    ) -> Option<Hits> {
        let s = self.shear::<L>(token, frame);
        // Each edge function belongs to the corner opposite, whose weight it is.
        let u = s.x[2] * s.y[1] - s.y[2] * s.x[1];
        let v = s.x[0] * s.y[2] - s.y[0] * s.x[2];
        let w = s.x[1] * s.y[0] - s.y[1] * s.x[0];
        let zero = L::splat(token, 0.0);
        let inside = zero.at_most(u.min(v).min(w)) | u.max(v).max(w).at_most(zero);
        // Mostly so, and then the keys need not be fetched.
        if inside == 0 {
            return None;
        }
        // Most are the triangles that the ray leaves or is aimed at: flat, so they are not met in between.
        let [from, to] = frame.ray.ends;
        let wanted = inside & !(keys.equal::<L>(token, from.0) | keys.equal::<L>(token, to.0));
        if wanted == 0 { None } else { self.finish::<S, L>(token, frame, limit, wanted, &s, [u, v, w]) }
    }

    #[inline(always)]
    fn shear<L: Lanes>(&self, token: L::Token, frame: &Frame) -> Sheared<L> {
        let [kx, ky, kz] = frame.axes;
        let z = self.along::<L>(token, frame, kz);
        Sheared {
            x: self.across(token, frame, kx, frame.shear[0], &z),
            y: self.across(token, frame, ky, frame.shear[1], &z),
            z,
        }
    }

    /// The corners' coordinates along an axis, from the ray's origin.
    #[inline(always)]
    fn along<L: Lanes>(&self, token: L::Token, frame: &Frame, axis: usize) -> [L; 3] {
        let [a, b, c] = &self.corners;
        let origin = L::splat(token, frame.origin[axis & 3]);
        [L::load(token, &a[axis]) - origin, L::load(token, &b[axis]) - origin, L::load(token, &c[axis]) - origin]
    }

    #[inline(always)]
    fn across<L: Lanes>(&self, token: L::Token, frame: &Frame, axis: usize, shear: f32, z: &[L; 3]) -> [L; 3] {
        let [a, b, c] = self.along::<L>(token, frame, axis);
        let shear = L::splat(token, shear);
        [a - shear * z[0], b - shear * z[1], c - shear * z[2]]
    }

    /// `t` and weights of the `wanted` lanes, whose edge functions do not disagree.
    #[inline(always)]
    fn finish<S: Safeguards, L: Lanes>(
        &self,
        token: L::Token,
        frame: &Frame,
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
        // Differences to the first corner: exact for a triangle that faces the ray, whatever the weights' rounding.
        let t = (s.z[0] + (second * to_second + third * to_third)) * L::splat(token, frame.shear[2]);

        let (tmin, tmax) = (L::splat(token, frame.ray.tmin), L::splat(token, frame.ray.tmax));
        let within = tmin.less(t) & t.at_most(L::splat(token, limit)) & t.less(tmax);
        let weights = [second.to_array(), third.to_array()];
        if !S::EXACT {
            let mask = within & wanted;
            return (mask != 0).then_some(Hits { mask, t: t.to_array(), weights });
        }
        let extent = largest(&s.x).max(largest(&s.y));
        let size = determinant.abs();
        let sound = (extent * extent * L::splat(token, THIN)).max(L::splat(token, TINY)).at_most(size)
            & L::splat(token, 0.0).less(u.abs().min(v.abs()).min(w.abs()));
        let distance = largest(&s.z);
        let slope = (to_second.abs() + to_third.abs()) * (extent * reciprocal.abs());
        let error = (distance + (distance + extent) * slope) * L::splat(token, frame.shear[2].abs() * T_ERROR);
        let clear = error.less((t - tmin).abs()) & error.less((t - tmax).abs());

        let settled = sound & clear;
        let mut hits = Hits { mask: settled & within & wanted, t: t.to_array(), weights };
        let unsettled = wanted & !settled;
        if unsettled != 0 {
            self.settle(frame, limit, unsettled, sound, &mut hits);
        }
        (hits.mask != 0).then_some(hits)
    }

    /// Finishes lanes in f64. Those in `sound` are here only because `t` is near a limit, and the side of the plane
    /// tells.
    #[inline(never)]
    fn settle(&self, frame: &Frame, limit: f32, mut unsettled: u32, sound: u32, hits: &mut Hits) {
        while unsettled != 0 {
            let lane = lowest(unsettled);
            unsettled &= unsettled - 1;
            let corner = |i: usize| {
                let [x, y, z] = &self.corners[i];
                Vec3::new(x.0[lane], y.0[lane], z.0[lane])
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
                hits.mask |= 1 << lane;
                hits.t[lane] = rounded;
                hits.weights[0][lane] = weights[0] as f32;
                hits.weights[1][lane] = weights[1] as f32;
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
        let across = |axis: usize, shear: f32| f64::from((corner[axis] - origin[axis]) - shear * along);
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
