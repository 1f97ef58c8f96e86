//! Methods that place samples themselves, read sample coordinates, or use the lens's blur for planning.

use crate::{AnyPoints, ClusterInputError, ClusterInputs, LensFirstHits, MadeSampler, Parameters, RegistryError};
use dapple_classics::{
    Dct, Domain, FilmPoints, FilterMethod, FourierDof, FourierDofOptions, MdasOptions, MethodFilter, Refinement, Splat,
    TreeSampler,
};
use dapple_core::Filter;

/// The input that methods need from a scene to place samples, for messages.
const DIMENSIONS: &str = "the meaning of the samples' dimensions";

fn refused(error: ClusterInputError, of: &'static str) -> RegistryError {
    match error {
        ClusterInputError::NoScene => RegistryError::NeedsWorld { of, what: DIMENSIONS },
        ClusterInputError::Failed(why) => RegistryError::Points { of, why },
    }
}

/// The meaning of the sample dimensions, for methods that place samples or read their coordinates.
fn domain(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Domain, RegistryError> {
    let domain = inputs.domain().map_err(|e| refused(e, p.of()))?;
    domain.ok_or(RegistryError::NeedsWorld { of: p.of(), what: DIMENSIONS })
}

/// The coordinates of the film's samples, for a filter that reads them.
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
            "samples depend on {what}, whose noise the sampler would take for detail; set force=1 to render anyway"
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

/// The tracer of first hits through the centre of the lens.
fn lens_first_hits(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<LensFirstHits, RegistryError> {
    let lacks = RegistryError::NeedsWorld { of: p.of(), what: "first hits through the centre of the lens" };
    match inputs.lens_first_hits() {
        Ok(first_hits) => first_hits.ok_or(lacks),
        Err(ClusterInputError::NoScene) => Err(lacks),
        Err(ClusterInputError::Failed(why)) => Err(p.refuse(why)),
    }
}

pub(crate) fn fourier_dof(
    p: &Parameters,
    points: AnyPoints,
    inputs: &dyn ClusterInputs,
) -> Result<MadeSampler, RegistryError> {
    let (options, bandwidth): (FourierDofOptions, _) = (p.options()?, p.options()?);
    let first_hits = lens_first_hits(p, inputs)?;
    if !first_hits.has_lens && options.force == 0 {
        let why = "the camera has no lens, so nothing is out of focus; give the camera a lens radius, or set force=1 to \
                   sample by the surfaces alone";
        return Err(p.refuse(why));
    }
    Ok(FourierDof::new(points, first_hits.trace, options, bandwidth)?.into())
}

pub(crate) fn splat(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let (options, bandwidth) = (p.options()?, p.options()?);
    Ok(Box::new(Splat::new(lens_first_hits(p, inputs)?.trace, options, bandwidth)?))
}
