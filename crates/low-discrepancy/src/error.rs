//! Errors of the point sets' constructors.

use std::fmt;

/// Invalid parameters of a point set. Each message has a remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Error {
    /// A number of strata that is 0, or so large that `f32` coordinates cannot distinguish them.
    BadStrata {
        /// The requested number of strata along each axis.
        strata: u32,
    },
    /// A number of samples per pixel that is 0, or so large that `f32` coordinates cannot distinguish them.
    BadCount {
        /// The requested number of samples per pixel.
        count: u32,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadStrata { strata } => {
                write!(f, "{strata} strata along each axis cannot be used: give 1 to {}", crate::Stratified::MAX_STRATA)
            }
            Self::BadCount { count } => write!(
                f,
                "a count of {count} samples per pixel cannot be used: give 1 to {}",
                crate::LowDiscrepancy::MAX_COUNT
            ),
        }
    }
}

impl std::error::Error for Error {}
