//! The default filter: first-order regression on features and clusters, in several passes. Their results are selected by
//! estimated error and blended.

use crate::averaging::prefilter;
use crate::error_map::{ERROR, EVIDENCE, Estimate, LAST, Radii, filtered, relative_weight, select, shrink};
use crate::fireflies::{self, FireflyLight};
use crate::graph::{Graph, bytes_of_rows};
use crate::inputs::{ClusterLookup, Inputs, Reads, guide, residual_guide};
use crate::light::{self, Layers, Light, Part};
use crate::network;
use crate::one_window::Bilateral;
use crate::planes::{Colours, Pair};
use crate::regression::regress;
use crate::tile::{FeatureScales, Likeness};
use crate::wide::wide;
use dapple_core::filter::{FilterMemory, ImagePlanes, filled};
use dapple_core::options::Options as _;
use dapple_core::{Error, Film, Filter, Filtered, Frame, Needs};

/// The weight of the fallback image in the first and second regression, relative to the prediction at a window's centre.
const BESIDE: [f32; 2] = [0.5, 0.4];

dapple_core::options! {
    /// The parameters of [`ClusterRegression`].
    pub struct ClusterRegressionOptions {
        /// Weight of a pixel of another cluster, relative to a pixel of the same cluster; 1 ignores clusters.
        pub outside: f64 = 0.2,
            |w| (0.0..=1.0).contains(&w), "0 (nothing crosses a border) to 1 (clusters do not matter)";
        /// Number of light layers denoised separately: 2 (direct, indirect), 1 (all light), auto (2 if spp >= 2, otherwise 1).
        pub layers: Layers = Layers::Auto => "auto";
        /// true: cluster-regression ends with its trained network; false: it ends with the regressions.
        pub network: bool = true => "true";
        /// Fireflies (pixels at least 880 times as bright as their surroundings): keep, drop, or spread (over neighbours).
        pub fireflies: FireflyLight = FireflyLight::Keep => "keep";
    }
}

/// Regression on features of the first non-specular surface, with weights from clusters, features and colours.
///
/// ```
/// use dapple_core::{Estimate, Film, Filter, Frame};
/// use dapple_denoise::ClusterRegression;
/// use std::sync::Arc;
///
/// let filter = ClusterRegression::new().with_clusters(Arc::new(|shape, _| Some(shape)), "");
/// let mut film = Film::new(Frame::new(16, 16)?, filter.needs());
/// for pixel in 0..256 {
///     for sample in 0..4 {
///         let noisy = if (pixel + sample / 2) % 2 == 0 { 0.5 } else { 1.5 };
///         film.push_estimate(pixel, sample % 2, &Estimate::new([noisy; 3]));
///     }
/// }
/// let image = filter.apply(&film)?;
/// assert!(image.radiance.iter().all(|[red, ..]| (red - 1.0).abs() < 0.1));
/// assert!(image.error.is_some());
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// # Algorithm
///
/// 1. Features are averaged over 9x9 pixels where they are equal up to their noise [after Rousselle 2013]. Noise from the lens,
///    the shutter and subpixel geometry is also in the radiance, so regression on noisy features would keep it.
/// 2. A [`Bilateral`] filter over 9x9 pixels without the corners computes a first image.
/// 3. The first pass runs only for direct lighting (step 7). A linear function of normal, albedo and position is fitted to the
///    radiance in a window, a disc 13 pixels wide, around every second pixel along x and y [after Bitterli 2016; Moon 2014].
///    * The weight of a pixel is `exp(-max(0, d_colour)) exp(-max(0, d_features))`, with `d` as in [`Bilateral`]. It is
///      multiplied by `m / (n + m)`, where `m` and `n` are the sample counts of the pixel and of the window's centre, and by
///      `outside` if the two lie in different clusters.
///    * Colours are compared over 3x3 pixels, in the half that is not being filtered [after Rousselle 2012].
///    * A pixel's colour is the mean of the predictions of all windows that contain it, with the same weights. The first image
///      is added with a small weight, and fills pixels that no window fits.
/// 4. In each pixel, the estimated errors of the unfiltered image and of the images of steps 2 and 3 are compared over 5x5
///    pixels. The best images, blended and divided by albedo, guide the second pass: step 3 with colours compared in this
///    guide. The noise of the guide is estimated from the halves. Both halves share the guide, the weights and the normal
///    equations.
/// 5. The images of steps 2 to 4 are compared in the same way, without the unfiltered image, and blended.
/// 6. The blend, divided by albedo, guides a regression over 41x41 pixels around every sixth pixel of every sixth row. Its
///    result is blended with the image of step 5, and then with the unfiltered image. The weights depend on how much of the
///    difference between two images is noise, according to the halves [after James and Stein 1961].
/// 7. With two `layers`, steps 2 to 6 filter direct and then indirect lighting, and the two images are added. Indirect lighting
///    has few edges, so colours and features may differ 1.4 times as much from step 4 on.
/// 8. A small trained network averages the film and the image of step 7 over neighbours and blends both [after Isik 2021]
///    (docs/results/learned.md). From 24 samples per pixel on, the network's weight falls with the square of the sample count.
///
/// # Guarantees
///
/// Bias vanishes as samples are added: pixels that differ by more than noise are not averaged. Without clusters, `outside` is
/// 1. Where features are missing, only colours are compared.
///
/// [`Filtered::error`] estimates the whole squared error from the halves, bias included.
/// Its mean over an image is 0.13 to 2.6 times the true error on six scenes at 1 to 16 samples per pixel
/// (docs/results/predicted-error.md). The estimate is for the image before the network. It is too high where the network
/// removes much noise, and too low where guides and blends follow the noise.
/// [`relative_errors`](crate::relative_errors) turns the estimate into scores for an adaptive sampler.
///
/// # Reach
///
/// Every pixel of the image may depend on every pixel of the film. The network's inputs are scaled by the image's mean
/// brightness, and the error's scale depends on the whole image. Windows, selections and blends reach a few hundred pixels.
#[derive(Clone, Debug, Default)]
pub struct ClusterRegression {
    options: ClusterRegressionOptions,
    reads: Reads,
    is_one_pass: bool,
}

impl ClusterRegression {
    /// Creates a regression without clusters.
    pub fn new() -> Self {
        Self::default()
    }

    /// Creates a regression with these parameters, without clusters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `outside` is in `[0, 1]`.
    pub fn with_options(options: ClusterRegressionOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { options, ..Self::default() })
    }

    /// Runs only the first pass, without the network: a fast estimate of the error for samplers.
    #[must_use]
    pub fn one_pass(self) -> Self {
        Self { is_one_pass: true, ..self }
    }

    /// Multiplies the weight of pixels in other clusters by `outside`, in the second pass by `max(outside, 0.7)`. The first hit
    /// of a pixel's first sample determines its cluster, even on a mirror or glass. `described` (the parameters of the
    /// clusters, such as `k=9,clamp=32`) is appended to the filter's description.
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

    /// The factor on the weight of a pixel in another cluster; 1 without clusters.
    fn outside(&self) -> f64 {
        if self.reads.label.is_some() { self.options.outside } else { 1.0 }
    }

    /// Runs the first pass on both halves of the samples. `beside` is the bilateral image, which serves as fallback.
    fn first(&self, graph: &Graph<'_>, inputs: &Inputs, beside: Pair) -> Pair {
        let guides = [0, 1].map(|half| guide(graph, inputs, half, true, false));
        let features = FeatureScales { bandwidth: 2.4, floors: [1e-2, 2e-3], slope: 1.2 };
        let like = Likeness { patch: 1, colour: 2.0, features: Some(features), outside: self.outside() as f32 };
        regress(graph, inputs, guides, like, (beside, BESIDE[0]))
    }

    /// Runs the second pass on both halves of the samples. `guide` is an image with less noise, by which pixels are
    /// compared.
    fn second(&self, graph: &Graph<'_>, inputs: &Inputs, guide: Pair) -> Pair {
        let features = FeatureScales { bandwidth: 5.0 * inputs.part.smoothness(), floors: [1e-2, 2e-2], slope: 3.0 };
        // The first pass has used most of the information in the clusters.
        let outside = self.outside().max(0.7) as f32;
        let colour = 1.5 * inputs.part.smoothness();
        let like = Likeness { patch: 1, colour, features: Some(features), outside };
        regress(graph, inputs, [residual_guide(graph, inputs, guide)], like, (guide, BESIDE[1]))
    }

    /// The candidates for the guide of the second pass: the image of the first pass, if that runs, and the bilateral image.
    ///
    /// In the first pass, the noise of a half does not affect the weights for that half. This pays off only for direct lighting
    /// on its own. For all light at once, leaving the pass out costs 1.5 % more error at 8 spp and saves a fifth of the time.
    fn before_second(&self, graph: &Graph<'_>, inputs: &Inputs) -> Vec<Pair> {
        let averaged = Bilateral::candidate().pair(graph, inputs);
        if self.has_first(inputs.part) { vec![self.first(graph, inputs, averaged), averaged] } else { vec![averaged] }
    }

    /// Returns `true` if the network runs after the regressions.
    fn has_network(&self) -> bool {
        self.options.network && !self.is_one_pass
    }

    /// Returns `true` if the first pass runs for this part of the light.
    pub(crate) fn has_first(&self, part: Part) -> bool {
        part == Part::Direct || self.is_one_pass
    }

    /// The filtered images of all parts of the light, and the denoised albedo.
    fn passes<'a>(&self, graph: &Graph<'a>, parts: &[Light<'a>]) -> (Vec<Estimate>, Colours) {
        let mut inputs = Inputs::new(graph, parts[0], &self.reads);
        prefilter(graph, &mut inputs);
        let mut estimates = Vec::new();
        for (number, part) in parts.iter().enumerate() {
            if number > 0 {
                inputs = inputs.of_part(graph, *part);
            }
            estimates.push(Estimate::new(graph, &inputs, *part, self.image(graph, &inputs), ERROR));
        }
        (estimates, inputs.features.albedo())
    }

    /// Filters the light from which `inputs` were read.
    fn image(&self, graph: &Graph<'_>, inputs: &Inputs) -> Pair {
        let mut images = self.before_second(graph, inputs);
        if self.is_one_pass {
            return images[0];
        }
        // Two passes of narrow windows, each followed by a selection by estimated error.
        let weight = relative_weight(graph, inputs, images[0]);
        let chosen = select(graph, inputs, &images, weight, CHOICE, true);
        images.push(self.second(graph, inputs, chosen));
        let base = select(graph, inputs, &images, weight, CHOICE, false);

        // A pass of wide windows; then the unfiltered image is blended with the result according to the noise of their
        // difference.
        let smooth = wide(graph, inputs, &residual_guide(graph, inputs, base), base);
        let image = shrink(graph, inputs, base, smooth, BLEND, WIDE_EVIDENCE);
        shrink(graph, inputs, inputs.unfiltered(), image, LAST, EVIDENCE)
    }
}

/// The bytes per pixel of the albedo that is passed to the network.
const ALBEDO: usize = 12;

/// The radius over which estimated errors are compared for the guides of the second and third pass.
const CHOICE: usize = 2;

/// The radii for blending the selected image with the wide pass.
pub(crate) const BLEND: Radii = Radii { bias: 8, noise: 20, alike: 2 };

/// The number of standard errors that a bias of the wide pass must exceed to count. With 1.25 and more, refractions lose
/// detail.
const WIDE_EVIDENCE: f32 = 0.5;

impl Filter for ClusterRegression {
    fn name(&self) -> &str {
        "cluster-regression"
    }

    fn describe(&self) -> String {
        let described = self.reads.describe(self.name(), &self.options.outside(self.outside()));
        described + if self.is_one_pass { ",passes=1" } else { "" }
    }

    fn needs(&self) -> Needs {
        let recorded = self.reads.recorded();
        let recorded = if self.options.layers == Layers::One { recorded } else { recorded.with_indirect() };
        if self.outside() < 1.0 { recorded.with_surfaces() } else { recorded }
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let is_one = self.options.layers == Layers::One || !needs.indirect;
        let rows = bytes_of_rows(frame, needs, |graph, film| {
            let parts = if is_one { vec![Light::all(film)] } else { Light::parts(film).to_vec() };
            let (estimates, albedo) = self.passes(graph, &parts);
            estimates.iter().flat_map(Estimate::planes).chain(albedo).collect()
        });
        let parts = Estimate::bytes_per_pixel(if is_one { 1 } else { 2 });
        let passes = frame.bytes(parts + ALBEDO).saturating_add(rows);
        let network = if self.has_network() { network::bytes(frame) } else { 0 };
        FilterMemory::new(frame, 0, ImagePlanes::RadianceAndError).at_least(passes.max(network))
    }

    fn runs(&self, needs: &Needs, spp: f64) -> u32 {
        if needs.indirect && self.options.layers.are_two(spp) { 2 } else { 1 }
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        if self.options.fireflies != FireflyLight::Spread {
            let found = fireflies::find(film);
            if let Some(calm) = fireflies::without(film, &found) {
                let spread = Self { options: self.options.fireflies(FireflyLight::Spread), ..self.clone() };
                let mut image = filled(&spread, &calm)?;
                fireflies::restore(&mut image, &found, self.options.fireflies);
                return Ok(image);
            }
        }
        let parts = light::parts(film, self.options.layers);
        let graph = Graph::new(film.frame().size().map(|n| n as usize));
        let (estimates, albedo) = self.passes(&graph, &parts);
        let (image, albedo) = filtered(graph, &estimates, albedo);
        let has_features = !self.reads.without_features;
        Ok(if self.has_network() { network::improve(film, image, albedo, has_features) } else { image })
    }
}
