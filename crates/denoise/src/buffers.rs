//! Denoising of image buffers from any renderer: slices in, an image and its error out.

pub(crate) mod film;
mod warnings;

use crate::{ClusterRegression, ClusterRegressionOptions, FireflyLight};
use dapple_core::{Error, Film, Filter, Filtered, filter::filled};
use std::sync::Arc;
pub use warnings::{Warning, warnings_of};

/// The variance of each pixel: of one sample, or of the mean of all `n` samples, which is `n` times smaller. Renderers
/// write one or the other. `T` is `[f32; 3]` for colours and vectors (one variance per channel), `f32` for depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Variance<'a, T = [f32; 3]> {
    /// The variance of one sample, as pbrt-v4's `Variance` layers hold it.
    OfSamples(&'a [T]),
    /// The variance of the pixel's mean: the squared standard error.
    OfMean(&'a [T]),
}

/// The number of samples of each pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Counts<'a> {
    /// The same number in all pixels.
    All(u32),
    /// One number per pixel. Pixels without samples are filled from their neighbours.
    Each(&'a [u32]),
}

impl From<u32> for Counts<'_> {
    fn from(count: u32) -> Self {
        Self::All(count)
    }
}

impl<'a> From<&'a [u32]> for Counts<'a> {
    fn from(counts: &'a [u32]) -> Self {
        Self::Each(counts)
    }
}

impl<'a> From<&'a Vec<u32>> for Counts<'a> {
    fn from(counts: &'a Vec<u32>) -> Self {
        Self::Each(counts)
    }
}

/// One set of samples per pixel, in row-major order from the top: mean radiance, sample count, and variance if known.
///
/// Radiance is linear RGB. `buffer.as_chunks::<3>().0` turns a slice of floats into a slice of colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleBuffers<'a> {
    mean: &'a [[f32; 3]],
    count: Counts<'a>,
    variance: Option<Variance<'a>>,
}

impl<'a> SampleBuffers<'a> {
    /// Creates buffers from the mean radiance of each pixel and the number of samples: a slice, or one number for all pixels.
    ///
    /// If the number is unknown, pass any value, such as 16: the ratios between pixels matter most.
    pub fn new(mean: &'a [[f32; 3]], count: impl Into<Counts<'a>>) -> Self {
        Self { mean, count: count.into(), variance: None }
    }

    /// The number of samples of pixel `i`; 0 if its mean is NaN or infinite.
    fn samples(&self, i: usize) -> u64 {
        if self.mean[i].iter().all(|x| x.is_finite()) { self.count.of(i) } else { 0 }
    }

    /// Sets the variance per channel.
    ///
    /// The variance is optional for two halves, and required for a single set of samples.
    #[must_use]
    pub fn variance(self, variance: Variance<'a>) -> Self {
        Self { variance: Some(variance), ..self }
    }
}

impl Counts<'_> {
    /// The number of samples of pixel `i`.
    fn of(&self, i: usize) -> u64 {
        u64::from(match self {
            Self::All(count) => *count,
            Self::Each(counts) => counts[i],
        })
    }
}

impl<'a> Variance<'a> {
    /// The same variances as a flat slice: the channels of one pixel after another.
    fn flat(self) -> Variance<'a, f32> {
        match self {
            Self::OfSamples(values) => Variance::OfSamples(values.as_flattened()),
            Self::OfMean(values) => Variance::OfMean(values.as_flattened()),
        }
    }

    /// The variance of one sample of pixel `i`, which has `count` samples.
    fn of_sample(self, i: usize, count: u64) -> [f64; 3] {
        [0, 1, 2].map(|c| self.flat().of_sample(3 * i + c, count))
    }
}

impl<'a> Variance<'a, f32> {
    fn values(self) -> &'a [f32] {
        match self {
            Self::OfSamples(values) | Self::OfMean(values) => values,
        }
    }

    /// The variance of one sample computed from entry `i`, which belongs to a pixel with `count` samples.
    fn of_sample(self, i: usize, count: u64) -> f64 {
        match self {
            Self::OfSamples(values) => f64::from(values[i]),
            Self::OfMean(values) => f64::from(values[i]) * count as f64,
        }
    }
}

/// A buffer of features (the channels of one pixel after another) and its variance, if known.
#[derive(Clone, Copy, Debug)]
struct Feature<'a> {
    mean: &'a [f32],
    variance: Option<Variance<'a, f32>>,
}

impl<'a> Feature<'a> {
    /// The values of a feature with three channels.
    fn colours(&self) -> &'a [[f32; 3]] {
        self.mean.as_chunks::<3>().0
    }
}

/// The indices of the features in [`Denoise::features`].
const NORMAL: usize = 0;
const ALBEDO: usize = 1;
const POSITION: usize = 2;
const DEPTH: usize = 3;

/// Denoises an image given as buffers: two independent halves of its samples, such as two renders with different seeds.
///
/// `size` is width and height in pixels. Features are added by the methods of [`Denoise`]; [`Denoise::run`] returns the
/// image and its estimated error.
///
/// ```
/// use dapple_denoise::{SampleBuffers, denoise};
///
/// let size = [32, 16];
/// # let noise = |i: usize, seed: usize| ((i * 7919 + seed * 104_729) % 1009) as f32 / 1009.0;
/// # let [a, b] = [1, 2].map(|seed| (0..512).map(|i| [0.5 + noise(i, seed); 3]).collect::<Vec<_>>());
/// # let (n, albedo, p) = (vec![[0.0, 1.0, 0.0]; 512], vec![[0.5; 3]; 512], vec![[1.0, 0.0, 2.0]; 512]);
/// let (half_a, half_b) = (SampleBuffers::new(&a, 8), SampleBuffers::new(&b, 8));
/// let image = denoise(size, &half_a, &half_b).normal(&n).albedo(&albedo).position(&p).run()?;
/// assert_eq!(image.radiance.len(), 512);
/// # let mse = |image: &[[f32; 3]]| image.iter().map(|c| (c[0] - 1.0).powi(2)).sum::<f32>();
/// # assert!(mse(&image.radiance) < 0.2 * mse(&a) && image.error.is_some());
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub fn denoise<'a>(size: [u32; 2], half_a: &SampleBuffers<'a>, half_b: &SampleBuffers<'a>) -> Denoise<'a> {
    Denoise::new(size, *half_a, Some(*half_b))
}

/// Denoises an image given as the mean of all samples and its variance, for renderers that keep no halves.
///
/// The image `x` is split into two halves `x + s` and `x - s`, where `s` is the pixel's standard error with a random sign
/// [after Rasines and Young 2022; Leiner et al. 2023]. Their mean is `x`, so no light is lost. True halves have less error;
/// `docs/book/src/denoise-buffers.md` shows how much.
///
/// ```
/// use dapple_denoise::{SampleBuffers, Variance, denoise_whole};
///
/// # let noise = |i: usize| ((i * 7919) % 1009) as f32 / 1009.0;
/// # let (mean, variance): (Vec<_>, Vec<_>) = (0..512).map(|i| ([0.5 + noise(i); 3], [1.0 / 12.0; 3])).unzip();
/// # let depth = vec![2.0; 512];
/// let all = SampleBuffers::new(&mean, 16).variance(Variance::OfMean(&variance));
/// let image = denoise_whole([32, 16], &all).depth(&depth).run()?;
/// # assert_eq!(image.size, [32, 16]);
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub fn denoise_whole<'a>(size: [u32; 2], all: &SampleBuffers<'a>) -> Denoise<'a> {
    Denoise::new(size, *all, None)
}

/// An image to be denoised, given as buffers. [`denoise`] and [`denoise_whole`] create it.
///
/// Features are means over each pixel's samples. All features are optional; more features leave less error. A pixel is a
/// miss if its [coverage](Denoise::coverage) is 0. Without coverage, a pixel is a miss if all given normals, positions and
/// depths are misses: 0, or a depth of at least 10^10.
#[derive(Clone)]
#[must_use = "`run` denoises the image"]
pub struct Denoise<'a> {
    size: [u32; 2],
    /// The samples of the first half, or all samples if there is no `second`.
    first: SampleBuffers<'a>,
    second: Option<SampleBuffers<'a>>,
    features: [Option<Feature<'a>>; 4],
    coverage: Option<&'a [f32]>,
    emission: Option<&'a [[f32; 3]]>,
    ids: Option<&'a [u32]>,
    filter: Option<&'a dyn Filter>,
    fireflies: FireflyLight,
    is_strict: bool,
}

impl<'a> Denoise<'a> {
    fn new(size: [u32; 2], first: SampleBuffers<'a>, second: Option<SampleBuffers<'a>>) -> Self {
        let features = [None; 4];
        let (coverage, emission, ids, filter) = (None, None, None, None);
        let fireflies = FireflyLight::default();
        Self { size, first, second, features, coverage, emission, ids, filter, fireflies, is_strict: false }
    }

    fn feature(mut self, place: usize, mean: &'a [f32], variance: Option<Variance<'a, f32>>) -> Self {
        self.features[place] = Some(Feature { mean, variance });
        self
    }

    /// Adds shading normals: of unit length, or shorter where they vary within a pixel.
    pub fn normal(self, mean: &'a [[f32; 3]]) -> Self {
        self.feature(NORMAL, mean.as_flattened(), None)
    }

    /// Adds noisy shading normals with their variance.
    pub fn noisy_normal(self, mean: &'a [[f32; 3]], variance: Variance<'a>) -> Self {
        self.feature(NORMAL, mean.as_flattened(), Some(variance.flat()))
    }

    /// Adds the albedo, linear RGB in 0 to 1.
    pub fn albedo(self, mean: &'a [[f32; 3]]) -> Self {
        self.feature(ALBEDO, mean.as_flattened(), None)
    }

    /// Adds a noisy albedo with its variance.
    pub fn noisy_albedo(self, mean: &'a [[f32; 3]], variance: Variance<'a>) -> Self {
        self.feature(ALBEDO, mean.as_flattened(), Some(variance.flat()))
    }

    /// Adds positions, in any unit and any space.
    pub fn position(self, mean: &'a [[f32; 3]]) -> Self {
        self.feature(POSITION, mean.as_flattened(), None)
    }

    /// Adds noisy positions with their variance.
    pub fn noisy_position(self, mean: &'a [[f32; 3]], variance: Variance<'a>) -> Self {
        self.feature(POSITION, mean.as_flattened(), Some(variance.flat()))
    }

    /// Adds the depth: the distance from the camera, along the ray or along the view axis.
    ///
    /// Without [`Denoise::position`], positions are computed from depths and pixel coordinates; the field of view is not
    /// needed. Without [`Denoise::depth`], depths are estimated from the positions.
    pub fn depth(self, mean: &'a [f32]) -> Self {
        self.feature(DEPTH, mean, None)
    }

    /// Adds a noisy depth with its variance.
    pub fn noisy_depth(self, mean: &'a [f32], variance: Variance<'a, f32>) -> Self {
        self.feature(DEPTH, mean, Some(variance))
    }

    /// Adds the fraction of each pixel's samples that hit a surface, 0 to 1. All features must then be means over only the
    /// samples that hit a surface.
    ///
    /// The fraction must come from the image's own samples; with others, light leaks across the edges of light sources.
    pub fn coverage(self, share: &'a [f32]) -> Self {
        Self { coverage: Some(share), ..self }
    }

    /// Adds the mean emission of light sources seen directly by the image's own samples. Bright lights then stay in their
    /// pixels.
    pub fn emission(self, mean: &'a [[f32; 3]]) -> Self {
        Self { emission: Some(mean), ..self }
    }

    /// Adds the id of the object, material or group that each pixel shows. Pixels with another id get less weight.
    pub fn ids(self, ids: &'a [u32]) -> Self {
        Self { ids: Some(ids), ..self }
    }

    /// Sets the filter. The default is [`Denoise::default_filter`].
    pub fn filter(self, filter: &'a dyn Filter) -> Self {
        Self { filter: Some(filter), ..self }
    }

    /// Sets where the default filter puts the energy of fireflies.
    pub fn fireflies(self, light: FireflyLight) -> Self {
        Self { fireflies: light, ..self }
    }

    /// Returns the filter that is used if none is set: [`ClusterRegression`], with [`ids`](Self::ids), if set, as clusters.
    ///
    /// # Errors
    ///
    /// The errors of [`ClusterRegression::with_options`].
    pub fn default_filter(&self) -> Result<ClusterRegression, Error> {
        let options = ClusterRegressionOptions::default().fireflies(self.fireflies);
        let plain = ClusterRegression::with_options(options)?;
        Ok(if self.ids.is_some() { plain.with_clusters(Arc::new(|id, _| Some(id)), "ids") } else { plain })
    }

    /// Makes [`Denoise::run`] fail if [`Denoise::warnings`] finds anything.
    pub fn strict(self) -> Self {
        Self { is_strict: true, ..self }
    }

    /// Lists signs of swapped or wrong buffers. Examples: the noise between pixels contradicts the variance, the halves are too
    /// similar, width and height (or normals and albedo) are swapped, or numbers are out of range, NaN or huge.
    ///
    /// # Errors
    ///
    /// The errors of [`Denoise::run`].
    pub fn warnings(&self) -> Result<Vec<Warning>, Error> {
        check(self)?;
        Ok(warnings::warnings(self))
    }

    /// Creates a film (per-pixel statistics) from the buffers, for filters and error maps that read films.
    ///
    /// [`ids`](Self::ids) become the shape numbers of the film's first hits.
    ///
    /// # Errors
    ///
    /// The errors of [`Denoise::run`].
    pub fn film(&self) -> Result<Film, Error> {
        film::film(self)
    }

    /// Denoises the image. Pixels whose mean is NaN or infinite are filled from their neighbours.
    ///
    /// # Errors
    ///
    /// * [`Error::EmptyFrame`] and [`Error::FrameTooLarge`] for an invalid size.
    /// * [`Error::BadBuffer`] for a buffer of the wrong length, or with a number that is NaN, infinite or out of range. Mean
    ///   radiance may be NaN or infinite; depths may be infinite.
    /// * [`Error::BadBuffer`] if no pixel has a sample, both halves are equal, or a single set of samples has no variance.
    /// * [`Error::Other`] with the first warning, after a call of [`strict`](Self::strict).
    /// * The errors of the filter.
    pub fn run(&self) -> Result<Filtered, Error> {
        if self.is_strict
            && let Some(warning) = self.warnings()?.into_iter().next()
        {
            return Err(Error::other("the buffers", warning));
        }
        let film = self.film()?;
        if let Some(filter) = self.filter {
            return filled(filter, &film);
        }
        filled(&self.default_filter()?, &film)
    }

    /// Denoises the image and writes its pixels to `out`, in row-major order from the top.
    ///
    /// One [filter](Self::filter) serves any number of frames. Each call allocates and frees the film and the filter's memory.
    /// After an error, `out` is unchanged.
    ///
    /// ```
    /// use dapple_denoise::{ClusterRegression, ClusterRegressionOptions, SampleBuffers, denoise};
    ///
    /// # let noise = |i: usize, seed: usize| ((i * 7919 + seed * 104_729) % 1009) as f32 / 1009.0;
    /// let filter = ClusterRegression::with_options(ClusterRegressionOptions::default().network(false))?;
    /// let (depth, mut out) = (vec![2.0; 512], vec![[0.0; 3]; 512]);
    /// for frame in 0..3 {
    ///     # let [a, b] = [1, 2].map(|k| (0..512).map(|i| [noise(i, 2 * frame + k); 3]).collect::<Vec<_>>());
    ///     let (half_a, half_b) = (SampleBuffers::new(&a, 8), SampleBuffers::new(&b, 8));
    ///     denoise([32, 16], &half_a, &half_b).depth(&depth).filter(&filter).run_into(&mut out)?;
    ///     assert!((out[100][0] - 0.5).abs() < 0.2);
    /// }
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// The errors of [`Denoise::run`], and [`Error::BadBuffer`] if `out` has a different number of pixels.
    pub fn run_into(&self, out: &mut [[f32; 3]]) -> Result<(), Error> {
        check_length(self.size, out.len(), "out")?;
        out.copy_from_slice(&self.run()?.radiance);
        Ok(())
    }
}

/// The names of the buffers of a single set of samples: mean, count and variance.
const WHOLE: [&str; 3] = ["mean", "count", "variance"];
const HALVES: [[&str; 3]; 2] = [
    ["mean of half a", "count of half a", "variance of half a"],
    ["mean of half b", "count of half b", "variance of half b"],
];

/// For each feature: the names of its buffer and of its variance, the number of channels, and the rules for the values.
const FEATURES: [([&str; 2], usize, &[Rule]); 4] = [
    (["normal", "variance of the normal"], 3, FINITE),
    (["albedo", "variance of the albedo"], 3, FINITE),
    (["position", "variance of the position"], 3, FINITE),
    (["depth", "variance of the depth"], 1, DEPTHS),
];

/// A condition on a value, and the end of the error message if it is violated.
type Rule = (fn(f32) -> bool, &'static str);

const IS_FINITE: Rule = (f32::is_finite, "is NaN or infinite; use a finite number");
const FINITE: &[Rule] = &[IS_FINITE];
const SQUARES: &[Rule] = &[IS_FINITE, (|v| v >= 0.0, "is negative; use squared standard deviations")];
const DEPTHS: &[Rule] = &[(|d| d >= 0.0, "is NaN or negative; use 0 or infinity for a miss")];
const SHARES: &[Rule] =
    &[(|share| (0.0..=1.0).contains(&share), "is not in 0 to 1; use the fraction of the samples that hit a surface")];

const EQUAL: &str = "it equals the mean of half a, so the noise cannot be estimated; pass two renders with different seeds, or one render and its variance to denoise_whole()";
const ALONE: &str = "it is missing, and the noise of a single image cannot be estimated; pass its variance, or two halves (renders with different seeds) to denoise()";

/// A buffer: its name, its values, the number of values per pixel, and the rules for pixels with samples.
type Named<'a> = (&'static str, Option<&'a [f32]>, usize, &'static [Rule]);

fn bad(buffer: &'static str, what: impl Into<String>) -> Error {
    Error::BadBuffer { buffer, what: what.into() }
}

/// Checks all buffers of an image. Each error names the buffer and the remedy.
fn check(image: &Denoise<'_>) -> Result<(), Error> {
    let size = image.size;
    if let Some(second) = &image.second {
        check_samples(size, &image.first, HALVES[0])?;
        check_samples(size, second, HALVES[1])?;
        check_independent(&image.first, second)?;
    } else {
        check_samples(size, &image.first, WHOLE)?;
        image.first.variance.ok_or_else(|| bad("variance", ALONE))?;
    }
    let mut buffers: Vec<Named<'_>> = Vec::new();
    for (feature, ([name, of_variance], channels, rules)) in image.features.iter().zip(FEATURES) {
        buffers.push((name, feature.map(|f| f.mean), channels, rules));
        buffers.push((of_variance, feature.and_then(|f| f.variance).map(Variance::values), channels, SQUARES));
    }
    buffers.push(("coverage", image.coverage, 1, SHARES));
    buffers.push(("emission", image.emission.map(<[_]>::as_flattened), 3, FINITE));
    buffers.into_iter().try_for_each(|buffer| check_numbers(size, buffer, |_| true))?;
    image.ids.map_or(Ok(()), |ids| check_length(size, ids.len(), "ids"))
}

fn check_samples(size: [u32; 2], set: &SampleBuffers<'_>, names: [&'static str; 3]) -> Result<(), Error> {
    let [mean, count, variance] = names;
    if let Counts::Each(counts) = set.count {
        check_length(size, counts.len(), count)?;
    }
    check_length(size, set.mean.len(), mean)?;
    if (0..set.mean.len()).all(|i| set.samples(i) == 0) {
        return Err(bad(count, "no pixel has a sample; pass the sample count of each pixel, or one count for all"));
    }
    check_numbers(size, (variance, set.variance.map(|v| v.flat().values()), 3, SQUARES), |i| set.samples(i) > 0)
}

/// Returns an error if both halves are the same buffer or have equal values. Images of a single colour may be equal, as they
/// have no noise.
fn check_independent(a: &SampleBuffers<'_>, b: &SampleBuffers<'_>) -> Result<(), Error> {
    let first = a.mean.first();
    let plain = a.mean.len() == 1 || a.mean.iter().all(|colour| Some(colour) == first);
    let same = std::ptr::eq(a.mean, b.mean) || (!plain && a.mean == b.mean);
    if same { Err(bad(HALVES[1][0], EQUAL)) } else { Ok(()) }
}

/// Checks the values of a buffer in the pixels for which `counts` returns `true`.
fn check_numbers(
    size: [u32; 2],
    (name, values, channels, rules): Named<'_>,
    counts: impl Fn(usize) -> bool,
) -> Result<(), Error> {
    let Some(values) = values else { return Ok(()) };
    check_length(size, values.len() / channels, name)?;
    for (holds, what) in rules {
        let is_wrong = |(i, value): (usize, &[f32])| counts(i) && !value.iter().all(|v| holds(*v));
        if let Some(pixel) = values.chunks_exact(channels).enumerate().position(is_wrong) {
            let [x, y] = [pixel % size[0] as usize, pixel / size[0] as usize];
            return Err(bad(name, format!("pixel ({x}, {y}) {what}")));
        }
    }
    Ok(())
}

fn check_length([width, height]: [u32; 2], found: usize, name: &'static str) -> Result<(), Error> {
    let expected = u64::from(width) * u64::from(height);
    if found as u64 == expected {
        return Ok(());
    }
    let what = format!("it has {found} values, but {width}x{height} pixels need {expected}; pass one value per pixel");
    Err(bad(name, what))
}
