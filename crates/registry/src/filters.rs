//! The filters.

use crate::inputs::CLUSTERS;
use crate::{CLUSTERING, ClusterInputs, Entry, Parameters, RegistryError, clustering};
#[cfg(feature = "classics")]
use dapple_classics::{
    CosineOptions, GemFilter, GemFilterOptions, JamesStein, JamesSteinOptions, LensBandwidthOptions, MdasBoxesOptions,
    Nfor, NforOptions, NlmLoopFilter, NlmLoopFilterOptions, SplatOptions, StagedOptions, SureFilter, SureFilterOptions,
    TlfrOptions, TreeMeanOptions, Wavelet, WaveletOptions, Welch, WelchOptions,
};
use dapple_core::options::Options as _;
use dapple_core::{Filter, Unfiltered};
use dapple_denoise::{
    Bilateral, BilateralOptions, ClusterGaussian, ClusterGaussianOptions, ClusterLookup, ClusterRegression,
    ClusterRegressionOptions, Gaussian, GaussianOptions, NlMeans, NlMeansOptions,
};
#[cfg(feature = "oidn")]
use dapple_oidn::{Library, Oidn, OidnBlend, OidnOptions};
use std::sync::Arc;

/// The constructor of a filter.
pub type MakeFilter = fn(&Parameters, &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError>;

/// All filters of the registry.
pub const FILTERS: &[Entry<MakeFilter>] = &[
    Entry::new(
        "none",
        "each pixel is the mean of its own samples",
        "none: the mean of the samples",
        "all noise stays",
        &[],
        |_, _| Ok(Box::new(Unfiltered)),
    ),
    Entry::new(
        "gaussian",
        "a Gaussian over pixel means",
        "none: a Gaussian over pixels, as in textbooks",
        "blurs edges, textures and shadows alike; bias does not vanish with more samples",
        &[GaussianOptions::PARAMETERS],
        |p, _| Ok(Box::new(Gaussian::with_options(p.options()?)?)),
    ),
    Entry::new(
        "cluster-gaussian",
        "the Gaussian, with less weight on pixels of other clusters (Lan 2016)",
        "Lan, Implementation and Optimization of Monte Carlo Ray Tracing, 2016 (docs/THESIS.md)",
        "blurs textures and shadows within a cluster; bias does not vanish with more samples",
        &[GaussianOptions::PARAMETERS, ClusterGaussianOptions::PARAMETERS, CLUSTERING],
        cluster_gaussian,
    ),
    Entry::new(
        "nlm",
        "non-local means with two half-buffers (Rousselle 2012)",
        "Rousselle, Knaus and Zwicker, Adaptive Rendering with Non-Local Means Filtering, 2012",
        "strong noise hides which pixels are similar; each half-buffer is less well distributed than the whole set",
        &[NlMeansOptions::PARAMETERS],
        |p, _| Ok(Box::new(NlMeans::with_options(p.options()?)?)),
    ),
    Entry::new(
        "bilateral",
        "cross-bilateral filter on distance, colour, features and cluster",
        "Eisemann and Durand 2004; Petschnigg et al. 2004; with clusters by Dapple",
        "one width for all pixels: blurs soft shadows and reflections where normals, albedo and depth are alike",
        &[BilateralOptions::PARAMETERS, CLUSTERING],
        bilateral,
    ),
    Entry::new(
        "cluster-regression",
        "regressions on features and clusters, the best by estimated error, then a small trained network (the default)",
        "Dapple, after Moon et al. 2014, Bitterli et al. 2016 and Isik et al. 2021 (docs/results/learned.md)",
        "takes as long as tens of samples of a simple scene; blurs detail that no feature shows; blotches on smooth walls at few samples",
        &[ClusterRegressionOptions::PARAMETERS, CLUSTERING],
        cluster_regression,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "sure",
        "several cross non-local means, the best per pixel by Stein's estimate of the error (Li 2012)",
        "Li, Wu and Chuang, SURE-based Optimization for Adaptive Sampling and Reconstruction, 2012",
        "assumes Gaussian noise, so fireflies remain; 41x41 windows are slow",
        &[SureFilterOptions::PARAMETERS],
        |p, _| Ok(Box::new(SureFilter::with_options(p.options()?)?)),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "mdas-boxes",
        "reconstruction for sampler mdas: boxes weighted by volume",
        "Meister and Hachisuka, multidimensional adaptive sampling on GPUs, JCGT 11(2), 2022",
        "blurs by up to a pixel at few samples; noise from other dimensions stays",
        &[MdasBoxesOptions::PARAMETERS],
        crate::classics::of_samples::<MdasBoxesOptions>,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "splat",
        "reconstruction for sampler fourier-dof: Gaussians sized by local bandwidth (after Soler 2009)",
        "after Soler et al., Fourier Depth of Field, 2009; defaults: Dapple",
        "blurs shadows and reflections on smooth surfaces; slow if all pixels of a smooth image have samples",
        &[SplatOptions::PARAMETERS, LensBandwidthOptions::PARAMETERS],
        crate::classics::splat,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "tlfr",
        "samples reprojected over lens and time, for defocus and motion blur (Lehtinen 2011)",
        "Lehtinen et al., Temporal Light Field Reconstruction for Rendering Distribution Effects, 2011",
        "misplaces reflections; noise from other dimensions stays; takes as long as tens of samples",
        &[TlfrOptions::PARAMETERS],
        crate::classics::of_samples::<TlfrOptions>,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "james-stein",
        "blends another filter's result with the unfiltered image (James-Stein shrinkage; Gu 2022)",
        "Gu, Iglesias-Guitian and Moon, Neural James-Stein Combiner, 2022, without the network",
        "the filter sees only half of the samples; dark pixels beside bright noisy ones are filtered too strongly",
        &[OF, JamesSteinOptions::PARAMETERS],
        james_stein,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "welch",
        "mean of the pixels that Welch's t-test cannot tell apart (after Sakai 2024)",
        "Sakai et al., A Statistical Approach to Monte Carlo Denoising, 2024",
        "at few samples the test finds few differences, so it blurs; overestimates the variance of low-discrepancy samples",
        &[WelchOptions::PARAMETERS],
        |p, _| Ok(Box::new(Welch::with_options(p.options()?)?)),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "nfor",
        "two passes of regression on features, each with the better of two bandwidths (Bitterli 2016)",
        "Bitterli et al., Nonlinearly Weighted First-order Regression for Denoising Monte Carlo Renderings, 2016",
        "takes as long as tens of samples per pixel; overestimates the variance of low-discrepancy samples",
        &[NforOptions::PARAMETERS],
        |p, _| Ok(Box::new(Nfor::with_options(p.options()?)?)),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "tree-mean",
        "mean of a pixel's cells, weighted by area or volume; for samplers subdivision and hierarchical",
        "Kajiya, The Rendering Equation, 1986; Whitted, An Improved Illumination Model for Shaded Display, 1980",
        "the plain mean is better where points are spread evenly and counts are equal",
        &[TreeMeanOptions::PARAMETERS],
        crate::classics::of_samples::<TreeMeanOptions>,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "dct",
        "cosines fitted to blocks of 8x8 pixels, one term per two samples (after Bolin and Meyer 1995)",
        "after Bolin and Meyer, A Frequency Based Ray Tracer, SIGGRAPH 1995; defaults but that of `share`: Dapple",
        "visible blocks; ringing at edges and around lights",
        &[CosineOptions::PARAMETERS],
        crate::classics::of_samples::<CosineOptions>,
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "staged",
        "means of means over cells of 1/8, 1/4 and 1/2 pixel, so that clumps of samples count less (after Mitchell 1987)",
        "after Mitchell, Generating Antialiased Images at Low Sampling Densities, 1987",
        "the plain mean is better where points are spread evenly and counts are equal; wider boxes blur",
        &[StagedOptions::PARAMETERS],
        crate::classics::of_samples::<StagedOptions>,
    ),
    #[cfg(feature = "oidn")]
    Entry {
        feature: Some(OIDN),
        ..Entry::new(
            "oidn",
            "Intel Open Image Denoise, a neural network; its library is found at run time",
            "Intel Open Image Denoise (openimagedenoise.org)",
            "does not estimate its error; removes the light of single bright pixels; results differ between versions and processors",
            &[OidnOptions::PARAMETERS],
            |p, _| Ok(Box::new(oidn(p)?)),
        )
    },
    #[cfg(feature = "oidn")]
    Entry {
        feature: Some(OIDN),
        aliases: &["both"],
        ..Entry::new(
            "oidn-blend",
            "the mean of oidn and cluster-regression",
            "Dapple; the mean with Intel Open Image Denoise (docs/results/oidn.md)",
            "no estimate of its error; the default filter alone may be better at many samples",
            &[OidnOptions::PARAMETERS, ClusterRegressionOptions::PARAMETERS, CLUSTERING],
            oidn_blend,
        )
    },
    #[cfg(feature = "classics")]
    Entry::classic(
        "gem",
        "per pixel the Gaussian with the least estimated error (Rousselle 2011)",
        "Rousselle, Knaus and Zwicker, Adaptive Sampling and Reconstruction using Greedy Error Minimization, 2011",
        "round kernels without features blur textures and shadow edges at few samples",
        &[GemFilterOptions::PARAMETERS],
        |p, _| Ok(Box::new(GemFilter::with_options(p.options()?)?)),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "nlm-loop",
        "original NLM program: 21x21 window, symmetric weights (Rousselle 2012)",
        "Rousselle, Knaus and Zwicker, Adaptive Rendering with Non-Local Means Filtering, 2012",
        "no features; takes as long as tens of samples; nlm is faster",
        &[NlmLoopFilterOptions::PARAMETERS],
        |p, _| Ok(Box::new(NlmLoopFilter::with_options(p.options()?)?)),
    ),
    #[cfg(feature = "classics")]
    Entry::classic(
        "wavelet",
        "wavelet coefficients shrunk by their standard error (after Overbeck 2009)",
        "after Overbeck, Donner and Ramamoorthi, Adaptive Wavelet Rendering, 2009",
        "ringing and blotches at few samples; texture of low contrast vanishes",
        &[WaveletOptions::PARAMETERS],
        |p, _| Ok(Box::new(Wavelet::with_options(p.options()?)?)),
    ),
];

#[cfg(feature = "classics")]
const OF: &[crate::Parameter] = &[crate::Parameter::new(
    "of",
    "gaussian",
    "Filter to blend, with \"/\" in place of \":\" and \",\", such as gaussian/alpha=2. Filters that need half-buffers are refused.",
)];

#[cfg(feature = "classics")]
fn james_stein(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let of = p.nested("of", |inner| crate::filter(inner, inputs))?;
    Ok(Box::new(p.made(JamesStein::with_options(of, p.options()?))?))
}

/// The Cargo feature of the filters that use Open Image Denoise.
const OIDN: &str = "oidn";

/// Filters that are not built into this program, each with its Cargo feature.
pub const NOT_BUILT: &[(&str, &str)] =
    if cfg!(feature = "oidn") { &[] } else { &[("oidn", OIDN), ("oidn-blend", OIDN)] };

#[cfg(feature = "oidn")]
fn oidn(p: &Parameters) -> Result<Oidn, RegistryError> {
    let options = p.options::<OidnOptions>()?;
    let library = Library::load().map_err(|e| RegistryError::NoLibrary { of: p.of(), why: e.to_string() })?;
    Ok(Oidn::new(library, options))
}

/// Creates the filter. Loads the library first, so that its absence is reported before a scene is read.
#[cfg(feature = "oidn")]
fn oidn_blend(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let oidn = oidn(p)?;
    Ok(Box::new(OidnBlend::new(oidn, cluster_regression(p, inputs)?)))
}

/// The name of the filter that `best` selects: of the filters available on this machine, the one with the least error in the
/// published comparison.
pub fn best_filter() -> &'static str {
    let found = open_image_denoise().is_some_and(|library| library.is_ok());
    if found { "oidn-blend" } else { crate::DEFAULT_FILTER }
}

/// The library of the filters `oidn` and `oidn-blend`: its path and version, or instructions for installing it. `None` without
/// the feature `oidn`.
pub fn open_image_denoise() -> Option<Result<String, String>> {
    #[cfg(feature = "oidn")]
    return Some(Library::load().map(ToString::to_string).map_err(|e| e.to_string()));
    #[cfg(not(feature = "oidn"))]
    None
}

fn cluster_gaussian(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let (kernel, options) = (Gaussian::with_options(p.options()?)?, p.options()?);
    labelled(p, inputs, None, |label| {
        let plain = ClusterGaussian::from_hits(label).with_kernel(kernel.clone()).with_options(options)?;
        Ok(plain.with_described(p.described(CLUSTERING)))
    })
}

fn bilateral(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let plain = Bilateral::with_options(p.options()?)?;
    labelled(p, inputs, Some(plain.clone()), |label| Ok(plain.clone().with_clusters(label, p.described(CLUSTERING))))
}

fn cluster_regression(p: &Parameters, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let plain = ClusterRegression::with_options(p.options()?)?;
    labelled(p, inputs, Some(plain.clone()), |label| Ok(plain.clone().with_clusters(label, p.described(CLUSTERING))))
}

/// Creates a filter with the clusters of the scene. Clusters are requested only if the parameters use them. `without` is the
/// filter for scenes without clusters; with `None`, such scenes are an error.
fn labelled<F: Filter + 'static>(
    p: &Parameters,
    inputs: &dyn ClusterInputs,
    without: Option<F>,
    made: impl Fn(ClusterLookup) -> Result<F, RegistryError>,
) -> Result<Box<dyn Filter>, RegistryError> {
    let params = clustering(p)?;
    let unlabelled = made(Arc::new(|_, _| None))?;
    if !unlabelled.needs().surfaces && unlabelled.needs().first_hits == 0 {
        return Ok(Box::new(unlabelled));
    }
    match inputs.labels(&params).map_err(|e| e.of(p.of()))? {
        Some(labels) => Ok(Box::new(made(labels)?)),
        None => Ok(Box::new(without.ok_or(RegistryError::NeedsWorld { of: p.of(), what: CLUSTERS })?)),
    }
}
