//! How surfaces scatter light, and how to sample it: warps, discrete distributions, frames, Fresnel terms,
//! microfacets and BSDFs.
//!
//! Everything here is a pure function of small `Copy` values: the per-sample path allocates nothing and
//! cannot fail. Directions are unit vectors; those of a BSDF lie in the shading frame, where the normal is
//! +z, and both `wo` and `wi` point away from the surface.

pub mod bsdf;
pub mod frame;
pub mod fresnel;
pub mod microfacet;
pub mod mis;
pub mod trigonometry;
pub mod warp;

pub use bsdf::{Bsdf, BsdfSample};
pub use frame::Frame;
pub use fresnel::ComplexIor;
pub use microfacet::TrowbridgeReitz;
pub use mis::power_heuristic;

/// Why something of this module could not be made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A microfacet width is outside `[0, 10]`.
    #[error("roughness stands for a microfacet width of {value}; give one from 0 (smooth) to 10")]
    Roughness {
        /// The width.
        value: f32,
    },
}
