//! The filters.

use crate::inputs::CLUSTERS;
use crate::{CLUSTERING, ClusterInputs, Entry, Parameters, RegistryError, clustering};
use dapple_core::{Filter, Options as _, Unfiltered};
use dapple_denoise::{
    Bilateral, BilateralOptions, ClusterGaussian, ClusterGaussianOptions, ClusterLookup, ClusterRegression,
    ClusterRegressionOptions, Gaussian, GaussianOptions, NlMeans, NlMeansOptions,
};
#[cfg(feature = "oidn")]
use dapple_oidn::{Both, Library, Oidn, OidnOptions};
use std::sync::Arc;

/// The constructor of a filter.
pub type MakeFilter = fn(&Parameters, &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError>;

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
    #[cfg(feature = "oidn")]
    Entry {
        feature: Some(OIDN),
        ..Entry::new(
            "oidn",
            "Intel Open Image Denoise, a neural network; its library is found at run time",
            &[OidnOptions::PARAMETERS],
            |p, _| Ok(Box::new(oidn(p)?)),
        )
    },
    #[cfg(feature = "oidn")]
    Entry {
        feature: Some(OIDN),
        ..Entry::new(
            "both",
            "the mean of oidn and cluster-regression",
            &[OidnOptions::PARAMETERS, ClusterRegressionOptions::PARAMETERS, CLUSTERING],
            both,
        )
    },
];

/// The feature of filters by Open Image Denoise.
const OIDN: &str = "oidn";

/// Filters that this program was built without, each with its Cargo feature.
pub const NOT_BUILT: &[(&str, &str)] = if cfg!(feature = "oidn") { &[] } else { &[("oidn", OIDN), ("both", OIDN)] };

#[cfg(feature = "oidn")]
fn oidn(p: &Parameters) -> Result<Oidn, RegistryError> {
    let options = p.options::<OidnOptions>()?;
    let library = Library::load().map_err(|e| RegistryError::NoLibrary { of: p.of(), why: e.to_string() })?;
    Ok(Oidn::new(library, options))
}

/// The library is loaded first, so that its absence is reported before a scene is read.
#[cfg(feature = "oidn")]
fn both(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let oidn = oidn(p)?;
    Ok(Box::new(Both::new(oidn, cluster_regression(p, inputs)?)))
}

fn cluster_gaussian(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let (kernel, options) = (Gaussian::with_options(p.options()?)?, p.options()?);
    labelled(p, inputs, None, |label| {
        let plain = ClusterGaussian::from_hits(label).with_kernel(kernel.clone()).with_options(options)?;
        Ok(plain.with_described(p.described(CLUSTERING)))
    })
}

fn bilateral(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let plain = Bilateral::with_options(p.options()?)?;
    labelled(p, inputs, Some(plain.clone()), |label| Ok(plain.clone().with_clusters(label, p.described(CLUSTERING))))
}

fn cluster_regression(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let plain = ClusterRegression::with_options(p.options()?)?;
    labelled(p, inputs, Some(plain.clone()), |label| Ok(plain.clone().with_clusters(label, p.described(CLUSTERING))))
}

/// Makes a filter with the clusters of the scene. Clusters are requested only if the parameters use them. `without` is
/// the filter for scenes without clusters; `None` refuses these.
fn labelled<F: Filter + 'static>(
    p: &Parameters,
    inputs: &dyn ClusterInputs,
    without: Option<F>,
    made: impl Fn(ClusterLookup) -> Result<F, RegistryError>,
) -> Result<Box<dyn Filter>, RegistryError> {
    let params = clustering(p)?;
    let unlabelled = made(Arc::new(|_| None))?;
    if unlabelled.needs().first_hits == 0 {
        return Ok(Box::new(unlabelled));
    }
    match inputs.labels(&params).map_err(|e| e.of(p.of()))? {
        Some(labels) => Ok(Box::new(made(labels)?)),
        None => Ok(Box::new(without.ok_or(RegistryError::NeedsWorld { of: p.of(), what: CLUSTERS })?)),
    }
}
