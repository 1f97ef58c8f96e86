//! The samplers.

use crate::{
    AnyPoints, CLUSTERING, ClusterFirstHits, ClusterInputs, Entry, Parameter, Parameters, RegistryError, clustering,
};
use dapple_adaptive::{Adaptive, AdaptiveOptions, Cycles, CyclesOptions, ErrorMap, Sequence, VarianceOptions};
#[cfg(feature = "classics")]
use dapple_classics::{
    Awr, AwrOptions, CosineOptions, DctOptions, Divergence, DivergenceOptions, Ears, EarsOptions, FourierDofOptions,
    Gem, GemOptions, HierarchicalOptions, LensBandwidthOptions, MdasOptions, NlmLoop, NlmLoopOptions, Perceptual,
    PerceptualOptions, PlacedHandle, SubdivisionOptions, Sure, SureOptions, UpperConfidence, UpperConfidenceOptions,
    VarianceThreshold, VarianceThresholdOptions,
};
use dapple_cluster_adaptive::{
    ClusterSize, ClusterThesis, ClusterThesisOptions, FirstHitSource, FirstHitsHandle, Placement,
};
use dapple_core::options::Options as _;
use dapple_core::{Film, Filter, Frame, PointSet, Sampler, samplers::Uniform};
use dapple_denoise::{ClusterRegression, relative_errors};
use dapple_mitchell::{Mitchell, MitchellOptions, MitchellPbrt, MitchellPbrtOptions};
use std::sync::Arc;

/// The constructor of a sampler.
pub type MakeSampler = fn(&Parameters, AnyPoints, &dyn ClusterInputs) -> Result<MadeSampler, RegistryError>;

/// A sampler, and the first-hit rays that it traces.
pub struct MadeSampler {
    /// The sampler.
    pub sampler: Box<dyn Sampler>,
    /// The first-hit rays that the sampler traces for its first plan; stays empty if it traces none.
    pub first_hits: FirstHitsHandle,
    /// A handle to the samples that the sampler places itself; `None` if it places none.
    #[cfg(feature = "classics")]
    pub placed: Option<PlacedHandle>,
}

impl<S: Sampler + 'static> From<S> for MadeSampler {
    fn from(sampler: S) -> Self {
        Self {
            sampler: Box::new(sampler),
            first_hits: FirstHitsHandle::default(),
            #[cfg(feature = "classics")]
            placed: None,
        }
    }
}

/// All samplers of the registry.
pub const SAMPLERS: &[Entry<MakeSampler>] = &[
    Entry::new(
        "variance",
        "pooled variance of a pilot, Neyman counts on a ladder",
        "Dapple; counts in proportion to deviations: Neyman 1934",
        "light that the pilot misses gets few samples; gains no more than the unevenness of noise allows",
        &[VarianceOptions::PARAMETERS],
        |p, points, _| Ok(Adaptive::variance_with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "uniform",
        "the same count for every pixel",
        "none: the baseline",
        "as many samples where there is no noise as where all of it is",
        &[],
        |_, points, _| Ok(Uniform::new(points).into()),
    ),
    Entry {
        aliases: &["cluster"],
        ..Entry::new(
            "adaptive",
            "counts by error: the pooled variance of a pilot, or a filter's error map (the default)",
            "Dapple (docs/results/adaptive.md); counts: Neyman 1934; error maps of filters: Rousselle et al. 2012",
            "settings suit the default filter: without a filter, `variance` leaves less error",
            &[BY, AdaptiveOptions::PARAMETERS],
            adaptive,
        )
    },
    Entry::new(
        "mitchell",
        "contrast of a pilot, two rates (Mitchell 1987)",
        "Mitchell, Generating Antialiased Images at Low Sampling Densities, SIGGRAPH 1987",
        "contrast takes edges and textures for noise; two rates cannot follow how large noise is",
        &[MitchellOptions::PARAMETERS],
        |p, points, _| Ok(Mitchell::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "mitchell-pbrt",
        "pbrt-v2's variant: samples that deviate from the pixel's mean or hit different shapes, two rates",
        "pbrt, version 2: src/samplers/adaptive.cpp, by Pharr and Humphreys, 2010",
        "pixels that are refined lose their first samples; noise in four samples refines pixels at random",
        &[MitchellPbrtOptions::PARAMETERS],
        |p, points, _| Ok(MitchellPbrt::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "cycles",
        "the stopping rule of Blender's Cycles: pixels whose two halves differ go on",
        "Blender's Cycles: kernel/film/adaptive_sampling.h",
        "pixels whose two halves agree by chance stop for ever, which biases them",
        &[CyclesOptions::PARAMETERS],
        |p, points, _| Ok(Cycles::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "cluster-thesis",
        "few samples where large clusters are seen, many where small ones are (Lan 2016), unbiased",
        "Lan, Implementation and Optimization of Monte Carlo Ray Tracing, 2016 (docs/THESIS.md)",
        "geometry alone makes the counts: textures, materials and caustics have no part; clusters and first-hit rays cost as much as \
                   tens of samples of a simple scene",
        &[PROBES, ClusterThesisOptions::PARAMETERS, A_PRIORI, CLUSTERING],
        cluster_thesis,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "gem",
        "samples for the pixels with the largest error under a Gaussian of selected scale (Rousselle 2011)",
        "Rousselle, Knaus and Zwicker, Adaptive Sampling and Reconstruction using Greedy Error Minimization, 2011",
        "counts suit Gaussians; filters that know features leave other errors",
        &[GemOptions::PARAMETERS],
        |p, points, _| Ok(Gem::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "nlm-loop",
        "counts by the difference of two halves after non-local means (Rousselle 2012)",
        "Rousselle, Knaus and Zwicker, Adaptive Rendering with Non-Local Means Filtering, 2012",
        "the filter runs once per round, and costs as much time as many samples of a simple scene",
        &[NlmLoopOptions::PARAMETERS],
        |p, points, _| Ok(NlmLoop::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "awr",
        "samples for blocks of pixels by the variance of their wavelets (after Overbeck 2009)",
        "after Overbeck, Donner and Ramamoorthi, Adaptive Wavelet Rendering, 2009",
        "counts suit wavelet shrinkage; filters that know features leave other errors",
        &[AwrOptions::PARAMETERS],
        |p, points, _| Ok(Awr::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "perceptual",
        "samples where noise is visible: contrast sensitivity and masking (after Bolin and Meyer 1998)",
        "after Bolin and Meyer, A Perceptually Based Adaptive Sampling Algorithm, SIGGRAPH 1998",
        "few samples in busy texture and in the dark: loses by squared error; FLIP is its metric",
        &[PerceptualOptions::PARAMETERS],
        |p, points, _| Ok(Perceptual::with_options(points, p.options()?)?.into()),
    ),
    Entry {
        aliases: &["then"],
        ..Entry::new(
            "sequence",
            "one sampler for the first samples, then another, which sees them as its pilot",
            "Lan, Implementation and Optimization of Monte Carlo Ray Tracing, 2016, as future work (docs/THESIS.md)",
            "a first stage that puts samples in the wrong place takes them from the second",
            &[SEQUENCE],
            sequence,
        )
    },
    #[cfg(feature = "classics")]
    Entry::classic(
        "variance-threshold",
        "samples until the confidence interval of the pixel's mean is narrow (after Kajiya 1986)",
        "Kajiya, The Rendering Equation, SIGGRAPH 1986; interval and defaults: Mitsuba's adaptive integrator",
        "pixels whose first samples agree stop for ever; variances are not pooled",
        &[VarianceThresholdOptions::PARAMETERS],
        |p, points, _| Ok(VarianceThreshold::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "mdas",
        "samples placed over image, lens, time and light where boxes of them differ; filter with mdas-boxes",
        "Hachisuka et al., Multidimensional Adaptive Sampling and Reconstruction for Ray Tracing, 2008; boxes: Meister and Hachisuka 2022",
        "noise of paths outside the domain looks like detail; a pilot of four samples per box misses what is small",
        &[MdasOptions::PARAMETERS],
        crate::classics::mdas,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "fourier-dof",
        "few pixels where the lens blurs, many samples where its light varies (after Soler 2009); filter with splat",
        "after Soler et al., Fourier Depth of Field, 2009",
        "knows no effect but the lens; shadows and noise of lights have no part in its counts",
        &[FourierDofOptions::PARAMETERS, LensBandwidthOptions::PARAMETERS],
        crate::classics::fourier_dof,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "dct",
        "samples where cosines fitted to blocks leave visible errors (after Bolin and Meyer 1995); filter with dct",
        "after Bolin and Meyer, A Frequency Based Ray Tracer, SIGGRAPH 1995",
        "noise looks like detail; counts suit cosines, and filters that know features leave other errors",
        &[DctOptions::PARAMETERS, CosineOptions::PARAMETERS],
        crate::classics::dct,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "ucb",
        "counts by an upper bound of each pixel's deviation (after Carpentier and Munos 2011)",
        "Carpentier and Munos, Finite Time Analysis of Stratified Sampling for Monte Carlo, NIPS 2011",
        "the bonus moves counts towards uniform ones; variances are not pooled",
        &[UpperConfidenceOptions::PARAMETERS],
        |p, points, _| Ok(UpperConfidence::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "subdivision",
        "parts of pixels split where samples contrast (after Whitted 1980); filter with tree-mean",
        "Whitted, An Improved Illumination Model for Shaded Display, 1980",
        "misses what four samples miss; noise keeps all parts of a pixel alive",
        &[SubdivisionOptions::PARAMETERS],
        crate::classics::placing::<SubdivisionOptions>,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "ears",
        "counts by error per ray: the splitting factor at the camera (after Rath 2022)",
        "Rath et al., EARS: Efficiency-Aware Russian Roulette and Splitting, 2022",
        "rays are not time; the published gains come from later vertices of a path",
        &[EarsOptions::PARAMETERS],
        |p, points, _| Ok(Ears::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "sure",
        "samples where the best filter of a bank still errs, by Stein's estimate (Li 2012)",
        "Li, Wu and Chuang, SURE-based Optimization for Adaptive Sampling and Reconstruction, 2012",
        "assumes Gaussian noise: fireflies look exact; planning costs as much as filtering",
        &[SureOptions::PARAMETERS],
        |p, points, _| Ok(Sure::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "divergence",
        "counts by f-divergences or entropies of each pixel's samples (after Rigau 2003)",
        "Rigau, Feixas and Sbert, Refinement Criteria Based on f-Divergences, and Entropy-based Adaptive Sampling, 2003; \
             fuzzy: Xu et al. 2008, not read; gh: Cui 2009, not read",
        "scores of single pixels are as noisy as their variances, which `variance` pools",
        &[DivergenceOptions::PARAMETERS],
        |p, points, _| Ok(Divergence::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "hierarchical",
        "hierarchical integration of pixels (after Kajiya 1986); filter with tree-mean:tree=contrast",
        "Kajiya, The Rendering Equation, 1986",
        "a well-distributed point set of known count beats it",
        &[HierarchicalOptions::PARAMETERS],
        crate::classics::placing::<HierarchicalOptions>,
    ),
];

const SEQUENCE: &[Parameter] = &[
    Parameter::new("first", "uniform", "The first sampler, with / for : and , (cluster-thesis/k=9/clamp=16)."),
    Parameter::new("spp", "4", "Samples per pixel that the first sampler spends at most, on average."),
    Parameter::new("second", "adaptive", "The second sampler, with / for : and , (// in a sampler inside that one)."),
];
const BY: &[Parameter] = &[Parameter::new(
    "by",
    "variance",
    "The error that counts follow: variance (of the pilot); with policy=keep also that of nlm, bilateral or cluster-regression.",
)];
const PROBES: &[Parameter] = &[
    Parameter::new("rays", "centre", "First-hit rays per pixel: centre (one, published), or so many jittered ones."),
    Parameter::new(
        "size",
        "box",
        "A cluster's size: box (projected box, published), triangles, screen (box in perspective), hits.",
    ),
];
const A_PRIORI: &[Parameter] =
    &[Parameter::new("policy", "a-priori", "Counts are planned from geometry alone: unbiased.")];

fn adaptive(p: &Parameters, points: AnyPoints, inputs: &dyn ClusterInputs) -> Result<MadeSampler, RegistryError> {
    let sampler = p.made(Adaptive::with_options(points, p.options()?))?;
    let Some(map) = error_map(p, inputs)? else { return Ok(sampler.into()) };
    Ok(p.made(sampler.with_error_map(map))?.into())
}

/// Creates the sampler `sequence`. Both of its samplers use the same point set.
fn sequence(p: &Parameters, points: AnyPoints, inputs: &dyn ClusterInputs) -> Result<MadeSampler, RegistryError> {
    let points: Arc<dyn PointSet> = Arc::from(points);
    let of = |key: &str| p.nested(key, |inner| crate::sampler(inner, Box::new(points.clone()), inputs));
    let spp = p.number("spp")?;
    let (first, second) = (of("first")?, of("second")?);
    let sampler = p.made(Sequence::new(first.sampler, spp, second.sampler))?;
    // The last samples belong to the second sampler.
    Ok(MadeSampler {
        sampler: Box::new(sampler),
        first_hits: first.first_hits.joined(second.first_hits),
        #[cfg(feature = "classics")]
        placed: second.placed.or(first.placed),
    })
}

/// The error map that a sampler uses in addition to the pooled variance: the error that a filter with default parameters
/// predicts for its image. For `cluster-regression`, it is the predicted error after one pass. `None` for `by=variance`.
fn error_map(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Option<ErrorMap>, RegistryError> {
    let name = p.choice("by", &["variance", "nlm", "bilateral", "cluster-regression"].map(|name| (name, name)))?;
    if name == "variance" {
        return Ok(None);
    }
    // The filter runs once per round. The first pass alone shows where errors are, at half of the cost and without clusters.
    let filter: Box<dyn Filter> = if name == "cluster-regression" {
        Box::new(ClusterRegression::new().one_pass())
    } else {
        crate::filter(name, inputs)?
    };
    let (needs, epsilon) = (filter.needs(), p.number("epsilon")?);
    let square = Frame::new(1024, 1024)?;
    let bytes_per_pixel = (filter.memory(&square, &needs).applying / square.pixels() as u64) as usize;
    let of = move |film: &Film| relative_errors(&filter.apply(film)?, epsilon);
    Ok(Some(ErrorMap { name: name.to_owned(), needs, of: Box::new(of), bytes_per_pixel }))
}

fn cluster_thesis(p: &Parameters, points: AnyPoints, inputs: &dyn ClusterInputs) -> Result<MadeSampler, RegistryError> {
    let placement = match p.value("rays") {
        "centre" => Placement::Centre,
        _ => Placement::Jittered(p.number("rays").map_err(|_| {
            p.refuse(format!("rays = \"{}\": use centre, or a number of rays per pixel", p.value("rays")))
        })?),
    };
    if !(1..=256).contains(&placement.per_pixel()) {
        return Err(p.refuse(format!("rays = \"{placement}\": use 1 to 256 per pixel, or centre")));
    }
    let size = p.choice("size", &["box", "triangles", "screen", "hits"].map(|size| (size, size)))?;
    let options: ClusterThesisOptions = p.options()?;
    p.choice("policy", &[("a-priori", ())])?;
    let params = clustering(p)?;
    p.made(options.check())?;

    let lacks = |what| RegistryError::NeedsWorld { of: p.of(), what };
    let first_hits =
        inputs.first_hits(&params).map_err(|e| e.of(p.of()))?.ok_or(lacks("clusters and first-hit rays"))?;
    let size = match size {
        "box" => ClusterSize::ProjectedBox,
        "hits" => ClusterSize::Hits,
        "screen" => ClusterSize::ScreenBox(inputs.world_to_clip().ok_or(lacks("the camera's matrix (size=screen)"))?),
        _ => {
            let vectors = p.made(inputs.area_vectors(&first_hits))?;
            ClusterSize::ProjectedTriangles(vectors.ok_or(lacks("the scene's triangles (size=triangles)"))?)
        }
    };
    let ClusterFirstHits { labels, clusters, shoot } = first_hits;
    let source = FirstHitSource { labels, clusters, shoot, placement, described: p.described(CLUSTERING) };
    let mut sampler = p.made(ClusterThesis::tracing(points, source, size, options))?;
    if options.lights > 0 {
        let visible = inputs.visibility().map_err(|e| e.of(p.of()))?;
        let visible = visible.ok_or(lacks("shadow rays to the scene's lights (lights=0 needs none)"))?;
        sampler = sampler.with_visibility(visible);
    }
    let first_hits = sampler.handle();
    Ok(MadeSampler { first_hits, ..sampler.into() })
}
