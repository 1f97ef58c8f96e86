//! A ray prepared for traversal: all quantities that depend on the ray alone, computed once.

use crate::Ray;
use glam::{Vec3, Vec4};

/// The largest absolute coordinate of a traced ray's origin.
const FARTHEST: f32 = (1u64 << 60) as f32;
/// Directions with a largest component outside `1/DIRECTION..DIRECTION` are first scaled by a power of two.
const DIRECTION: f32 = 1024.0;

/// A valid ray with its slab and shear constants [after Woop, Benthin and Wald 2013].
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedRay {
    /// The ray, with a non-negative `tmin` and a direction of moderate length.
    pub(crate) ray: Ray,
    /// The ray's origin. The array has four entries, so that an axis below four is always in range.
    pub(crate) origin: [f32; 4],
    /// The reciprocal direction per axis, finite and with the direction's sign.
    pub(crate) inverse: [f32; 4],
    /// The bound of a box that the ray meets first along each axis: 0 for the lower, 1 for the upper bound.
    pub(crate) near: [usize; 3],
    /// A permutation of the three axes. The direction's longest component is along the last one.
    pub(crate) axes: [usize; 3],
    /// The shear: the direction's first two axes over its last, and the reciprocal of the last.
    pub(crate) shear: [f32; 3],
}

impl PreparedRay {
    /// Prepares a valid ray with a direction of moderate length, without rescaling its parameter `t`. `None` for other
    /// rays.
    #[inline(always)]
    pub(crate) fn ordinary(ray: &Ray) -> Option<Self> {
        let longest = ray.direction.abs().max_element();
        let moderate = (1.0 / DIRECTION..=DIRECTION).contains(&longest);
        if moderate && is_sane(ray) { Some(Self::prepare(ray)) } else { None }
    }

    /// Prepares a ray with a very short or very long direction; `None` if it is invalid.
    ///
    /// The direction is scaled by a power of two, which is exact unless `t` leaves the range of f32. The second number
    /// converts the prepared ray's `t` to the caller's.
    #[cold]
    pub(crate) fn rescaled(ray: &Ray) -> Option<(Self, f32)> {
        let longest = ray.direction.abs().max_element();
        // If no number lies between the limits, nothing can be hit.
        let room = ray.tmin.max(0.0).next_up() < ray.tmax;
        if !is_sane(ray) || !ray.direction.is_finite() || longest == 0.0 || !room {
            return None;
        }
        // Denormal components are first lifted, since 2^149 is not an f32.
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
        // A component of 0 (or one whose reciprocal overflows) keeps its sign and takes the largest reciprocal.
        // Boxes are grown enough for their walls to be as far away as triangles can be (`build::LEAST`).
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

/// Returns true if a ray's origin is bounded, `tmin < tmax`, and `tmax` is above 0; false if one of them is NaN.
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

/// 2^exponent, with `exponent` from -127 (a denormal) to 127.
fn power_of_two(exponent: i32) -> f32 {
    if exponent <= -127 { f32::MIN_POSITIVE / 2.0 } else { f32::from_bits(((exponent + 127) as u32) << 23) }
}
