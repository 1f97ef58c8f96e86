//! Non-local means over two halves of the samples.

use crate::averaging::{Form, Window, average, memory};
use crate::guide::guide;
use crate::inputs::Inputs;
use crate::one_window::OneWindow;
use crate::parameters::{Reads, describe};
use crate::plane::Pair;
use crate::tile::{FeatureScales, Likeness, REACH};
use dapple_core::{Error, Film, FilmRows, Filter, FilterMemory, Filtered, Frame, Needs, Options as _};

dapple_core::options! {
    /// The parameters of [`NlMeans`]: `k` and patches as published, and smaller windows.
    pub struct NlMeansOptions {
        /// Pixels searched to each side, 0 to 7.
        pub window: usize = REACH => "7", |window| window <= REACH, "0 to 7 pixels to each side";
        /// Pixels compared to each side, 0 to 3.
        pub patch: usize = 3, |patch| patch <= 3, "0 to 3 pixels to each side";
        /// Differences are measured in this many standard deviations.
        pub k: f64 = 0.45, |k| (1e-3..=1e3).contains(&k), "0.001 to 1000 standard deviations";
        /// The same for features (normal, albedo and depth); none: only colours count (published).
        ///
        /// With features, colours are compared without their albedo.
        pub features: Option<f64> = None => "none",
            |k| k.is_none_or(|k| (1e-3..=1e3).contains(&k)), "0.001 to 1000 standard deviations";
    }
}

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
/// [`NlMeansOptions::features`] also compares features, and compares colours without their albedo.
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
/// * A pixel's variance is shrunk to that of 5x5 pixels, not scaled to that of the halves. Its floor goes with 1 / n.
/// * Each pixel counts by its samples.
/// * There is one pass, without adaptive sampling.
///
/// # Result
///
/// Pixels without samples are filled from their window, or black if the window is empty.
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
}

impl OneWindow for NlMeans {
    fn reads(&self) -> Reads {
        Reads { without_features: self.options.features.is_none(), ..Reads::default() }
    }

    fn radius(&self) -> usize {
        self.options.window + self.options.patch
    }

    fn pair(&self, inputs: &Inputs) -> Pair {
        let demodulated = self.options.features.is_some();
        let guides = [0, 1].map(|half| guide(inputs, half, demodulated, demodulated));
        let window = Window { radius: self.options.window, form: Form::Square, cut: 0.05, falloff: 0.0 };
        let values = [0, 1].map(|h: usize| &guides[h].colour);
        let mut pair = Pair(average(inputs, values, &guides, &self.likeness(), &window));
        if demodulated {
            pair.modulate(inputs.features.albedo());
        }
        pair
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

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        memory(frame, false, &self.likeness(), self.options.features.is_some())
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
