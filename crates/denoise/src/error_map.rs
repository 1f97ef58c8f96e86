//! Error estimates of filtered images from two halves: for choices and blends, the error of the result, and planned counts.

use crate::inputs::Inputs;
use crate::planes::{Channels, Pair, Plane, box_mean, combined, map, map_to_one, per_pixel, sum_pixels, update};
use dapple_core::{Error, Filtered};

/// The constant that relMSE adds to the squared mean.
const EPSILON: f32 = 0.01;

/// The factor on the estimated error of the unfiltered image when it is compared with filtered images. Its estimate is
/// never negative, while those of filtered images scatter. Without the factor, that scatter would select the noisy
/// image where all errors are small.
const HANDICAP: f32 = 2.0;

/// The weight of each pixel's squared error, as in relMSE: one over the squared mean of 3x3 pixels plus epsilon.
pub(crate) fn relative_weight(inputs: &Inputs, image: &Pair) -> Plane {
    let ([ra, ga, ba, rb, gb, bb], [na, nb]) = (image.channels(), inputs.counts());
    let grey = map_to_one([ra, ga, ba, rb, gb, bb, na, nb], |[ra, ga, ba, rb, gb, bb, na, nb]| {
        let of = |a: f32, b: f32| combined([a, b], [na, nb]);
        (of(ra, rb) + of(ga, gb) + of(ba, bb)) / 3.0
    });
    let epsilon = EPSILON / inputs.level() / inputs.level();
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
/// The selection is blurred over 5x5 pixels. With `unfiltered`, the unfiltered image is the last candidate; its
/// error counts [`HANDICAP`] times.
pub(crate) fn select(inputs: &Inputs, filtered: &[Pair], weight: &[f32], radius: usize, unfiltered: bool) -> Pair {
    let unfiltered = unfiltered.then(|| inputs.unfiltered());
    let candidates: Vec<Channels<'_>> = filtered.iter().map(Pair::channels).chain(unfiltered).collect();
    let of = |&image: &Channels<'_>| {
        let [error] = raw_error::<1>(inputs, image, weight);
        box_mean(&error, inputs.size, radius)
    };
    let mut errors: Vec<Plane> = candidates.iter().map(of).collect();
    if let (Some(_), Some(own)) = (unfiltered, errors.last_mut()) {
        update(own, [], |error, []| error * HANDICAP);
    }
    let shares = shares(inputs, &errors);
    Pair(std::array::from_fn(|k| {
        let mut sum = vec![0.0; shares[0].len()];
        for (image, share) in candidates.iter().zip(&shares) {
            update(&mut sum, [image[k], share], |sum, [value, share]| sum + share * value);
        }
        sum
    }))
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
        let is_best = map_to_one([&best], |[best]| if best == number { 1.0 } else { 0.0 });
        box_mean(&is_best, inputs.size, 2)
    };
    (0..errors.len()).map(share).collect()
}

/// The number of standard errors by which a bias must exceed 0 to count in the last blend. Without it, patches of specks remain
/// up to 16 spp; with 2, 1.5 % more error at 32 spp.
pub(crate) const EVIDENCE: f32 = 1.0;

/// The radii over which a blend pools its two sums, in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Radii {
    /// The radius for the squared difference that both halves agree on: the bias of the smooth image.
    pub(crate) bias: usize,
    /// The radius for the noise of the difference.
    pub(crate) noise: usize,
    /// The radius over which the noise of a filtered image is alike; 0 if the noise of every pixel is its own.
    pub(crate) alike: usize,
}

/// The radii of the last blend of a filter, with the unfiltered image.
pub(crate) const LAST: Radii = Radii { bias: 5, noise: 10, alike: 0 };

/// The radius over which the share of the smooth image is averaged.
const SHARE: usize = 3;

/// Moves the image `narrow` towards `smooth` as far as their difference is noise.
///
/// With `D_A` and `D_B` the differences of the halves, `V` the mean of `(D_A - D_B)^2 / 4` over a window and `B` that of
/// `D_A D_B`, the result is `narrow + a (smooth - narrow)` with `a = V / (V + max(0, B))`. The halves share no sample,
/// so `D_A D_B` estimates the squared bias without noise. It counts as far as it exceeds `evidence` standard errors:
/// otherwise chance would keep patches of noise. If every pixel has its own noise, the products themselves give their standard
/// error. In a filtered image, patches of pixels have the same noise, and products of strong detail are large: there, without
/// bias, a product's mean square is `4 V^2`, with `V` over a patch, and a patch counts once. Squares are relative to the
/// squared radiance of `smooth`, as in relMSE. A choice between the images by a threshold would keep dark pixels, which look free of noise, and replace
/// bright ones, and so darken the image. Without any pixel that both halves have sampled, the result is `smooth`.
pub(crate) fn shrink(inputs: &Inputs, narrow: Channels<'_>, smooth: &Pair, radii: Radii, evidence: f32) -> Pair {
    let weight = relative_weight(inputs, smooth);
    let smooth = smooth.channels();
    let [noise, bias] = differences(inputs, narrow, smooth, &weight);
    let squares = if radii.alike > 0 {
        map_to_one([&box_mean(&noise, inputs.size, radii.alike)], |[noise]| 4.0 * noise * noise)
    } else {
        map_to_one([&bias], |[bias]| bias * bias)
    };
    let mut share = box_mean(&noise, inputs.size, radii.noise);
    let [bias, squares] = [bias, squares].map(|plane| box_mean(&plane, inputs.size, radii.bias));
    // The number of standard errors of a mean over the window, per root of the mean square.
    let errors = evidence * (2 * radii.alike + 1) as f32 / (2 * radii.bias + 1) as f32;
    update(&mut share, [&bias, &squares], |noise, [bias, square]| {
        let certain = (bias - errors * square.sqrt()).max(0.0);
        (noise + 1e-12) / (noise + certain + 1e-12)
    });
    let share = box_mean(&share, inputs.size, SHARE);
    let blend = |k: usize| {
        map_to_one([narrow[k], smooth[k], &share], |[narrow, smooth, share]| (1.0 - share) * narrow + share * smooth)
    };
    Pair(std::array::from_fn(blend))
}

/// The planes of the noise and of the product of the halves' differences, per pixel; 0 where a half has no samples.
fn differences(inputs: &Inputs, narrow: Channels<'_>, smooth: Channels<'_>, weight: &[f32]) -> [Plane; 2] {
    let ([nra, nga, nba, nrb, ngb, nbb], [sra, sga, sba, srb, sgb, sbb]) = (narrow, smooth);
    let [na, nb] = inputs.counts();
    map([nra, nga, nba, nrb, ngb, nbb, sra, sga, sba, srb, sgb, sbb, na, nb, weight], |values| {
        let [nra, nga, nba, nrb, ngb, nbb, sra, sga, sba, srb, sgb, sbb, na, nb, weight] = values;
        let (mut noise, mut bias) = (0.0, 0.0);
        for [a, b] in [[sra - nra, srb - nrb], [sga - nga, sgb - ngb], [sba - nba, sbb - nbb]] {
            noise += (a - b) * (a - b) * 0.25;
            bias += a * b;
        }
        let known = na != 0.0 && nb != 0.0;
        [noise, bias].map(|sum: f32| if known { sum * weight / 3.0 } else { 0.0 })
    })
}

/// The usual radius of [`filtered`] in pixels.
pub(crate) const ERROR: usize = 3;

/// The filtered image in radiance, with the estimated squared error of each pixel.
///
/// The error is the larger of two smoothed estimates: the whole error over `radius` pixels to each side, and the variance over 5x5. It is
/// at least 5 % of the image's mean error, both relative to the squared brightness of 3x3 pixels. It is infinite where
/// no pixel in reach has samples in both halves.
///
/// Taking the larger estimate keeps the positive part of noise, so that the map's mean is too high. That of the whole error, unsmoothed,
/// is too low (see [`raw_error`]). The map is scaled to the geometric mean of both means; the lower one is at least the variance.
pub(crate) fn filtered(inputs: &Inputs, image: &Pair, radius: usize) -> Filtered {
    let weight = relative_weight(inputs, image);
    let [whole, variance] = raw_error(inputs, image.channels(), &weight);
    let known = map_to_one(inputs.counts(), |[a, b]| if a > 0.0 && b > 0.0 { 1.0 } else { 0.0 });
    let near = |plane: &[f32], radius| -> Plane {
        let (mut mean, count) = (box_mean(plane, inputs.size, radius), box_mean(&known, inputs.size, radius));
        update(&mut mean, [&count], |sum, [n]| if n > 0.0 { sum / n } else { f32::INFINITY });
        mean
    };
    let mut error = near(&whole, radius);
    update(&mut error, [&near(&variance, 2)], |whole, [variance]| whole.max(variance).max(0.0));
    let counted = |i: usize| if error[i].is_finite() { [f64::from(error[i]), 1.0] } else { [0.0; 2] };
    let [sum, count] = sum_pixels(inputs.size, counted);
    let raw = |i: usize| [whole[i], variance[i], known[i]].map(f64::from);
    let [whole, variance, pixels] = sum_pixels(inputs.size, raw);
    let mean = sum / count.max(1.0);
    let scale = if mean > 0.0 { (whole.max(variance) / pixels.max(1.0) / mean).sqrt() } else { 1.0 };
    let (least, scale) = ((0.05 * mean) as f32, scale.min(1.0) as f32 * inputs.level() * inputs.level());
    update(&mut error, [&weight], |error, [weight]| error.max(least) / weight * scale);
    let ([ra, ga, ba, rb, gb, bb], counts, level) = (image.channels(), inputs.counts(), inputs.level());
    let colour = |i: usize| {
        let counts = counts.map(|count| count[i]);
        [[ra, rb], [ga, gb], [ba, bb]].map(|[a, b]| (combined([a[i], b[i]], counts) * level).min(f32::MAX))
    };
    let radiance = per_pixel(inputs.pixels(), colour);
    Filtered::new(inputs.size.map(|n| n as u32), radiance).with_error(error)
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
