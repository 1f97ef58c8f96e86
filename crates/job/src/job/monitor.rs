//! Observers of a job's run, and warnings about time limits that cannot be met.

use crate::Warning;
use dapple_core::film::Record;
use dapple_core::render::{Control, Monitor, NoMonitor, Status};

/// An observer of a job's run.
pub trait JobMonitor {
    /// Called after about 0.2 seconds of tracing each. The returned value decides whether the render continues.
    fn progress(&mut self, status: &Status<'_>) -> Control;

    /// Called when all samples are traced, unless the render was stopped.
    fn end(&mut self, status: &Status<'_>) {
        let _ = status;
    }

    /// Receives a warning during the run.
    fn warn(&mut self, warning: Warning) {
        let _ = warning;
    }

    /// Called on resuming, with the mean samples per pixel of the checkpoint.
    fn resumed(&mut self, spp: f64) {
        let _ = spp;
    }
}

impl JobMonitor for NoMonitor {
    fn progress(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }
}

/// Adapts a render's [`Monitor`] to a [`JobMonitor`] that ignores warnings.
pub struct RenderMonitor<'m>(pub &'m mut dyn Monitor);

impl JobMonitor for RenderMonitor<'_> {
    fn progress(&mut self, status: &Status<'_>) -> Control {
        self.0.progress(status)
    }

    fn end(&mut self, status: &Status<'_>) {
        self.0.end(status);
    }
}

/// The tolerated excess over a time limit, as a fraction of the limit.
const TOLERANCE: f64 = 0.1;
/// The excess in seconds that is tolerated in addition to [`TOLERANCE`].
const LEAST_EXCESS: f64 = 0.1;

/// An observer of the first round of a render with a time limit.
#[derive(Debug, Default)]
pub(super) struct TimeWatch {
    warned: bool,
}

impl TimeWatch {
    /// Returns a warning, once, if the rows traced so far show that the first round takes longer than the time limit.
    pub(super) fn look(&mut self, status: &Status<'_>, min_spp: u32) -> Option<Warning> {
        let limit = status.seconds_limit.filter(|_| !self.warned && status.round == 0 && status.samples > 0)?;
        // The first rows may be the slowest, so that the estimate waits for a tenth of the limit or two seconds.
        if status.seconds < (0.1 * limit).min(2.0) {
            return None;
        }
        let needed = status.seconds * status.expected as f64 / status.samples as f64;
        self.warned = needed > limit * (1.0 + 2.0 * TOLERANCE) + LEAST_EXCESS;
        self.warned.then_some(Warning::TimeTooShort { limit, min_spp, needed })
    }
}

/// Returns a warning if a render that took `taken` seconds exceeded its time limit beyond the tolerance.
pub(super) fn exceeded(limit: f64, taken: f64, filter: f64, (record, min_spp): (&Record, u32)) -> Option<Warning> {
    if record.interrupted || taken <= limit * (1.0 + TOLERANCE) + LEAST_EXCESS {
        return None;
    }
    let only = record.rounds.first().filter(|_| record.rounds.len() == 1);
    let first = only.map(|round| (round.plan_seconds + round.trace_seconds, min_spp));
    Some(Warning::TimeExceeded { limit, taken, first, filter })
}
