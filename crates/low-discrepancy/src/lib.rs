//! See the crate's README.

mod keys;
mod random;
mod sobol;

pub use random::Random;
pub use sobol::Sobol;
