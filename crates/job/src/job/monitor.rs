//! Observers of a job's run.

use crate::Warning;
use dapple_core::{Control, Monitor, NoMonitor, Status};

/// An observer of a job's run.
pub trait JobMonitor {
    /// Called between two slices. The returned value decides whether the render continues.
    fn slice(&mut self, status: &Status<'_>) -> Control;

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

    fn end(&mut self, status: &Status<'_>) {
        self.0.end(status);
    }
}
