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

/// The error of an invalid point set parameter. Each message contains a remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The number of strata is 0, or so large that `f32` coordinates cannot distinguish them.
    #[error("{strata} strata along each axis are out of range; use 1 to {}", Stratified::MAX_STRATA)]
    BadStrata {
        /// The requested number of strata along each axis.
        strata: u32,
    },
    /// The number of samples per pixel is 0, or so large that `f32` coordinates cannot distinguish them.
    #[error("a count of {count} samples per pixel is out of range; use 1 to {}", LowDiscrepancy::MAX_COUNT)]
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
