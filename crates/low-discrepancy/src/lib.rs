#![doc = include_str!("../README.md")]

mod error;
mod halton;
mod keys;
mod low_discrepancy;
mod random;
mod sobol;
mod stratified;

pub use error::Error;
pub use halton::Halton;
pub use low_discrepancy::LowDiscrepancy;
pub use random::Random;
pub use sobol::Sobol;
pub use stratified::Stratified;
