//! Error estimates of filtered images from two halves. They select and blend images, measure the error of the result, and plan
//! sample counts.

use crate::graph::{Graph, Reach, all};
use crate::inputs::Inputs;
use crate::light::{Light, finite};
use crate::planes::{Colours, Pair, Plane, box_mean, box_mean_of, combined, map, map_to_one};
use dapple_core::{Error, Filtered};

/// The constant that is added to the squared mean in relMSE.
const EPSILON: f32 = 0.01;

/// The factor on the estimated error of the unfiltered image when it is compared with filtered images. That estimate is never
/// negative, while estimates for filtered images scatter around their mean. Without the factor, that scatter would select the
/// noisy image where all errors are small.
const HANDICAP: f32 = 2.0;

/// The weight of each pixel's squared error, as in relMSE: `1 / (mean^2 + epsilon)`, with the mean over 3x3 pixels.
pub(crate) fn relative_weight(graph: &Graph<'_>, inputs: &Inputs, image: Pair) -> Plane {
    let (Pair([ra, ga, ba, rb, gb, bb]), [na, nb]) = (image, inputs.counts());
    let grey = map_to_one(graph, [ra, ga, ba, rb, gb, bb, na, nb], |[ra, ga, ba, rb, gb, bb, na, nb]| {
        let of = |a: f32, b: f32| combined([a, b], [na, nb]);
        (of(ra, rb) + of(ga, gb) + of(ba, bb)) / 3.0
    });
    let epsilon = EPSILON / inputs.level() / inputs.level();
    let mean = box_mean(graph, grey, 1);
    map_to_one(graph, [mean], move |[mean]| 1.0 / (mean * mean + epsilon).max(1e-30))
}

/// The estimated squared error of each pixel times its weight, unsmoothed, and the part that is variance. Both are 0 where a
/// half has no samples. With `N` = 1, the variance is left out.
///
/// Let `F_A`, `F_B` be the filtered and `A`, `B` the unfiltered halves. `A` and `B` share no sample.
/// So `E (F_A - B)^2` is the squared error of `F_A` plus the variance of `B`, and `E (A - B)^2` is the sum of both variances.
/// Averaging `F_A` and `F_B` reduces the error by the square of half their difference.
///
/// This holds if `F_A` does not depend on `B`. In fact, the weights and blends of `F_A` depend on `B`, so the estimate is too
/// low by the covariances of `F_A` with `B` and of `F_B` with `A`.
///
/// The sample variance in place of `(A - B)^2` would overrate the noise of low-discrepancy samples.
pub(crate) fn raw_error<const N: usize>(graph: &Graph<'_>, inputs: &Inputs, image: Pair, weight: Plane) -> [Plane; N] {
    let (Pair([fra, fga, fba, frb, fgb, fbb]), Pair([ra, ga, ba, rb, gb, bb])) = (image, inputs.unfiltered());
    let [na, nb] = inputs.counts();
    map(graph, [fra, fga, fba, frb, fgb, fbb, ra, ga, ba, rb, gb, bb, na, nb, weight], |values| {
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

/// Selects in each pixel the candidate with the least estimated error over `(2 radius + 1)^2` pixels; among equals, the first.
/// The selection is blurred over 5x5 pixels. With `unfiltered`, the unfiltered image is the last candidate, and its error is
/// multiplied by [`HANDICAP`].
pub(crate) fn select(
    graph: &Graph<'_>,
    inputs: &Inputs,
    filtered: &[Pair],
    weight: Plane,
    radius: usize,
    unfiltered: bool,
) -> Pair {
    let candidates: Vec<Pair> = filtered.iter().copied().chain(unfiltered.then(|| inputs.unfiltered())).collect();
    let of = |image: &Pair| {
        let [error] = raw_error::<1>(graph, inputs, *image, weight);
        box_mean(graph, error, radius)
    };
    let mut errors: Vec<Plane> = candidates.iter().map(of).collect();
    if let Some(own) = errors.last_mut().filter(|_| unfiltered) {
        *own = map_to_one(graph, [*own], |[error]| error * HANDICAP);
    }
    let shares = shares(graph, &errors);
    let add = |sum: Option<Plane>, (value, share): (Plane, Plane)| match sum {
        None => Some(map_to_one(graph, [value, share], |[value, share]| 0.0 + share * value)),
        Some(sum) => Some(map_to_one(graph, [sum, value, share], |[sum, value, share]| sum + share * value)),
    };
    Pair(std::array::from_fn(|k| {
        let shared = candidates.iter().map(|image| image.0[k]).zip(shares.iter().copied());
        shared.fold(None, add).unwrap_or(weight)
    }))
}

/// The blend weight of each candidate, blurred over 5x5 pixels: 1 where its error is the least (the first among equals), else
/// 0.
fn shares(graph: &Graph<'_>, errors: &[Plane]) -> Vec<Plane> {
    let [mut least, mut best] = map(graph, [errors[0]], |[error]| [error, 0.0]);
    for (number, error) in (1u8..).zip(&errors[1..]) {
        let number = f32::from(number);
        [least, best] = map(
            graph,
            [least, best, *error],
            move |[least, best, error]| {
                if error < least { [error, number] } else { [least, best] }
            },
        );
    }
    let share = |number: usize| {
        let number = number as f32;
        let is_best = map_to_one(graph, [best], move |[best]| if best == number { 1.0 } else { 0.0 });
        box_mean(graph, is_best, 2)
    };
    (0..errors.len()).map(share).collect()
}

/// The number of standard errors that a bias must exceed to count in the last blend. With 0, patches of specks remain up to 16
/// spp; with 2, the error at 32 spp is 1.5 % higher.
pub(crate) const EVIDENCE: f32 = 1.0;

/// The radii in pixels over which a blend averages its estimates of bias and noise.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Radii {
    /// The radius for the squared difference on which both halves agree: the squared bias of the smooth image.
    pub(crate) bias: usize,
    /// The radius for the noise of the difference.
    pub(crate) noise: usize,
    /// The radius within which pixels of a filtered image share their noise; 0 if each pixel has independent noise.
    pub(crate) alike: usize,
}

/// The radii for the last blend of a filter, which mixes in the unfiltered image.
pub(crate) const LAST: Radii = Radii { bias: 5, noise: 10, alike: 0 };

/// The radius over which the weight of the smooth image is averaged.
const SHARE: usize = 3;

/// Blends the images `narrow` and `smooth`. The more of their difference is noise, the closer the result is to `smooth`.
///
/// `D_A` and `D_B` are the differences `smooth - narrow` in the halves. `V` and `B` are the means of `(D_A - D_B)^2 / 4` and of
/// `D_A D_B` over a window. The result is `narrow + a (smooth - narrow)` with `a = V / (V + max(0, B))`. The halves share no
/// sample, so `D_A D_B` estimates the squared bias without noise.
///
/// Only the part of `B` above `evidence` standard errors counts; otherwise patches of noise would remain by chance. If each
/// pixel has independent noise, the products themselves give their standard error. In a filtered image, patches of pixels share
/// their noise, and products of strong detail are large. There the mean square of a product without bias is `4 V^2`, with `V`
/// over a patch, and each patch counts as one sample.
///
/// Squares are relative to the squared radiance of `smooth`, as in relMSE. Selecting one of the images by a threshold would
/// keep dark pixels, which look free of noise, and replace bright ones: the image would darken. If no pixel was sampled by both
/// halves, the result is `smooth`.
pub(crate) fn shrink(
    graph: &Graph<'_>,
    inputs: &Inputs,
    narrow: Pair,
    smooth: Pair,
    radii: Radii,
    evidence: f32,
) -> Pair {
    let weight = relative_weight(graph, inputs, smooth);
    let [noise, bias] = differences(graph, inputs, narrow, smooth, weight);
    let squares = if radii.alike > 0 {
        map_to_one(graph, [box_mean(graph, noise, radii.alike)], |[noise]| 4.0 * noise * noise)
    } else {
        map_to_one(graph, [bias], |[bias]| bias * bias)
    };
    let noise = box_mean(graph, noise, radii.noise);
    let [bias, squares] = [bias, squares].map(|plane| box_mean(graph, plane, radii.bias));
    // The standard errors of a mean over the window, in units of the root mean square, times `evidence`.
    let errors = evidence * (2 * radii.alike + 1) as f32 / (2 * radii.bias + 1) as f32;
    let share = map_to_one(graph, [noise, bias, squares], move |[noise, bias, square]| {
        let certain = (bias - errors * square.sqrt()).max(0.0);
        (noise + 1e-12) / (noise + certain + 1e-12)
    });
    let share = box_mean(graph, share, SHARE);
    let blend = |k: usize| {
        map_to_one(graph, [narrow.0[k], smooth.0[k], share], |[narrow, smooth, share]| {
            (1.0 - share) * narrow + share * smooth
        })
    };
    Pair(std::array::from_fn(blend))
}

/// The noise and the product of the halves' differences, as planes; 0 where a half has no samples.
fn differences(graph: &Graph<'_>, inputs: &Inputs, narrow: Pair, smooth: Pair, weight: Plane) -> [Plane; 2] {
    let (Pair([nra, nga, nba, nrb, ngb, nbb]), Pair([sra, sga, sba, srb, sgb, sbb])) = (narrow, smooth);
    let [na, nb] = inputs.counts();
    map(graph, [nra, nga, nba, nrb, ngb, nbb, sra, sga, sba, srb, sgb, sbb, na, nb, weight], |values| {
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

/// The usual radius in pixels over which an [`Estimate`] averages errors.
pub(crate) const ERROR: usize = 3;

/// The filtered image of one part of the light, in radiance, and the data of its error map.
///
/// The error is the larger of two smoothed estimates: the whole error over `radius` pixels to each side, and the variance over
/// 5x5 pixels. It is at least 5 % of the image's mean error, both relative to the squared brightness of 3x3 pixels. It is
/// infinite where no pixel in reach has samples in both halves.
///
/// Taking the larger estimate keeps positive noise, so that the map's mean is too high. The mean of the unsmoothed error is too
/// low (see [`raw_error`]). The map is scaled to the geometric mean of both means; the lower one is at least the variance.
pub(crate) struct Estimate {
    /// The radiance, including the withheld light; `more` is the variance of the withheld light.
    colour: Colours,
    more: Plane,
    /// The error times `weight`, before scaling.
    error: Plane,
    weight: Plane,
    /// The whole error, the part that is variance, and 1 where both are known (else 0).
    raw: [Plane; 3],
    level: f32,
}

impl Estimate {
    /// Creates the estimate for the filtered `image` of the light from which `inputs` were read.
    pub(crate) fn new<'a>(graph: &Graph<'a>, inputs: &Inputs, light: Light<'a>, image: Pair, radius: usize) -> Self {
        let weight = relative_weight(graph, inputs, image);
        let [whole, variance] = raw_error(graph, inputs, image, weight);
        let known = map_to_one(graph, inputs.counts(), |[a, b]| if a > 0.0 && b > 0.0 { 1.0 } else { 0.0 });
        let near = |plane: Plane, radius: usize| -> Plane {
            let means = [plane, known].map(|plane| box_mean(graph, plane, radius));
            map_to_one(graph, means, |[sum, n]| if n > 0.0 { sum / n } else { f32::INFINITY })
        };
        let error = map_to_one(graph, [near(whole, radius), near(variance, 2)], |[whole, variance]| {
            whole.max(variance).max(0.0)
        });
        let (bounds, level, [na, nb]) = (inputs.bounds(), inputs.level(), inputs.counts());
        let planes = image.0.into_iter().chain([na, nb]);
        let [r, g, b, more] = graph.rows(all(planes, Reach::rows(0)), move |rows, y, mut to: [&mut [f32]; 4]| {
            let (image, [na, nb]) = (image.0.map(|plane| rows.row(plane, y)), [na, nb].map(|plane| rows.row(plane, y)));
            let width = na.len();
            for x in 0..width {
                let counts = [na[x], nb[x]];
                let colour =
                    [0, 1, 2].map(|c| (combined([image[c][x], image[3 + c][x]], counts) * level).min(f32::MAX));
                let ([r, g, b], more) = bounds.restored(light, y * width + x, colour);
                to.iter_mut().zip([r, g, b, more]).for_each(|(to, value)| to[x] = value);
            }
        });
        Self { colour: [r, g, b], more, error, weight, raw: [whole, variance, known], level }
    }

    /// The bytes per pixel while this many parts of the light are added: the radiance, and two planes for the error of each
    /// part.
    pub(crate) const fn bytes_per_pixel(parts: usize) -> usize {
        12 + 8 * parts
    }

    /// The planes from which the image and its error are computed.
    pub(crate) fn planes(&self) -> impl Iterator<Item = Plane> {
        [self.more, self.error, self.weight].into_iter().chain(self.colour).chain(self.raw)
    }
}

/// The error of one part of the light, filled row by row.
#[derive(Default)]
struct ErrorMap {
    error: Vec<f32>,
    weight: Vec<f32>,
    /// The pixels with withheld light, and its variance.
    more: Vec<(usize, f32)>,
    /// The sum of the finite errors, their number, and the sums of [`Estimate::raw`].
    sums: [f64; 5],
}

impl ErrorMap {
    /// The squared error of each pixel.
    fn scaled(self, level: f32) -> Vec<f32> {
        let [sum, count, whole, variance, pixels] = self.sums;
        let mean = sum / count.max(1.0);
        let scale = if mean > 0.0 { (whole.max(variance) / pixels.max(1.0) / mean).sqrt() } else { 1.0 };
        let (least, scale) = ((0.05 * mean) as f32, scale.min(1.0) as f32 * level * level);
        let mut all = self.error;
        all.iter_mut().zip(&self.weight).for_each(|(error, weight)| *error = error.max(least) / weight * scale);
        for (i, more) in self.more {
            if all[i].is_finite() {
                all[i] = finite(f64::from(all[i]) + f64::from(more));
            }
        }
        all
    }
}

/// Adds the images of all parts of the light, and collects `planes`. The errors of the parts are assumed to be independent.
pub(crate) fn filtered<const N: usize>(
    graph: Graph<'_>,
    parts: &[Estimate],
    planes: [Plane; N],
) -> (Filtered, [Vec<f32>; N]) {
    let [width, height] = graph.size;
    let new = || Vec::with_capacity(width * height);
    let (mut radiance, mut others) = (vec![[0.0; 3]; width * height], planes.map(|_| new()));
    let mut maps: Vec<ErrorMap> =
        parts.iter().map(|_| ErrorMap { error: new(), weight: new(), ..ErrorMap::default() }).collect();
    let read: Vec<Plane> = parts.iter().flat_map(Estimate::planes).chain(planes).collect();
    graph.run(&read, |rows, range| {
        for y in range {
            others.iter_mut().zip(planes).for_each(|(all, plane)| all.extend_from_slice(rows.row(plane, y)));
            for (number, (part, map)) in parts.iter().zip(&mut maps).enumerate() {
                let colour = part.colour.map(|plane| rows.row(plane, y));
                for (x, sum) in radiance[y * width..][..width].iter_mut().enumerate() {
                    let own = colour.map(|row| row[x]);
                    *sum = if number == 0 { own } else { [0, 1, 2].map(|c| (sum[c] + own[c]).min(f32::MAX)) };
                }
                let more = rows.row(part.more, y).iter().enumerate().filter(|(_, more)| **more != 0.0);
                map.more.extend(more.map(|(x, more)| (y * width + x, *more)));
                let (error, raw) = (rows.row(part.error, y), part.raw.map(|plane| rows.row(plane, y)));
                let mut sums = [0.0; 5];
                for x in 0..width {
                    let [sum, count] = if error[x].is_finite() { [error[x], 1.0] } else { [0.0; 2] };
                    let own = [sum, count, raw[0][x], raw[1][x], raw[2][x]];
                    sums.iter_mut().zip(own).for_each(|(sum, value)| *sum += f64::from(value));
                }
                map.sums.iter_mut().zip(sums).for_each(|(all, row)| *all += row);
                map.error.extend_from_slice(error);
                map.weight.extend_from_slice(rows.row(part.weight, y));
            }
        }
    });
    let errors = maps.into_iter().zip(parts).map(|(map, part)| map.scaled(part.level));
    let error = errors.reduce(|mut all, other| {
        // A sum of finite errors stays finite.
        let most = |error: f32| if error < f32::INFINITY { f32::MAX } else { error };
        all.iter_mut().zip(other).for_each(|(sum, value)| *sum = (*sum + value).min(most(sum.max(value))));
        all
    });
    (Filtered::new([width as u32, height as u32], radiance).with_error(error), others)
}

/// The estimated squared error of each filtered pixel relative to `mean^2 + epsilon`, in row-major order.
///
/// The error is [`Filtered::error`]. The mean is taken over 3x3 pixels and the channels.
/// An infinite error is replaced by the largest finite one, or by 1 if none is finite. Values are finite and not negative. They
/// serve as scores for an adaptive sampler.
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
/// [`Error::Other`] if `filtered` has no error.
pub fn relative_errors(filtered: &Filtered, epsilon: f32) -> Result<Vec<f32>, Error> {
    let Some(error) = &filtered.error else {
        return Err(Error::other(
            "relative_errors",
            "the filtered image has no error estimate; record variances, or use another filter",
        ));
    };
    let size = filtered.size.map(|n| n as usize);
    let grey: Vec<f32> = filtered.radiance.iter().map(|[r, g, b]| ((r + g + b) / 3.0).min(1e15)).collect();
    let squares = box_mean_of(&grey, size, 1).into_iter().map(|mean| mean * mean + epsilon);
    let relative: Vec<f32> = error.iter().zip(squares).map(|(error, square)| error / square).collect();
    let largest = relative.iter().copied().filter(|e| e.is_finite()).reduce(f32::max).unwrap_or(1.0);
    Ok(relative.into_iter().map(|e| if e.is_finite() { e.max(0.0) } else { largest }).collect())
}
