//! The default methods.

use dapple_adaptive::Adaptive;
use dapple_core::{Filter, Sampler};
use dapple_denoise::ClusterRegression;
use dapple_low_discrepancy::Sobol;

/// The name of the default sampler. The default of its parameter `epsilon` suits the default filter; without a filter,
/// an `epsilon` of 0.01 is better.
pub const DEFAULT_SAMPLER: &str = "adaptive";
/// The name of the default point set.
pub const DEFAULT_POINTS: &str = "sobol";
/// The name of the default filter (denoiser).
pub const DEFAULT_FILTER: &str = "cluster-regression";

/// A sampler, and the filter that makes the image from its samples.
pub struct SamplerAndFilter {
    /// The sampler.
    pub sampler: Box<dyn Sampler>,
    /// The filter.
    pub filter: Box<dyn Filter>,
}

impl From<SamplerAndFilter> for (Box<dyn Sampler>, Box<dyn Filter>) {
    fn from(SamplerAndFilter { sampler, filter }: SamplerAndFilter) -> Self {
        (sampler, filter)
    }
}

/// Makes the default sampler with Sobol' points of this seed, and the default filter without clusters.
///
/// ```
/// let pair = dapple_registry::default_pair(7);
/// assert_eq!((pair.sampler.name(), pair.filter.name()), ("adaptive", "cluster-regression"));
/// ```
pub fn default_pair(seed: u64) -> SamplerAndFilter {
    SamplerAndFilter { sampler: Box::new(Adaptive::new(Sobol::new(seed))), filter: Box::new(ClusterRegression::new()) }
}
