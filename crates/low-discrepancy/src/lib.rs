#![doc = include_str!("../README.md")]

mod blue_noise;
mod blue_noise_keys;
mod halton;
mod keys;
mod lattice;
mod low_discrepancy;
mod mitchell;
mod pmj02;
mod random;
mod sobol;

pub use blue_noise::BlueNoise;
pub use blue_noise_keys::BlueNoiseKeys;
pub use halton::Halton;
pub use lattice::Lattice;
pub use low_discrepancy::{LowDiscrepancy, ZSobol};
pub use mitchell::{Diffused, Mitchell1991};
pub use pmj02::Pmj02;
pub use random::{Random, Stratified};
pub use sobol::Sobol;

/// Invalid parameters of a point set. Each message has a remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A number of strata that is 0, or so large that `f32` coordinates cannot distinguish them.
    #[error("{strata} strata along each axis cannot be used: give 1 to {}", Stratified::MAX_STRATA)]
    BadStrata {
        /// The requested number of strata along each axis.
        strata: u32,
    },
    /// A number of samples per pixel that is 0, or so large that `f32` coordinates cannot distinguish them.
    #[error("a count of {count} samples per pixel cannot be used: give 1 to {}", LowDiscrepancy::MAX_COUNT)]
    BadCount {
        /// The requested number of samples per pixel.
        count: u32,
    },
}

impl From<Error> for dapple_core::Error {
    fn from(error: Error) -> Self {
        Self::Method(Box::new(error))
    }
}
