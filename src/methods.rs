//! Samplers, point sets and filters by name, for hosts without clusters.

use dapple_core::{Error, Filter, PointSet, Sampler};
use dapple_registry::{HostClusters, PointSettings};

/// Makes a point set (where samples lie) from its description: `NAME` or `NAME:key=value,…`.
///
/// Some point sets suit one number of samples, which a parameter sets: `stratified:strata=8`, 8x8 cells, suits 64 samples.
///
/// ```
/// let points = dapple::points("sobol", 7)?;
/// assert_eq!(points.describe(), "sobol:seed=7");
/// # Ok::<(), dapple::Error>(())
/// ```
///
/// # Errors
///
/// [`Error::Method`] for an unknown name or key, or for a value out of range.
pub fn points(description: &str, seed: u64) -> Result<Box<dyn PointSet>, Error> {
    Ok(dapple_registry::points(description, PointSettings { seed, spp: None })?)
}

/// Makes a sampler (how many samples each pixel gets) from its description: `NAME` or `NAME:key=value,…`.
///
/// ```
/// let sampler = dapple::sampler("adaptive:epsilon=0.5", dapple::points("sobol", 7)?)?;
/// assert!(sampler.describe().contains("epsilon=0.5"));
///
/// let error = dapple::sampler("adaptiv", dapple::points("sobol", 7)?).err().expect("a typing error");
/// assert!(error.to_string().contains("did you mean \"adaptive\"?"));
/// # Ok::<(), dapple::Error>(())
/// ```
///
/// # Errors
///
/// [`Error::Method`] for an unknown name or key, or for a value out of range.
/// `cluster-thesis` needs clusters and first-hit rays: use `dapple_registry::sampler` for it.
pub fn sampler(description: &str, points: Box<dyn PointSet>) -> Result<Box<dyn Sampler>, Error> {
    Ok(dapple_registry::sampler(description, points, &HostClusters::none())?.sampler)
}

/// Makes a filter (denoiser) from its description: `NAME` or `NAME:key=value,…`.
///
/// ```
/// let filter = dapple::filter("cluster-regression")?;
/// assert!(filter.needs().features);
/// # Ok::<(), dapple::Error>(())
/// ```
///
/// # Errors
///
/// [`Error::Method`] for an unknown name or key, or for a value out of range.
/// `cluster-gaussian` needs clusters: use `dapple_registry::filter` for it.
pub fn filter(description: &str) -> Result<Box<dyn Filter>, Error> {
    Ok(dapple_registry::filter(description, &HostClusters::none())?)
}
