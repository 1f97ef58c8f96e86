//! Shrinkage of noisy pixels towards a filtered image.

use crate::windows::{per_pixel, window_sums};
use dapple_core::filter::{FilterMemory, ImagePlanes};
use dapple_core::options::{Options as _, nested};
use dapple_core::{Error, Film, Filter, Filtered, Frame, Needs, film::Recorder};
use std::sync::Arc;

/// The estimate of a pixel's noise that determines the shrinkage of [`JamesStein`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NoiseEstimate {
    /// The squared difference between the two halves of the samples, valid for any point set.
    #[default]
    Halves,
    /// The sample variance over the count, as published. It is too large for low-discrepancy points and then shrinks too much.
    Samples,
}

dapple_core::choices!(NoiseEstimate { Halves = "halves", Samples = "samples" });

dapple_core::options! {
    /// The parameters of [`JamesStein`].
    pub struct JamesSteinOptions {
        /// Width in pixels of the window over which the shrinkage is estimated, an odd number from 3 to 63.
        pub window: usize = 15, |w| w % 2 == 1 && (3..=63).contains(&w), "an odd number from 3 to 63";
        /// Noise estimate, pooled over the window: halves (difference of half-buffers) or samples (sample variance).
        pub noise: NoiseEstimate = NoiseEstimate::Halves => "halves";
    }
}

/// Shrinkage of noisy pixels towards the image of another filter [Gu 2022, without the network].
///
/// Let `y` be the pixel means of one half of the samples, `s^2` their variance, and `z` the filtered image of the other half.
/// In each channel, over a window of `K^2` pixels,
///
/// `rho = max(0, 1 - (K^2 - 2) s^2 / max(sum (y - z)^2, 1e-5))`
///
/// is the positive-part factor of [James and Stein 1961]. Each pixel averages `rho` over the same window, and the half's result
/// is `z + rho (y - z)`. The image is the mean of both results, weighted by the sample counts of their halves.
///
/// *Guarantee*: let `z` be independent of `y`, and `s^2` known and equal over the window. Without the averaging of `rho`, each
/// half's squared error over the window is then below the error of `y`, for any filter. With many samples, `rho` approaches 1
/// where the filter is biased, so the bias vanishes. If a poor filter is applied to few samples, the mean of both halves can
/// have a few percent more error than the unfiltered image.
///
/// # Differences from the paper
///
/// * `z` is the image of any filter. In the paper, it is the image of a regression.
/// * `s^2` is the mean over the window. In the paper, a network weights the pixels.
///
/// # Weaknesses
///
/// `z` uses only half of the samples. One factor applies to a window of 15x15 pixels: fine detail in a smooth surrounding is
/// shrunk, and so are dark pixels beside bright noisy ones. If noise is proportional to the brightness of a texture, the result
/// can have 8 % more error than the unfiltered image. Filters that need halves themselves are rejected.
///
/// # Result
///
/// Pixels without samples in one half use the mean of the other half. Pixels without any samples are the mean of both filtered
/// images. The error is not estimated.
pub struct JamesStein<F> {
    of: F,
    options: JamesSteinOptions,
}

impl<F: Filter> JamesStein<F> {
    /// Creates a filter that shrinks towards the images of the filter `of`, with the default parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a filter that needs halves.
    pub fn new(of: F) -> Result<Self, Error> {
        Self::with_options(of, JamesSteinOptions::default())
    }

    /// Creates a filter that shrinks towards the images of the filter `of`, with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range, and for a filter that needs halves.
    pub fn with_options(of: F, options: JamesSteinOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        if of.needs().halves {
            let allowed = "a filter that needs no halves, such as gaussian";
            return Err(Error::OutOfRange { name: "of", value: of.name().to_owned(), allowed });
        }
        Ok(Self { of, options })
    }

    /// The shrunk image of `half`: its pixels, moved towards the filtered image `z` of the other half.
    fn shrunk(&self, film: &Film, half: usize, z: &[[f32; 3]]) -> Vec<[f64; 3]> {
        let size = film.frame().size().map(|n| n as usize);
        let radius = self.options.window / 2;
        let noise = |i: usize| noise(film, half, i, self.options.noise);
        let difference = |i: usize| {
            let y = film.half(half, i).unwrap_or_default().mean;
            std::array::from_fn::<f64, 3, _>(|c| y[c] - f64::from(z[i][c]))
        };
        // Per pixel: 1 if both halves have samples, the squared differences, 1 if the noise is known, and the noise.
        let sums = window_sums(size, radius, |i| {
            let mut sums = [0.0; 8];
            if [0, 1].iter().all(|&h| film.half(h, i).unwrap_or_default().count > 0) {
                sums[0] = 1.0;
                (0..3).for_each(|c| sums[1 + c] = difference(i)[c] * difference(i)[c]);
            }
            if let Some(noise) = noise(i) {
                sums[4] = 1.0;
                (0..3).for_each(|c| sums[5 + c] = noise[c]);
            }
            sums
        });
        let factors = |i: usize| {
            let sums = &sums[i];
            std::array::from_fn::<f64, 3, _>(|c| factor(sums[0], sums[5 + c] / sums[4].max(1.0), sums[1 + c]))
        };
        let smooth = window_sums(size, radius, |i| {
            let [r, g, b] = factors(i);
            [1.0, r, g, b]
        });
        let pixel = |i: usize| {
            let difference = difference(i);
            std::array::from_fn(|c| f64::from(z[i][c]) + smooth[i][1 + c] / smooth[i][0] * difference[c])
        };
        per_pixel(film, pixel)
    }
}

/// The variance of the mean of pixel `i` in `half`; `None` if it is unknown.
fn noise(film: &Film, half: usize, i: usize, estimate: NoiseEstimate) -> Option<[f64; 3]> {
    let [own, other] = [half, 1 - half].map(|half| film.half(half, i).unwrap_or_default());
    match estimate {
        NoiseEstimate::Samples => Some(own.variance()?.map(|v| v / own.count as f64)),
        NoiseEstimate::Halves => {
            // The difference of both means has the variance of a sample times 1 / own + 1 / other.
            let share = other.count as f64 / (own.count + other.count).max(1) as f64;
            let both = own.count > 0 && other.count > 0;
            both.then(|| std::array::from_fn(|c| (own.mean[c] - other.mean[c]).powi(2) * share))
        }
    }
}

/// The fraction, in `[0, 1]`, of the difference between pixels and filtered image that is kept.
///
/// `count` is the number of pixels in the window, `variance` their noise, and `squares` the sum of squared differences.
fn factor(count: f64, variance: f64, squares: f64) -> f64 {
    // Fewer than 3 pixels give no shrinkage estimate.
    let excess = (count - 2.0).max(0.0) * variance / squares.max(1e-5);
    if excess.is_finite() { (1.0 - excess).max(0.0) } else { 0.0 }
}

impl<F: Filter> Filter for JamesStein<F> {
    fn name(&self) -> &str {
        "james-stein"
    }

    fn describe(&self) -> String {
        format!("james-stein:of={},{}", nested(&self.of.describe()), self.options.describe())
    }

    fn needs(&self) -> Needs {
        let needs = self.of.needs();
        let needs = if needs.features { needs.with_feature_halves() } else { needs };
        needs.and(Needs::none().with_half_variance())
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        self.of.recorders()
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        // One half's film and image beside the filter's planes; then both images, sums over rows and windows, and factors.
        let mut alone = *needs;
        (alone.halves, alone.feature_halves) = (false, false);
        let half = Film::bytes_per_pixel(&alone) + 12;
        let filtering = self.of.memory(frame, &alone).applying.saturating_add(frame.bytes(half));
        let own = FilterMemory::new(frame, 2 * 12 + 2 * 64 + 2 * 32 + 24, ImagePlanes::Radiance);
        own.at_least(filtering)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let of_half = |half| -> Result<Vec<[f32; 3]>, Error> { Ok(self.of.apply(&film.half_film(half)?)?.radiance) };
        let filtered = [of_half(0)?, of_half(1)?];
        let shrunk = [0, 1].map(|half: usize| self.shrunk(film, half, &filtered[1 - half]));
        let pixel = |i: usize| -> [f32; 3] {
            let [a, b] = [0, 1].map(|half| film.half(half, i).unwrap_or_default().count as f64);
            std::array::from_fn(|c| {
                let mean = match (a > 0.0, b > 0.0) {
                    (true, true) => (a * shrunk[0][i][c] + b * shrunk[1][i][c]) / (a + b),
                    (false, false) => 0.5 * (f64::from(filtered[0][i][c]) + f64::from(filtered[1][i][c])),
                    _ => film.mean(i)[c],
                };
                mean.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32
            })
        };
        Ok(Filtered::new(film.frame().size(), per_pixel(film, pixel)))
    }
}
