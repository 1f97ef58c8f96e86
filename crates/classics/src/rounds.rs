//! Rounds of samples: a uniform pilot, equal steps of the budget, and the pixels with the largest errors.

use dapple_core::{Error, Feedback, Plan, Stopping, allocate, mix, saturating_u32};
use std::cmp::Ordering;
use std::mem;

/// The samples of each pixel so far.
pub(crate) fn counts_so_far(seen: &Feedback<'_>) -> Vec<u32> {
    (0..seen.pixels()).map(|i| saturating_u32(seen.film.count(i))).collect()
}

/// The sum of counts.
pub(crate) fn total(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}

/// The samples that pixels lack of the counts `wanted`.
pub(crate) fn lacking(wanted: &[u32], now: &[u32]) -> Vec<u32> {
    wanted.iter().zip(now).map(|(n, now)| n - now).collect()
}

/// The number of first samples per pixel in effect: `wanted`, within the bounds of each pixel's count and the mean budget.
pub(crate) fn first_samples(seen: &Feedback<'_>, wanted: u32) -> u32 {
    let mean = saturating_u32(seen.budget.total / seen.pixels() as u64);
    wanted.max(seen.budget.min_spp).min(seen.budget.max_spp).min(mean)
}

/// Requests the samples that pixels lack of the first `samples` per pixel. Returns `true` if any are missing and the budget
/// suffices; otherwise the counts of `plan` stay 0.
pub(crate) fn plan_first(seen: &Feedback<'_>, samples: u32, plan: &mut Plan) -> bool {
    plan.counts = counts_so_far(seen).into_iter().map(|n| samples.saturating_sub(n)).collect();
    let is_missing = plan.total() > 0 && plan.total() <= seen.budget.left();
    if !is_missing {
        plan.counts.fill(0);
    }
    is_missing
}

/// The number of samples of the next round, if the budget beyond `first` samples per pixel is divided into `rounds` equal
/// steps.
pub(crate) fn next_step(seen: &Feedback<'_>, first: u32, rounds: u32) -> u64 {
    let budget = seen.budget;
    let first = (u64::from(first) * seen.pixels() as u64).min(budget.total);
    let step = |k: u32| first + (u128::from(budget.total - first) * u128::from(k) / u128::from(rounds.max(1))) as u64;
    let target = (1..=rounds).map(step).find(|&target| target > budget.spent).unwrap_or(budget.total);
    target.min(budget.total).saturating_sub(budget.spent)
}

/// Cuts the planned counts at each pixel's ceiling, and spreads what is cut evenly over pixels below it.
pub(crate) fn within_ceiling(seen: &Feedback<'_>, mut planned: Vec<u32>) -> Result<Vec<u32>, Error> {
    let most = seen.budget.max_spp;
    let mut beyond = 0;
    for (count, now) in planned.iter_mut().zip(counts_so_far(seen)) {
        let room = most.saturating_sub(now);
        beyond += u64::from(count.saturating_sub(room));
        *count = (*count).min(room);
    }
    with_extra(seen, planned, beyond)
}

/// Adds `extra` samples to the planned counts, such that all pixels' counts become as equal as their ceilings allow.
pub(crate) fn with_extra(seen: &Feedback<'_>, planned: Vec<u32>, extra: u64) -> Result<Vec<u32>, Error> {
    if extra == 0 {
        return Ok(planned);
    }
    let now = counts_so_far(seen);
    let floors: Vec<u32> = planned.iter().zip(&now).map(|(more, n)| n + more).collect();
    let counts = allocate(&vec![1.0; floors.len()], &floors, seen.budget.max_spp, total(&floors) + extra)?.counts;
    Ok(lacking(&counts, &now))
}

/// The rule by which a round's samples go to the pixels with the largest scores.
///
/// [`Stopping::Threshold`] adds `step` samples to each pixel whose score exceeds 1. [`Stopping::Budget`] adds them to the
/// quarter of the pixels with the largest scores above 0, at most 64 times until the budget is spent. If no pixel is
/// left for them, the rest of the budget is spread evenly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WorstFirst {
    pub(crate) mode: Stopping,
    /// The samples of a round in each of its pixels.
    pub(crate) step: u32,
    /// The largest number of samples of a pixel, as a multiple of the mean budget.
    pub(crate) cap: f64,
}

/// The share of the pixels that a round refines with [`Stopping::Budget`].
const QUARTER: usize = 4;
/// The largest number of rounds with [`Stopping::Budget`].
const ROUNDS: u64 = 64;

impl WorstFirst {
    /// The bytes per pixel that planning takes besides plan and scores.
    pub(crate) const BYTES: usize = 24;

    /// Fills the counts of `plan`. They stay 0 if no more samples are wanted.
    ///
    /// Scores are errors relative to the threshold. NaN counts as 0. Ties go by a hash of the pixel's index.
    pub(crate) fn plan(&self, seen: &Feedback<'_>, scores: &[f64], plan: &mut Plan) -> Result<(), Error> {
        let (budget, pixels) = (seen.budget, seen.pixels());
        let mean = budget.total as f64 / pixels as f64;
        let ceiling = ((self.cap * mean).ceil().min(f64::from(u32::MAX)) as u32).min(budget.max_spp);
        let room = |i: usize| ceiling.saturating_sub(saturating_u32(seen.film.count(i)));
        let least = if self.mode == Stopping::Threshold { 1.0 } else { 0.0 };
        let mut open: Vec<u32> = (0..pixels).filter(|&i| scores[i] > least && room(i) > 0).map(|i| i as u32).collect();
        let mut step = self.step;
        let order = |a: &u32, b: &u32| by_score(scores, *a, *b);
        if self.mode == Stopping::Budget {
            let most = pixels.div_ceil(QUARTER);
            step = step.max(saturating_u32(budget.total / ROUNDS / most as u64));
            if most < open.len() {
                open.select_nth_unstable_by(most, order);
                open.truncate(most);
            }
        }
        let mut left = budget.left();
        if left < open.len() as u64 * u64::from(step) {
            open.sort_unstable_by(order);
        }
        for i in open.into_iter().map(|i| i as usize) {
            plan.counts[i] = step.min(room(i)).min(saturating_u32(left));
            left -= u64::from(plan.counts[i]);
        }
        if plan.total() == 0 && self.mode == Stopping::Budget {
            plan.counts = with_extra(seen, mem::take(&mut plan.counts), budget.left())?;
        }
        Ok(())
    }
}

/// Orders pixels by falling score, then by a hash of their index.
fn by_score(scores: &[f64], a: u32, b: u32) -> Ordering {
    let tie = |i: u32| mix(u64::from(i));
    scores[b as usize].total_cmp(&scores[a as usize]).then_with(|| tie(a).cmp(&tie(b)))
}
