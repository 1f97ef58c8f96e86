//! The samplers.

use crate::{
    AnyPoints, CLUSTERING, ClusterInputs, ClusterProbes, Entry, Parameter, Parameters, RegistryError, clustering,
};
use dapple_adaptive::{Adaptive, AdaptiveOptions, Cycles, CyclesOptions, ErrorMap, VarianceOptions};
use dapple_cluster_adaptive::{ClusterSize, ClusterThesis, ClusterThesisOptions, Placement, ProbeSource, ProbesHandle};
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Options as _, Sampler};
use dapple_denoise::relative_errors;
use dapple_mitchell::{Mitchell, MitchellOptions, MitchellPbrt, MitchellPbrtOptions};

/// The constructor of a sampler.
pub type MakeSampler = fn(&Parameters, AnyPoints, &dyn ClusterInputs) -> Result<MadeSampler, RegistryError>;

/// A sampler, and the probes that it traces.
pub struct MadeSampler {
    /// The sampler.
    pub sampler: Box<dyn Sampler>,
    /// The probes that the sampler traces for its first plan; stays empty if it traces none.
    pub probes: ProbesHandle,
}

impl<S: Sampler + 'static> From<S> for MadeSampler {
    fn from(sampler: S) -> Self {
        Self { sampler: Box::new(sampler), probes: ProbesHandle::default() }
    }
}

/// All samplers of the registry.
pub const SAMPLERS: &[Entry<MakeSampler>] = &[
    Entry::new(
        "variance",
        "pooled variance of a pilot, Neyman counts on a ladder",
        &[VarianceOptions::PARAMETERS],
        |p, points, _| Ok(Adaptive::variance_with_options(points, p.options()?)?.into()),
    ),
    Entry::new("uniform", "the same count for every pixel", &[], |_, points, _| Ok(Uniform::new(points).into())),
    Entry {
        aliases: &["cluster"],
        ..Entry::new(
            "adaptive",
            "counts by error: pooled variance of a pilot, or a filter's error map; cells at hit points (the default)",
            &[BY, AdaptiveOptions::PARAMETERS],
            adaptive,
        )
    },
    Entry::new(
        "mitchell",
        "contrast of a pilot, two rates (Mitchell 1987)",
        &[MitchellOptions::PARAMETERS],
        |p, points, _| Ok(Mitchell::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "mitchell-pbrt",
        "pbrt-v2's variant: samples that deviate from the pixel's mean, two rates",
        &[MitchellPbrtOptions::PARAMETERS],
        |p, points, _| Ok(MitchellPbrt::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "cycles",
        "the stopping rule of Blender's Cycles: pixels whose two halves differ go on",
        &[CyclesOptions::PARAMETERS],
        |p, points, _| Ok(Cycles::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "cluster-thesis",
        "few samples where large clusters are seen, many where small ones are (Lan 2016), unbiased",
        &[PROBES, ClusterThesisOptions::PARAMETERS, A_PRIORI, CLUSTERING],
        cluster_thesis,
    ),
];

const BY: &[Parameter] = &[Parameter::new(
    "by",
    "variance",
    "The error that counts follow: variance (pooled, of the pilot), or that of nlm, bilateral or cluster-regression.",
)];
const PROBES: &[Parameter] = &[
    Parameter::new("probes", "centre", "Probe rays per pixel: centre (one, published), or so many jittered ones."),
    Parameter::new(
        "size",
        "box",
        "A cluster's size: box (projected box, published), triangles, screen (box in perspective), hits.",
    ),
];
const A_PRIORI: &[Parameter] =
    &[Parameter::new("policy", "a-priori", "Counts are planned from geometry alone: unbiased.")];

fn adaptive(p: &Parameters, points: AnyPoints, inputs: &dyn ClusterInputs) -> Result<MadeSampler, RegistryError> {
    let sampler = Adaptive::with_options(points, p.options()?).map_err(|e| p.refuse(e.to_string()))?;
    Ok(match error_map(p, inputs)? {
        Some(map) => sampler.with_error_map(map).map_err(|e| p.refuse(e.to_string()))?.into(),
        None => sampler.into(),
    })
}

/// The error map that a sampler uses besides the pooled variance: the error that a filter with default parameters
/// predicts for its image. For the regression filter, the error after one pass. `None` without a filter.
fn error_map(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Option<ErrorMap>, RegistryError> {
    let by = ["nlm", "bilateral", "cluster-regression"].map(|name| (name, Some(name)));
    let [nlm, bilateral, regression] = by;
    let Some(name) = p.choice("by", &[("variance", None), nlm, bilateral, regression])? else { return Ok(None) };
    // The filter runs once per round. Its first pass shows where errors are, at half of the cost and without clusters.
    let quick = if name == "cluster-regression" { "cluster-regression:passes=1,outside=1" } else { name };
    let filter = crate::filter(quick, inputs)?;
    let (needs, epsilon) = (filter.needs(), p.number("epsilon")?);
    let square = Frame::new(1024, 1024)?;
    let bytes_per_pixel = (filter.memory(&square, &needs).applying / square.pixels() as u64) as usize;
    let of = move |film: &Film| relative_errors(&filter.apply(film)?, epsilon);
    Ok(Some(ErrorMap { name: name.to_owned(), needs, of: Box::new(of), bytes_per_pixel }))
}

/// A cluster's size as the sampler's parameters give it, before the clusters exist.
#[derive(Clone, Copy)]
enum Size {
    Box,
    Triangles,
    Screen,
    Hits,
}

fn cluster_thesis(p: &Parameters, points: AnyPoints, inputs: &dyn ClusterInputs) -> Result<MadeSampler, RegistryError> {
    let placement = match p.value("probes") {
        "centre" => Placement::Centre,
        _ => Placement::Jittered(p.number("probes").map_err(|_| {
            p.refuse(format!("probes = \"{}\": centre, or a number of rays per pixel, is required", p.value("probes")))
        })?),
    };
    if !(1..=256).contains(&placement.per_pixel()) {
        return Err(p.refuse(format!("probes = \"{placement}\": 1 to 256 per pixel, or centre, are required")));
    }
    let sizes = [("box", Size::Box), ("triangles", Size::Triangles), ("screen", Size::Screen), ("hits", Size::Hits)];
    let size = p.choice("size", &sizes)?;
    let options: ClusterThesisOptions = p.options()?;
    p.choice("policy", &[("a-priori", ())])?;
    let params = clustering(p)?;
    options.check().map_err(|e| p.refuse(e.to_string()))?;

    let lacks = |what| RegistryError::NeedsWorld { of: p.of(), what };
    let probes = inputs.probes(&params).map_err(|e| e.of(p.of()))?.ok_or(lacks("clusters and first-hit probes"))?;
    let size = match size {
        Size::Box => ClusterSize::ProjectedBox,
        Size::Hits => ClusterSize::Hits,
        Size::Screen => {
            ClusterSize::ScreenBox(inputs.world_to_clip().ok_or(lacks("the camera's matrix (size=screen)"))?)
        }
        Size::Triangles => {
            let vectors = inputs.area_vectors(&probes).map_err(|e| p.refuse(e.to_string()))?;
            ClusterSize::ProjectedTriangles(vectors.ok_or(lacks("the scene's triangles (size=triangles)"))?)
        }
    };
    let ClusterProbes { labels, clusters, shoot } = probes;
    let source = ProbeSource { labels, clusters, shoot, placement, described: p.described(CLUSTERING) };
    let sampler = ClusterThesis::probing(points, source, size, options).map_err(|e| p.refuse(e.to_string()))?;
    Ok(MadeSampler { probes: sampler.handle(), sampler: Box::new(sampler) })
}
