//! Colours and features of both halves of a film.

use crate::variances::per_pixel;
use crate::windows::window_sums;
use dapple_core::{Features, Film};

/// The number of regressors that features give: normal (3), albedo (3) and depth.
pub(super) const FEATURES: usize = 7;

/// Three channels per pixel.
pub(super) type Rgb = Vec<[f64; 3]>;

/// The feature buffers: normal, albedo, and depth in the first channel.
pub(super) type Buffers = [Rgb; 3];

/// The number of channels of each feature buffer.
pub(super) const CHANNELS: [usize; 3] = [3, 3, 1];

/// The samples of one half.
pub(super) struct HalfPlanes {
    /// The mean radiance; where the half has no samples, that of the pixels around.
    pub(super) colour: Rgb,
    /// The variance of that mean.
    pub(super) variance: Rgb,
    /// `true` for pixels with samples.
    pub(super) known: Vec<bool>,
    /// The mean of each feature, and its variance.
    pub(super) features: Buffers,
    pub(super) spread: Buffers,
}

/// The radius of the window from which pixels without samples or variance take them.
const NEAR: usize = 2;

impl HalfPlanes {
    /// The bytes per pixel of one half, and of the sums from which it is made.
    pub(super) const BYTES: [usize; 2] = [2 * 24 + 1 + 6 * 24, 128];

    pub(super) fn new(film: &Film, half: usize) -> Self {
        let size = film.frame().size().map(|n| n as usize);
        let of = |i: usize| film.half(half, i).unwrap_or_default();
        // Per pixel: a 1 if there are samples, the mean, degrees of freedom of both halves, and squared deviations.
        let sums = window_sums(size, NEAR, |i| {
            let (own, all) = (of(i), film.moments(i));
            let [r, g, b] = own.mean;
            let [vr, vg, vb] = all.m2;
            [f64::from(u8::from(own.count > 0)), r, g, b, all.count.saturating_sub(1) as f64, vr, vg, vb]
        });
        let near = |i: usize, c: usize| sums[i][c] / sums[i][if c > 4 { 4 } else { 0 }].max(1.0);
        let colour = |i: usize| match of(i) {
            own if own.count > 0 => own.mean,
            _ if film.count(i) > 0 => film.mean(i),
            _ => [1, 2, 3].map(|c| near(i, c)),
        };
        let variance = |i: usize| {
            let of_sample = film.moments(i).variance().unwrap_or_else(|| [5, 6, 7].map(|c| near(i, c)));
            of_sample.map(|v| v / of(i).count.max(1) as f64)
        };
        let features = features(film, half);
        Self {
            colour: per_pixel(film, colour),
            variance: per_pixel(film, variance),
            known: (0..film.frame().pixels()).map(|i| of(i).count > 0).collect(),
            features: std::array::from_fn(|k| features.iter().map(|f| f[0][k]).collect()),
            spread: std::array::from_fn(|k| features.iter().map(|f| f[1][k]).collect()),
        }
    }
}

/// The three features of each pixel, and their variances. Depths are relative to the largest.
fn features(film: &Film, half: usize) -> Vec<[[[f64; 3]; 3]; 2]> {
    let depths = (0..film.frame().pixels()).filter_map(|i| film.features(i)).map(|f| f.depth);
    let depth = depths.fold(0.0, f32::max);
    let unit = if depth > 0.0 { 1.0 / depth } else { 0.0 };
    per_pixel(film, |i| {
        let (Some(own), Some(all)) = (film.half_features(half, i), film.features(i)) else { return [[[0.0; 3]; 3]; 2] };
        // A half without samples takes the features of both.
        let own = if own.samples > 0 { own } else { all };
        let mean = |f: &Features| {
            let share = f.hits as f32 / f.samples.max(1) as f32;
            let bounded = |x: f32| f64::from((share * x).clamp(-1e9, 1e9));
            [f.normal.map(bounded), f.albedo.map(bounded), [bounded(f.depth * unit), 0.0, 0.0]]
        };
        [mean(&own), variances(&all, own.samples, unit)]
    })
}

/// The variance of the means of a half of `samples` samples, from the sample variance of all. Misses have features 0.
fn variances(all: &Features, samples: u32, unit: f32) -> [[f64; 3]; 3] {
    let v = all.variance.unwrap_or_default();
    let share = all.hits as f32 / all.samples.max(1) as f32;
    let spread = |variance: f32, mean: f32| {
        let of_sample = share * variance + share * (1.0 - share) * mean * mean;
        f64::from(of_sample.clamp(0.0, 1e18)) / f64::from(samples.max(1))
    };
    let [n, a] = [all.normal, all.albedo];
    let three = |at: usize, mean: [f32; 3]| [0, 1, 2].map(|c| spread(v[at + c], mean[c]));
    [three(0, n), three(3, a), [spread(v[9] * unit * unit, all.depth * unit), 0.0, 0.0]]
}

/// The regressors of each pixel.
pub(super) fn regressors(buffers: &Buffers) -> Vec<[f64; FEATURES]> {
    let [normal, albedo, depth] = buffers;
    let of = |((n, a), d): ((&[f64; 3], &[f64; 3]), &[f64; 3])| [n[0], n[1], n[2], a[0], a[1], a[2], d[0]];
    normal.iter().zip(albedo).zip(depth).map(of).collect()
}
