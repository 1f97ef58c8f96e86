//! Pixel means and their variances, as `Gaussian` and `ClusterGaussian` read them.

use crate::among::Among;
use crate::light::Light;
use crate::planes::level;
use crate::withheld::Bounds;
use dapple_core::{Error, Film};
use rayon::prelude::*;

/// The emission that blurs leave in each pixel; `None` if the film recorded none. The film's rows begin with row `top` of
/// the whole image.
pub(crate) fn emission(film: &Film, top: usize, among: &mut Among<'_>) -> Result<Option<Vec<[f64; 3]>>, Error> {
    if !film.needs().emission {
        return Ok(None);
    }
    let place = among.place(0, top);
    let light = Light::all(film);
    let level = level(light, &place, among)?;
    let bounds = Bounds::new(light, level, &place, among)?;
    let withheld = |i| bounds.withheld_emission(light, i);
    Ok(Some((0..film.frame().pixels()).into_par_iter().with_min_len(1024).map(withheld).collect()))
}

/// The mean of pixel `i` without the `emission` that stays there, followed by 1, or zeros if the pixel has no samples. Weighted sums of these are the numerator
/// and denominator of a mean over the pixels with samples.
#[inline]
pub(crate) fn mean_and_presence(film: &Film, emission: Option<&[[f64; 3]]>, i: usize) -> [f64; 4] {
    if film.count(i) == 0 {
        return [0.0; 4];
    }
    let [r, g, b] = film.refined_mean(i);
    let [er, eg, eb] = emission.map_or([0.0; 3], |emission| emission[i]);
    [r - er, g - eg, b - eb, 1.0]
}

/// The estimated variance of each pixel's mean, averaged over the channels; `None` if the film recorded none.
///
/// The estimate comes from the halves if the film has them, since only these are valid for low-discrepancy samples.
/// Otherwise it comes from the sample variance. It is infinite where unknown, and 0 in pixels without samples, which no
/// sum includes.
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

/// The weighted mean from a weighted sum of [`mean_and_presence`] plus the pixel's own `emission`; black if no sample is in
/// reach.
#[inline]
pub(crate) fn normalised(sum: [f64; 4], emission: [f64; 3]) -> [f32; 3] {
    if sum[3] > 0.0 { std::array::from_fn(|c| (sum[c] / sum[3] + emission[c]) as f32) } else { [0.0; 3] }
}

/// The squared error of a weighted mean, from the sum of squared weights times variances and the sum of weights.
/// Infinite if no sample is in reach.
#[inline]
pub(crate) fn squared_error(sum: f64, weight: f64) -> f32 {
    if weight > 0.0 { (sum / (weight * weight)) as f32 } else { f32::INFINITY }
}
