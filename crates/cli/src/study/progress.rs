//! The progress of a study, and its stop on Ctrl-C.

use crate::display::Display;
use crate::output;
use crate::stop::Stop;
use dapple_core::Control;
use dapple_study::{StudyMonitor, StudyProgress};
use indicatif::HumanDuration;
use std::time::Duration;

pub(super) struct Bar {
    display: Display,
    stop: Stop,
}

impl Bar {
    pub(super) fn new(quiet: bool, stop: Stop) -> Self {
        let display = Display::new(quiet, None);
        display.begin();
        Self { display, stop }
    }

    /// Removes the bar.
    pub(super) fn finish(&mut self) {
        self.display = Display::Silent;
    }
}

impl StudyMonitor for Bar {
    fn progress(&mut self, progress: &StudyProgress<'_>) -> Control {
        if self.stop.asked() {
            return Control::Stop;
        }
        if !self.display.is_silent() {
            let left = progress.left.map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
            let left = left.map_or_else(String::new, |left| format!("{} left, ", HumanDuration(left)));
            let (done, runs) = (progress.done, progress.runs);
            self.display.update(progress.share, format!("{left}{done} of {runs} runs; {}", progress.doing));
        }
        Control::Continue
    }

    fn warning(&mut self, warning: &str) {
        output::warn(warning);
    }
}
