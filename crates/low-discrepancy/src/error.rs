//! Errors of the constructors.

/// Invalid parameters of a point set. Each message tells what to do.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A grid without cells, or with more than `f32` coordinates can distinguish.
    #[error("{strata} strata along each axis cannot be used: give 1 to {}", crate::Stratified::MAX_STRATA)]
    BadStrata {
        /// The requested number of strata along each axis.
        strata: u32,
    },
    /// No samples, or more than `f32` coordinates can distinguish.
    #[error("a count of {count} samples per pixel cannot be used: give 1 to {}", crate::LowDiscrepancy::MAX_COUNT)]
    BadCount {
        /// The requested number of samples per pixel.
        count: u32,
    },
}
