//! The cross-bilateral filter over distance, features, colours and clusters.

use crate::averaging::{VANISHING, Window, average, guide, memory};
use crate::cluster_gaussian::ClusterLookup;
use crate::error_map::{Pair, filtered};
use crate::parameters::{NEEDS, bandwidth, out, outside_weight, radius};
use crate::planes::Inputs;
use crate::tile::{FeatureScales, Likeness, REACH};
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, Needs};
use std::fmt;

/// The cross-bilateral filter [after Eisemann and Durand 2004; Petschnigg 2004], with first-hit features and clusters.
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
/// use dapple_core::{Film, Filter, Frame};
/// use dapple_denoise::Bilateral;
/// use std::sync::Arc;
///
/// // A pixel of another material counts half.
/// let filter = Bilateral::default().with_clusters(Arc::new(|hit| Some(hit.material)), 0.5, "")?;
/// let mut film = Film::new(Frame::new(16, 16)?, filter.needs());
/// for pixel in 0..256 {
///     for sample in 0..4 {
///         film.push(pixel, sample % 2, [if (pixel + sample / 2) % 2 == 0 { 0.5 } else { 1.5 }; 3]);
///     }
/// }
/// let image = filter.apply(&film)?;
/// assert!(image.radiance.iter().all(|[red, ..]| (red - 1.0).abs() < 0.1));
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone)]
pub struct Bilateral {
    window: usize,
    falloff: f64,
    colour: f64,
    features: f64,
    outside: f64,
    label: Option<ClusterLookup>,
    described: String,
}

impl Default for Bilateral {
    fn default() -> Self {
        let described = String::new();
        Self { window: REACH, falloff: 0.03, colour: 0.8, features: 1.0, outside: 1.0, label: None, described }
    }
}

impl Bilateral {
    /// Windows of `window` pixels to each side with the spatial weight `exp(-falloff r^2)`, `r` in pixels.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `window <= 7` and `falloff` is in `0 ..= 100`.
    pub fn new(window: usize, falloff: f64) -> Result<Self, Error> {
        if !(0.0..=100.0).contains(&falloff) {
            return out("falloff", falloff, "0 (a flat window) to 100, per square pixel");
        }
        Ok(Self { window: radius("window", window, REACH)?, falloff, ..Self::default() })
    }

    /// Sets the bandwidths: differences of colours and of features are measured in this many standard deviations.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless both are in `0.001 ..= 1000`.
    pub fn with_bandwidths(self, colour: f64, features: f64) -> Result<Self, Error> {
        bandwidth("colour", colour)?;
        bandwidth("features", features)?;
        Ok(Self { colour, features, ..self })
    }

    /// Multiplies the weight of a pixel by `outside` if its first sample lies in another cluster. `described` is
    /// appended to the filter's description; it tells how the clusters are made, such as `k=9,clamp=32`.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `outside` is in `[0, 1]`.
    pub fn with_clusters(
        self,
        label: ClusterLookup,
        outside: f64,
        described: impl Into<String>,
    ) -> Result<Self, Error> {
        Ok(Self { label: Some(label), outside: outside_weight(outside)?, described: described.into(), ..self })
    }

    /// The bilateral filter that makes the first image of `ClusterRegression`. It serves there as well as the default,
    /// at a third of the cost.
    pub(crate) fn candidate() -> Self {
        Self { window: 4, falloff: 0.06, colour: 0.75, features: 1.25, ..Self::default() }
    }

    /// Filters both halves of a film's samples, and returns an image from each.
    pub(crate) fn pair(&self, inputs: &Inputs) -> Pair {
        let guides = [0, 1].map(|half| guide(inputs, half, true, true));
        let window = Window { radius: self.window, cut: VANISHING, falloff: self.falloff as f32 };
        let values = [0, 1].map(|h: usize| &guides[h].colour);
        let mut pair = Pair(average(inputs, values, &guides, &self.likeness(), &window));
        pair.modulate(inputs);
        pair
    }

    fn likeness(&self) -> Likeness {
        let features = FeatureScales { bandwidth: self.features as f32, floors: [1e-2, 2e-2] };
        Likeness { patch: 1, colour: self.colour as f32, features: Some(features), outside: self.outside as f32 }
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
        let Self { window, falloff, colour, features, outside, described, .. } = self;
        let comma = if described.is_empty() { "" } else { "," };
        format!(
            "bilateral:window={window},falloff={falloff},colour={colour},features={features},outside={outside}{comma}{described}"
        )
    }

    fn needs(&self) -> Needs {
        if self.label.is_some() && self.outside < 1.0 { NEEDS.with_first_hits(1) } else { NEEDS }
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        memory(frame, self.label.is_some() && needs.first_hits > 0, &self.likeness(), true)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let inputs = Inputs::new(film, self.label.as_ref());
        Ok(filtered(&inputs, &self.pair(&inputs)))
    }
}
