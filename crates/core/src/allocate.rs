//! Exact allocation of an integer budget to pixels.
//!
//! Both [`allocate`] and [`Ladder::allocate`] minimise `sum_p g_p f(n_p)` over integers `floor_p <= n_p <= ceiling`
//! that add up to the budget. `n_p` is pixel `p`'s sample count, `g_p` its score (its weight squared times its
//! variance), and `f` falls with the count.
//!
//! The objective is separable and convex, so handing out samples in the order of their marginal gain (decrease of the
//! objective) is exactly optimal [Fox 1966]. Most samples are handed out at once, to all steps whose gain exceeds a common
//! threshold. The rest follow step by step, in the order of gain. Ties go to the smaller count and then by a hash of the
//! pixel's index, so that no part of the image is preferred.
//!

mod ladder;
mod order;
mod share;

pub use ladder::Ladder;
pub use share::share;

use crate::{Error, parallel};
use order::{Waiting, hand_out, steps_above};

/// The result of an allocation: one sample count per pixel.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Allocation {
    /// The number of samples of each pixel.
    pub counts: Vec<u32>,
    /// The number of samples that were not allocated because all pixels are at the ceiling.
    pub unspent: u64,
    /// The number of scores that were replaced: NaN and negative ones by 0, infinite ones by the largest finite score.
    pub replaced: usize,
}

/// A pixel's error `f(n)` as a function of its sample count `n`, and the allowed counts.
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

/// Returns the integer counts `n_p` that sum to `total` and minimise `sum_p scores[p] / n_p`. Before rounding, `n_p` is
/// proportional to the square root of the score [Neyman 1934].
///
/// Counts satisfy `floors[p] <= counts[p] <= ceiling`; a floor above the ceiling takes precedence. If every pixel reaches the
/// ceiling, the other samples are [`Allocation::unspent`].
///
/// ```
/// let counts = dapple_core::plan::allocate(&[1.0, 4.0, 9.0], &[1; 3], 100, 60)?.counts;
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
    let demand = PixelDemand::new(scores, floors, ceiling, total);
    share_out(&demand, ceiling, &EveryCount)
}

/// A budget, and the pixels among which it is divided.
#[derive(Clone, Copy, Debug)]
struct PixelDemand<'a> {
    scores: &'a [f64],
    floors: &'a [u32],
    ceiling: u32,
    total: u64,
}

impl<'a> PixelDemand<'a> {
    fn new(scores: &'a [f64], floors: &'a [u32], ceiling: u32, total: u64) -> Self {
        assert_eq!(scores.len(), floors.len(), "one floor per score");
        assert!(u32::try_from(scores.len()).is_ok(), "pixels are numbered with 32 bits");
        Self { scores, floors, ceiling, total }
    }

    /// The sum of the counts if each pixel gets `n` samples, or its floor if that is larger.
    fn at(&self, n: u32) -> u64 {
        self.floors.iter().map(|&floor| u64::from(floor.max(n))).sum()
    }
}

/// Allocates the budget. `rung` replaces the ceiling, except if all scores are equal or the budget does not fit below it.
fn share_out(demand: &PixelDemand<'_>, rung: u32, steps: &impl Steps) -> Result<Allocation, Error> {
    let PixelDemand { scores, floors, ceiling, total } = *demand;
    let (range, replaced) = Range::of(scores);
    let [needed, most, room] = [0, ceiling, rung].map(|n| demand.at(n));
    if needed > total {
        return Err(Error::BudgetTooSmall { budget: total, needed, pixels: scores.len() });
    }
    if most <= total {
        let counts = floors.iter().map(|&n| n.max(ceiling)).collect();
        return Ok(Allocation { counts, unspent: total - most, replaced });
    }
    if range.is_point() {
        return Ok(Allocation { counts: level(floors, ceiling, total), unspent: 0, replaced });
    }
    let scores = range.clean(scores);
    let ceiling = if room >= total { rung } else { ceiling };
    let demand = PixelDemand { scores: &scores, ceiling, ..*demand };
    Ok(Allocation { counts: share_out_clean(&demand, needed, steps), unspent: 0, replaced })
}

/// The number of pixels that are summed by one task.
const SERIAL: usize = 4096;

/// Returns the counts that minimise the total error and sum to `total`. Requires scores above 0 that are not all equal. The
/// total must be at least `needed`, the sum of the floors, and must fit below the ceiling.
fn share_out_clean(demand: &PixelDemand<'_>, needed: u64, steps: &impl Steps) -> Vec<u32> {
    let PixelDemand { scores, floors, ceiling, total } = *demand;
    let reach = |g: f64, floor: u32, threshold: f64| steps.reach(threshold / g).min(ceiling).max(floor);
    let spend = |threshold: f64| -> u64 {
        let part = |number: usize| {
            let part = number * SERIAL..scores.len().min((number + 1) * SERIAL);
            let each = scores[part.clone()].iter().zip(&floors[part]);
            each.map(|(&g, &floor)| u128::from(reach(g, floor, threshold))).sum()
        };
        parallel::sum(scores.len().div_ceil(SERIAL), &part) as u64
    };
    let start = threshold_of_some(demand, reach, steps);
    let close = (scores.len() / 64).max(256) as u64;
    // The search sums over all pixels several times. From outside the pool, each sum would wait longer than it takes.
    let bracket = parallel::within(|| find_threshold(start, total, close, spend));
    let (mut counts, spent): (Vec<u32>, u64) = match bracket.within {
        Some((t, spent)) => (scores.iter().zip(floors).map(|(&g, &floor)| reach(g, floor, t)).collect(), spent),
        None => (floors.to_vec(), needed),
    };
    let mut left = total - spent;
    let within = bracket.within.map_or(0.0, |(threshold, _)| threshold);
    let mut threshold = if bracket.beyond > 0.0 { bracket.beyond } else { within * (1.0 - LOWER) };
    let mut lower = LOWER;
    while left > 0 {
        let waiting = steps_above(threshold, &counts, demand, steps);
        let end = |count| steps.next(count).min(ceiling);
        left = hand_out(waiting, &mut counts, left, end);
        if threshold == 0.0 {
            break;
        }
        // Lower the threshold in growing steps; finally list all steps, from the last rung to the ceiling.
        lower *= 2.0;
        threshold = if threshold > LEAST { threshold * (1.0 - lower).max(1e-9) } else { 0.0 };
    }
    counts
}

/// The fraction by which the threshold is first lowered, if samples are left over.
const LOWER: f64 = 1e-3;
/// A threshold below the gain of every step of a ladder. Scores lie between 1e-60 and 1. A step to the last rung gains
/// 2^-128 times the score, at the steepest exponent.
const LEAST: f64 = 1e-120;

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
    let left = total - spend(low);
    if left > 0 {
        // Fewer samples are left than pixels are open, or the next level would have fitted.
        let open = counts.iter().enumerate().filter(|(_, n)| **n == low);
        let open = open.map(|(k, &count)| Waiting { gain: 1.0, count, pixel: k as u32 }).collect();
        hand_out(open, &mut counts, left, |count| count + 1);
    }
    counts
}

/// The range of the scores. NaN and negative scores count as 0.
#[derive(Clone, Copy)]
struct Range {
    /// The smallest score.
    least: f64,
    /// The largest finite score; 1 if no finite score is above 0.
    most: f64,
    /// The largest score, possibly infinite.
    top: f64,
}

impl Range {
    /// The range of the scores, and the number of scores to be replaced.
    fn of(scores: &[f64]) -> (Self, usize) {
        let mut range = Self { least: f64::INFINITY, most: 0.0, top: 0.0 };
        let mut replaced = 0;
        for &g in scores {
            if g.is_nan() || g < 0.0 || g == f64::INFINITY {
                replaced += 1;
            }
            // `max` turns NaN into 0.
            let g = g.max(0.0);
            range.least = range.least.min(g);
            range.top = range.top.max(g);
            if g < f64::INFINITY {
                range.most = range.most.max(g);
            }
        }
        range.most = if range.most > 0.0 { range.most } else { 1.0 };
        (range, replaced)
    }

    /// Returns `true` if all scores are equal.
    fn is_point(&self) -> bool {
        self.clean_one(self.least) == self.clean_one(self.top)
    }

    /// The score, divided by the largest and clamped to `[1e-60, 1]`. NaN and negative scores count as 0, infinite ones
    /// as the largest finite score. A score of 0 becomes 1e-60: such pixels get samples only after all others are at the
    /// ceiling, and then equal numbers.
    fn clean_one(&self, g: f64) -> f64 {
        // Relative to the largest, so that scores of 1e300 do not overflow.
        let g = if g.is_nan() || g < 0.0 { 0.0 } else { g.min(self.most) };
        (g / self.most).max(1e-60)
    }

    fn clean(&self, scores: &[f64]) -> Vec<f64> {
        scores.iter().map(|&g| self.clean_one(g)).collect()
    }
}

/// Two close thresholds of the gain (error decrease) per sample, between which the budget runs out.
struct Bracket {
    /// A threshold within the budget, and the number of samples spent there. All steps with at least this gain fit.
    /// `None` if only the floors fit.
    within: Option<(f64, u64)>,
    /// A threshold beyond the budget, which is too small for all steps with at least this gain. 0 if the search found none.
    beyond: f64,
}

/// Estimates, from some of the pixels, the gain (error decrease) per sample at which the budget runs out. The search over
/// all pixels starts there, which saves most of its dozen steps.
fn threshold_of_some(demand: &PixelDemand<'_>, reach: impl Fn(f64, u32, f64) -> u32, steps: &impl Steps) -> f64 {
    let PixelDemand { scores, floors, total, .. } = *demand;
    let pixels = scores.len();
    let some: Vec<(f64, u32)> = (0..pixels).step_by((pixels / SOME).max(1)).map(|k| (scores[k], floors[k])).collect();
    let share = some.len() as f64 / pixels as f64;
    let spend = |threshold: f64| some.iter().map(|&(g, floor)| u64::from(reach(g, floor, threshold))).sum();
    let mean = u32::try_from(total / pixels as u64).unwrap_or(u32::MAX - 1).max(1);
    let score = some.iter().map(|(g, _)| g).sum::<f64>() / some.len() as f64;
    let start = steps.gain(mean, steps.next(mean)) * score;
    let bracket = find_threshold(start, (total as f64 * share) as u64, SOME as u64 / 64, spend);
    bracket.within.map_or(start, |(threshold, _)| threshold)
}

/// The approximate number of pixels that [`threshold_of_some`] uses.
const SOME: usize = 2048;

/// Searches for the gain (error decrease) per sample above which all steps together spend `total` samples.
///
/// The search starts at `start`. It stops when at most `close` samples are left over, or only steps of nearly equal
/// gain remain. `spend` returns the number of samples spent at a threshold, and falls as the threshold rises.
fn find_threshold(start: f64, total: u64, close: u64, spend: impl Fn(f64) -> u64) -> Bracket {
    let (least, most) = (LEAST.ln(), 2.0_f64.ln());
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
            (high, bracket.within) = ((guess, excess(spent)), Some((guess.exp(), spent)));
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
