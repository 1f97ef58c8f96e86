//! The progress bar of a render, and the stop of the render on Ctrl-C.

use super::Show;
use crate::output;
use crate::stop::Stop;
use dapple_core::{Budget, Control, Status};
use dapple_job::{Job, JobMonitor, Warning};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::Duration;

/// The number of steps of the progress bar.
const STEPS: u64 = 1000;

pub(super) struct Progress {
    bar: ProgressBar,
    stop: Stop,
    /// True hides the progress bar and notes.
    silent: bool,
    pixels: f64,
    /// The number of shards of the image; 1 without shards.
    shards: f64,
    error: Option<f64>,
    /// The index of the present round of samples, and the predicted relMSE at the beginning of the round.
    predicted: (u32, Option<f64>),
}

impl Progress {
    pub(super) fn new(show: &Show<'_>, stop: Stop) -> Self {
        let silent = show.json || show.quiet;
        // The bar hides itself if stderr is not a terminal.
        let target = if silent { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(STEPS), target);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {msg}") {
            bar.set_style(style);
        }
        Self { bar, stop, silent, pixels: 1.0, shards: 1.0, error: None, predicted: (u32::MAX, None) }
    }

    /// Sets the image's size and the budget from a job.
    pub(super) fn begin(&mut self, job: &Job) {
        self.pixels = job.frame().pixels() as f64;
        self.shards = f64::from(job.spec().shard.map_or(1, |shard| shard.of()));
        self.error = match job.limits().budget {
            Budget::Error { relmse, .. } => Some(relmse),
            _ => None,
        };
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn show(&mut self, status: &Status<'_>) {
        let share = match status.seconds_limit {
            Some(limit) => status.seconds / limit,
            None => status.samples as f64 * self.shards / status.expected.max(1) as f64,
        };
        let share = share.clamp(0.0, 1.0);
        let mut message = format!("{:.1} spp, round {}", status.samples as f64 / self.pixels, status.round + 1);
        if let Some(goal) = self.error {
            // The prediction reads the whole film, and is therefore made only once per round.
            if self.predicted.0 != status.round {
                self.predicted =
                    (status.round, status.film.record().filtered_relmse.or_else(|| status.film.predicted_relmse()));
            }
            match self.predicted.1 {
                Some(now) => message += &format!(", relMSE {now:.2e} of {goal:.2e}"),
                None => message += &format!(", the goal is relMSE {goal:.2e}"),
            }
        } else if share > 0.0 {
            let left = status.seconds * (1.0 - share) / share;
            let left = Duration::try_from_secs_f64(left).unwrap_or(Duration::MAX);
            message += &format!(", {} left", HumanDuration(left));
        }
        self.bar.set_message(message);
        self.bar.set_position((share * STEPS as f64) as u64);
    }
}

impl JobMonitor for Progress {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        if self.stop.asked() {
            return Control::Stop;
        }
        if !self.bar.is_hidden() {
            self.show(status);
        }
        Control::Continue
    }

    fn warn(&mut self, warning: Warning) {
        self.bar.suspend(|| output::warn(warning.to_string()));
    }

    fn resumed(&mut self, spp: f64) {
        if !self.silent {
            self.bar.suspend(|| output::say("resume", &format!("resuming after {spp:.2} spp")));
        }
    }
}
