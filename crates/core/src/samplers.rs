//! The uniform sampler, and the sequence of two samplers.

mod then;
mod uniform;

pub use then::Then;
pub use uniform::Uniform;

use crate::{Feedback, allocate, saturating_u32};

/// Returns counts per pixel that sum to `total` and differ by at most one. A hash of the pixel's index picks the pixels
/// that get the remainder.
fn level(seen: &Feedback<'_>, total: u64) -> Result<Vec<u32>, crate::Error> {
    let pixels = seen.pixels();
    let floors = vec![seen.budget.min_spp.min(saturating_u32(total / pixels as u64)); pixels];
    Ok(allocate(&vec![1.0; pixels], &floors, seen.budget.max_spp, total)?.counts)
}
