//! The samplers, point sets and filters of `dapple-registry` by name, made for a world.

mod inputs;

pub use dapple_registry::{
    AnyPoints, Entry, FILTERS, MakeFilter, MakePoints, MakeSampler, NOT_BUILT, POINTS, Parameter, Parameters,
    RegistryError, SAMPLERS, Setting, check_filter, check_points, check_sampler, points, verdicts,
};
pub use inputs::{MethodInputs, film_points};

use crate::WorldClusters;
use dapple_classics::PlacedHandle;
use dapple_cluster_adaptive::ProbesHandle;
use dapple_core::{Filter, Sampler};
use inputs::OnWorld;
use std::sync::Arc;

/// A sampler, and the clusters and probes that it uses.
pub struct MadeSampler {
    /// The sampler.
    pub sampler: Box<dyn Sampler>,
    /// The clusters; `None` if it uses none.
    pub clusters: Option<Arc<WorldClusters>>,
    /// The probes that the sampler traces for its first plan; stays empty if it traces none.
    pub probes: ProbesHandle,
    /// The samples that the sampler places; `None` if it places none.
    pub placed: Option<PlacedHandle>,
}

/// A filter, and the clusters that it uses.
pub struct MadeFilter {
    /// The filter.
    pub filter: Box<dyn Filter>,
    /// The clusters; `None` if it uses none.
    pub clusters: Option<Arc<WorldClusters>>,
}

/// Makes a sampler from its description (`NAME` or `NAME:key=value,…`), with the point set `points`.
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
/// [`RegistryError::NeedsWorld`] if the sampler reads the world and `inputs` has none.
pub fn sampler(description: &str, points: AnyPoints, inputs: &MethodInputs) -> Result<MadeSampler, RegistryError> {
    let inputs = OnWorld::new(inputs);
    let dapple_registry::MadeSampler { sampler, probes, placed } =
        dapple_registry::sampler(description, points, &inputs)?;
    Ok(MadeSampler { sampler, clusters: inputs.into_used(), probes, placed })
}

/// Makes a filter (denoiser) from its description (`NAME` or `NAME:key=value,…`).
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
/// [`RegistryError::NotBuilt`] for a filter whose feature is off, [`RegistryError::NoLibrary`] for one whose library is
/// missing. [`RegistryError::NeedsWorld`] if the filter reads the world and `inputs` has none.
pub fn filter(description: &str, inputs: &MethodInputs) -> Result<MadeFilter, RegistryError> {
    let inputs = OnWorld::new(inputs);
    let filter = dapple_registry::filter(description, &inputs)?;
    Ok(MadeFilter { filter, clusters: inputs.into_used() })
}
