//! The default methods.

use dapple_adaptive::Adaptive;
use dapple_core::{Filter, Methods, Needs, Sampler};
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

impl From<SamplerAndFilter> for Methods<'static> {
    fn from(SamplerAndFilter { sampler, filter }: SamplerAndFilter) -> Self {
        Self { sampler, filter: Some(filter), needs: Needs::none() }
    }
}

/// Makes the default sampler with Sobol' points of this seed, and the default filter without clusters.
///
/// ```
/// use dapple_core::{Frame, Limits, Session};
///
/// let pair = dapple_registry::default_pair(7);
/// assert_eq!((pair.sampler.name(), pair.filter.name()), ("adaptive", "cluster-regression"));
/// let session = Session::new(Frame::new(8, 8)?, Limits::samples(16 * 64), pair)?;
/// # let _ = session;
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub fn default_pair(seed: u64) -> SamplerAndFilter {
    SamplerAndFilter { sampler: Box::new(Adaptive::new(Sobol::new(seed))), filter: Box::new(ClusterRegression::new()) }
}
