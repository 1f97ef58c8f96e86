//! The default methods.

use dapple_adaptive::Adaptive;
use dapple_core::{Methods, PointSet};
use dapple_denoise::ClusterRegression;
use dapple_low_discrepancy::Sobol;

/// The name of the default sampler. The default of its parameter `epsilon` suits the default filter; without a filter,
/// an `epsilon` of 0.01 is better.
pub const DEFAULT_SAMPLER: &str = "adaptive";
/// The name of the default point set.
pub const DEFAULT_POINTS: &str = "sobol";
/// The name of the default filter (denoiser).
pub const DEFAULT_FILTER: &str = "cluster-regression";

/// Makes the default sampler with Sobol' points of this seed, and the default filter without clusters.
///
/// ```
/// use dapple_core::{Frame, Limits, Session};
///
/// let pair = dapple_registry::default_pair(7);
/// assert_eq!((pair.sampler.name(), pair.filter.as_ref().unwrap().name()), ("adaptive", "cluster-regression"));
/// let session = Session::new(Frame::new(8, 8)?, Limits::spp(16.0), pair)?;
/// # let _ = session;
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub fn default_pair(seed: u64) -> Methods<'static> {
    default_pair_with(Sobol::new(seed))
}

/// Makes the default sampler with these points, and the default filter without clusters.
///
/// With [`HostNumbers`](dapple_core::HostNumbers), the pair serves renderers that draw random numbers of their own.
pub fn default_pair_with(points: impl PointSet + 'static) -> Methods<'static> {
    Methods::from((Adaptive::new(points), ClusterRegression::new()))
}
