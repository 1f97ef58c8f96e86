//! The bootstrap confidence interval of a mean.

use super::interval::{Interval, IntervalMethod};
use super::mean;
use super::student::{normal_cdf, normal_quantile};
use crate::blocks::percentile;
use crate::sum::Sum;

/// The number of bootstrap resamples. The ends of a 95 % interval then vary by less than 3 % of its half width.
/// Derivation: sqrt(0.025 * 0.975 / 9999) over the normal density at 1.96 is 0.027 standard deviations.
pub const BOOTSTRAP_RESAMPLES: usize = 9999;

/// The confidence interval of the mean by the bias-corrected and accelerated bootstrap [after Efron 1987].
///
/// `values` must have at least two elements, all finite. The seed is fixed, so equal values give equal intervals.
pub(super) fn bootstrap(values: &[f64], confidence: f64) -> Interval {
    let value = mean(values);
    let mut random = SplitMix(0x6461_7070_6c65);
    let mut means: Vec<f64> = (0..BOOTSTRAP_RESAMPLES).map(|_| resampled_mean(values, value, &mut random)).collect();
    means.sort_unstable_by(f64::total_cmp);
    let [below, up_to] = [means.partition_point(|&m| m < value), means.partition_point(|&m| m <= value)];
    // Half of the ties count; the share is never 0 or 1.
    let share = (0.5 * (below + up_to) as f64 + 0.5) / (BOOTSTRAP_RESAMPLES as f64 + 1.0);
    let bias = normal_quantile(share);
    let acceleration = acceleration(values, value);
    let end = |p: f64| {
        let z = bias + normal_quantile(p);
        let rest = 1.0 - acceleration * z;
        // Past the pole the percentile is an end of the range.
        let at = if rest > 0.0 { normal_cdf(bias + z / rest) } else { f64::from(u8::from(z > 0.0)) };
        percentile(&means, 100.0 * at)
    };
    let tail = 0.5 - 0.5 * confidence;
    Interval { value, low: end(tail), high: end(1.0 - tail), method: IntervalMethod::Bootstrap }
}

/// The mean of a resample: as many values as `values` has, drawn with replacement. It sums deviations from `mean`, so
/// that equal values give exactly their mean.
fn resampled_mean(values: &[f64], mean: f64, random: &mut SplitMix) -> f64 {
    let sum: f64 = (0..values.len()).map(|_| values[random.below(values.len())] - mean).sum();
    mean + sum / values.len() as f64
}

/// The acceleration: a sixth of the skewness of the mean's jackknife values [after Efron 1987].
fn acceleration(values: &[f64], mean: f64) -> f64 {
    let distances = values.iter().map(|v| v - mean);
    let square = distances.clone().map(|d| d * d).collect::<Sum>().value();
    let cube = distances.map(|d| d * d * d).collect::<Sum>().value();
    if square > 0.0 { cube / (6.0 * square * square.sqrt()) } else { 0.0 }
}

/// The random number generator SplitMix64 [after Steele 2014].
struct SplitMix(u64);

impl SplitMix {
    /// A uniform random number in `0..count`; probabilities differ by at most 2^-64 `count`.
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((u128::from(z ^ z >> 31) * count as u128) >> 64) as usize
    }
}
