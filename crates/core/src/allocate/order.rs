//! Steps sorted by gain, and the distribution of the last samples over them.

use super::{PixelDemand, Steps};
use crate::point_set::mix;
use std::cmp::Ordering;

/// A step of a pixel: from `count` to the next count.
#[derive(Clone, Copy)]
pub(super) struct Waiting {
    /// The error decrease per sample, above 0.
    pub(super) gain: f64,
    pub(super) count: u32,
    // 32 bits keep the struct at 16 bytes: if many scores are equal, many pixels wait.
    /// The pixel's index in the window.
    pub(super) pixel: u32,
}

impl Waiting {
    /// The order of steps: larger gains first, then smaller counts, then a hash of the pixel's index.
    fn order(&self, other: &Self) -> Ordering {
        let tie = |step: &Self| (step.count, mix(step.pixel.into()));
        other.gain.total_cmp(&self.gain).then_with(|| tie(self).cmp(&tie(other)))
    }
}

/// All steps above the current `counts` whose error decrease per sample is at least `threshold`.
pub(super) fn steps_above(
    threshold: f64,
    counts: &[u32],
    demand: &PixelDemand<'_>,
    steps: &impl Steps,
) -> Vec<Waiting> {
    let mut waiting = Vec::new();
    for (k, (&n, &score)) in counts.iter().zip(demand.scores).enumerate() {
        // Rounding must not hide a step, so the quick test is a little lower.
        if threshold > 0.0 && steps.reach(threshold * (1.0 - 1e-9) / score) <= n {
            continue;
        }
        let mut count = n;
        while count < demand.ceiling {
            let next = steps.next(count);
            let gain = score * steps.gain(count, next);
            if gain < threshold {
                break;
            }
            waiting.push(Waiting { gain, count, pixel: k as u32 });
            count = next;
        }
    }
    waiting
}

/// Applies the `waiting` steps in order until the `left` remaining samples are used up. Returns the number of unused
/// samples. A step from count `n` raises its pixel to `end(n)`; the last step may stop short.
pub(super) fn hand_out(mut waiting: Vec<Waiting>, counts: &mut [u32], mut left: u64, end: impl Fn(u32) -> u32) -> u64 {
    let width = |step: &Waiting| u64::from(end(step.count) - step.count);
    if waiting.iter().map(width).sum::<u64>() > left {
        waiting = first_steps(waiting, left, width);
        waiting.sort_unstable_by(Waiting::order);
    }
    for step in waiting {
        if left == 0 {
            break;
        }
        let samples = width(&step).min(left);
        let count = &mut counts[step.pixel as usize];
        *count = (*count).max(step.count + samples as u32);
        left -= samples;
    }
    left
}

/// Drops the steps that the `left` samples cannot reach, except for a few. Repeated splits of the list at its middle step
/// take linear time.
fn first_steps(mut waiting: Vec<Waiting>, left: u64, width: impl Fn(&Waiting) -> u64) -> Vec<Waiting> {
    let (mut first, mut before) = (0, 0);
    while waiting.len() - first > 64 {
        let middle = (waiting.len() - first) / 2;
        let (low, _, _) = waiting[first..].select_nth_unstable_by(middle, Waiting::order);
        let taken = before + low.iter().map(&width).sum::<u64>();
        if taken >= left {
            waiting.truncate(first + middle);
        } else {
            (first, before) = (first + middle, taken);
        }
    }
    waiting
}
