#![doc = include_str!("../README.md")]

mod blue_noise;
mod blue_noise_keys;
mod diffused;
mod error;
mod halton;
mod keys;
mod lattice;
mod low_discrepancy;
mod mitchell_1991;
mod optimised_keys;
mod pixel_pattern;
mod pmj02;
mod random;
mod sobol;
mod stratified;
mod void_and_cluster;
mod zsobol;

pub use blue_noise::BlueNoise;
pub use blue_noise_keys::BlueNoiseKeys;
pub use diffused::Diffused;
pub use error::Error;
pub use halton::Halton;
pub use lattice::Lattice;
pub use low_discrepancy::LowDiscrepancy;
pub use mitchell_1991::Mitchell1991;
pub use pmj02::Pmj02;
pub use random::Random;
pub use sobol::Sobol;
pub use stratified::Stratified;
pub use zsobol::ZSobol;
