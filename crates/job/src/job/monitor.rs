//! Observers of a job's run.

use crate::Warning;
use dapple_core::{Control, Film, Monitor, NoMonitor, Status};

/// An observer of a job's run.
pub trait JobMonitor {
    /// Called between two slices. The returned value decides whether the render continues.
    fn slice(&mut self, status: &Status<'_>) -> Control;

    /// Called at the end of each round of a render by several processes. The film holds the rows of this process.
    fn barrier(&mut self, status: &Status<'_>) {
        let _ = status;
    }

    /// Returns `true` if the monitor takes everyone's rows by [`JobMonitor::rows`] after a [`JobMonitor::barrier`]. The default
    /// is `false`.
    fn reads_rows(&self) -> bool {
        false
    }

    /// Takes the next rows of the window, from the top, with counts, means and variances.
    fn rows(&mut self, rows: &Film) {
        let _ = rows;
    }

    /// Called when all samples are traced, unless the render was stopped.
    fn end(&mut self, status: &Status<'_>) {
        let _ = status;
    }

    /// Called between two slices of the training passes of the whole image, which precede a crop with its bits
    /// ([`RenderSpec::crop_exact`](crate::RenderSpec::crop_exact)).
    fn training(&mut self, status: &Status<'_>) -> Control {
        let _ = status;
        Control::Continue
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
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }
}

/// Adapts a render's [`Monitor`] to a [`JobMonitor`] that ignores warnings.
pub struct RenderMonitor<'m>(pub &'m mut dyn Monitor);

impl JobMonitor for RenderMonitor<'_> {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self.0.slice(status)
    }

    fn reads_rows(&self) -> bool {
        self.0.reads_rows()
    }

    fn rows(&mut self, rows: &Film) {
        self.0.rows(rows);
    }

    fn end(&mut self, status: &Status<'_>) {
        self.0.end(status);
    }
}
