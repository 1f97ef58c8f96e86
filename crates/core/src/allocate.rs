//! Exact allocation of an integer budget to pixels.
//!
//! Both [`allocate`] and [`Ladder::allocate`] minimise `sum_p g_p f(n_p)` over integers `floor_p <= n_p <= ceiling`
//! that add up to the budget. `n_p` is pixel `p`'s sample count, `g_p` its score (its weight squared times its
//! variance), and `f` falls with the count.
//!
//! The objective is separable and convex, so handing out samples in the order of their marginal gain (decrease of the
//! objective) is exactly optimal [Fox 1966]. Most samples are handed out at once, down to a common threshold of the
//! gain, the rest one by one. Ties go to the smaller count and then by a hash of the pixel's index, so that no part of
//! the image is preferred.

mod ladder;
mod share;

pub use ladder::Ladder;
pub use share::share;

use crate::Error;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// The result of an allocation: one sample count per pixel.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Allocation {
    /// The number of samples of each pixel.
    pub counts: Vec<u32>,
    /// The number of samples of the budget that fit in no pixel, because all are at the ceiling.
    pub unspent: u64,
    /// The number of scores that were replaced: NaN and negative ones by 0, infinite ones by the largest finite score.
    pub replaced: usize,
}

/// A pixel's error `f(n)` as a function of its sample count `n`, and the counts that a pixel may have.
trait Steps: Sync {
    /// The smallest allowed count above `n`.
    fn next(&self, n: u32) -> u32;
    /// The largest count reached from 0 by steps that each decrease `f` by at least `threshold` per sample.
    fn reach(&self, threshold: f64) -> u32;
    /// The decrease of `f` per sample from count `n` to count `m`, that is `(f(n) - f(m)) / (m - n)`.
    fn gain(&self, n: u32, m: u32) -> f64;
}

/// The error `f(n) = 1/n` of independent samples, with every integer count allowed.
struct EveryCount;

impl Steps for EveryCount {
    fn next(&self, n: u32) -> u32 {
        n.saturating_add(1)
    }

    fn reach(&self, threshold: f64) -> u32 {
        // The largest n with 1/(n (n-1)) >= threshold.
        (((1.0 + 4.0 / threshold).sqrt() + 1.0) * 0.5) as u32
    }

    fn gain(&self, n: u32, m: u32) -> f64 {
        if n == 0 { f64::MAX } else { 1.0 / (f64::from(n) * f64::from(m)) }
    }
}

/// Returns the integer counts `n_p` that sum to `total` and minimise `sum_p scores[p] / n_p`. Unrounded, `n_p` is
/// proportional to the root of the score [Neyman 1934].
///
/// Counts satisfy `floors[p] <= counts[p] <= ceiling`; a floor above the ceiling wins.
///
/// ```
/// let counts = dapple_core::allocate(&[1.0, 4.0, 9.0], &[1; 3], 100, 60)?.counts;
/// assert_eq!(counts, [10, 20, 30]);
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// # Errors
///
/// [`Error::BudgetTooSmall`] if the floors alone exceed `total`.
///
/// # Panics
///
/// If `scores` and `floors` differ in length, or have more than 2^32 - 1 elements.
pub fn allocate(scores: &[f64], floors: &[u32], ceiling: u32, total: u64) -> Result<Allocation, Error> {
    share_out(scores, floors, ceiling, total, &EveryCount)
}

fn share_out(
    scores: &[f64],
    floors: &[u32],
    ceiling: u32,
    total: u64,
    steps: &impl Steps,
) -> Result<Allocation, Error> {
    assert_eq!(scores.len(), floors.len(), "one floor per score");
    assert!(u32::try_from(scores.len()).is_ok(), "pixels are numbered with 32 bits");
    let needed: u64 = floors.iter().map(|&n| u64::from(n)).sum();
    if needed > total {
        return Err(Error::BudgetTooSmall { budget: total, needed, pixels: floors.len() });
    }
    let (scores, replaced) = clean(scores);
    let most: u64 = floors.iter().map(|&n| u64::from(n.max(ceiling))).sum();
    if most <= total {
        let counts = floors.iter().map(|&n| n.max(ceiling)).collect();
        return Ok(Allocation { counts, unspent: total - most, replaced });
    }
    if all_equal(&scores) {
        return Ok(Allocation { counts: level(floors, ceiling, total), unspent: 0, replaced });
    }
    let share_out = || share_out_clean(&scores, floors, ceiling, total, steps);
    // The search sums over all pixels a dozen times. Called from outside the pool, each sum would wait for a thread to
    // wake up, which took longer than the sum.
    let counts = if scores.len() < 2 * SERIAL { share_out() } else { rayon::scope(|_| share_out()) };
    Ok(Allocation { counts, unspent: 0, replaced })
}

/// The least number of pixels that one thread's task handles.
const SERIAL: usize = 4096;

/// Returns the counts that minimise the total error and sum to `total`. Requires scores above 0, not all equal, and a
/// total within floors and ceiling.
fn share_out_clean(scores: &[f64], floors: &[u32], ceiling: u32, total: u64, steps: &impl Steps) -> Vec<u32> {
    let reach = |g: f64, floor: u32, threshold: f64| steps.reach(threshold / g).min(ceiling).max(floor);
    let spend = |threshold: f64| -> u64 {
        let each = scores.par_iter().zip(floors).with_min_len(SERIAL);
        each.map(|(&g, &floor)| u64::from(reach(g, floor, threshold))).sum()
    };
    let mean = u32::try_from(total / scores.len() as u64).unwrap_or(u32::MAX - 1).max(1);
    let start = steps.gain(mean, steps.next(mean)) * scores.iter().sum::<f64>() / scores.len() as f64;
    let start = threshold_of_some(start, scores, floors, total, reach);
    let bracket = find_threshold(start, total, (scores.len() / 64).max(256) as u64, spend);
    let mut counts: Vec<u32> = match bracket.within {
        Some(t) => scores.iter().zip(floors).map(|(&g, &floor)| reach(g, floor, t)).collect(),
        None => floors.to_vec(),
    };
    let mut left = total - counts.iter().map(|&n| u64::from(n)).sum::<u64>();
    hand_out_above(bracket.beyond, &mut counts, scores, ceiling, &mut left, steps);
    hand_out(&mut counts, scores, ceiling, left, steps);
    counts
}

fn all_equal(scores: &[f64]) -> bool {
    scores.windows(2).all(|w| w[0] == w[1])
}

/// Returns counts that sum to `total` and are as equal as floors and ceiling allow. A hash of the pixel's index picks
/// the pixels that get one of the remaining samples. Requires a `total` that fits under the ceiling.
fn level(floors: &[u32], ceiling: u32, total: u64) -> Vec<u32> {
    let at = |level: u32, floor: u32| level.min(ceiling).max(floor);
    let spend = |level: u32| floors.iter().map(|&floor| u64::from(at(level, floor))).sum::<u64>();
    // The highest level that fits. Level 0 does, since the floors do.
    let (mut low, mut high) = (0, ceiling);
    while low < high {
        let middle = low + (high - low).div_ceil(2);
        if spend(middle) <= total { low = middle } else { high = middle - 1 }
    }
    let mut counts: Vec<u32> = floors.iter().map(|&floor| at(low, floor)).collect();
    let left = (total - spend(low)) as usize;
    if left > 0 {
        let open = counts.iter().enumerate().filter(|(_, n)| **n == low);
        let mut open: Vec<(u64, usize)> = open.map(|(pixel, _)| (mix(pixel as u64), pixel)).collect();
        // Fewer samples are left than pixels are open, or the next level would have fitted.
        open.select_nth_unstable(left);
        open[..left].iter().for_each(|&(_, pixel)| counts[pixel] += 1);
    }
    counts
}

/// Returns the scores, divided by the largest and clamped to `[1e-60, 1]`, and the number of NaN, negative and infinite
/// scores. A score of 0 becomes 1e-60: such pixels wait until all others are at the ceiling, and then get equal shares.
fn clean(scores: &[f64]) -> (Vec<f64>, usize) {
    let largest = scores.iter().copied().filter(|g| g.is_finite()).fold(0.0, f64::max);
    let largest = if largest > 0.0 { largest } else { 1.0 };
    let mut replaced = 0;
    let cleaned = scores
        .iter()
        .map(|&g| {
            if g.is_nan() || g < 0.0 || g == f64::INFINITY {
                replaced += 1;
            }
            // Relative to the largest, so that scores of 1e300 do not overflow.
            let g = if g.is_nan() || g < 0.0 { 0.0 } else { g.min(largest) };
            (g / largest).max(1e-60)
        })
        .collect();
    (cleaned, replaced)
}

/// Two close thresholds of the gain (error decrease) per sample, between which the budget runs out.
struct Bracket {
    /// A threshold within the budget: all steps with at least this gain fit. `None` if only the floors fit.
    within: Option<f64>,
    /// A threshold beyond the budget: all steps with at least this gain exceed it. 0 if the search met none.
    beyond: f64,
}

/// Estimates, from a subset of pixels, the gain (error decrease) per sample at which the budget runs out. The search
/// over all pixels starts there, which saves most of its dozen steps.
fn threshold_of_some(
    start: f64,
    scores: &[f64],
    floors: &[u32],
    total: u64,
    reach: impl Fn(f64, u32, f64) -> u32,
) -> f64 {
    let stride = scores.len() / SOME;
    if stride < 2 {
        return start;
    }
    let some = || scores.iter().zip(floors).step_by(stride);
    let share = some().count() as f64 / scores.len() as f64;
    let spend = |threshold: f64| some().map(|(&g, &floor)| u64::from(reach(g, floor, threshold))).sum();
    let bracket = find_threshold(start, (total as f64 * share) as u64, SOME as u64 / 64, spend);
    bracket.within.unwrap_or(start)
}

/// The approximate number of pixels from which [`threshold_of_some`] estimates.
const SOME: usize = 2048;

/// Searches for the gain (error decrease) per sample above which all steps together spend `total` samples.
///
/// The search starts at `start`. It stops when at most `close` samples are left over, or only steps of nearly equal
/// gain remain. `spend` returns the number of samples spent at a threshold, and falls as the threshold rises.
fn find_threshold(start: f64, total: u64, close: u64, spend: impl Fn(f64) -> u64) -> Bracket {
    // Gains of steps beyond the first lie between 1 (scores are relative to the largest) and 1e-60 (the smallest score)
    // times 2^-128 (the last rung, at the steepest exponent).
    let (least, most) = (1e-120_f64.ln(), 2.0_f64.ln());
    let excess = |spent: u64| (spent.max(1) as f64).ln() - (total as f64).ln();
    let mut bracket = Bracket { within: None, beyond: 0.0 };
    let (mut low, mut high) = ((least, f64::NAN), (most, f64::NAN));
    let mut guess = start.ln().clamp(least, most);
    // The bracket is halved at least every other step, so the search ends earlier.
    for step in 0..120 {
        let spent = spend(guess.exp());
        if spent > total {
            (low, bracket.beyond) = ((guess, excess(spent)), guess.exp());
        } else {
            (high, bracket.within) = ((guess, excess(spent)), Some(guess.exp()));
            if total - spent <= close {
                break;
            }
        }
        if high.0 - low.0 < 1e-3 {
            break;
        }
        // Outwards from the start in doubling steps, then regula falsi on log(spent) with bisection every other step.
        // The first step follows from the excess: spending goes about with the root of the threshold, or slower.
        let outwards = |excess: f64| (4.0 * excess.abs()).clamp(0.01, 1.0) * f64::from(1u32 << step.min(10));
        guess = match (low.1.is_nan(), high.1.is_nan()) {
            (true, _) => (high.0 - outwards(high.1)).max(least),
            (_, true) => (low.0 + outwards(low.1)).min(most),
            _ if step % 2 == 1 => 0.5 * (low.0 + high.0),
            _ => low.0 + (high.0 - low.0) * (low.1 / (low.1 - high.1)).clamp(0.02, 0.98),
        };
    }
    bracket
}

/// A pixel queued for its next samples, ordered by their gain: the error decrease per sample.
struct Waiting {
    gain: f64,
    count: u32,
    // 32 bits keep the struct at 16 bytes: if many scores are equal, many pixels wait.
    pixel: u32,
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain
            .total_cmp(&other.gain)
            .then_with(|| other.count.cmp(&self.count))
            // The hash is a bijection.
            .then_with(|| mix(other.pixel.into()).cmp(&mix(self.pixel.into())))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

/// Raises pixels by all steps whose error decrease per sample is at least `threshold`, largest decrease first. Stops
/// early if none of the `left` samples remains.
fn hand_out_above(
    threshold: f64,
    counts: &mut [u32],
    scores: &[f64],
    ceiling: u32,
    left: &mut u64,
    steps: &impl Steps,
) {
    // Without a threshold beyond the budget, this would list every step.
    if threshold == 0.0 || *left == 0 {
        return;
    }
    let mut waiting = Vec::new();
    for (pixel, (&n, &score)) in counts.iter().zip(scores).enumerate() {
        if steps.reach(threshold / score) <= n {
            continue;
        }
        let mut count = n;
        while count < ceiling {
            let next = steps.next(count);
            let gain = score * steps.gain(count, next);
            if gain < threshold {
                break;
            }
            waiting.push(Waiting { gain, count, pixel: pixel as u32 });
            count = next;
        }
    }
    // A step is at least one sample.
    let most = usize::try_from(*left).unwrap_or(usize::MAX);
    if waiting.len() > most {
        waiting.select_nth_unstable_by(most, |a, b| b.cmp(a));
        waiting.truncate(most);
    }
    waiting.sort_unstable_by(|a, b| b.cmp(a));
    for Waiting { pixel, count, .. } in waiting {
        let width = u64::from(steps.next(count).min(ceiling) - count).min(*left);
        counts[pixel as usize] = count + width as u32;
        *left -= width;
        if *left == 0 {
            return;
        }
    }
}

/// Hands out the `left` samples one step at a time, each time to the pixel with the largest error decrease per sample.
fn hand_out(counts: &mut [u32], scores: &[f64], ceiling: u32, mut left: u64, steps: &impl Steps) {
    if left == 0 {
        return;
    }
    let waiting = |pixel: usize, count: u32| {
        let gain = scores[pixel] * steps.gain(count, steps.next(count));
        Waiting { gain, count, pixel: pixel as u32 }
    };
    let open = counts.iter().enumerate().filter(|(_, n)| **n < ceiling);
    let mut heap: BinaryHeap<Waiting> = open.map(|(pixel, &n)| waiting(pixel, n)).collect();
    while left > 0 {
        let Some(Waiting { pixel, count, .. }) = heap.pop() else { return };
        let width = u64::from(steps.next(count).min(ceiling) - count).min(left);
        let pixel = pixel as usize;
        counts[pixel] = count + width as u32;
        left -= width;
        if counts[pixel] < ceiling {
            heap.push(waiting(pixel, counts[pixel]));
        }
    }
}

/// Converts `n` to 32 bits. Larger numbers become `u32::MAX`.
#[doc(hidden)]
#[inline]
pub fn saturating_u32(n: u64) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// A bijective 64-bit mix (the finaliser of SplitMix64, [Steele, Lea and Flood 2014]).
#[doc(hidden)]
#[inline]
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests;
