//! What every Dapple point set, sampler and filter must pass, called with one line each.

mod filter;
mod sampler;

pub use filter::{filter, filter_on_frames};
pub use sampler::{Spending, bits, sampler, sampler_on_frames, threshold_sampler};
