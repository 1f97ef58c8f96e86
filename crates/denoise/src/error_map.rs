//! Error estimates of filtered images from two halves, for choosing between filters and planning counts.

use crate::among::Among;
use crate::planes::{Colours, Inputs, Plane, box_mean};
use dapple_core::{Error, Filtered};
use rayon::prelude::*;

/// The constant that relMSE adds to the squared mean.
const EPSILON: f32 = 0.01;

/// The factor on the estimated error of the unfiltered image when it is compared with filtered images. Its estimate is
/// never negative, while those of filtered images scatter. Without the factor, that scatter would select the noisy
/// image where all errors are small.
const HANDICAP: f32 = 2.0;

/// The number of pixels per parallel task.
const CHUNK: usize = 4096;

/// Two images, one from each half of the samples.
#[derive(Clone)]
pub(crate) struct Pair(pub(crate) [Colours; 2]);

impl Pair {
    /// The unfiltered mean colours of both halves.
    pub(crate) fn unfiltered(inputs: &Inputs) -> Self {
        Self([0, 1].map(|h| inputs.halves[h].colour.clone()))
    }

    /// Channel `c` of pixel `i` in the mean of both halves, weighted by their sample counts.
    pub(crate) fn combined(&self, inputs: &Inputs, c: usize, i: usize) -> f32 {
        let (a, b) = (self.0[0][c][i], self.0[1][c][i]);
        b + inputs.first_share(i) * (a - b)
    }

    /// Multiplies both halves by each pixel's albedo, raised to at least 0.02.
    pub(crate) fn modulate(&mut self, inputs: &Inputs) {
        self.each(|c, i, value| value * inputs.divisor(c, i));
    }

    /// Adds `light` to both halves.
    pub(crate) fn add(&mut self, light: &[Colours; 2]) {
        for (plane, light) in self.0.iter_mut().flatten().zip(light.iter().flatten()) {
            plane.iter_mut().zip(light).for_each(|(value, light)| *value += light);
        }
    }

    fn each(&mut self, f: impl Fn(usize, usize, f32) -> f32) {
        for (c, plane) in self.0.iter_mut().flat_map(|half| half.iter_mut().enumerate()) {
            for (i, value) in plane.iter_mut().enumerate() {
                *value = f(c, i, *value);
            }
        }
    }

    /// The sum of several pairs of images, each multiplied by a weight per pixel.
    pub(crate) fn mixed(pairs: &[&Self], weights: &[Plane]) -> Self {
        let mix = |half: usize, c: usize| -> Plane {
            let mut sum = vec![0.0; pairs[0].0[half][c].len()];
            sum.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, sum)| {
                for (pair, weight) in pairs.iter().zip(weights) {
                    let (own, weight) = (&pair.0[half][c][chunk * CHUNK..], &weight[chunk * CHUNK..]);
                    sum.iter_mut().zip(own).zip(weight).for_each(|((s, p), w)| *s += w * p);
                }
            });
            sum
        };
        Self([0, 1].map(|half| std::array::from_fn(|c| mix(half, c))))
    }
}

/// The weight of each pixel's squared error, as in relMSE: one over the squared mean of 3x3 pixels plus epsilon.
pub(crate) fn relative_weight(inputs: &Inputs, image: &Pair) -> Plane {
    let of = |c: usize, i: usize| image.combined(inputs, c, i);
    let grey = |i: usize| (of(0, i) + of(1, i) + of(2, i)) / 3.0;
    let grey: Plane = (0..inputs.pixels()).into_par_iter().with_min_len(1024).map(grey).collect();
    let epsilon = EPSILON / inputs.level / inputs.level;
    let mean = box_mean(&grey, inputs.size, 1);
    mean.into_par_iter().with_min_len(1024).map(|m| 1.0 / (m * m + epsilon).max(1e-30)).collect()
}

/// The estimated squared error of each pixel times its weight, unsmoothed, and the part of it that is variance. Both
/// are 0 where a half has no samples.
///
/// Let `F_A`, `F_B` be the filtered and `A`, `B` the unfiltered halves. `A` and `B` share no sample.
/// So `E (F_A - B)^2` is the error of `F_A` plus the variance of `B`, and `E (A - B)^2` is the sum of both variances.
/// Averaging `F_A` and `F_B` removes the square of half their difference.
///
/// This holds if `F_A` does not depend on `B`. Weights and blends do depend on it, so the estimate is too low by the
/// covariances of `F_A` with `B` and of `F_B` with `A`.
///
/// The sample variance in place of `(A - B)^2` would overrate the noise of low-discrepancy samples.
pub(crate) fn raw_error(inputs: &Inputs, image: &Pair, weight: &[f32]) -> [Plane; 2] {
    let mut planes = [vec![0.0; inputs.pixels()], vec![0.0; inputs.pixels()]];
    let [whole, variance] = &mut planes;
    let chunks = whole.par_chunks_mut(CHUNK).zip(variance.par_chunks_mut(CHUNK));
    chunks.enumerate().for_each(|(chunk, (whole, variance))| {
        let from = chunk * CHUNK;
        let [a, b] = &inputs.halves;
        for c in 0..3 {
            let (fa, fb) = (&image.0[0][c][from..][..whole.len()], &image.0[1][c][from..][..whole.len()]);
            let (ua, ub) = (&a.colour[c][from..][..whole.len()], &b.colour[c][from..][..whole.len()]);
            for i in 0..whole.len() {
                let common = 0.25 * (fa[i] - fb[i]) * (fa[i] - fb[i]);
                let (across, back, apart) = (fa[i] - ub[i], fb[i] - ua[i], ua[i] - ub[i]);
                whole[i] += 0.5 * (across * across + back * back - apart * apart) - common;
                variance[i] += common;
            }
        }
        let (na, nb) = (&a.count[from..], &b.count[from..]);
        for i in 0..whole.len() {
            let known = if na[i] == 0.0 || nb[i] == 0.0 { 0.0 } else { weight[from + i] / 3.0 };
            whole[i] *= known;
            variance[i] *= known;
        }
    });
    planes
}

/// Selects per pixel the candidate with the least estimated error over `(2 radius + 1)^2` pixels, the first of equals.
/// The selection is blurred over 5x5 pixels. The error of the unfiltered image, if that is a candidate, counts
/// [`HANDICAP`] times.
///
/// The unfiltered image must also be better than each other candidate by `evidence` standard errors of that difference;
/// 0 is no condition. One pixel whose two halves are bright by chance reaches 1 standard error.
pub(crate) fn select(
    inputs: &Inputs,
    filtered: &[Pair],
    unfiltered: Option<&Pair>,
    weight: &[f32],
    radius: usize,
    evidence: f32,
) -> Pair {
    let candidates: Vec<&Pair> = filtered.iter().chain(unfiltered).collect();
    let raw: Vec<Plane> = candidates
        .par_iter()
        .map(|pair| {
            let [whole, _] = raw_error(inputs, pair, weight);
            whole
        })
        .collect();
    let mut errors: Vec<Plane> = raw.par_iter().map(|error| box_mean(error, inputs.size, radius)).collect();
    for error in &mut errors[filtered.len()..] {
        error.iter_mut().for_each(|e| *e *= HANDICAP);
    }
    if evidence > 0.0 && unfiltered.is_some() {
        let (others, own) = errors.split_at_mut(filtered.len());
        let doubtful: Vec<Vec<bool>> = (0..others.len())
            .into_par_iter()
            .map(|k| is_doubtful(inputs, [&raw[k], &raw[filtered.len()]], radius, evidence))
            .collect();
        for (i, error) in own[0].iter_mut().enumerate() {
            *error = if doubtful.iter().any(|doubtful| doubtful[i]) { f32::INFINITY } else { *error };
        }
    }
    let best =
        |i: usize| (1..errors.len()).fold(0, |best, k| if errors[k][i] < errors[best][i] { k } else { best }) as u8;
    let chosen: Vec<u8> = (0..inputs.pixels()).into_par_iter().with_min_len(1024).map(best).collect();
    let share = |k: usize| {
        let is: Plane = chosen.iter().map(|&c| if usize::from(c) == k { 1.0 } else { 0.0 }).collect();
        box_mean(&is, inputs.size, 2)
    };
    let shares: Vec<Plane> = (0..candidates.len()).into_par_iter().map(share).collect();
    Pair::mixed(&candidates, &shares)
}

/// For each pixel, whether the mean of `other - own` over `(2 radius + 1)^2` pixels is at most `evidence` standard errors.
fn is_doubtful(inputs: &Inputs, [other, own]: [&Plane; 2], radius: usize, evidence: f32) -> Vec<bool> {
    let apart: Plane = other.iter().zip(own).map(|(other, own)| other - own).collect();
    let squares: Plane = apart.iter().map(|d| d * d).collect();
    let [mean, square] = [apart, squares].map(|plane| box_mean(&plane, inputs.size, radius));
    let errors = evidence / (2 * radius + 1) as f32;
    mean.iter().zip(&square).map(|(mean, square)| *mean <= errors * square.sqrt()).collect()
}

/// The filtered image in radiance, with the estimated squared error of each pixel ([`filtered_over`] 7x7 pixels).
pub(crate) fn filtered(inputs: &Inputs, image: &Pair, among: &mut Among<'_>) -> Result<Filtered, Error> {
    filtered_over(inputs, image, ERROR, among)
}

/// The filtered image in radiance, with the estimated squared error of each pixel.
///
/// The error is the larger of two smoothed estimates: the whole error over this radius and the variance over 5x5. It is
/// at least 5 % of the image's mean error, both relative to the squared brightness of 3x3 pixels. It is infinite where
/// no pixel in reach has samples in both halves.
///
/// Taking the larger estimate keeps the positive part of noise. On images with strong noise the sum is up to three times
/// the true error, and less with a larger radius.
pub(crate) fn filtered_over(
    inputs: &Inputs,
    image: &Pair,
    radius: usize,
    among: &mut Among<'_>,
) -> Result<Filtered, Error> {
    let weight = relative_weight(inputs, image);
    let [whole, variance] = raw_error(inputs, image, &weight);
    let [a, b] = [0, 1].map(|h| &inputs.halves[h].count);
    let known: Plane = a.iter().zip(b).map(|(a, b)| f32::from(u8::from(*a > 0.0 && *b > 0.0))).collect();
    let near = |plane: &[f32], radius| -> Plane {
        let (sums, counts) = (box_mean(plane, inputs.size, radius), box_mean(&known, inputs.size, radius));
        sums.iter().zip(counts).map(|(s, n)| if n > 0.0 { s / n } else { f32::INFINITY }).collect()
    };
    let smooth: Plane = near(&whole, radius).iter().zip(near(&variance, 2)).map(|(w, v)| w.max(v).max(0.0)).collect();
    let finite = |i: usize| if smooth[i].is_finite() { [f64::from(smooth[i]), 1.0] } else { [0.0; 2] };
    let [sum, count] = among.sum_pixels(&inputs.place, inputs.size[0], finite)?;
    let floor = 0.05 * sum / count.max(1.0);
    let square = inputs.level * inputs.level;
    let error: Vec<f32> = smooth.iter().zip(&weight).map(|(e, w)| e.max(floor as f32) / w * square).collect();
    let of = |c: usize, i: usize| (image.combined(inputs, c, i) * inputs.level).min(f32::MAX);
    let colour = |i: usize| [of(0, i), of(1, i), of(2, i)];
    let radiance = (0..inputs.pixels()).into_par_iter().with_min_len(1024).map(colour).collect();
    Ok(Filtered::new(inputs.size.map(|n| n as u32), radiance).with_error(error))
}

/// The radius of [`filtered`] in pixels.
const ERROR: usize = 3;

/// The rows that a smoothed error of this radius reads above and below its own: those of the relative weights too.
pub(crate) const fn error_rows(radius: usize) -> usize {
    if radius > 2 { radius + 1 } else { 3 }
}

/// The rows that the error of [`filtered`] reads above and below its own.
pub(crate) const ERROR_ROWS: usize = error_rows(ERROR);

/// The rows that [`select`] reads of its candidates above and below its own: the errors, and the blurred selection.
pub(crate) const fn select_rows(radius: usize) -> usize {
    radius + 2
}

/// The estimated squared error of each filtered pixel relative to `mean^2 + epsilon`, row by row.
///
/// The error is [`Filtered::error`]. The mean is taken over 3x3 pixels and the channels.
/// An infinite error counts as the largest finite one, or as 1 if none is finite. Values are finite and not negative.
/// They serve as scores for a sampler that follows the error of a filter.
///
/// ```
/// use dapple_core::Filtered;
/// use dapple_denoise::relative_errors;
///
/// let image = Filtered::new([2, 1], vec![[1.0; 3]; 2]).with_error(vec![0.5, f32::INFINITY]);
/// assert_eq!(relative_errors(&image, 0.0)?, [0.5, 0.5]);
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// # Errors
///
/// [`Error::NotRecorded`] when `filtered` has no error.
pub fn relative_errors(filtered: &Filtered, epsilon: f32) -> Result<Vec<f32>, Error> {
    let Some(error) = &filtered.error else {
        return Err(Error::NotRecorded { who: "relative_errors".to_owned(), what: "the filter's own error" });
    };
    let size = filtered.size.map(|n| n as usize);
    let grey: Plane = filtered.radiance.iter().map(|[r, g, b]| ((r + g + b) / 3.0).min(1e15)).collect();
    let squares = box_mean(&grey, size, 1).into_iter().map(|mean| mean * mean + epsilon);
    let relative: Plane = error.iter().zip(squares).map(|(error, square)| error / square).collect();
    let largest = relative.iter().copied().filter(|e| e.is_finite()).reduce(f32::max).unwrap_or(1.0);
    Ok(relative.into_iter().map(|e| if e.is_finite() { e.max(0.0) } else { largest }).collect())
}
