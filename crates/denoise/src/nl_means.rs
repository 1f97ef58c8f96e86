//! Non-local means over two halves of the samples.

use crate::averaging::{Window, average, guide, memory};
use crate::error_map::{Pair, filtered};
use crate::parameters::{bandwidth, radius};
use crate::planes::Inputs;
use crate::tile::{FeatureScales, Likeness, REACH};
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, Needs};

/// Non-local means: each pixel becomes the mean of pixels with similar surroundings.
///
/// The patches around two pixels `p` and `q` are compared by the mean over pixels and channels of
///
/// `((u_p - u_q)^2 - (v_p + min(v_p, v_q))) / (k^2 (v_p + v_q))`
///
/// where `u` is a pixel's mean and `v` its variance. The subtrahend is the squared difference that noise alone causes.
/// The weight is `exp(-max(0, d))` of that mean `d`, and 0 below 0.05.
///
/// Weights from one half of the samples filter the other half, so the filter does not keep the noise that its weights
/// follow.
/// The image is the mean of both halves, weighted by their counts [after Rousselle 2012].
///
/// [`NlMeans::with_features`] also compares first hits, and compares colours without their albedo.
///
/// ```
/// use dapple_core::{Film, Filter, Frame};
/// use dapple_denoise::NlMeans;
///
/// let filter = NlMeans::new(5, 2, 0.6)?; // 11x11 windows, 5x5 patches
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
/// * A pixel's variance is shrunk to that of 5x5 pixels, not scaled to that of the halves. Its floor goes with 1 / n.
/// * Each pixel counts by its samples.
/// * There is one pass, without adaptive sampling.
///
/// # Result
///
/// Pixels without samples are filled from their window, or black if the window is empty.
/// [`Filtered::error`] estimates the whole squared error from the halves, bias included.
#[derive(Clone, Debug, PartialEq)]
pub struct NlMeans {
    window: usize,
    patch: usize,
    k: f64,
    features: Option<f64>,
}

impl Default for NlMeans {
    /// `k` 0.45 and patches of 7x7 pixels as published; windows of 15x15 pixels.
    fn default() -> Self {
        Self { window: REACH, patch: 3, k: 0.45, features: None }
    }
}

impl NlMeans {
    /// Windows and patches with this many pixels to each side. Colour differences are measured in `k` standard
    /// deviations.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `window <= 7`, `patch <= 3` and `k` is in `0.001 ..= 1000`.
    pub fn new(window: usize, patch: usize, k: f64) -> Result<Self, Error> {
        bandwidth("k", k)?;
        Ok(Self { window: radius("window", window, REACH)?, patch: radius("patch", patch, 3)?, k, features: None })
    }

    /// Also compares the normals, albedo and depth of first hits, in units of `k` standard deviations.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `k` is in `0.001 ..= 1000`.
    pub fn with_features(self, k: f64) -> Result<Self, Error> {
        bandwidth("features", k)?;
        Ok(Self { features: Some(k), ..self })
    }

    fn likeness(&self) -> Likeness {
        let scales = |k: f64| FeatureScales { bandwidth: k as f32, floors: [1e-2, 2e-2] };
        Likeness { patch: self.patch, colour: self.k as f32, features: self.features.map(scales), outside: 1.0 }
    }

    /// Filters both halves of a film's samples, and returns an image from each.
    pub(crate) fn pair(&self, inputs: &Inputs) -> Pair {
        let demodulated = self.features.is_some();
        let guides = [0, 1].map(|half| guide(inputs, half, demodulated, demodulated));
        let window = Window { radius: self.window, cut: 0.05, falloff: 0.0 };
        let values = [0, 1].map(|h: usize| &guides[h].colour);
        let mut pair = Pair(average(inputs, values, &guides, &self.likeness(), &window));
        if demodulated {
            pair.modulate(inputs);
        }
        pair
    }
}

impl Filter for NlMeans {
    fn name(&self) -> &str {
        "nlm"
    }

    fn describe(&self) -> String {
        let Self { window, patch, k, features } = self;
        let features = features.map_or("none".to_owned(), |k| k.to_string());
        format!("nlm:window={window},patch={patch},k={k},features={features}")
    }

    fn needs(&self) -> Needs {
        let plain = Needs::none().with_variance().with_halves();
        if self.features.is_some() { plain.with_features() } else { plain }
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        memory(frame, false, &self.likeness(), self.features.is_some())
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let inputs = Inputs::new(film, None);
        Ok(filtered(&inputs, &self.pair(&inputs)))
    }
}
