//! The filters.

use super::{CLUSTERING, Entry, Parameters, RegistryError, clustering};
use crate::Stage;
use dapple_core::{Filter, Options as _, Unfiltered};
use dapple_denoise::{
    Bilateral, BilateralOptions, ClusterGaussian, ClusterGaussianOptions, ClusterLookup, ClusterRegression,
    ClusterRegressionOptions, Gaussian, GaussianOptions, NlMeans, NlMeansOptions,
};
use std::sync::Arc;

/// The constructor of a filter.
pub type MakeFilter = fn(&Parameters, &Stage) -> Result<Box<dyn Filter>, RegistryError>;

/// All filters of the registry.
pub const FILTERS: &[Entry<MakeFilter>] = &[
    Entry::new("none", "each pixel the mean of its own samples", &[], |_, _| Ok(Box::new(Unfiltered))),
    Entry::new("gaussian", "a Gaussian over pixel means", &[GaussianOptions::PARAMETERS], |p, _| {
        Ok(Box::new(Gaussian::with_options(p.options()?)?))
    }),
    Entry::new(
        "cluster-gaussian",
        "the Gaussian, in which pixels of other clusters weigh less (Lan 2016)",
        &[GaussianOptions::PARAMETERS, ClusterGaussianOptions::PARAMETERS, CLUSTERING],
        cluster_gaussian,
    ),
    Entry::new("nlm", "non-local means with two halves (Rousselle 2012)", &[NlMeansOptions::PARAMETERS], |p, _| {
        Ok(Box::new(NlMeans::with_options(p.options()?)?))
    }),
    Entry::new(
        "bilateral",
        "cross-bilateral: near, of a similar surface and colour, in the same cluster",
        &[BilateralOptions::PARAMETERS, CLUSTERING],
        bilateral,
    ),
    Entry::new(
        "cluster-regression",
        "regression on features and clusters, twice, and the best of it and others by estimated error (the default)",
        &[ClusterRegressionOptions::PARAMETERS, CLUSTERING],
        cluster_regression,
    ),
];

fn cluster_gaussian(p: &Parameters, stage: &Stage) -> Result<Box<dyn Filter>, RegistryError> {
    let (kernel, options) = (Gaussian::with_options(p.options()?)?, p.options()?);
    labelled(p, stage, |label| {
        let plain = ClusterGaussian::from_hits(label).with_kernel(kernel.clone()).with_options(options)?;
        Ok(plain.with_described(p.described(CLUSTERING)))
    })
}

fn bilateral(p: &Parameters, stage: &Stage) -> Result<Box<dyn Filter>, RegistryError> {
    let plain = Bilateral::with_options(p.options()?)?;
    labelled(p, stage, |label| Ok(plain.clone().with_clusters(label, p.described(CLUSTERING))))
}

fn cluster_regression(p: &Parameters, stage: &Stage) -> Result<Box<dyn Filter>, RegistryError> {
    let plain = ClusterRegression::with_options(p.options()?)?;
    labelled(p, stage, |label| Ok(plain.clone().with_clusters(label, p.described(CLUSTERING))))
}

/// Makes a filter with the clusters of the world on `stage`. Clusters are computed only if the parameters use them.
fn labelled<F: Filter + 'static>(
    p: &Parameters,
    stage: &Stage,
    made: impl Fn(ClusterLookup) -> Result<F, RegistryError>,
) -> Result<Box<dyn Filter>, RegistryError> {
    let params = clustering(p)?;
    params.check().map_err(|e| p.refuse(e.to_string()))?;
    let without = made(Arc::new(|_| None))?;
    if without.needs().first_hits == 0 {
        return Ok(Box::new(without));
    }
    let clusters = stage.clusters(p.of(), &params)?;
    Ok(Box::new(made(Arc::new(move |hit| clusters.label(hit)))?))
}
