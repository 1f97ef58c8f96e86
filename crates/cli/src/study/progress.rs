//! The progress bar of a study, and the stop of the study on Ctrl-C.

use crate::output;
use crate::stop::Stop;
use dapple_core::Control;
use dapple_study::{StudyMonitor, StudyProgress};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::Duration;

/// The number of steps of the progress bar.
const STEPS: u64 = 1000;

pub(super) struct Bar {
    bar: ProgressBar,
    stop: Stop,
}

impl Bar {
    pub(super) fn new(quiet: bool, stop: Stop) -> Self {
        // The bar hides itself if stderr is not a terminal.
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(STEPS), target);
        if let Ok(style) = ProgressStyle::with_template("{bar:20} {percent:>3} %  {wide_msg}") {
            bar.set_style(style);
        }
        Self { bar, stop }
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// Prints a line above the progress bar.
    pub(super) fn say(&self, line: &str) {
        self.bar.suspend(|| output::say("study", line));
    }
}

impl StudyMonitor for Bar {
    fn progress(&mut self, progress: &StudyProgress<'_>) -> Control {
        if self.stop.asked() {
            return Control::Stop;
        }
        if !self.bar.is_hidden() {
            let left = progress.left.map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
            let left = left.map_or_else(String::new, |left| format!("{} left, ", HumanDuration(left)));
            let (done, runs) = (progress.done, progress.runs);
            self.bar.set_message(format!("{left}{done} of {runs} runs; {}", progress.doing));
            self.bar.set_position((progress.share * STEPS as f64) as u64);
        }
        Control::Continue
    }

    fn warning(&mut self, warning: &str) {
        self.bar.suspend(|| output::warn(warning));
    }
}
