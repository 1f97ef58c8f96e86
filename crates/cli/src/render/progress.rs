//! Progress with time left, the ear for Ctrl-C, and the hand that gives checkpoints away.

use super::Options;
use super::checkpoints::Checkpoints;
use super::settings::Settings;
use crate::stop::Stop;
use dapple_core::{Budget, Control, Monitor, Status};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::Duration;

/// Steps of the bar.
const STEPS: u64 = 1000;

pub(super) struct Progress {
    bar: ProgressBar,
    stop: Stop,
    /// Where checkpoints go, if they do.
    pub(super) checkpoints: Option<Checkpoints>,
    pixels: f64,
    /// The machines that share the image.
    shards: f64,
    error: Option<f64>,
    /// The predicted error at the last barrier, and the round it was asked in.
    predicted: (u32, Option<f64>),
}

impl Progress {
    pub(super) fn new(options: &Options, settings: &Settings, stop: Stop, checkpoints: Option<Checkpoints>) -> Self {
        // Hidden by itself where stderr is no terminal.
        let target =
            if options.json || options.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(STEPS), target);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {msg}") {
            bar.set_style(style);
        }
        let error = match settings.limits.budget {
            Budget::Error { relmse, .. } => Some(relmse),
            _ => None,
        };
        let (pixels, predicted) = (settings.frame.pixels() as f64, (u32::MAX, None));
        let shards = f64::from(options.shard.map_or(1, |shard| shard.of()));
        Self { bar, stop, checkpoints, pixels, shards, error, predicted }
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
        if let Some(wanted) = self.error {
            // A walk over the whole film: once a round is enough.
            if self.predicted.0 != status.round {
                self.predicted = (status.round, status.film.predicted_relmse());
            }
            match self.predicted.1 {
                Some(now) => message += &format!(", relMSE {now:.2e} of {wanted:.2e}"),
                None => message += &format!(", relMSE {wanted:.2e} wanted"),
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

impl Monitor for Progress {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        if self.stop.asked() {
            self.end(status);
            return Control::Stop;
        }
        if let Some(checkpoints) = &mut self.checkpoints {
            checkpoints.slice(status);
        }
        if !self.bar.is_hidden() {
            self.show(status);
        }
        Control::Continue
    }

    fn end(&mut self, status: &Status<'_>) {
        if let Some(checkpoints) = &mut self.checkpoints {
            checkpoints.finish(status);
        }
    }
}
