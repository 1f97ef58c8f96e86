//! The progress of a render, its live image, and its stop on Ctrl-C.

use super::Show;
use super::live::Live;
use crate::display::Display;
use crate::output;
use crate::stop::Stop;
use dapple_core::{Budget, Control, Status};
use dapple_job::{Job, JobMonitor, RenderedImage, Warning};
use indicatif::HumanDuration;
use std::time::{Duration, Instant};

/// The largest share of the time that predictions of the error may take.
const PREDICTING: f64 = 0.01;

pub(super) struct Progress {
    display: Display,
    live: Live,
    pub(super) stop: Stop,
    pixels: f64,
    /// True for a sampler that decides on counts by samples: its first round is a pilot.
    is_adaptive: bool,
    /// The number of rounds, if it is known.
    rounds: Option<u32>,
    goal: Option<f64>,
    predicted: Predicted,
}

/// The predicted relMSE of the image so far, and the time at which the next prediction is due. A prediction reads the
/// whole film.
struct Predicted {
    relmse: Option<f64>,
    due: Instant,
}

impl Progress {
    pub(super) fn new(show: &Show<'_>, stop: Stop, live: Live) -> Self {
        let display = Display::new(show.json || show.quiet, show.progress_every);
        let predicted = Predicted { relmse: None, due: Instant::now() };
        Self { display, live, stop, pixels: 1.0, is_adaptive: false, rounds: None, goal: None, predicted }
    }

    /// Shows the name of the present phase.
    pub(super) fn phase(&self, name: &'static str) {
        self.display.phase(name);
    }

    /// Sets the image's size and the budget from a job, and begins to show tracing.
    pub(super) fn begin(&mut self, job: &Job) {
        self.pixels = job.frame().pixels() as f64;
        self.is_adaptive = !job.is_a_priori();
        self.rounds = job.rounds();
        self.goal = match job.limits().budget {
            Budget::Error { relmse, .. } => Some(relmse),
            _ => None,
        };
        self.live.begin(job);
        self.display.begin();
    }

    /// Shows the final image to viewers of the live image.
    pub(super) fn finish(&mut self, image: &RenderedImage) {
        self.live.finish(image);
    }

    fn show(&mut self, status: &Status<'_>) {
        let share = match status.seconds_limit {
            Some(limit) => status.seconds / (limit - status.filter_seconds.unwrap_or(0.0)).max(1e-3),
            None => status.samples as f64 / status.expected.max(1) as f64,
        };
        let share = share.clamp(0.0, 1.0);
        let round = status.round + 1;
        let mut message = match (round, self.rounds) {
            (1, _) if self.is_adaptive => "pilot".to_owned(),
            (_, Some(rounds)) if rounds > 1 => format!("round {round} of {}", rounds.max(round)),
            (1, _) => "tracing".to_owned(),
            _ => format!("round {round}"),
        };
        message += &format!(", {:.1} spp", status.samples as f64 / self.pixels);
        self.predicted.update(status);
        match (self.predicted.relmse, self.goal) {
            (Some(now), Some(goal)) => message += &format!(", relMSE {now:.2e} of {goal:.2e}"),
            (None, Some(goal)) => message += &format!(", the goal is relMSE {goal:.2e}"),
            (Some(now), None) => message += &format!(", relMSE {now:.2e} unfiltered"),
            (None, None) => {}
        }
        if self.goal.is_none() && share > 0.0 {
            let left = status.seconds * (1.0 - share) / share;
            let left = Duration::try_from_secs_f64(left).unwrap_or(Duration::MAX);
            message += &format!(", {} left", HumanDuration(left));
        }
        self.display.update(share, message);
    }
}

impl Predicted {
    fn update(&mut self, status: &Status<'_>) {
        let now = Instant::now();
        if now < self.due {
            return;
        }
        let relmse = status.film.record().filtered_relmse.or_else(|| status.film.predicted_relmse());
        // The prediction is infinite until each pixel has two samples.
        self.relmse = relmse.filter(|relmse| relmse.is_finite());
        let rest = if self.relmse.is_some() { Duration::from_secs(1) } else { Duration::ZERO };
        self.due = now + now.elapsed().div_f64(PREDICTING).max(rest);
    }
}

impl JobMonitor for Progress {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        if self.stop.asked() {
            return Control::Stop;
        }
        if !self.display.is_silent() {
            self.show(status);
        }
        self.live.show(status.film);
        Control::Continue
    }

    fn warn(&mut self, warning: Warning) {
        output::warn(warning.to_string());
    }

    fn resumed(&mut self, spp: f64) {
        if !self.display.is_silent() {
            output::say("resume", &format!("resuming after {spp:.2} spp"));
        }
    }
}
