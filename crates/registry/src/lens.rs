//! Methods that know the lens before they sample.

use crate::{AnyPoints, ClusterInputError, ClusterInputs, LensProbes, MadeSampler, Parameters, RegistryError};
use dapple_classics::{FourierDof, FourierDofOptions, Splat};
use dapple_core::Filter;

fn probes(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<LensProbes, RegistryError> {
    let lacks = RegistryError::NeedsWorld { of: p.of(), what: "first hits through the centre of the lens" };
    match inputs.lens_probes() {
        Ok(probes) => probes.ok_or(lacks),
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
    let probes = probes(p, inputs)?;
    if !probes.has_lens && options.force == 0 {
        let why = "the camera has no lens, so nothing is out of focus; give it a lens radius, or force=1 to sample by the \
                   surfaces alone";
        return Err(p.refuse(why.to_owned()));
    }
    Ok(FourierDof::new(points, probes.trace, options, bandwidth)?.into())
}

pub(crate) fn splat(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let (options, bandwidth) = (p.options()?, p.options()?);
    Ok(Box::new(Splat::new(probes(p, inputs)?.trace, options, bandwidth)?))
}
