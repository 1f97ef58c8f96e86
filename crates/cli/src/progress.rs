//! Display of progress: a bar on a terminal, otherwise plain lines at intervals. Progress of a render, with the live image
//! and the stop on Ctrl-C.

use crate::machine::Stop;
use crate::output;
use crate::render::Show;
use crate::render::live::Live;
use dapple_core::limits::Budget;
use dapple_core::render::{Control, Status};
use dapple_job::{Job, JobMonitor, RenderedImage, Warning};
use indicatif::HumanDuration;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, stderr};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The number of steps of the progress bar.
const STEPS: u64 = 1000;
/// The interval at which the spinner of a phase of unknown length moves.
const TICK: Duration = Duration::from_millis(200);
/// Default interval between two plain lines, in seconds.
const LINES: f64 = 10.0;

/// The display of progress: a bar, plain lines, or nothing.
pub(crate) enum Display {
    Silent,
    Bar(ProgressBar),
    Lines(Lines),
}

impl Display {
    /// A bar if stderr is a terminal and `every` is `None`; otherwise plain lines, one every `every` seconds. Nothing if
    /// `is_silent`.
    pub(crate) fn new(is_silent: bool, every: Option<f64>) -> Self {
        if is_silent {
            return Self::Silent;
        }
        if every.is_none() && stderr().is_terminal() {
            // A bar hides itself on a terminal that cannot move its cursor.
            let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr());
            output::print_above(Some(bar.clone()));
            return Self::Bar(bar);
        }
        Lines::start(Duration::try_from_secs_f64(every.unwrap_or(LINES)).unwrap_or(Duration::MAX))
            .map_or(Self::Silent, Self::Lines)
    }

    pub(crate) fn is_silent(&self) -> bool {
        matches!(self, Self::Silent)
    }

    /// Shows a phase of unknown length, with its elapsed seconds.
    pub(crate) fn phase(&self, name: &'static str) {
        match self {
            Self::Silent => {}
            Self::Bar(bar) => {
                style(bar, "{spinner} {msg}, {elapsed}");
                bar.reset_elapsed();
                bar.set_message(name);
                bar.enable_steady_tick(TICK);
            }
            Self::Lines(lines) => lines.set(name.into(), true),
        }
    }

    /// Begins to show tracing, a phase with a known end.
    pub(crate) fn begin(&self) {
        if let Self::Bar(bar) = self {
            bar.disable_steady_tick();
            style(bar, "{bar:30} {percent:>3} %  {wide_msg}");
        }
    }

    /// Shows the completed fraction of the work, from 0 to 1, and a message.
    pub(crate) fn update(&self, share: f64, message: String) {
        match self {
            Self::Silent => {}
            Self::Bar(bar) => {
                bar.set_message(message);
                bar.set_position((share * STEPS as f64) as u64);
            }
            Self::Lines(lines) => lines.set(format!("{:.0} %, {message}", 100.0 * share), false),
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        if let Self::Bar(bar) = self {
            output::print_above(None);
            bar.finish_and_clear();
        }
    }
}

fn style(bar: &ProgressBar, template: &str) {
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
}

/// A thread that prints the latest message at intervals. A message that is current for longer than the interval is printed at
/// least once.
pub(crate) struct Lines {
    state: Arc<(Mutex<State>, Condvar)>,
    every: Duration,
    began: Instant,
    thread: Option<JoinHandle<()>>,
}

struct State {
    message: String,
    /// The time at which the message was set.
    set: Instant,
    is_printed: bool,
    /// True if the elapsed seconds of the phase follow the message.
    is_phase: bool,
    since: Instant,
    is_over: bool,
}

impl Lines {
    /// Starts the thread; `None` if the system refuses one.
    fn start(every: Duration) -> Option<Self> {
        let began = Instant::now();
        let message = "starting".into();
        let state = State { message, set: began, is_printed: false, is_phase: true, since: began, is_over: false };
        let state = Arc::new((Mutex::new(state), Condvar::new()));
        let shared = state.clone();
        let thread = std::thread::Builder::new().name("progress".into());
        let thread = thread.spawn(move || print(&shared, every, began)).ok()?;
        Some(Self { state, every, began, thread: Some(thread) })
    }

    fn set(&self, message: String, is_phase: bool) {
        let mut state = self.state.0.lock().unwrap_or_else(PoisonError::into_inner);
        self.print_if_due(&mut state);
        (state.message, state.set, state.is_printed, state.is_phase) = (message, Instant::now(), false, is_phase);
        if is_phase {
            state.since = state.set;
        }
    }

    /// Prints the message if it has been current for the whole interval and the thread was too late to print it.
    fn print_if_due(&self, state: &mut State) {
        if !state.is_printed && state.set.elapsed() >= self.every {
            state.print(self.began);
        }
    }
}

impl State {
    fn print(&mut self, began: Instant) {
        let mut line = format!("{:.0} s: {}", began.elapsed().as_secs_f64(), self.message);
        if self.is_phase {
            line += &format!(", for {:.0} s", self.since.elapsed().as_secs_f64());
        }
        output::say("progress", &line);
        self.is_printed = true;
    }
}

fn print((state, changed): &(Mutex<State>, Condvar), every: Duration, began: Instant) {
    let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
    loop {
        let due = Instant::now() + every;
        while !state.is_over && Instant::now() < due {
            let left = due.saturating_duration_since(Instant::now());
            state = changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        if state.is_over {
            return;
        }
        state.print(began);
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        let mut state = self.state.0.lock().unwrap_or_else(PoisonError::into_inner);
        self.print_if_due(&mut state);
        state.is_over = true;
        drop(state);
        self.state.1.notify_all();
        // The thread ends by itself; a panic in it only costs progress lines.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// The largest fraction of the time that predictions of the error may take.
const PREDICTING: f64 = 0.01;

pub(crate) struct Progress {
    display: Display,
    live: Live,
    pub(crate) stop: Stop,
    pixels: f64,
    /// True for a sampler that derives sample counts from earlier samples; its first round is a pilot.
    is_adaptive: bool,
    /// The number of rounds, if it is known.
    rounds: Option<u32>,
    goal: Option<f64>,
    /// The predicted relMSE of the image so far.
    predicted: Option<f64>,
    /// The time at which the next prediction is due. A prediction reads the whole film.
    due: Instant,
}

impl Progress {
    pub(crate) fn new(show: &Show<'_>, stop: Stop, live: Live) -> Self {
        let display = Display::new(show.json || show.quiet, show.progress_every);
        let (predicted, due) = (None, Instant::now());
        Self { display, live, stop, pixels: 1.0, is_adaptive: false, rounds: None, goal: None, predicted, due }
    }

    /// Shows the name of the present phase.
    pub(crate) fn phase(&self, name: &'static str) {
        self.display.phase(name);
    }

    /// Sets the image's size and the budget from a job, and begins to show tracing.
    pub(crate) fn begin(&mut self, job: &Job) {
        self.pixels = job.frame().pixels() as f64;
        self.is_adaptive = !job.is_a_priori();
        self.rounds = job.rounds();
        self.goal = if let Budget::Error { relmse, .. } = job.limits().budget { Some(relmse) } else { None };
        self.live.begin(job);
        self.display.begin();
    }

    /// Shows the final image to viewers of the live image.
    pub(crate) fn finish(&mut self, image: &RenderedImage) {
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
        self.predict(status);
        match (self.predicted, self.goal) {
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

    fn predict(&mut self, status: &Status<'_>) {
        let now = Instant::now();
        if now < self.due {
            return;
        }
        let relmse = status.film.record().filtered_relmse.or_else(|| status.film.predicted_relmse());
        // The prediction is infinite until each pixel has two samples.
        self.predicted = relmse.filter(|relmse| relmse.is_finite());
        let rest = if self.predicted.is_some() { Duration::from_secs(1) } else { Duration::ZERO };
        self.due = now + now.elapsed().div_f64(PREDICTING).max(rest);
    }
}

impl JobMonitor for Progress {
    fn progress(&mut self, status: &Status<'_>) -> Control {
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
