//! Filters that average over one window around each pixel: non-local means, and the cross-bilateral filter over distance,
//! features, colours and clusters.

use crate::averaging::{VANISHING, Window, average};
use crate::error_map::{ERROR, Estimate, filtered};
use crate::graph::{Graph, bytes_of_rows};
use crate::inputs::{ClusterLookup, Inputs, Reads, describe, guide};
use crate::light::Light;
use crate::planes::Pair;
use crate::tile::{FeatureScales, Likeness, REACH};
use dapple_core::options::Options as _;
use dapple_core::{Error, Film, Filter, Filtered, Frame, Needs, filter::FilterMemory, filter::ImagePlanes};

dapple_core::options! {
    /// The parameters of [`NlMeans`]. The defaults are as published, except for a smaller window.
    pub struct NlMeansOptions {
        /// Search radius in pixels, 0 to 7.
        pub window: usize = REACH => "7", |window| window <= REACH, "0 to 7 pixels to each side";
        /// Patch radius in pixels, 0 to 3.
        pub patch: usize = 3, |patch| patch <= 3, "0 to 3 pixels to each side";
        /// Tolerance of colour differences in standard deviations. Larger values smooth more.
        pub k: f64 = 0.45, |k| (1e-3..=1e3).contains(&k), "0.001 to 1000 standard deviations";
        /// Tolerance of normal, albedo and depth differences in standard deviations; none: compare colour only (as published).
        ///
        /// With features, colours are divided by albedo before they are compared.
        pub features: Option<f64> = None => "none",
            |k| k.is_none_or(|k| (1e-3..=1e3).contains(&k)), "0.001 to 1000 standard deviations";
    }
}

/// Non-local means: each pixel becomes the mean of pixels with similar surroundings.
///
/// The patches around two pixels `p` and `q` are compared by `d`, the mean over their pixels and channels of
///
/// `((u_p - u_q)^2 - (v_p + min(v_p, v_q))) / (k^2 (v_p + v_q))`
///
/// where `u` is a pixel's mean and `v` its variance. The subtracted term is the squared difference expected from noise alone.
/// The weight is `exp(-max(0, d))`, or 0 if that is below 0.05.
///
/// Weights from one half of the samples filter the other half, so the weights are independent of the noise that they filter.
/// The image is the mean of both halves, weighted by their counts [after Rousselle 2012].
///
/// With [`NlMeansOptions::features`], features are compared too, and colours are divided by albedo.
///
/// ```
/// use dapple_core::{Film, Filter, Frame};
/// use dapple_denoise::{NlMeans, NlMeansOptions};
///
/// // 11x11 windows, 5x5 patches
/// let filter = NlMeans::with_options(NlMeansOptions::default().window(5).patch(2).k(0.6))?;
/// let mut film = Film::new(Frame::new(16, 16)?, filter.needs());
/// for pixel in 0..256 {
///     for sample in 0..4 {
///         // Samples go to the two halves in turns.
///         film.push(pixel, sample % 2, [if (pixel + sample / 2) % 2 == 0 { 0.5 } else { 1.5 }; 3]);
///     }
/// }
/// let image = filter.apply(&film)?;
/// assert!(image.radiance.iter().all(|[red, ..]| (red - 1.0).abs() < 1e-5));
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// # Differences from the paper
///
/// * Windows have at most 15x15 pixels, not 21x21.
/// * A pixel's variance is shrunk towards the mean of 5x5 pixels, not scaled to the variance between the halves. With `n`
///   samples, a small constant divided by `n` is added.
/// * The weight of a pixel with `m` samples is multiplied by `m / (n + m)`, where `n` is the filtered pixel's count.
/// * There is one pass, without adaptive sampling.
///
/// # Result
///
/// Pixels without samples are filled from their window; they are black if the window has no samples.
/// [`Filtered::error`] estimates the whole squared error from the halves, bias included.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NlMeans {
    options: NlMeansOptions,
}

impl NlMeans {
    /// The filter with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(options: NlMeansOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { options })
    }

    fn likeness(&self) -> Likeness {
        let scales = |k: f64| FeatureScales { bandwidth: k as f32, floors: [1e-2, 2e-2], slope: 3.0 };
        let NlMeansOptions { patch, k, features, .. } = self.options;
        Likeness { patch, colour: k as f32, features: features.map(scales), outside: 1.0 }
    }

    /// The statistics that the filter reads besides halves and variance.
    fn reads(&self) -> Reads {
        Reads { without_features: self.options.features.is_none(), ..Reads::default() }
    }

    fn pair(&self, graph: &Graph<'_>, inputs: &Inputs) -> Pair {
        let window = Window { radius: self.options.window, disc: None, cut: 0.05, falloff: 0.0 };
        means(graph, inputs, self.likeness(), window, self.options.features.is_some())
    }
}

impl Filter for NlMeans {
    fn name(&self) -> &str {
        "nlm"
    }

    fn describe(&self) -> String {
        describe(self.name(), &self.options, "")
    }

    fn needs(&self) -> Needs {
        self.reads().recorded()
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        memory(frame, needs, &self.reads(), |graph, inputs| self.pair(graph, inputs))
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        apply(self, film, &self.reads(), |graph, inputs| self.pair(graph, inputs))
    }
}

dapple_core::options! {
    /// The parameters of [`Bilateral`].
    pub struct BilateralOptions {
        /// Window radius in pixels, 0 to 7.
        pub window: usize = REACH => "7", |window| window <= REACH, "0 to 7 pixels to each side";
        /// The spatial weight is exp(-falloff r^2), with the distance r in pixels.
        pub falloff: f64 = 0.03,
            |falloff| (0.0..=100.0).contains(&falloff), "0 (a flat window) to 100, per square pixel";
        /// Tolerance of colour differences in standard deviations. Larger values smooth more.
        pub colour: f64 = 0.8, |k| (1e-3..=1e3).contains(&k), "0.001 to 1000 standard deviations";
        /// Tolerance of normal, albedo and depth differences in standard deviations. Larger values smooth more.
        pub features: f64 = 1.0 => "1", |k| (1e-3..=1e3).contains(&k), "0.001 to 1000 standard deviations";
        /// Weight of a pixel of another cluster, relative to a pixel of the same cluster; 1 ignores clusters.
        pub outside: f64 = 1.0 => "1",
            |w| (0.0..=1.0).contains(&w), "0 (nothing crosses a border) to 1 (clusters do not matter)";
    }
}

/// The radius of the compared patches in pixels.
const PATCH: usize = 1;

/// The cross-bilateral filter [after Eisemann and Durand 2004; Petschnigg 2004], with features and clusters.
///
/// The weight of a pixel is the product of
///
/// * a Gaussian of the distance, `exp(-falloff r^2)`;
/// * `exp(-max(0, d_features))`, where `d_features` is the largest of the differences of normal, albedo and depth, in units of
///   `features` standard deviations;
/// * `exp(-max(0, d_colour))`, where `d_colour` is the colour difference over 3x3 pixels, in units of `colour` standard
///   deviations;
/// * `outside` if the pixels lie in different clusters.
///
/// Differences are squared and reduced by the expected noise, as in [`NlMeans`]. Colours are divided by albedo and compared in
/// the half of the samples that is not being filtered. The colour term makes the filter consistent: pixels that differ by more
/// than noise are not averaged.
///
/// [`Filtered::error`] estimates the whole squared error from the halves, bias included.
///
/// ```
/// use dapple_core::{Estimate, Film, Filter, Frame};
/// use dapple_denoise::{Bilateral, BilateralOptions};
/// use std::sync::Arc;
///
/// // A pixel of another shape counts half.
/// let filter = Bilateral::with_options(BilateralOptions::default().outside(0.5))?;
/// let filter = filter.with_clusters(Arc::new(|shape, _| Some(shape)), "");
/// let mut film = Film::new(Frame::new(16, 16)?, filter.needs());
/// for pixel in 0..256 {
///     for sample in 0..4 {
///         let noisy = if (pixel + sample / 2) % 2 == 0 { 0.5 } else { 1.5 };
///         film.push_estimate(pixel, sample % 2, &Estimate::new([noisy; 3]));
///     }
/// }
/// let image = filter.apply(&film)?;
/// assert!(image.radiance.iter().all(|[red, ..]| (red - 1.0).abs() < 0.1));
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Bilateral {
    options: BilateralOptions,
    reads: Reads,
    /// The largest squared distance from the centre in a disc-shaped window; `None` for a square window.
    disc: Option<usize>,
}

impl Bilateral {
    /// The filter with these parameters, without clusters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(options: BilateralOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { options, ..Self::default() })
    }

    /// Multiplies the weight of pixels in other clusters by `outside`; a pixel's first sample determines its cluster.
    /// `described` (the parameters of the clusters, such as `k=9,clamp=32`) is appended to the filter's description.
    #[must_use]
    pub fn with_clusters(self, label: ClusterLookup, described: impl Into<String>) -> Self {
        Self { reads: Reads { label: Some(label), described: described.into(), ..self.reads }, ..self }
    }

    /// Filters by colours alone, for films without features. Every pixel counts as a miss.
    ///
    /// Without this setting, a film whose samples all lack features is rejected ([`Error::NoneReported`]).
    #[must_use]
    pub fn without_features(self) -> Self {
        Self { reads: Reads { without_features: true, ..self.reads }, ..self }
    }

    /// The bilateral filter for the first image of `ClusterRegression`. Compared with the default, its weights fall faster with
    /// distance and slower with feature differences. The window has no corners; their weight would be at most 1/150 of the
    /// centre's.
    pub(crate) fn candidate() -> Self {
        let options = BilateralOptions::default().window(4).falloff(0.25).colour(0.75).features(4.0);
        Self { options, disc: Some(18), ..Self::default() }
    }

    fn likeness(&self) -> Likeness {
        let BilateralOptions { colour, features, outside, .. } = self.options;
        let features = FeatureScales { bandwidth: features as f32, floors: [1e-2, 2e-2], slope: 3.0 };
        Likeness { patch: PATCH, colour: colour as f32, features: Some(features), outside: outside as f32 }
    }

    /// The images of both halves of a film's samples.
    pub(crate) fn pair(&self, graph: &Graph<'_>, inputs: &Inputs) -> Pair {
        let BilateralOptions { window: radius, falloff, .. } = self.options;
        let window = Window { radius, disc: self.disc, cut: VANISHING, falloff: falloff as f32 };
        means(graph, inputs, self.likeness(), window, true)
    }
}

impl Filter for Bilateral {
    fn name(&self) -> &str {
        "bilateral"
    }

    fn describe(&self) -> String {
        self.reads.describe(self.name(), &self.options)
    }

    fn needs(&self) -> Needs {
        let recorded = self.reads.recorded();
        if self.reads.label.is_some() && self.options.outside < 1.0 { recorded.with_surfaces() } else { recorded }
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        memory(frame, needs, &self.reads, |graph, inputs| self.pair(graph, inputs))
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        apply(self, film, &self.reads, |graph, inputs| self.pair(graph, inputs))
    }
}

/// Filters a film; `pair` computes the filtered halves.
fn apply(
    filter: &impl Filter,
    film: &Film,
    reads: &Reads,
    pair: impl Fn(&Graph<'_>, &Inputs) -> Pair,
) -> Result<Filtered, Error> {
    film.require(filter.name(), &filter.needs())?;
    let graph = Graph::new(film.frame().size().map(|n| n as usize));
    let estimate = estimate(&graph, film, reads, pair);
    let (image, []) = filtered(graph, &[estimate], []);
    Ok(image)
}

/// The memory of [`apply`].
fn memory(frame: &Frame, needs: &Needs, reads: &Reads, pair: impl Fn(&Graph<'_>, &Inputs) -> Pair) -> FilterMemory {
    let rows = bytes_of_rows(frame, needs, |graph, film| estimate(graph, film, reads, pair).planes().collect());
    let all = frame.bytes(Estimate::bytes_per_pixel(1)).saturating_add(rows);
    FilterMemory::new(frame, 0, ImagePlanes::RadianceAndError).at_least(all)
}

fn estimate<'a>(
    graph: &Graph<'a>,
    film: &'a Film,
    reads: &Reads,
    pair: impl Fn(&Graph<'_>, &Inputs) -> Pair,
) -> Estimate {
    let light = Light::all(film);
    let inputs = Inputs::new(graph, light, reads);
    let image = pair(graph, &inputs);
    Estimate::new(graph, &inputs, light, image, ERROR)
}

/// The filtered images of both halves: means over a window around each pixel. With `demodulated`, colours are divided by albedo
/// before they are compared and averaged.
fn means(graph: &Graph<'_>, inputs: &Inputs, like: Likeness, window: Window, demodulated: bool) -> Pair {
    let guides = [0, 1].map(|half| guide(graph, inputs, half, demodulated, demodulated));
    let values = guides.each_ref().map(|guide| guide.colour);
    let pair = average(graph, inputs, values, guides, (like, window), Vec::new());
    if demodulated { pair.modulated(graph, inputs.features.albedo()) } else { pair }
}
