//! A ray made ready for traversal: everything that depends on the ray alone, computed once.

use crate::Ray;
use glam::{Vec3, Vec4};

/// Largest origin coordinate that is traced.
const FARTHEST: f32 = (1u64 << 60) as f32;
/// Directions whose largest component lies outside `1/DIRECTION..DIRECTION` are first scaled by a power of two.
const DIRECTION: f32 = 1024.0;

/// A valid ray with its slab and shear constants [after Woop, Benthin and Wald 2013].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// The ray, `tmin` not negative, the direction of moderate length.
    pub(crate) ray: Ray,
    /// The origin; arrays of four, so that an axis below four is always in range.
    pub(crate) origin: [f32; 4],
    /// Reciprocal direction per axis; finite, with the direction's sign.
    pub(crate) inverse: [f32; 4],
    /// Per axis, which bound of a box the ray meets first: 0 for the lower, 1 for the upper.
    pub(crate) near: [usize; 3],
    /// Axes: the last is the one along which the direction is longest.
    pub(crate) axes: [usize; 3],
    /// Shear: direction of the first two axes over that of the last, and the last's reciprocal.
    pub(crate) shear: [f32; 3],
}

impl Frame {
    /// A valid ray with a direction of moderate length, ready for traversal; the caller's `t` is the frame's.
    #[inline(always)]
    pub(crate) fn ordinary(ray: &Ray) -> Option<Self> {
        let longest = ray.direction.abs().max_element();
        let moderate = (1.0 / DIRECTION..=DIRECTION).contains(&longest);
        if moderate && is_sane(ray) { Some(Self::prepare(ray)) } else { None }
    }

    /// The same for a direction that is very short or very long, scaled by a power of two, which is exact but where
    /// `t` leaves the range of f32; `None` if the ray is invalid. The second number turns the frame's `t` into the
    /// caller's.
    #[cold]
    pub(crate) fn rescaled(ray: &Ray) -> Option<(Self, f32)> {
        let longest = ray.direction.abs().max_element();
        // Where no number lies between the limits, nothing is met between them.
        let room = ray.tmin.max(0.0).next_up() < ray.tmax;
        if !is_sane(ray) || !ray.direction.is_finite() || longest == 0.0 || !room {
            return None;
        }
        // Denormal components are first lifted, since 2^149 is no f32.
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
        // A component of 0 (or one whose reciprocal overflows) keeps its sign and takes the largest reciprocal: boxes
        // are grown, enough for walls to be as far as triangles can be (`build::LEAST`).
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

/// Whether origin and limits are what a ray's may be.
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

/// 2^exponent; `exponent` from -127 (a denormal) to 127.
fn power_of_two(exponent: i32) -> f32 {
    if exponent <= -127 { f32::MIN_POSITIVE / 2.0 } else { f32::from_bits(((exponent + 127) as u32) << 23) }
}
