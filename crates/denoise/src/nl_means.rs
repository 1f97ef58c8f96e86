//! Non-local means with two halves.

use crate::averaging::{Window, average, guide, memory};
use crate::error_map::{Pair, filtered};
use crate::planes::Inputs;
use crate::tile::{FeatureScales, Likeness, REACH};
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, Needs};

/// What a filter that reads halves and features reads.
pub(crate) const NEEDS: Needs = Needs::none().with_variance().with_halves().with_features();

/// A parameter out of range.
pub(crate) fn out<T>(name: &'static str, value: impl ToString, allowed: &'static str) -> Result<T, Error> {
    Err(Error::OutOfRange { name, value: value.to_string(), allowed })
}

/// Refuses a bandwidth that is no number above 0.
pub(crate) fn bandwidth(name: &'static str, value: f64) -> Result<f32, Error> {
    let range = 1e-3..=1e3;
    if range.contains(&value) { Ok(value as f32) } else { out(name, value, "0.001 to 1000 standard deviations") }
}

/// Refuses a radius that is too large.
pub(crate) fn radius(name: &'static str, value: usize, most: usize) -> Result<usize, Error> {
    let allowed = if most == REACH { "0 to 7 pixels to each side" } else { "0 to 3 pixels to each side" };
    if value <= most { Ok(value) } else { out(name, value, allowed) }
}

/// Non-local means: each pixel the mean of pixels whose surroundings look alike.
///
/// Two pixels' patches (`patch` to each side, 7x7 pixels by default) are compared by the mean over pixels and channels of
///
/// `((u_p - u_q)^2 - (v_p + min(v_p, v_q))) / (k^2 (v_p + v_q))`
///
/// with `u` the pixels' means and `v` their variances: what noise alone adds to the squared difference is taken off
/// again. The weight is `exp(-max(0, d))`, and 0 below 0.05. Weights from one half filter the other, so that noise that
/// they follow is not noise that they keep; the image is both halves' by their counts [after Rousselle 2012].
///
/// Where this differs from what was published: windows are of at most 15x15 pixels (21x21 there); a pixel's variance is
/// shrunk to that of 5x5 pixels, not scaled to that of the halves; a floor under it goes with 1 / n; each pixel counts
/// by its samples; and there is one pass, without the adaptive sampling.
///
/// [`NlMeans::with_features`] compares first hits too, and colours without their albedo.
///
/// Pixels without samples are filled from their window, black if that has none. [`Filtered::error`] is an estimate of the
/// whole squared error, bias included, from the halves.
#[derive(Clone, Debug, PartialEq)]
pub struct NlMeans {
    window: usize,
    patch: usize,
    k: f64,
    features: Option<f64>,
}

impl Default for NlMeans {
    /// `k` 0.45 and patches of 7x7 pixels as published, windows of 15x15.
    fn default() -> Self {
        Self { window: REACH, patch: 3, k: 0.45, features: None }
    }
}

impl NlMeans {
    /// Windows and patches of so many pixels to each side, differences measured in `k` standard deviations.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `window <= 7`, `patch <= 3` and `k` is in `0.001 ..= 1000`.
    pub fn new(window: usize, patch: usize, k: f64) -> Result<Self, Error> {
        bandwidth("k", k)?;
        Ok(Self { window: radius("window", window, REACH)?, patch: radius("patch", patch, 3)?, k, features: None })
    }

    /// The same; first hits' normals, albedo and depth weigh too, measured in `k` standard deviations.
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

    /// Both halves of a film filtered.
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
