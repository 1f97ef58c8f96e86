//! Methods that place samples or read their coordinates.

use crate::{AnyPoints, ClusterInputError, ClusterInputs, MadeSampler, Parameters, RegistryError};
use dapple_classics::{Dct, Domain, FilmPoints, FilterMethod, MdasOptions, MethodFilter, Refinement, TreeSampler};
use dapple_core::Filter;

/// The part that methods which place samples lack without a scene.
const DIMENSIONS: &str = "the meaning of the samples' dimensions";

fn refused(error: ClusterInputError, of: &'static str) -> RegistryError {
    match error {
        ClusterInputError::NoScene => RegistryError::NeedsWorld { of, what: DIMENSIONS },
        ClusterInputError::Failed(why) => RegistryError::Points { of, why },
    }
}

/// The dimensions in which a sampler places or reads samples.
fn domain(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Domain, RegistryError> {
    let domain = inputs.domain().map_err(|e| refused(e, p.of()))?;
    domain.ok_or(RegistryError::NeedsWorld { of: p.of(), what: DIMENSIONS })
}

/// The points of the samples that a filter reads.
fn film_points(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<FilmPoints, RegistryError> {
    let points = inputs.film_points().map_err(|e| refused(e, p.of()))?;
    points.ok_or(RegistryError::NeedsWorld { of: p.of(), what: "the coordinates of the film's samples" })
}

pub(crate) fn mdas(
    p: &Parameters,
    points: AnyPoints,
    inputs: &dyn ClusterInputs,
) -> Result<MadeSampler, RegistryError> {
    let options: MdasOptions = p.options()?;
    let domain = domain(p, inputs)?;
    if let Some(what) = domain.outside().filter(|_| options.force == 0) {
        let why = format!(
            "samples depend on {what}, and its noise looks like detail; force=1 samples the scene all the same"
        );
        return Err(RegistryError::Points { of: p.of(), why });
    }
    placing::<MdasOptions>(p, points, inputs)
}

pub(crate) fn placing<R: Refinement + 'static>(
    p: &Parameters,
    points: AnyPoints,
    inputs: &dyn ClusterInputs,
) -> Result<MadeSampler, RegistryError> {
    let sampler = TreeSampler::<_, R>::new(points, &domain(p, inputs)?, p.options()?)?;
    let placed = Some(sampler.placed());
    Ok(MadeSampler { placed, ..sampler.into() })
}

pub(crate) fn dct(p: &Parameters, points: AnyPoints, inputs: &dyn ClusterInputs) -> Result<MadeSampler, RegistryError> {
    Ok(Dct::new(points, &domain(p, inputs)?, p.options()?, p.options()?)?.into())
}

pub(crate) fn of_samples<M: FilterMethod<FilmPoints> + 'static>(
    p: &Parameters,
    inputs: &dyn ClusterInputs,
) -> Result<Box<dyn Filter>, RegistryError> {
    let options: M = p.options()?;
    Ok(Box::new(MethodFilter::new(film_points(p, inputs)?, options)?))
}
