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
    /// A handle to the samples whose coordinates the sampler chooses; `None` if the point set provides all coordinates.
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
        "Neyman allocation (counts in proportion to the standard deviation) from pooled pilot variance",
        "Dapple; allocation: Neyman 1934",
        "light that the pilot misses gets few samples; little gain if noise is evenly distributed",
        &[VarianceOptions::PARAMETERS],
        |p, points, _| Ok(Adaptive::variance_with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "uniform",
        "the same count for every pixel",
        "none: the baseline",
        "wastes samples where there is no noise",
        &[],
        |_, points, _| Ok(Uniform::new(points).into()),
    ),
    Entry {
        aliases: &["cluster"],
        ..Entry::new(
            "adaptive",
            "the default sampler: counts follow the estimated error (pooled pilot variance or a filter's error map)",
            "Dapple (docs/results/adaptive.md); counts: Neyman 1934; error maps of filters: Rousselle et al. 2012",
            "settings suit the default filter; without a filter, `variance` leaves less error",
            &[BY, AdaptiveOptions::PARAMETERS],
            adaptive,
        )
    },
    Entry::new(
        "mitchell",
        "two sampling levels, chosen by the contrast of a pilot (Mitchell 1987)",
        "Mitchell, Generating Antialiased Images at Low Sampling Densities, SIGGRAPH 1987",
        "mistakes edges and textures for noise; two levels cannot adapt to the amount of noise",
        &[MitchellOptions::PARAMETERS],
        |p, points, _| Ok(Mitchell::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "mitchell-pbrt",
        "pbrt-v2's variant: more samples for pixels whose pilot samples differ in luminance or in the shape hit",
        "pbrt, version 2: src/samplers/adaptive.cpp, by Pharr and Humphreys, 2010",
        "refined pixels lose their pilot samples; with only four pilot samples, noise decides which pixels are refined",
        &[MitchellPbrtOptions::PARAMETERS],
        |p, points, _| Ok(MitchellPbrt::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "cycles",
        "the stopping rule of Blender's Cycles: keep sampling pixels whose two halves differ",
        "Blender's Cycles: kernel/film/adaptive_sampling.h",
        "pixels whose two halves agree by chance stop too early, which biases them",
        &[CyclesOptions::PARAMETERS],
        |p, points, _| Ok(Cycles::with_options(points, p.options()?)?.into()),
    ),
    Entry::new(
        "cluster-thesis",
        "fewer samples on large groups of similar triangles (clusters), more on small ones (Lan 2016), unbiased",
        "Lan, Implementation and Optimization of Monte Carlo Ray Tracing, 2016 (docs/THESIS.md)",
        "ignores textures, materials and caustics; clusters and first-hit rays cost as much as tens of samples of a simple scene",
        &[PROBES, ClusterThesisOptions::PARAMETERS, A_PRIORI, CLUSTERING],
        cluster_thesis,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "gem",
        "more samples where the best Gaussian per pixel still has most error (Rousselle 2011)",
        "Rousselle, Knaus and Zwicker, Adaptive Sampling and Reconstruction using Greedy Error Minimization, 2011",
        "counts do not suit feature-guided filters",
        &[GemOptions::PARAMETERS],
        |p, points, _| Ok(Gem::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "nlm-loop",
        "counts follow the difference of two half-buffers after non-local means (Rousselle 2012)",
        "Rousselle, Knaus and Zwicker, Adaptive Rendering with Non-Local Means Filtering, 2012",
        "runs its filter in every round, which takes as long as rendering many samples of a simple scene",
        &[NlmLoopOptions::PARAMETERS],
        |p, points, _| Ok(NlmLoop::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "awr",
        "more samples for blocks of pixels whose wavelet coefficients are noisy (after Overbeck 2009)",
        "after Overbeck, Donner and Ramamoorthi, Adaptive Wavelet Rendering, 2009",
        "counts suit wavelet shrinkage, not feature-guided filters",
        &[AwrOptions::PARAMETERS],
        |p, points, _| Ok(Awr::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "perceptual",
        "more samples where noise is visible: contrast sensitivity and masking (after Bolin and Meyer 1998)",
        "after Bolin and Meyer, A Perceptually Based Adaptive Sampling Algorithm, SIGGRAPH 1998",
        "few samples in busy texture and in the dark, so more squared error than uniform counts; judge it by FLIP, not MSE",
        &[PerceptualOptions::PARAMETERS],
        |p, points, _| Ok(Perceptual::with_options(points, p.options()?)?.into()),
    ),
    Entry {
        aliases: &["then"],
        ..Entry::new(
            "sequence",
            "one sampler for the first samples, then another, which uses them as its pilot",
            "Lan, Implementation and Optimization of Monte Carlo Ray Tracing, 2016, as future work (docs/THESIS.md)",
            "a poor first sampler wastes budget",
            &[SEQUENCE],
            sequence,
        )
    },
    #[cfg(feature = "classics")]
    Entry::classic(
        "variance-threshold",
        "keep sampling until the confidence interval of the pixel's mean is narrow (after Kajiya 1986)",
        "Kajiya, The Rendering Equation, SIGGRAPH 1986; interval and defaults: Mitsuba's adaptive integrator",
        "pixels whose first samples agree stop too early; variances are not pooled",
        &[VarianceThresholdOptions::PARAMETERS],
        |p, points, _| Ok(VarianceThreshold::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "mdas",
        "samples in image x lens x time x light space, refined where cells vary (Hachisuka 2008); filter with mdas-boxes",
        "Hachisuka et al., Multidimensional Adaptive Sampling and Reconstruction for Ray Tracing, 2008; boxes: Meister and Hachisuka 2022; defaults of pilot and pixel: Dapple",
        "noise from other dimensions is mistaken for detail; features that the pilot misses are found late or never",
        &[MdasOptions::PARAMETERS],
        crate::classics::mdas,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "fourier-dof",
        "sparse pixels in defocused areas, more lens samples where radiance varies over the lens (after Soler 2009); filter with splat",
        "after Soler et al., Fourier Depth of Field, 2009; defaults: Dapple",
        "accounts for defocus only, not for shadows or noisy lights",
        &[FourierDofOptions::PARAMETERS, LensBandwidthOptions::PARAMETERS],
        crate::classics::fourier_dof,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "dct",
        "more samples where cosines fitted to 8x8 pixels leave visible errors (after Bolin and Meyer 1995); filter with dct",
        "after Bolin and Meyer, A Frequency Based Ray Tracer, SIGGRAPH 1995; defaults but that of `share`: Dapple",
        "mistakes noise for detail; counts do not suit feature-guided filters",
        &[DctOptions::PARAMETERS, CosineOptions::PARAMETERS],
        crate::classics::dct,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "ucb",
        "counts follow an upper confidence bound of each pixel's deviation (after Carpentier and Munos 2011)",
        "Carpentier and Munos, Finite Time Analysis of Stratified Sampling for Monte Carlo, NIPS 2011",
        "the bonus for uncertainty makes counts more uniform; variances are not pooled",
        &[UpperConfidenceOptions::PARAMETERS],
        |p, points, _| Ok(UpperConfidence::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "subdivision",
        "pixels split into quadrants where samples differ (after Whitted 1980); filter with tree-mean",
        "Whitted, An Improved Illumination Model for Shaded Display, 1980",
        "misses what four samples miss; noise forces splitting everywhere",
        &[SubdivisionOptions::PARAMETERS],
        crate::classics::placing::<SubdivisionOptions>,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "ears",
        "counts follow the error relative to ray count (EARS splitting at the camera; after Rath 2022)",
        "Rath et al., EARS: Efficiency-Aware Russian Roulette and Splitting, 2022",
        "ray count is only a proxy for time; the published gains come from later path vertices",
        &[EarsOptions::PARAMETERS],
        |p, points, _| Ok(Ears::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "sure",
        "more samples where the best of several filters still has most error, by Stein's estimate (Li 2012)",
        "Li, Wu and Chuang, SURE-based Optimization for Adaptive Sampling and Reconstruction, 2012",
        "assumes Gaussian noise, so fireflies remain; setting counts takes as long as filtering",
        &[SureOptions::PARAMETERS],
        |p, points, _| Ok(Sure::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "divergence",
        "counts follow f-divergences or entropies of each pixel's samples (after Rigau 2003)",
        "Rigau, Feixas and Sbert, Refinement Criteria Based on f-Divergences, and Entropy-based Adaptive Sampling, 2003; \
             fuzzy: Xu et al. 2008; gh: Cui 2009 (neither text was available)",
        "scores come from single pixels, so they are noisy; sampler `variance` averages over neighbours",
        &[DivergenceOptions::PARAMETERS],
        |p, points, _| Ok(Divergence::with_options(points, p.options()?)?.into()),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "hierarchical",
        "splits cells of sample space where samples differ (after Kajiya 1986); filter with tree-mean:tree=contrast",
        "Kajiya, The Rendering Equation, 1986",
        "worse than a good point set with fixed counts",
        &[HierarchicalOptions::PARAMETERS],
        crate::classics::placing::<HierarchicalOptions>,
    ),
];

const SEQUENCE: &[Parameter] = &[
    Parameter::new(
        "first",
        "uniform",
        "First sampler, with \"/\" in place of \":\" and \",\", such as cluster-thesis/k=9/clamp=16.",
    ),
    Parameter::new("spp", "4", "Maximum mean number of samples per pixel of the first sampler."),
    Parameter::new(
        "second",
        "adaptive",
        "Second sampler, written like the first; a sampler nested in it has \"//\" in place of \":\" and \",\".",
    ),
];
const BY: &[Parameter] = &[Parameter::new(
    "by",
    "variance",
    "Error estimate for counts: variance (of the pilot) or, with policy=keep, the error map of nlm, bilateral or cluster-regression.",
)];
const PROBES: &[Parameter] = &[
    Parameter::new(
        "rays",
        "centre",
        "First-hit rays per pixel: centre (one through the centre, as published), or a number of jittered rays.",
    )
    .alias("probes"),
    Parameter::new(
        "size",
        "box",
        "Size of a cluster: box (projected area of its bounding box, as published), triangles (that of its triangles), screen (its box in pixels) or hits (pixels that see it).",
    ),
];
const A_PRIORI: &[Parameter] =
    &[Parameter::new("policy", "a-priori", "a-priori: counts follow from geometry alone (unbiased); the only value.")];

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
