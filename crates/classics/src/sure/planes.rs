//! Per-pixel means, variances and features that the filters of the bank read.

use crate::variances::per_pixel;
use crate::windows::window_sums;
use dapple_core::{Film, Needs};

/// The number of features: normal (3), albedo (3) and depth.
pub(super) const FEATURES: usize = 7;

/// The statistics that the planes are made from.
pub(super) const NEEDS: Needs = Needs::none().with_variance().with_features();

/// The radius of the window from which pixels without a variance take one.
const NEAR: usize = 2;

/// The planes of an image, row by row.
pub(super) struct Planes {
    pub(super) size: [usize; 2],
    /// The mean radiance; for pixels without samples, that of their neighbours.
    pub(super) colour: Vec<[f64; 3]>,
    /// The variance of the mean.
    pub(super) variance: Vec<[f64; 3]>,
    /// The mean of each feature, and the variance of one sample. Depths are relative to the largest.
    pub(super) features: Vec<[[f32; FEATURES]; 2]>,
    /// `true` for pixels with samples.
    pub(super) known: Vec<bool>,
}

impl Planes {
    /// The bytes per pixel of the planes and of the sums from which they are made.
    pub(super) const BYTES: usize = 24 + 24 + 8 * FEATURES + 1 + 2 * 64;

    pub(super) fn new(film: &Film) -> Self {
        let size = film.frame().size().map(|n| n as usize);
        // Per pixel: a 1 if there are samples, the mean, degrees of freedom, and squared deviations.
        let sums = window_sums(size, NEAR, |i| {
            let (moments, known) = (film.moments(i), f64::from(u8::from(film.count(i) > 0)));
            let [r, g, b] = film.mean(i);
            let [vr, vg, vb] = moments.m2;
            [known, r, g, b, moments.count.saturating_sub(1) as f64, vr, vg, vb]
        });
        let near = |i: usize, c: usize| sums[i][c] / sums[i][if c > 4 { 4 } else { 0 }].max(1.0);
        let colour = |i: usize| if film.count(i) > 0 { film.mean(i) } else { [1, 2, 3].map(|c| near(i, c)) };
        let variance = |i: usize| {
            let of_sample = film.moments(i).variance().unwrap_or_else(|| [5, 6, 7].map(|c| near(i, c)));
            of_sample.map(|v| v / film.count(i).max(1) as f64)
        };
        let pixels = 0..film.frame().pixels();
        let depth = pixels.clone().filter_map(|i| film.features(i)).map(|f| f.depth).fold(0.0, f32::max);
        let features = |i: usize| features(film, i, if depth > 0.0 { 1.0 / depth } else { 0.0 });
        Self {
            size,
            colour: per_pixel(film, colour),
            variance: per_pixel(film, variance),
            features: per_pixel(film, features),
            known: pixels.map(|i| film.count(i) > 0).collect(),
        }
    }

    /// The index of the pixel `offset` away from column `x` and row `y`; `None` outside the image.
    pub(super) fn at(&self, x: isize, y: isize) -> Option<usize> {
        let [width, height] = self.size;
        let inside = x >= 0 && y >= 0 && x < width as isize && y < height as isize;
        inside.then(|| y as usize * width + x as usize)
    }

    /// The logarithm of the weight that features give to a pair of pixels, 0 or below.
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

/// Means and sample variances of pixel `i`'s features. Samples without a hit have features 0.
fn features(film: &Film, i: usize, unit: f32) -> [[f32; FEATURES]; 2] {
    let Some(f) = film.features(i).filter(|f| f.hits > 0) else { return [[0.0; FEATURES]; 2] };
    let [nx, ny, nz] = f.normal;
    let [r, g, b] = f.albedo;
    let v = f.variance.unwrap_or_default();
    let mean = [nx, ny, nz, r, g, b, f.depth * unit];
    let variance = [v[0], v[1], v[2], v[3], v[4], v[5], v[9] * unit * unit];
    let share = f.hits as f32 / f.samples as f32;
    let bounded = |x: f32| x.clamp(-1e9, 1e9);
    let spread = |k: usize| bounded(share * variance[k] + share * (1.0 - share) * mean[k] * mean[k]);
    [mean.map(|m| bounded(share * m)), std::array::from_fn(spread)]
}
