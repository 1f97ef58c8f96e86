//! Error estimates of filtered images from two halves, for choosing between filters and planning counts.

use crate::among::Among;
use crate::maps::{box_mean, map, update};
use crate::planes::{Colours, Inputs, Plane, first_share, raised};
use dapple_core::{Error, Filtered};
use rayon::prelude::*;

/// The constant that relMSE adds to the squared mean.
const EPSILON: f32 = 0.01;

/// The factor on the estimated error of the unfiltered image when it is compared with filtered images. Its estimate is
/// never negative, while those of filtered images scatter. Without the factor, that scatter would select the noisy
/// image where all errors are small.
const HANDICAP: f32 = 2.0;

/// Two images, one from each half of the samples.
#[derive(Clone)]
pub(crate) struct Pair(pub(crate) [Colours; 2]);

/// Red, green and blue of the first half, then of the second.
pub(crate) type Channels<'a> = [&'a [f32]; 6];

/// The places of channel `k` of [`Channels`] and of its weights, among planes of which every fourth holds weights.
pub(crate) const fn beside_weights(k: usize) -> [usize; 2] {
    [k + k / 3, k / 3 * 4 + 3]
}

impl Pair {
    /// Two images from their channels.
    pub(crate) fn new([ra, ga, ba, rb, gb, bb]: [Plane; 6]) -> Self {
        Self([[ra, ga, ba], [rb, gb, bb]])
    }

    /// The channels of both images.
    pub(crate) fn channels(&self) -> Channels<'_> {
        let [[ra, ga, ba], [rb, gb, bb]] = &self.0;
        [ra, ga, ba, rb, gb, bb]
    }

    /// Multiplies both halves by each pixel's albedo, [raised].
    pub(crate) fn modulate(&mut self, inputs: &Inputs) {
        for (c, plane) in self.0.iter_mut().flat_map(|half| half.iter_mut().enumerate()) {
            update(plane, [&inputs.features.mean[3 + c]], |value, [albedo]| value * raised(albedo));
        }
    }

    /// Adds `light` to both halves.
    pub(crate) fn add(&mut self, light: &[Colours; 2]) {
        for (plane, light) in self.0.iter_mut().flatten().zip(light.iter().flatten()) {
            update(plane, [light], |value, [light]| value + light);
        }
    }
}

/// A channel of the mean of both halves `a` and `b`, weighted by their sample counts `na` and `nb`.
#[inline(always)]
pub(crate) fn combined([a, b]: [f32; 2], [na, nb]: [f32; 2]) -> f32 {
    b + first_share([na, nb]) * (a - b)
}

/// The weight of each pixel's squared error, as in relMSE: one over the squared mean of 3x3 pixels plus epsilon.
pub(crate) fn relative_weight(inputs: &Inputs, image: &Pair) -> Plane {
    let ([ra, ga, ba, rb, gb, bb], [na, nb]) = (image.channels(), inputs.counts());
    let [grey] = map([ra, ga, ba, rb, gb, bb, na, nb], |[ra, ga, ba, rb, gb, bb, na, nb]| {
        let of = |a: f32, b: f32| combined([a, b], [na, nb]);
        [(of(ra, rb) + of(ga, gb) + of(ba, bb)) / 3.0]
    });
    let epsilon = EPSILON / inputs.level / inputs.level;
    let mut weight = box_mean(&grey, inputs.size, 1);
    update(&mut weight, [], |mean, []| 1.0 / (mean * mean + epsilon).max(1e-30));
    weight
}

/// The estimated squared error of each pixel times its weight, unsmoothed, and the part of it that is variance. Both
/// are 0 where a half has no samples. One plane (`N`) leaves the variance out.
///
/// Let `F_A`, `F_B` be the filtered and `A`, `B` the unfiltered halves. `A` and `B` share no sample.
/// So `E (F_A - B)^2` is the error of `F_A` plus the variance of `B`, and `E (A - B)^2` is the sum of both variances.
/// Averaging `F_A` and `F_B` removes the square of half their difference.
///
/// This holds if `F_A` does not depend on `B`. Weights and blends do depend on it, so the estimate is too low by the
/// covariances of `F_A` with `B` and of `F_B` with `A`.
///
/// The sample variance in place of `(A - B)^2` would overrate the noise of low-discrepancy samples.
pub(crate) fn raw_error<const N: usize>(inputs: &Inputs, image: Channels<'_>, weight: &[f32]) -> [Plane; N] {
    let ([fra, fga, fba, frb, fgb, fbb], [ra, ga, ba, rb, gb, bb]) = (image, inputs.unfiltered());
    let [na, nb] = inputs.counts();
    map([fra, fga, fba, frb, fgb, fbb, ra, ga, ba, rb, gb, bb, na, nb, weight], |values| {
        let [fra, fga, fba, frb, fgb, fbb, ra, ga, ba, rb, gb, bb, na, nb, weight] = values;
        let (mut whole, mut variance) = (0.0, 0.0);
        for [fa, fb, ua, ub] in [[fra, frb, ra, rb], [fga, fgb, ga, gb], [fba, fbb, ba, bb]] {
            let common = 0.25 * (fa - fb) * (fa - fb);
            let (across, back, apart) = (fa - ub, fb - ua, ua - ub);
            whole += 0.5 * (across * across + back * back - apart * apart) - common;
            variance += common;
        }
        let known = if na == 0.0 || nb == 0.0 { 0.0 } else { weight / 3.0 };
        std::array::from_fn(|k| [whole, variance][k] * known)
    })
}

/// Selects per pixel the candidate with the least estimated error over `(2 radius + 1)^2` pixels, the first of equals.
/// The selection is blurred over 5x5 pixels. The unfiltered image is the last candidate if there is an `evidence`; its error
/// counts [`HANDICAP`] times.
///
/// The unfiltered image must also be better than each other candidate by `evidence` standard errors of that difference;
/// 0 is no condition. One pixel whose two halves are bright by chance reaches 1 standard error.
pub(crate) fn select(inputs: &Inputs, filtered: &[Pair], weight: &[f32], radius: usize, evidence: Option<f32>) -> Pair {
    let unfiltered = evidence.map(|_| inputs.unfiltered());
    let candidates: Vec<Channels<'_>> = filtered.iter().map(Pair::channels).chain(unfiltered).collect();
    let raw: Vec<Plane> = candidates
        .iter()
        .map(|&image| {
            let [whole] = raw_error(inputs, image, weight);
            whole
        })
        .collect();
    let mut errors: Vec<Plane> = raw.iter().map(|error| box_mean(error, inputs.size, radius)).collect();
    if let (Some(evidence), Some((own, others))) = (evidence, errors.split_last_mut()) {
        update(own, [], |error, []| error * HANDICAP);
        if evidence > 0.0 {
            for other in &raw[..others.len()] {
                forbid_doubtful(inputs, own, [other, &raw[others.len()]], radius, evidence);
            }
        }
    }
    drop(raw);
    mixed(&candidates, &shares(inputs, &errors))
}

/// The share of each candidate: 1 where its error is the least, the first of equals, blurred over 5x5 pixels.
fn shares(inputs: &Inputs, errors: &[Plane]) -> Vec<Plane> {
    let (mut least, mut best) = (errors[0].clone(), vec![0.0; errors[0].len()]);
    for (number, error) in (1u8..).zip(&errors[1..]) {
        let number = f32::from(number);
        update(&mut best, [error, &least], |best, [error, least]| if error < least { number } else { best });
        update(&mut least, [error], |least, [error]| if error < least { error } else { least });
    }
    let share = |number: usize| {
        let number = number as f32;
        let [is] = map([&best], |[best]| [if best == number { 1.0 } else { 0.0 }]);
        box_mean(&is, inputs.size, 2)
    };
    (0..errors.len()).map(share).collect()
}

/// The sum of several pairs of images, each multiplied by a weight per pixel.
fn mixed(images: &[Channels<'_>], weights: &[Plane]) -> Pair {
    let mix = |k: usize| -> Plane {
        let mut sum = vec![0.0; weights[0].len()];
        for (image, weight) in images.iter().zip(weights) {
            update(&mut sum, [image[k], weight], |sum, [value, weight]| sum + weight * value);
        }
        sum
    };
    Pair::new(std::array::from_fn(mix))
}

/// Sets the error of a candidate to infinity where the mean of `other - own` over `(2 radius + 1)^2` pixels is at most `evidence`
/// standard errors.
fn forbid_doubtful(inputs: &Inputs, error: &mut [f32], [other, own]: [&Plane; 2], radius: usize, evidence: f32) {
    let [apart, squares] = map([other, own], |[other, own]| [other - own, (other - own) * (other - own)]);
    let [mean, square] = [apart, squares].map(|plane| box_mean(&plane, inputs.size, radius));
    let errors = evidence / (2 * radius + 1) as f32;
    let is_doubtful = |mean: f32, square: f32| mean <= errors * square.sqrt();
    update(
        error,
        [&mean, &square],
        |error, [mean, square]| {
            if is_doubtful(mean, square) { f32::INFINITY } else { error }
        },
    );
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
    let [whole, variance] = raw_error(inputs, image.channels(), &weight);
    let [known] = map(inputs.counts(), |[a, b]| [if a > 0.0 && b > 0.0 { 1.0 } else { 0.0 }]);
    let near = |plane: &[f32], radius| -> Plane {
        let (mut mean, count) = (box_mean(plane, inputs.size, radius), box_mean(&known, inputs.size, radius));
        update(&mut mean, [&count], |sum, [n]| if n > 0.0 { sum / n } else { f32::INFINITY });
        mean
    };
    let mut smooth = near(&whole, radius);
    update(&mut smooth, [&near(&variance, 2)], |whole, [variance]| whole.max(variance).max(0.0));
    let finite = |i: usize| if smooth[i].is_finite() { [f64::from(smooth[i]), 1.0] } else { [0.0; 2] };
    let [sum, count] = among.sum_pixels(&inputs.place, inputs.size[0], finite)?;
    let floor = (0.05 * sum / count.max(1.0)) as f32;
    let square = inputs.level * inputs.level;
    update(&mut smooth, [&weight], |error, [weight]| error.max(floor) / weight * square);
    let ([ra, ga, ba, rb, gb, bb], counts) = (image.channels(), inputs.counts());
    let colour = |i: usize| {
        let of =
            |a: &[f32], b: &[f32]| (combined([a[i], b[i]], counts.map(|count| count[i])) * inputs.level).min(f32::MAX);
        [of(ra, rb), of(ga, gb), of(ba, bb)]
    };
    let radiance = (0..inputs.pixels()).into_par_iter().with_min_len(1024).map(colour).collect();
    Ok(Filtered::new(inputs.size.map(|n| n as u32), radiance).with_error(smooth))
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
