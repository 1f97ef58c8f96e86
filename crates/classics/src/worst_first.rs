//! Rounds that add a few samples to the pixels with the largest errors.

use crate::rounds_and_variances::with_extra;
use dapple_core::{Error, Feedback, Plan, Stopping, mix, saturating_u32};
use std::cmp::Ordering;
use std::mem;

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
