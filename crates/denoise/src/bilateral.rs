//! The cross-bilateral filter over distance, features, colours and clusters.

use crate::averaging::{Form, VANISHING, Window, average, memory};
use crate::guide::guide;
use crate::inputs::Inputs;
use crate::one_window::OneWindow;
use crate::parameters::{ClusterLookup, Reads};
use crate::plane::Pair;
use crate::tile::{FeatureScales, Likeness, REACH};
use dapple_core::{Error, Film, FilmRows, Filter, FilterMemory, Filtered, Frame, Needs, Options as _};
use std::fmt;

dapple_core::options! {
    /// The parameters of [`Bilateral`].
    pub struct BilateralOptions {
        /// Pixels averaged to each side, 0 to 7.
        pub window: usize = REACH => "7", |window| window <= REACH, "0 to 7 pixels to each side";
        /// The spatial weight is exp(-falloff r^2).
        pub falloff: f64 = 0.03,
            |falloff| (0.0..=100.0).contains(&falloff), "0 (a flat window) to 100, per square pixel";
        /// Differences of colours are measured in this many standard deviations.
        pub colour: f64 = 0.8, |k| (1e-3..=1e3).contains(&k), "0.001 to 1000 standard deviations";
        /// The same for features: normal, albedo and depth.
        pub features: f64 = 1.0 => "1", |k| (1e-3..=1e3).contains(&k), "0.001 to 1000 standard deviations";
        /// Weight of a pixel of another cluster relative to one of the same; 1: no clusters.
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
/// * a Gaussian of its distance, `exp(-falloff r^2)`;
/// * `exp(-max(0, d_features))`, with the largest difference of normal, albedo and depth in `features` standard
///   deviations;
/// * `exp(-max(0, d_colour))`, with the difference of 3x3 pixels in `colour` standard deviations;
/// * `outside` if the pixels lie in different clusters.
///
/// The expected difference due to noise is subtracted as in [`NlMeans`](crate::NlMeans).
/// Colours are compared without their albedo, in the half of the samples that is not being filtered.
/// The colour term makes the filter consistent: pixels that differ by more than noise do not mix, however many samples
/// they have.
///
/// [`Filtered::error`] estimates the whole squared error from the halves, bias included.
///
/// ```
/// use dapple_core::{Estimate, Film, Filter, Frame};
/// use dapple_denoise::{Bilateral, BilateralOptions};
/// use std::sync::Arc;
///
/// // A pixel of another material counts half.
/// let filter = Bilateral::with_options(BilateralOptions::default().outside(0.5))?;
/// let filter = filter.with_clusters(Arc::new(|hit| Some(hit.material)), "");
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
#[derive(Clone, Default)]
pub struct Bilateral {
    options: BilateralOptions,
    reads: Reads,
    form: Form,
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

    /// Multiplies the weight of a pixel by `outside` if its first sample lies in another cluster. `described` is
    /// appended to the filter's description: the parameters of the clusters, such as `k=9,clamp=32`.
    #[must_use]
    pub fn with_clusters(self, label: ClusterLookup, described: impl Into<String>) -> Self {
        Self { reads: Reads { label: Some(label), described: described.into(), ..self.reads }, ..self }
    }

    /// Filters by colours alone, for films without features. Every pixel counts as a miss.
    ///
    /// A film that has room for features but never got any is otherwise refused
    /// ([`Error::NoneReported`]).
    #[must_use]
    pub fn without_features(self) -> Self {
        Self { reads: Reads { without_features: true, ..self.reads }, ..self }
    }

    /// The bilateral filter that makes the first image of `ClusterRegression`. Its weights fall faster with distance than those
    /// of the default, and slower with features. Corners of the window would have a 150th of the centre's weight, or less.
    pub(crate) fn candidate() -> Self {
        let options = BilateralOptions::default().window(4).falloff(0.25).colour(0.75).features(4.0);
        Self { options, form: Form::Disc(18), ..Self::default() }
    }

    fn likeness(&self) -> Likeness {
        let BilateralOptions { colour, features, outside, .. } = self.options;
        let features = FeatureScales { bandwidth: features as f32, floors: [1e-2, 2e-2], slope: 3.0 };
        Likeness { patch: PATCH, colour: colour as f32, features: Some(features), outside: outside as f32 }
    }
}

impl OneWindow for Bilateral {
    fn reads(&self) -> Reads {
        self.reads.clone()
    }

    fn radius(&self) -> usize {
        self.options.window + PATCH
    }

    fn pair(&self, inputs: &Inputs) -> Pair {
        let guides = [0, 1].map(|half| guide(inputs, half, true, true));
        let BilateralOptions { window: radius, falloff, .. } = self.options;
        let window = Window { radius, form: self.form, cut: VANISHING, falloff: falloff as f32 };
        let values = [0, 1].map(|h: usize| &guides[h].colour);
        let mut pair = Pair(average(inputs, values, &guides, &self.likeness(), &window));
        pair.modulate(inputs.features.albedo());
        pair
    }
}

impl fmt::Debug for Bilateral {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Bilateral({})", self.describe())
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
        if self.reads.label.is_some() && self.options.outside < 1.0 { recorded.with_first_hits(1) } else { recorded }
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        memory(frame, self.reads.label.is_some() && needs.first_hits > 0, &self.likeness(), true)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        Ok(self.image(film))
    }

    fn reach(&self, _: &Frame) -> Option<u32> {
        Some(self.rows_read())
    }

    fn survey(&self, film: &Film) -> Result<Vec<f64>, Error> {
        self.globals(film)
    }

    fn apply_rows(&self, rows: &FilmRows<'_>, survey: &[f64]) -> Result<Filtered, Error> {
        self.image_of_rows(rows, survey)
    }
}
