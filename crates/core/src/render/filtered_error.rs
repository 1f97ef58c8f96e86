//! The relMSE of a filtered image, measured with samples that the filter has not seen.
//!
//! Let `F` be the filtered image of the samples so far, and `X`, `Y` the means of the next round's samples in the two
//! halves. If they are independent, `E (F - X)(F - Y)` is the squared error of `F`, without bias for any filter. [`Points`]
//! corrects for the dependence within a low-discrepancy sequence.
//!
//! The filter's own estimate uses only samples that the filter has fitted. The ratio of the measured error to this estimate
//! changes slowly as samples are added. Multiplied by it, the filter's estimate predicts the error of the image of all samples.

use crate::{Error, Film, Filter};
use serde::{Deserialize, Serialize};

/// The constant that relMSE adds to the squared mean.
const EPSILON: f64 = 0.01;
/// The width of a block in pixels. The variance of a measurement comes from the differences between blocks.
const BLOCK: usize = 8;
/// The minimum number of blocks with a measurement.
const FEWEST: usize = 4;
/// The standard deviation of the ratio (the true error divided by the filter's own estimate) before it is measured.
const PRIOR: f64 = 0.6;
/// The relative standard deviation by which the ratio changes when the number of samples doubles.
const DRIFT: f64 = 0.2;
/// The minimum relative standard deviation of a measurement.
const LEAST: f64 = 0.2;
/// The factor on the variance of a measurement that lies below the current ratio. Blocks without the rare bright paths give
/// low measurements that seem precise.
const LOW: f64 = 3.0;
/// The number of standard deviations that are added to the ratio. Without them, renders would on average stop too early, at
/// the first low prediction.
const CAUTION: f64 = 0.3;
/// The range to which the ratio is clamped.
const RATIOS: [f64; 2] = [0.2, 5.0];
/// The range of the exponent with which the error of filtered images falls with the number of samples; `FALL` is its
/// initial value.
const FALLS: [f64; 2] = [0.4, 1.2];
const FALL: f64 = 0.8;

/// A predicted relMSE.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Prediction {
    pub(super) relmse: f64,
    /// The exponent with which the error falls with the number of samples.
    pub(super) fall: f64,
    /// True if samples that are not in the image have confirmed the prediction.
    pub(super) confirmed: bool,
}

impl Prediction {
    /// The prediction for the unfiltered image. Its error falls approximately as n^-1.2.
    pub(super) fn unfiltered(film: &Film) -> Self {
        Self { relmse: film.predicted_relmse().unwrap_or(f64::INFINITY), fall: 1.2, confirmed: true }
    }
}

/// The filtered image at the last prediction, the halves from which it was made, and the ratio measured so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FilteredError {
    samples: u64,
    /// The relMSE according to the filter's own estimate.
    own: f64,
    pub(super) prediction: Prediction,
    /// The true error divided by the filter's own estimate; `variance` is the variance of this ratio.
    ratio: f64,
    variance: f64,
    image: Vec<[f32; 3]>,
    error: Vec<f32>,
    counts: [Vec<u32>; 2],
    means: [Vec<[f32; 3]>; 2],
}

impl FilteredError {
    /// Filters the film and predicts the error of the image. `None` if the filter has no estimate of its own.
    pub(crate) fn next(before: Option<Self>, film: &Film, filter: &dyn Filter) -> Result<Option<Self>, Error> {
        let samples = film.record().samples;
        if before.as_ref().is_some_and(|before| before.samples == samples) {
            return Ok(before);
        }
        let image = filter.apply(film)?;
        let (Some(error), [first, second]) = (image.error, &film.kept[..]) else { return Ok(None) };
        let size = film.frame().size().map(|n| n as usize);
        let own = own_relmse(&image.radiance, &error, size);
        let (mut ratio, mut variance, mut fall, mut confirmed) = (1.0, PRIOR * PRIOR, FALL, false);
        if let Some(before) = before {
            let growth = samples as f64 / before.samples.max(1) as f64;
            (ratio, variance, confirmed) = (before.ratio, before.variance, before.prediction.confirmed);
            variance += (ratio * DRIFT * growth.log2()).powi(2);
            if let Some((measured, spread)) = before.measure(film, size) {
                let spread = if measured < ratio { LOW * spread } else { spread };
                let gain = variance / (variance + spread);
                ratio = (ratio + gain * (measured - ratio)).clamp(RATIOS[0], RATIOS[1]);
                variance *= 1.0 - gain;
                confirmed = true;
            }
            let fell = (before.own / own).ln() / growth.ln();
            fall = if fell.is_finite() { fell.clamp(FALLS[0], FALLS[1]) } else { before.prediction.fall };
        }
        let counts = [first, second].map(|planes| planes.counts.clone());
        let means = [first, second].map(|planes| planes.means.iter().map(|m| m.map(|x| x as f32)).collect());
        let (image, relmse) = (image.radiance, own * (ratio + CAUTION * variance.sqrt()));
        let prediction = Prediction { relmse, fall, confirmed };
        Ok(Some(Self { samples, own, prediction, ratio, variance, image, error, counts, means }))
    }

    /// Measures the image's true error divided by the filter's own estimate, with the samples added since the last
    /// prediction. Returns this ratio and its variance; `None` if too few blocks have new samples in both halves.
    fn measure(&self, film: &Film, size: [usize; 2]) -> Option<(f64, f64)> {
        let [width, height] = size;
        let columns = width.div_ceil(BLOCK);
        let mut blocks = vec![[0.0; 2]; columns * height.div_ceil(BLOCK)];
        let mut points = Points::default();
        each_weight(&self.image, size, |i, weight| {
            let (Some(x), Some(y)) = (self.fresh(film, 0, i), self.fresh(film, 1, i)) else { return };
            let block = &mut blocks[i / width / BLOCK * columns + i % width / BLOCK];
            for c in 0..3 {
                let of = f64::from(self.image[i][c]);
                let [a, b] = [0, 1].map(|half: usize| f64::from(self.means[half][i][c]));
                block[0] += weight[c] * (of - x[c]) * (of - y[c]);
                block[1] += weight[c] * f64::from(self.error[i]);
                let across = (of - x[c]) * (0.5 * (a + b) - y[c]) + (of - y[c]) * (0.5 * (a + b) - x[c]);
                points.across += 0.5 * weight[c] * across;
                points.shared += 0.5 * weight[c] * (a - b) * (x[c] - y[c]);
                points.variance += 0.5 * weight[c] * (a - b) * (a - b);
            }
        });
        let known = blocks.iter().filter(|block| block[1] > 0.0).count();
        let [measured, own] = [0, 1].map(|k: usize| blocks.iter().map(|block| block[k]).sum::<f64>());
        let ratio = (measured + points.correction()) / own;
        if known < FEWEST || !ratio.is_finite() {
            return None;
        }
        let expected = ratio.max(self.ratio);
        let square = |block: &[f64; 2]| (block[0] - expected * block[1]).powi(2);
        let spread = blocks.iter().map(square).sum::<f64>() / (own * own) + (LEAST * expected).powi(2);
        spread.is_finite().then_some((ratio, spread))
    }

    /// The mean of the new samples in a half of pixel `i`. `None` if the half has no new samples, has lost samples, or had
    /// none before.
    fn fresh(&self, film: &Film, half: usize, i: usize) -> Option<[f64; 3]> {
        let planes = &film.kept[half];
        let before = f64::from(self.counts[half][i]);
        let now = planes.counts[i] as f64;
        let gained = now - before;
        let of = |c: usize| (now * planes.means[i][c] - before * f64::from(self.means[half][i][c])) / gained;
        (gained > 0.0 && before > 0.0).then(|| [of(0), of(1), of(2)])
    }

    /// Returns `true` if all planes have as many values as the film has pixels.
    pub(crate) fn fits(&self, film: &Film) -> bool {
        let pixels = film.frame().pixels();
        let [counts, means] = [self.counts.each_ref().map(Vec::len), self.means.each_ref().map(Vec::len)];
        film.kept.len() == 2 && [[self.image.len(), self.error.len()], counts, means] == [[pixels; 2]; 3]
    }
}

/// Sums over pixels that correct for the dependence between a point set's successive samples.
///
/// Low-discrepancy samples fill the gaps between earlier ones. So the new mean `X` of a half is low where its old mean `A`
/// is high. Since `F` follows `A`, `(F - X)(F - Y)` is too large. Let `C` be the covariance of `A` and `X`, and `g` the
/// weight of each half's pixel mean in `F`. Then the product's mean is the squared error minus `2 g C`. Halves are
/// independent, so `E (A - B)(X - Y) = 2 C`, and `E (F - X)((A + B) / 2 - Y) = g var A - C / 2 - g C`.
#[derive(Default)]
struct Points {
    /// The sum of `(F - X)((A + B) / 2 - Y)`.
    across: f64,
    /// The sum of `C`.
    shared: f64,
    /// The sum of `var A`.
    variance: f64,
}

impl Points {
    /// The sum of `2 g C`, at most 0: independent samples need no correction.
    fn correction(&self) -> f64 {
        let shared = self.shared.clamp(-0.5 * self.variance, 0.0);
        let weight = (self.across + 0.5 * shared) / (self.variance - shared);
        2.0 * shared * if weight.is_finite() { weight.clamp(0.0, 0.5) } else { 0.0 }
    }
}

/// The relMSE of an image, from the squared error of each pixel.
fn own_relmse(image: &[[f32; 3]], error: &[f32], size: [usize; 2]) -> f64 {
    let mut sum = 0.0;
    each_weight(image, size, |i, weight| sum += weight.iter().sum::<f64>() * f64::from(error[i]));
    sum / (3 * image.len()) as f64
}

/// Calls `f` with each pixel and the weights of its channels in relMSE. The mean of 3x3 pixels replaces the truth, as in
/// [`Film::predicted_relmse`].
fn each_weight(image: &[[f32; 3]], [width, height]: [usize; 2], mut f: impl FnMut(usize, [f64; 3])) {
    for y in 0..height {
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        for x in 0..width {
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            let count = (rows.len() * columns.len()) as f64;
            let mut level = [0.0; 3];
            for row in rows.clone() {
                for pixel in &image[row * width..][columns.clone()] {
                    (0..3).for_each(|c| level[c] += f64::from(pixel[c]));
                }
            }
            f(y * width + x, level.map(|sum| 1.0 / ((sum / count).powi(2) + EPSILON)));
        }
    }
}
