//! The filters.

use super::{CLUSTERING, Entry, Parameter, Parameters, RegistryError, clustering};
use crate::Stage;
use dapple_core::{Filter, Unfiltered};
use dapple_denoise::{Bilateral, ClusterGaussian, ClusterLookup, ClusterRegression, Gaussian, NlMeans, Passes};
use std::sync::Arc;

/// How a filter is made.
pub type MakeFilter = fn(&Parameters, &Stage) -> Result<Box<dyn Filter>, RegistryError>;

/// The filters.
pub const FILTERS: &[Entry<MakeFilter>] = &[
    Entry {
        name: "none",
        about: "each pixel the mean of its own samples",
        parameters: &[],
        make: |_, _| Ok(Box::new(Unfiltered)),
    },
    Entry {
        name: "gaussian",
        about: "a Gaussian over pixel means",
        parameters: &[GAUSSIAN],
        make: |p, _| Ok(Box::new(gaussian(p)?)),
    },
    Entry {
        name: "cluster-gaussian",
        about: "the Gaussian, in which pixels of other clusters weigh less (Lan 2016)",
        parameters: &[GAUSSIAN, CLUSTER_GAUSSIAN, CLUSTERING],
        make: cluster_gaussian,
    },
    Entry {
        name: "nlm",
        about: "non-local means with two halves (Rousselle 2012)",
        parameters: &[NLM],
        make: |p, _| Ok(Box::new(nl_means(p)?)),
    },
    Entry {
        name: "bilateral",
        about: "cross-bilateral: near, of a similar surface and colour, in the same cluster",
        parameters: &[BILATERAL, CLUSTERING],
        make: bilateral,
    },
    Entry {
        name: "cluster-regression",
        about: "regression on features and clusters, twice, and the best of it and others by estimated error (the default)",
        parameters: &[CLUSTER_REGRESSION, CLUSTERING],
        make: cluster_regression,
    },
];

const GAUSSIAN: &[Parameter] = &[
    ("alpha", "0.5", "the kernel is exp(-alpha r^2) - exp(-alpha radius^2) along each axis"),
    ("radius", "4", "half its width in pixels"),
];
const CLUSTER_GAUSSIAN: &[Parameter] = &[
    ("outside", "0.05", "weight of a pixel of another cluster relative to one of the same"),
    ("hits", "1", "first hits that tell a pixel's clusters, 1 (published) to 8"),
];
const NLM: &[Parameter] = &[
    ("window", "7", "pixels searched to each side, 0 to 7"),
    ("patch", "3", "pixels compared to each side, 0 to 3"),
    ("k", "0.45", "differences are measured in this many standard deviations"),
    ("features", "none", "the same for first hits' normals, albedo and depth; none: only colours count (published)"),
];
const BILATERAL: &[Parameter] = &[
    ("window", "7", "pixels averaged to each side, 0 to 7"),
    ("falloff", "0.03", "the spatial weight is exp(-falloff r^2)"),
    ("colour", "0.8", "differences of colours are measured in this many standard deviations"),
    ("features", "1", "the same for first hits' normals, albedo and depth"),
    ("outside", "1", "weight of a pixel of another cluster relative to one of the same; 1: no clusters"),
];
const CLUSTER_REGRESSION: &[Parameter] = &[
    ("passes", "2", "2, or 1: regression alone, without a second pass and a choice"),
    ("outside", "0.2", "weight of a pixel of another cluster relative to one of the same; 1: no clusters"),
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

/// A filter with clusters of the world on `stage`, which are made only if they matter.
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
