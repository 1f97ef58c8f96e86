//! The state of a render between slices: the film, the open round, and the stage that a machine traces.

use super::filtered_error::FilteredError;
use super::repeats::Repeats;
use crate::integrator::{TrainingData, TrainingSum};
use crate::{Film, Frame, plan::Plan};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The state of a render between slices.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct State {
    pub(crate) film: Film,
    pub(crate) round: u32,
    /// The round being traced, if any; the next one is planned after it.
    pub(crate) open: Option<OpenRound>,
    /// The data of all training passes so far, to replay on resuming.
    pub(crate) passes: Vec<TrainingData>,
    /// The filtered image of the last prediction, if an error limit applies to a filtered image.
    pub(crate) filtered_error: Option<FilteredError>,
    /// The number of the pass that the integrator is prepared for; `None` before the first and after a resumption.
    pub(crate) prepared: Option<u32>,
    /// The stage of which the film has some rows; `None` for a film of the whole window.
    pub(crate) stage: Option<Stage>,
    /// The search for repeated random numbers. It restarts after a resumption.
    pub(crate) repeats: Repeats,
}

/// The progress within a round. In rows before `row`, the first `end` samples of each pixel are traced; in the others, the
/// first `start`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Cursor {
    pub(crate) start: u32,
    pub(crate) end: u32,
    pub(crate) row: u32,
}

/// A round that is partly traced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct OpenRound {
    pub(crate) plan: Plan,
    /// The round's samples after those of `plan`; a session hands out a round in parts.
    pub(crate) later: Option<Plan>,
    pub(crate) cursor: Cursor,
    /// The sums of the unfinished training pass. For each traced row of 16x16-pixel blocks: the index of the row of
    /// blocks, and the sums by key.
    pub(crate) pending: Vec<(usize, Vec<TrainingSum>)>,
    /// The number of samples traced before this round.
    pub(crate) before: u64,
    /// The number of this round's samples that are traced and no longer in `plan`.
    pub(crate) submitted: u64,
    pub(crate) plan_seconds: f64,
    /// Seconds of tracing this round before the snapshot.
    pub(crate) traced_seconds: f64,
}

impl OpenRound {
    /// The largest number of samples of a pixel.
    pub(crate) fn longest(&self) -> u32 {
        self.plan.halves().flatten().copied().max().unwrap_or(0)
    }

    /// The number of samples among the first `start` of each pixel, summed over pixels.
    pub(crate) fn before(&self, start: u32) -> u64 {
        self.plan.halves().flatten().map(|&count| u64::from(count.min(start))).sum()
    }

    /// The number of planned counts above `start`: one count per pixel, or one per pixel and half.
    pub(crate) fn above(&self, start: u32) -> u64 {
        self.plan.halves().flatten().map(|&count| u64::from(count > start)).sum()
    }

    /// The number of this round's samples already traced in each pixel of `row`.
    pub(crate) fn done(&self, row: usize) -> u32 {
        if row < self.cursor.row as usize { self.cursor.end } else { self.cursor.start }
    }

    /// Keeps only the untraced rest in the plan.
    pub(crate) fn keep_rest(&mut self, width: usize) {
        if self.cursor == Cursor::default() {
            return;
        }
        let rest = self.rest(width);
        self.submitted += self.plan.total() - rest.total();
        (self.plan, self.cursor) = (rest, Cursor::default());
    }

    /// Keeps the first `depth` samples of each pixel in `plan`, and moves the others to `later`.
    pub(super) fn split(&mut self, depth: u32) {
        let rest = self.plan.with_counts(|counts| counts.iter().map(|n| n.saturating_sub(depth)).collect());
        self.plan = self.plan.with_counts(|counts| counts.iter().map(|n| *n.min(&depth)).collect());
        self.later = Some(rest).filter(|rest| rest.total() > 0);
    }

    /// Moves the samples of `later` back to `plan`.
    pub(crate) fn join(&mut self) {
        let Some(later) = self.later.take() else { return };
        let all = self.plan.halves_mut().zip(later.halves());
        all.for_each(|(counts, more)| counts.iter_mut().zip(more).for_each(|(n, more)| *n = n.saturating_add(*more)));
    }

    /// The untraced rest of the round as a plan. It withdraws no samples: withdrawals happen when the round begins.
    pub(crate) fn rest(&self, width: usize) -> Plan {
        let left = |counts: &[u32]| -> Vec<u32> {
            counts.iter().enumerate().map(|(i, n)| n.saturating_sub(self.done(i / width))).collect()
        };
        self.plan.with_counts(left)
    }
}

/// The samples of a render between two barriers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stage {
    /// The window of the render.
    pub(crate) frame: Frame,
    /// The first row to trace, and the row after the last. The rows above are already traced.
    pub(crate) rows: [u32; 2],
    /// The numbers of samples per pixel at which the integrator's passes end, ascending. The last one is the end of the stage.
    pub(crate) ends: Vec<u32>,
}

impl Stage {
    /// The window of the render.
    pub fn frame(&self) -> Frame {
        self.frame
    }

    /// The rows of the window that are to be traced.
    pub fn rows(&self) -> Range<u32> {
        self.rows[0]..self.rows[1]
    }

    /// The number of passes in the stage, at least 1. [`Integrator::prepare`](crate::Integrator::prepare) may run before each.
    pub fn passes(&self) -> usize {
        self.ends.len()
    }

    /// Returns `true` if `film` covers some rows of the window, and the stage has rows and passes.
    pub(crate) fn has(&self, film: &Frame) -> bool {
        let top = film.origin()[1].checked_sub(self.frame.origin()[1]);
        let rows = top.and_then(|top| self.frame.rows(top..top + film.size()[1]).ok());
        rows == Some(*film) && self.rows[0] < self.rows[1] && self.ends.is_sorted() && !self.ends.is_empty()
    }

    pub(super) fn end(&self) -> u32 {
        self.ends.last().copied().unwrap_or(0)
    }

    /// Samples per pixel of the pass from sample `start`.
    pub(super) fn pass_length(&self, start: u32) -> u32 {
        self.ends.iter().find(|end| **end > start).map_or(0, |end| end - start)
    }
}

/// The result of tracing a round: whether and where a monitor stopped it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stopped {
    No,
    /// The monitor stopped the render while samples of the round remained to be traced.
    Within,
    /// The monitor stopped the render after the last slice of the round.
    AtEnd,
}
