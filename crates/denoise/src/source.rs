//! What filters read of a film.

use dapple_core::Film;
use rayon::prelude::*;

/// The mean of pixel `i` and a 1, or zeros if it has no samples: weighted sums of these are numerator
/// and denominator of a weighted mean over the pixels that have samples.
#[inline]
pub(crate) fn mean_and_presence(film: &Film, i: usize) -> [f64; 4] {
    if film.count(i) == 0 {
        return [0.0; 4];
    }
    let [r, g, b] = film.mean(i);
    [r, g, b, 1.0]
}

/// The estimated variance of each pixel's mean, averaged over the channels: from the halves where the
/// film has them, since they alone are honest for low-discrepancy samples, else from the sample
/// variance. Infinite where unknown, 0 in pixels without samples (which no sum includes). `None`
/// where the film knows neither.
pub(crate) fn variances(film: &Film) -> Option<Vec<f64>> {
    let needs = film.needs();
    if !needs.halves && !needs.variance {
        return None;
    }
    let variance = |i| {
        if film.count(i) == 0 {
            return 0.0;
        }
        let known = if needs.halves {
            film.squared_error(i)
        } else {
            let moments = film.moments(i);
            moments.variance().map(|v| v.map(|v| v / moments.count as f64))
        };
        known.map_or(f64::INFINITY, |[r, g, b]| (r + g + b) / 3.0)
    };
    Some((0..film.frame().pixels()).into_par_iter().with_min_len(1024).map(variance).collect())
}

/// The weighted mean, from [`mean_and_presence`] summed up; black if no sample is in reach.
#[inline]
pub(crate) fn normalised([r, g, b, weight]: [f64; 4]) -> [f32; 3] {
    if weight > 0.0 { [r, g, b].map(|x| (x / weight) as f32) } else { [0.0; 3] }
}

/// The squared error of a weighted mean, from the sums of squared weight times variance and of weight;
/// infinite if no sample is in reach.
#[inline]
pub(crate) fn squared_error(sum: f64, weight: f64) -> f32 {
    if weight > 0.0 { (sum / (weight * weight)) as f32 } else { f32::INFINITY }
}
