//! The clock of a render.

use std::time::Instant;

/// A stopwatch for wall time that leaves out the time in the monitor.
pub(super) struct Clock {
    start: Instant,
    away: f64,
}

impl Clock {
    /// Starts a stopwatch that shows `seconds` now.
    pub(super) fn start(seconds: f64) -> Self {
        Self { start: Instant::now(), away: -seconds }
    }

    pub(super) fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64() - self.away
    }

    /// Takes back the time since the stopwatch showed `seconds`.
    pub(super) fn leave_out_since(&mut self, seconds: f64) {
        self.away += self.seconds() - seconds;
    }
}
