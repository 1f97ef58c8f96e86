//! A bank of cross non-local means filters, Stein's estimate of each filter's error, and the planes that the filters read.

use crate::windows::{FEATURES, Means, PatchSums, PixelTile, feature_moments, per_pixel, unit_of_depth};
use dapple_core::{Film, Needs, film::luminance, parallel};

/// The number of smoothing filters. The bank has one more, the first, which leaves the image unchanged.
pub(super) const FILTERS: usize = 8;
/// The number of filters in the bank.
pub(super) const BANK: usize = 1 + FILTERS;
/// The largest standard deviation of patch differences; each next filter has half the previous one.
const WIDEST: f64 = 0.64;
/// The radius of a patch in pixels, as published.
const PATCH: isize = 2;
/// The number of values that are compared per patch: pixels times channels.
const COMPARED: f64 = 3.0 * ((2 * PATCH + 1) * (2 * PATCH + 1)) as f64;
/// The sum of feature terms below which a pixel gets no weight.
const UNLIKE: f64 = -40.0;
/// The width and the height of a tile in pixels.
const TILE: [usize; 2] = [32, 8];
/// The number that is added to the squared luminance in priorities, as published.
const DARK: f64 = 1e-2;

/// The bank's result for one pixel.
#[derive(Clone, Copy, Default)]
pub(super) struct OfPixel {
    /// The filtered pixel, from the widest filter to the narrowest.
    pub(super) filtered: [[f32; 3]; FILTERS],
    /// The estimated squared error of each filter of the bank, starting with the unfiltered image. May be negative.
    pub(super) error: [f64; BANK],
    /// The relative error that more samples would reduce, for each filter of the bank. May be negative.
    pub(super) priority: [f64; BANK],
}

/// The weighted sums of one filter at one pixel: the weight, and per channel the values, the squares, and two terms for the
/// derivative. These terms describe how the pixel's own value changes the patches around it.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: f64,
    value: [f64; 3],
    square: [f64; 3],
    /// The sum of `w a`, where `a` is the difference between the pixel and the opposite pixel.
    own: [f64; 3],
    /// The sum of `w a y`.
    moved: [f64; 3],
}

/// `sigma^2` of the filter with this number; the widest filter has number 0.
fn squared_sigma(filter: usize) -> f64 {
    let sigma = WIDEST / f64::from(1u32 << filter);
    sigma * sigma
}

impl Sums {
    /// The filtered pixel, and the derivative of each channel by the pixel's own value; `None` if the weight is 0.
    fn estimate(&self, filter: usize) -> Option<[[f64; 3]; 2]> {
        if self.weight <= 0.0 {
            return None;
        }
        let share = 1.0 / self.weight;
        let value = self.value.map(|v| v * share);
        let derivative = |c: usize| {
            let spread = self.square[c] * share - value[c] * value[c];
            let moved = (self.own[c] * value[c] - self.moved[c]) * share;
            share + (spread + moved) / (squared_sigma(filter) * COMPARED)
        };
        Some([value, std::array::from_fn(derivative)])
    }
}

/// Applies the bank with windows of `2 radius + 1` pixels.
pub(super) fn apply(planes: &Planes, radius: usize) -> Vec<OfPixel> {
    let width = planes.size[0];
    let mut all = vec![OfPixel::default(); width * planes.size[1]];
    parallel::chunks(&mut all, width * TILE[1], |band, pixels| {
        for tile in PixelTile::of_band(planes.size, TILE, band) {
            for ([x, y], sums) in tile.pixels().zip(&sums(planes, tile, radius as isize)) {
                pixels[(y - tile.top) * width + x] = of_pixel(planes, y * width + x, sums);
            }
        }
    });
    all
}

/// The errors of the bank at pixel `i`, averaged over the channels: `(F - y)^2 + 2 v dF/dy - v` for a mean `y` of variance `v`
/// [after Stein 1981].
fn of_pixel(planes: &Planes, i: usize, sums: &[Sums; FILTERS]) -> OfPixel {
    let (y, v) = (planes.means.colour[i], planes.means.variance[i]);
    let mean = |values: [f64; 3]| (values[0] + values[1] + values[2]) / 3.0;
    let priority = |error: f64, value: [f64; 3]| {
        let level = luminance(value);
        (error + mean(v)) / (level * level + DARK)
    };
    let mut result = OfPixel::default();
    // The published error of the unfiltered image is twice its variance, which favours filtering.
    (result.error[0], result.priority[0]) = (2.0 * mean(v), priority(mean(v), y));
    for (filter, sums) in sums.iter().enumerate() {
        let Some([value, derivative]) = sums.estimate(filter) else {
            result.filtered[filter] = y.map(|y| y as f32);
            continue;
        };
        let error = |c: usize| (value[c] - y[c]).powi(2) + 2.0 * v[c] * derivative[c] - v[c];
        let error = mean([error(0), error(1), error(2)]);
        result.filtered[filter] = value.map(|v| v as f32);
        (result.error[1 + filter], result.priority[1 + filter]) = (error, priority(error, value));
    }
    result
}

/// The sums of a tile's pixels over windows of `2 radius + 1` pixels.
fn sums(planes: &Planes, tile: PixelTile, radius: isize) -> Vec<[Sums; FILTERS]> {
    let mut sums = vec![[Sums::default(); FILTERS]; tile.size[0] * tile.size[1]];
    let mut patches = PatchSums::new(tile.size, PATCH as usize);
    for (dy, dx) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx))) {
        let distances = patches.compute(tile, |x, y| planes.squared_difference([x, y], [x + dx, y + dy]));
        for ((sums, [x, y]), &distance) in sums.iter_mut().zip(tile.pixels()).zip(distances) {
            let (i, [x, y]) = (y * planes.size[0] + x, [x as isize, y as isize]);
            let Some(j) = planes.at(x + dx, y + dy).filter(|&j| planes.means.known[j]) else { continue };
            let like = planes.likeness(i, j);
            if like < UNLIKE {
                continue;
            }
            let near = dx.abs() <= PATCH && dy.abs() <= PATCH;
            let opposite = if near { planes.at(x - dx, y - dy) } else { None };
            let colour = &planes.means.colour;
            add_pair(sums, [distance, like], [colour[i], colour[j]], opposite.map(|o| colour[o]));
        }
    }
    sums
}

/// Adds a neighbour to the sums of a pixel. `distance` is the distance between the patches around both pixels, and `like` the
/// logarithm of the weight by features. If the neighbour's patch contains the pixel, `opposite` is the colour of the pixel on
/// the other side.
fn add_pair(
    sums: &mut [Sums; FILTERS],
    [distance, like]: [f64; 2],
    [y, other]: [[f64; 3]; 2],
    opposite: Option<[f64; 3]>,
) {
    let features = libm::exp(like);
    // The sigmas halve, so each weight by colour is the fourth power of the previous one.
    let mut colours = libm::exp(-0.5 * distance / (COMPARED * squared_sigma(0)));
    for sums in sums {
        let weight = features * colours;
        sums.weight += weight;
        for c in 0..3 {
            let weighted = weight * other[c];
            sums.value[c] += weighted;
            sums.square[c] += weighted * other[c];
            if let Some(opposite) = opposite {
                let own = weight * (y[c] - opposite[c]);
                sums.own[c] += own;
                sums.moved[c] += own * other[c];
            }
        }
        let squared = colours * colours;
        colours = squared * squared;
    }
}

/// The statistics from which the planes are computed.
pub(super) const NEEDS: Needs = Needs::none().with_variance().with_features();

/// The planes of an image, row by row.
pub(super) struct Planes {
    pub(super) size: [usize; 2],
    pub(super) means: Means,
    /// The mean of each feature, and the variance of one sample. Depths are relative to the largest.
    pub(super) features: Vec<[[f32; FEATURES]; 2]>,
}

impl Planes {
    /// The bytes per pixel of the planes and of the sums from which they are computed.
    pub(super) const BYTES: usize = Means::BYTES[0] + Means::BYTES[1] + 8 * FEATURES;

    pub(super) fn new(film: &Film) -> Self {
        let unit = unit_of_depth(film);
        let moments = |f| feature_moments(&f, unit);
        let features = |i| film.features(i).filter(|f| f.hits > 0).map_or_else(Default::default, moments);
        let size = film.frame().size().map(|n| n as usize);
        Self { size, means: Means::new(film, None), features: per_pixel(film, features) }
    }

    /// The index of the pixel in column `x` and row `y`; `None` outside the image.
    pub(super) fn at(&self, x: isize, y: isize) -> Option<usize> {
        let [width, height] = self.size;
        let inside = x >= 0 && y >= 0 && x < width as isize && y < height as isize;
        inside.then(|| y as usize * width + x as usize)
    }

    /// The squared difference between two pixels, summed over the channels; 0 if one lies outside the image.
    fn squared_difference(&self, [x, y]: [isize; 2], other: [isize; 2]) -> f64 {
        self.at(x, y).zip(self.at(other[0], other[1])).map_or(0.0, |(i, j)| {
            let d: [f64; 3] = std::array::from_fn(|c| self.means.colour[i][c] - self.means.colour[j][c]);
            d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        })
    }

    /// The logarithm of the weight by features for a pair of pixels; 0 or below.
    pub(super) fn likeness(&self, i: usize, j: usize) -> f64 {
        let ([a, va], [b, vb]) = (&self.features[i], &self.features[j]);
        let mut sum = 0.0;
        for k in 0..FEATURES {
            let d = a[k] - b[k];
            sum += d * d / (va[k] + vb[k]).max(LEAST_VARIANCE) * SCALES[k];
        }
        f64::from(sum)
    }
}

/// The least variance by which squared differences of features are divided, as published.
const LEAST_VARIANCE: f32 = 1e-2;

/// `-1 / (2 sigma^2)` of each feature, with the published standard deviations: normal 0.8, albedo 0.25, depth 0.6.
const SCALES: [f32; FEATURES] = {
    const fn scale(sigma: f32) -> f32 {
        -0.5 / (sigma * sigma)
    }
    let (normal, albedo) = (scale(0.8), scale(0.25));
    [normal, normal, normal, albedo, albedo, albedo, scale(0.6)]
};
