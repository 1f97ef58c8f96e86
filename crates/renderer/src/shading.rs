//! BSDFs and their building blocks: warps, discrete distributions, frames, Fresnel terms and microfacets.
//!
//! All functions here are pure, take small `Copy` values and allocate nothing per sample. Directions are unit vectors.
//! The directions of a BSDF are in the shading frame: the normal is +z, and both `wo` and `wi` point away from the
//! surface.

// `!(x > 0.0)` is intended: it rejects NaN too.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod bsdf;
pub mod coat;
pub mod dielectric;
pub mod discrete;
pub mod fresnel;
pub mod layered;
pub mod metal_coat;
pub mod microfacet;
pub mod trigonometry;
pub mod warp;

pub use bsdf::Bsdf;
pub use coat::{Coat, CoatOptions};
pub use dielectric::{DiffuseTransmission, RoughDielectric, SmoothDielectric, Tint};
pub use discrete::{Discrete, GridCell, PiecewiseConstant2d};
pub use fresnel::ComplexIor;
pub use layered::{Layered, Layers, Plastic, Substrate};
pub use metal_coat::MetalCoat;
pub use microfacet::TrowbridgeReitz;

use glam::Vec3;

/// The error of a BSDF or distribution parameter that is out of range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A microfacet width is outside `[0, 10]`.
    #[error(
        "the roughness gives a microfacet width (alpha) of {value}; choose a roughness with a width from 0 (smooth) to 10"
    )]
    Roughness {
        /// The invalid microfacet width.
        value: f32,
    },
    /// An index of refraction is outside `[0.1, 10]`.
    #[error("an index of refraction of {value} is invalid; use 0.1 to 10 (glass has 1.5)")]
    Eta {
        /// The invalid index of refraction.
        value: f32,
    },
    /// A coat's thickness is negative or not finite.
    #[error("a coat thickness of {value} is invalid; use a finite number of at least 0")]
    Thickness {
        /// The invalid optical thickness.
        value: f32,
    },
    /// A weight is negative, infinite or NaN.
    #[error("weight {index} of the distribution is {value}; use finite weights of at least 0")]
    Weight {
        /// The index of the invalid weight.
        index: usize,
        /// The invalid weight.
        value: f32,
    },
    /// There are more weights, or more columns or rows of weights, than a distribution can hold.
    #[error("a sampling distribution has {count} entries along one axis, but at most {most} are allowed; use fewer")]
    TooMany {
        /// The number of weights, or of columns or rows.
        count: usize,
        /// The largest number that a distribution holds.
        most: usize,
    },
    /// The number of weights differs from the number of cells (columns times rows).
    #[error("a distribution of {} columns x {} rows needs {} weights, not {count}; pass one weight per cell", .size[0], .size[1], .size[0].saturating_mul(.size[1]))]
    Shape {
        /// The number of weights given.
        count: usize,
        /// The numbers of columns and rows.
        size: [usize; 2],
    },
}

/// A right-handed orthonormal frame in world space whose z axis is a surface normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadingFrame {
    /// The x axis, a unit vector along the surface.
    pub tangent: Vec3,
    /// The y axis, a unit vector along the surface.
    pub bitangent: Vec3,
    /// The z axis, the unit normal.
    pub normal: Vec3,
}

impl ShadingFrame {
    /// Makes a frame around a unit normal, without branches [Duff et al. 2017]. The frame is orthonormal within 3e-7
    /// for every unit normal, including `(0, 0, -1)` and a z of -0.0.
    #[inline]
    pub fn from_normal(normal: Vec3) -> Self {
        let Vec3 { x, y, z } = normal;
        let sign = 1f32.copysign(z);
        let a = -1.0 / (sign + z);
        let b = x * y * a;
        Self {
            tangent: Vec3::new(1.0 + sign * x * x * a, sign * b, -sign * x),
            bitangent: Vec3::new(b, sign + y * y * a, -y),
            normal,
        }
    }

    /// Makes a frame whose x axis is the part of `direction` perpendicular to the normal. For anisotropic materials,
    /// `direction` is the derivative of position with respect to u. Returns [`ShadingFrame::from_normal`] if
    /// `direction` is zero, along the normal or not finite.
    #[inline]
    pub fn from_normal_and_tangent(normal: Vec3, direction: Vec3) -> Self {
        // Scaled first, since derivatives with respect to u may be very small or very large.
        let direction = direction / direction.abs().max_element();
        let across = direction - normal * normal.dot(direction);
        let length = across.length();
        // At smaller lengths, rounding determines the direction; 1e-4 leaves three digits of it.
        if !(length > 1e-4) {
            return Self::from_normal(normal);
        }
        let tangent = across / length;
        // Made orthogonal again, since the first subtraction may have cancelled.
        let tangent = unit(tangent - normal * normal.dot(tangent));
        Self { tangent, bitangent: unit(normal.cross(tangent)), normal }
    }

    /// Makes a hit's frame around the interpolated normal `shading` (of any length), negated if it points away from the
    /// unit normal `geometric`. If `shading` is zero or not finite, as where vertex normals cancel, `geometric` is used. The x
    /// axis is along `tangent`, as in [`Self::from_normal_and_tangent`]; with `None`, as in [`Self::from_normal`].
    #[inline]
    pub fn from_shading_normal(shading: Vec3, geometric: Vec3, tangent: Option<Vec3>) -> Self {
        let longest = shading.abs().max_element();
        // Interpolated unit normals that cancel to less than 1e-6 consist of rounding error.
        let normal = if longest > 1e-6 && shading.is_finite() {
            let unit = unit(shading / longest);
            if unit.dot(geometric) < 0.0 { -unit } else { unit }
        } else {
            geometric
        };
        match tangent {
            Some(direction) => Self::from_normal_and_tangent(normal, direction),
            None => Self::from_normal(normal),
        }
    }

    /// Transforms the world-space vector `v` to this frame.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.tangent), v.dot(self.bitangent), v.dot(self.normal))
    }

    /// Transforms the vector `v` from this frame to world space.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }
}

/// Returns `v` divided by its length. Multiplying by the reciprocal would lose another bit.
#[inline]
fn unit(v: Vec3) -> Vec3 {
    v / v.length()
}

/// A direction sampled from a [`Bsdf`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The sampled direction towards the light, in the shading frame. For transmission, its z has the opposite sign of
    /// `wo`'s.
    pub wi: Vec3,
    /// The factor `f |cos| / pdf` by which the path's throughput is multiplied.
    pub weight: Vec3,
    /// The solid-angle density of `wi`, equal to [`Bsdf::pdf`]. For a specular sample, the probability of choosing its
    /// lobe.
    pub pdf: f32,
    /// True for a lobe that scatters in a single direction. [`Bsdf::evaluate`] and [`Bsdf::pdf`] do not include such a lobe,
    /// and light sampling cannot find it.
    pub specular: bool,
    /// The index of refraction on the side of `wi` relative to the side of `wo`; 1 except for refraction. `weight`
    /// includes a division by `eta^2`, which is undone when the path leaves the glass. Russian roulette should
    /// therefore multiply the throughput by the product of `eta^2` along the path [Pharr et al. 2023, sec. 14.2.3].
    pub eta: f32,
}

/// Returns the index of the cell of a table over `[0, 1]` that contains `value`, and the position in the cell, 0 to 1. The
/// table has `cells` equal cells.
#[inline]
fn cell(value: f32, cells: usize) -> (usize, f32) {
    let place = value.clamp(0.0, 1.0) * cells as f32;
    let cell = (place as usize).min(cells - 1);
    (cell, place - cell as f32)
}

/// Returns the linear interpolation of a table of pairs at a cosine. The table has `CELLS + 1` entries.
#[inline]
fn interpolate<const CELLS: usize>(table: &[[f32; 2]], cos: f32) -> [f32; 2] {
    let (cell, t) = cell(cos, CELLS);
    let (a, b) = (table[cell], table[cell + 1]);
    [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
}

/// Returns `w` mirrored about the unit vector `m`.
#[inline]
fn mirror(w: Vec3, m: Vec3) -> Vec3 {
    2.0 * w.dot(m) * m - w
}

/// Returns the weight of a sample by the power heuristic with exponent 2 [Veach 1997, sec. 9.2.4], for two strategies with one
/// sample each. `pdf` is the density of the strategy that generated the sample, and `other` the density of the other strategy.
///
/// The result is in `[0, 1]` for non-negative densities. `power_heuristic(a, b) + power_heuristic(b, a)` is 1 within
/// rounding, unless both are 0. The ratio is squared, not the densities, so nothing overflows. Two infinite densities
/// give 0.5; a `pdf` of 0 or NaN gives 0.
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    if !(pdf > 0.0) {
        return 0.0;
    }
    if !(other > 0.0) {
        return 1.0;
    }
    let ratio = if pdf == other { 1.0 } else { other / pdf };
    1.0 / (1.0 + ratio * ratio)
}

/// Returns [`power_heuristic`] divided by `pdf`, with one division fewer. `pdf` must be finite and above 0.
#[inline]
pub(crate) fn power_heuristic_over_pdf(pdf: f32, other: f32) -> f32 {
    let ratio = other / pdf;
    // If the square of the ratio overflows, the result is 0.
    1.0 / (pdf + pdf * ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_division_less_changes_nothing_but_the_last_digits() {
        // Where the longer form's squares neither over- nor underflow.
        let densities = (-30..=30).step_by(3).map(|e| 2_f32.powi(e) * 1.37);
        for pdf in densities.clone() {
            for other in densities.clone().chain([0.0, pdf]) {
                let (short, long) = (power_heuristic_over_pdf(pdf, other), power_heuristic(pdf, other) / pdf);
                assert!(
                    (short - long).abs() <= long * 1e-6 || short.max(long) < 1e-30,
                    "{pdf} {other}: {short} {long}"
                );
            }
        }
    }
}
