//! The uniform sampler.

mod uniform;

pub use uniform::Uniform;

use crate::{Feedback, allocate};

/// Counts that differ by at most one: the same floor for every pixel, the rest of the budget spread
/// by a hash of the pixel's number.
fn level(seen: &Feedback<'_>, total: u64) -> Result<Vec<u32>, crate::Error> {
    let pixels = seen.pixels();
    let floors = vec![seen.budget.min_spp.min(u32::try_from(total / pixels as u64).unwrap_or(u32::MAX)); pixels];
    Ok(allocate(&vec![1.0; pixels], &floors, seen.budget.max_spp, total)?.counts)
}
