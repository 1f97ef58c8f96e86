//! Halves of samples from buffers: given ones, or an image split by its own noise.

use super::{Counts, SampleBuffers, Variance};
use crate::maps::box_mean;
use dapple_core::{RgbMoments, mix};

impl Counts<'_> {
    /// The number of samples of pixel `i`.
    pub(super) fn of(&self, i: usize) -> u64 {
        u64::from(match self {
            Self::All(count) => *count,
            Self::Each(counts) => counts[i],
        })
    }
}

impl Variance<'_> {
    /// The variance of one sample of pixel `i`, which has `count` samples.
    pub(super) fn of_sample(&self, i: usize, count: u64) -> [f64; 3] {
        match self {
            Self::OfSamples(values) => values[i].map(f64::from),
            Self::OfMean(values) => values[i].map(|v| f64::from(v) * count as f64),
        }
    }
}

/// The moments of both halves in pixel `i` of an image that is split by its own noise.
///
/// For normal noise of known variance, `x + s z` and `x - s z` with a normal number `z` are independent [after Rasines and
/// Young 2022; Leiner et al. 2023]. A random sign for `z` leaves about as much error. As with true halves, one of the two
/// then has all the light of a bright sample, so that the filter finds it.
///
/// Of `n = p + q` samples, the halves get `p` and `q`, and steps of `s sqrt(q / p)` and `s sqrt(p / q)`. So each varies as the
/// mean of its samples does, and their mean by counts is `x`.
pub(super) fn split(all: &SampleBuffers<'_>, i: usize) -> [RgbMoments; 2] {
    let count = all.count.of(i);
    if count == 0 {
        return [RgbMoments::default(); 2];
    }
    let (p, q) = ((count - count / 2).max(1), (count / 2).max(1));
    let variance = all.variance.map_or([0.0; 3], |v| v.of_sample(i, count));
    let mean = all.mean[i].map(f64::from);
    let z = sign(i);
    let half = |own: u64, other: u64, sign: f64| {
        let step = |c: usize| sign * (variance[c] / count as f64 * other as f64 / own as f64).sqrt();
        RgbMoments::new(own, std::array::from_fn(|c| mean[c] + step(c)), variance)
    };
    [half(p, q, z), half(q, p, -z)]
}

/// A random sign for pixel `i`.
fn sign(i: usize) -> f64 {
    if mix((i as u64).wrapping_add(0x9e37_79b9_7f4a_7c15)) & 1 == 0 { 1.0 } else { -1.0 }
}

/// The variance of one sample per pixel and channel, from the difference of two halves over 5x5 pixels.
///
/// A pixel's own difference has one degree of freedom, too few to stand for its variance.
pub(super) fn variance_of_halves(size: [usize; 2], [a, b]: &[SampleBuffers<'_>; 2]) -> Vec<[f32; 3]> {
    let pixels = size[0] * size[1];
    let share = |i: usize| {
        let (p, q) = (a.count.of(i) as f64, b.count.of(i) as f64);
        if p + q > 0.0 { p * q / (p + q) } else { 0.0 }
    };
    let known: Vec<f32> = (0..pixels).map(|i| f32::from(u8::from(share(i) > 0.0))).collect();
    let near = box_mean(&known, size, 2);
    let planes = [0, 1, 2].map(|c: usize| {
        let own = |i: usize| {
            let apart = f64::from(a.mean[i][c]) - f64::from(b.mean[i][c]);
            if known[i] > 0.0 { (apart * apart * share(i)).min(1e30) as f32 } else { 0.0 }
        };
        box_mean(&(0..pixels).map(own).collect::<Vec<_>>(), size, 2)
    });
    (0..pixels).map(|i| [0, 1, 2].map(|c| if near[i] > 0.0 { planes[c][i] / near[i] } else { 0.0 })).collect()
}
