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
pub mod frame;
pub mod fresnel;
pub mod glossy;
pub mod layered;
pub mod metal_coat;
pub mod microfacet;
pub mod sample;
pub mod trigonometry;
pub mod warp;

pub use bsdf::Bsdf;
pub use coat::{Coat, CoatOptions};
pub use dielectric::{DiffuseTransmission, RoughDielectric, SmoothDielectric, Tint};
pub use discrete::{Discrete, PiecewiseConstant2d};
pub use frame::ShadingFrame;
pub use fresnel::ComplexIor;
pub use glossy::{Plastic, Substrate};
pub use layered::{Layered, Layers};
pub use metal_coat::MetalCoat;
pub use microfacet::TrowbridgeReitz;
pub(crate) use sample::power_heuristic_over_pdf;
pub use sample::{BsdfSample, power_heuristic};

/// A parameter of a BSDF or a distribution is out of its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A microfacet width is outside `[0, 10]`.
    #[error("roughness makes a microfacet width of {value}; give one from 0 (smooth) to 10")]
    Roughness {
        /// The invalid microfacet width.
        value: f32,
    },
    /// An index of refraction is outside `[0.1, 10]`.
    #[error("an index of refraction is {value}; give one from 0.1 to 10 (1.5 is common)")]
    Eta {
        /// The invalid index of refraction.
        value: f32,
    },
    /// A coat's thickness is negative or not finite.
    #[error("a coat's thickness is {value}; give a finite one from 0 up")]
    Thickness {
        /// The invalid optical thickness.
        value: f32,
    },
    /// A weight is negative, infinite or NaN.
    #[error("weight {index} is {value}; weights must be finite and not negative")]
    Weight {
        /// The index of the invalid weight.
        index: usize,
        /// The invalid weight.
        value: f32,
    },
    /// A distribution would have more items, or more cells along a side, than it can hold.
    #[error("{count} items or cells a side are more than the {most} that a distribution holds; merge some")]
    TooMany {
        /// The number of items, or of cells along the side.
        count: usize,
        /// The largest number of items, or of cells along a side, that a distribution holds.
        most: usize,
    },
    /// The number of weights given differs from the number of cells, columns times rows.
    #[error("{count} weights do not fill a grid of {} columns x {} rows; give one per cell", .size[0], .size[1])]
    Shape {
        /// The number of weights given.
        count: usize,
        /// The numbers of columns and rows.
        size: [usize; 2],
    },
}
