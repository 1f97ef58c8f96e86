//! The filters.

use super::{CLUSTERING, Entry, Parameter, Parameters, RegistryError, clustering};
use crate::Stage;
use dapple_core::{Filter, Unfiltered};
use dapple_denoise::{Bilateral, ClusterGaussian, ClusterLookup, ClusterRegression, Gaussian, NlMeans, Passes};
use std::sync::Arc;

/// The constructor of a filter.
pub type MakeFilter = fn(&Parameters, &Stage) -> Result<Box<dyn Filter>, RegistryError>;

/// All filters of the registry.
pub const FILTERS: &[Entry<MakeFilter>] = &[
    Entry::new("none", "each pixel the mean of its own samples", &[], |_, _| Ok(Box::new(Unfiltered))),
    Entry::new("gaussian", "a Gaussian over pixel means", &[GAUSSIAN], |p, _| Ok(Box::new(gaussian(p)?))),
    Entry::new(
        "cluster-gaussian",
        "the Gaussian, in which pixels of other clusters weigh less (Lan 2016)",
        &[GAUSSIAN, CLUSTER_GAUSSIAN, CLUSTERING],
        cluster_gaussian,
    ),
    Entry::new("nlm", "non-local means with two halves (Rousselle 2012)", &[NLM], |p, _| Ok(Box::new(nl_means(p)?))),
    Entry::new(
        "bilateral",
        "cross-bilateral: near, of a similar surface and colour, in the same cluster",
        &[BILATERAL, CLUSTERING],
        bilateral,
    ),
    Entry::new(
        "cluster-regression",
        "regression on features and clusters, twice, and the best of it and others by estimated error (the default)",
        &[CLUSTER_REGRESSION, CLUSTERING],
        cluster_regression,
    ),
];

const GAUSSIAN: &[Parameter] = &[
    Parameter::new("alpha", "0.5", "The kernel is exp(-alpha r^2) - exp(-alpha radius^2) along each axis."),
    Parameter::new("radius", "4", "Half its width in pixels."),
];
const CLUSTER_GAUSSIAN: &[Parameter] = &[
    Parameter::new("outside", "0.05", "Weight of a pixel of another cluster relative to one of the same."),
    Parameter::new("hits", "1", "First hits that tell a pixel's clusters, 1 (published) to 8."),
];
const NLM: &[Parameter] = &[
    Parameter::new("window", "7", "Pixels searched to each side, 0 to 7."),
    Parameter::new("patch", "3", "Pixels compared to each side, 0 to 3."),
    Parameter::new("k", "0.45", "Differences are measured in this many standard deviations."),
    Parameter::new(
        "features",
        "none",
        "The same for first hits' normals, albedo and depth; none: only colours count (published).",
    ),
];
const BILATERAL: &[Parameter] = &[
    Parameter::new("window", "7", "Pixels averaged to each side, 0 to 7."),
    Parameter::new("falloff", "0.03", "The spatial weight is exp(-falloff r^2)."),
    Parameter::new("colour", "0.8", "Differences of colours are measured in this many standard deviations."),
    Parameter::new("features", "1", "The same for first hits' normals, albedo and depth."),
    Parameter::new("outside", "1", "Weight of a pixel of another cluster relative to one of the same; 1: no clusters."),
];
const CLUSTER_REGRESSION: &[Parameter] = &[
    Parameter::new("passes", "2", "2, or 1: regression alone, without a second pass and a choice."),
    Parameter::new(
        "outside",
        "0.2",
        "Weight of a pixel of another cluster relative to one of the same; 1: no clusters.",
    ),
];

fn gaussian(p: &Parameters) -> Result<Gaussian, RegistryError> {
    Ok(Gaussian::new(p.number("alpha")?, p.number("radius")?)?)
}

fn cluster_gaussian(p: &Parameters, stage: &Stage) -> Result<Box<dyn Filter>, RegistryError> {
    let (kernel, outside, hits) = (gaussian(p)?, p.number("outside")?, p.number("hits")?);
    let made = |label| ClusterGaussian::from_hits(hits, label)?.with_kernel(kernel.clone()).with_outside(outside);
    let params = clustering(p)?;
    params.check().map_err(|e| p.refuse(e.to_string()))?;
    made(Arc::new(|_| None))?;
    let clusters = stage.clusters(p.of(), &params)?;
    Ok(Box::new(made(Arc::new(move |hit| clusters.label(hit)))?.with_described(p.described(CLUSTERING))))
}

fn nl_means(p: &Parameters) -> Result<NlMeans, RegistryError> {
    let plain = NlMeans::new(p.number("window")?, p.number("patch")?, p.number("k")?)?;
    Ok(if p.value("features") == "none" { plain } else { plain.with_features(p.number("features")?)? })
}

fn bilateral(p: &Parameters, stage: &Stage) -> Result<Box<dyn Filter>, RegistryError> {
    let plain = Bilateral::new(p.number("window")?, p.number("falloff")?)?;
    let plain = plain.with_bandwidths(p.number("colour")?, p.number("features")?)?;
    let made =
        |label| plain.clone().with_clusters(label, p.number("outside")?, p.described(CLUSTERING)).map_err(Into::into);
    labelled(p, stage, made)
}

fn cluster_regression(p: &Parameters, stage: &Stage) -> Result<Box<dyn Filter>, RegistryError> {
    let passes = p.choice("passes", &[("1", Passes::One), ("2", Passes::Two)])?;
    let plain = ClusterRegression::new().with_passes(passes);
    let made =
        |label| plain.clone().with_clusters(label, p.number("outside")?, p.described(CLUSTERING)).map_err(Into::into);
    labelled(p, stage, made)
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
