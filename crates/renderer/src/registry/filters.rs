//! The filters.

use super::{CLUSTERING, Entry, Parameter, Parameters, RegistryError, clustering};
use crate::Stage;
use dapple_core::{Filter, Unfiltered};
use dapple_reconstruction::{ClusterGaussian, Gaussian};
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
];

const GAUSSIAN: &[Parameter] = &[
    ("alpha", "0.5", "the kernel is exp(-alpha r^2) - exp(-alpha radius^2) along each axis"),
    ("radius", "4", "half its width in pixels"),
];
const CLUSTER_GAUSSIAN: &[Parameter] = &[
    ("outside", "0.05", "weight of a pixel of another cluster relative to one of the same"),
    ("hits", "1", "first hits that tell a pixel's clusters, 1 (published) to 8"),
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
