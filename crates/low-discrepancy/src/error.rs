//! What a constructor refuses.

/// Why a point set cannot be made. Each message says what to do.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A grid without cells, or with more than an `f32` can tell apart.
    #[error("{strata} strata along each axis cannot be used: give 1 to {}", crate::Stratified::MAX_STRATA)]
    BadStrata {
        /// Strata asked for.
        strata: u32,
    },
    /// No samples, or more than an `f32` can tell apart.
    #[error("a count of {count} samples per pixel cannot be used: give 1 to {}", crate::LowDiscrepancy::MAX_COUNT)]
    BadCount {
        /// Samples per pixel asked for.
        count: u32,
    },
}
