//! Observers of a job's run.

use crate::Warning;
use dapple_core::{Control, Monitor, NoMonitor, Status};

/// An observer of a job's run.
pub trait JobMonitor {
    /// Called between two slices. The returned value decides whether the render continues.
    fn slice(&mut self, status: &Status<'_>) -> Control;

    /// Called at the end of each round of a render by several processes, with everyone's pixels if the monitor
    /// [reads the film](JobMonitor::reads_film).
    fn barrier(&mut self, status: &Status<'_>) {
        let _ = status;
    }

    /// Returns `false` if the monitor does not read the film of a render by several processes at [`JobMonitor::barrier`] and
    /// [`JobMonitor::end`]. It then holds the rows of its process only, as it does between them, and less is sent. The default
    /// is `true`.
    fn reads_film(&self) -> bool {
        true
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

    fn reads_film(&self) -> bool {
        false
    }
}

/// Adapts a render's [`Monitor`] to a [`JobMonitor`] that ignores warnings.
pub struct RenderMonitor<'m>(pub &'m mut dyn Monitor);

impl JobMonitor for RenderMonitor<'_> {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self.0.slice(status)
    }

    fn reads_film(&self) -> bool {
        self.0.reads_barriers()
    }

    fn end(&mut self, status: &Status<'_>) {
        self.0.end(status);
    }
}
