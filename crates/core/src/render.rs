//! The render loop: plan a round, trace it, plan the next.

mod budget;
pub(crate) mod holdout;
mod round;

use crate::film::Bank;
use crate::snapshot::{Cursor, OpenRound, View};
use crate::{
    Error, Film, Filter, Frame, Integrator, Limits, Needs, Plan, Progress, Retention, RoundRecord, Sampler, Snapshot,
    TrainingData,
};
use budget::Meter;
use holdout::{Holdout, Prediction};
use round::Stopped;
use std::time::Instant;

/// The state of a render between two slices of tracing (about 0.2 seconds each), passed to a [`Monitor`].
#[non_exhaustive]
#[derive(Clone, Copy)]
pub struct Status<'a> {
    /// The film so far, with valid statistics in every pixel.
    pub film: &'a Film,
    /// The number of the round being traced, from 0.
    pub round: u32,
    /// The number of samples traced so far.
    pub samples: u64,
    /// The number of samples to trace in all, as far as known; a limit of time or error may change it.
    pub expected: u64,
    /// Wall seconds of planning and tracing so far, without the monitor's own time.
    pub seconds: f64,
    /// The time limit in seconds, if there is one.
    pub seconds_limit: Option<f64>,
    view: View<'a>,
}

impl Status<'_> {
    /// The state of the render as bytes for [`Snapshot::from_bytes`], about as many as the film takes in memory. A
    /// render resumed from them ends with the same bits as this one.
    pub fn snapshot(&self) -> Vec<u8> {
        self.view.write()
    }
}

/// A monitor's decision about the render.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Continue rendering.
    Continue,
    /// Stop the render and return the film so far.
    Stop,
}

/// An observer of a render, called about five times a second: for progress, previews, checkpoints and Ctrl-C.
///
/// A closure `FnMut(&Status) -> Control` is a monitor too.
///
/// ```
/// use dapple_core::{Control, Monitor, Status};
///
/// /// Stops after a minute.
/// struct Minute;
///
/// impl Monitor for Minute {
///     fn slice(&mut self, status: &Status<'_>) -> Control {
///         if status.seconds < 60.0 { Control::Continue } else { Control::Stop }
///     }
/// }
/// ```
pub trait Monitor {
    /// Called after each slice of tracing (about 0.2 seconds). The returned value decides whether the render continues.
    fn slice(&mut self, status: &Status<'_>) -> Control;

    /// Called once at the end, unless the render was stopped. A render resumed from a snapshot taken here may have
    /// larger limits.
    fn end(&mut self, status: &Status<'_>) {
        let _ = status;
    }
}

/// The monitor that does nothing: the render runs to the end.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoMonitor;

impl Monitor for NoMonitor {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }
}

impl<F: FnMut(&Status<'_>) -> Control> Monitor for F {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self(status)
    }
}

/// A render to run or resume: the frame, the limits, the statistics to record and a monitor.
///
/// The film records the statistics that the sampler needs and those of [`Render::needs`]. An error limit adds halves.
/// Tracing uses the current rayon thread pool.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// #     fn capacity(&self) -> u64 { u64::MAX }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Control, Draws, Estimate, Frame, Integrator, Limits, Needs, Render, Status, TrainingLog};
///
/// struct Ramp;
/// impl Integrator for Ramp {
///     fn estimate(&self, draws: &Draws<'_>, _: &mut TrainingLog) -> Estimate {
///         Estimate::new([draws.pixel()[0] as f32; 3])
///     }
/// }
///
/// let frame = Frame::new(16, 9)?;
/// let mut slices = 0;
/// let mut progress = |_: &Status<'_>| {
///     slices += 1;
///     Control::Continue
/// };
/// let film = Render::new(frame, &Limits::samples(8 * 16 * 9))
///     .needs(Needs::none().with_variance())
///     .monitor(&mut progress)
///     .run(&mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(film.record().samples, 8 * 16 * 9);
/// assert_eq!(film.moments(3).variance(), Some([0.0; 3]));
/// assert!(slices > 0);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[must_use = "nothing is rendered before `run` or `resume`"]
pub struct Render<'a> {
    frame: Frame,
    limits: &'a Limits,
    needs: Needs,
    monitor: Option<&'a mut dyn Monitor>,
    filter: Option<&'a dyn Filter>,
}

impl<'a> Render<'a> {
    /// A render of `frame` within `limits`, without a monitor.
    pub fn new(frame: Frame, limits: &'a Limits) -> Self {
        Self { frame, limits, needs: Needs::none(), monitor: None, filter: None }
    }

    /// Adds statistics that the film must record besides counts and means.
    pub fn needs(mut self, needs: Needs) -> Self {
        self.needs = self.needs.and(needs);
        self
    }

    /// Sets the monitor that is called between slices of tracing (about 0.2 seconds each).
    pub fn monitor(mut self, monitor: &'a mut dyn Monitor) -> Self {
        self.monitor = Some(monitor);
        self
    }

    /// Makes an error limit concern the image of this filter instead of the unfiltered one. The film records what the
    /// filter needs. Without an error limit, nothing changes.
    ///
    /// At the end of each budget, the film is filtered. The next samples, which that image has not seen, then measure its
    /// error and correct the filter's own estimate, [`Filtered::error`](crate::Filtered::error).
    /// [`Record::filtered_relmse`](crate::Record::filtered_relmse) holds the last prediction. A filter that has no
    /// estimate leaves the limit with the unfiltered image.
    ///
    /// # Precision
    ///
    /// `docs/results/predicted-error.md` compares predicted with true errors.
    pub fn error_of(mut self, filter: &'a dyn Filter) -> Self {
        self.filter = Some(filter);
        self
    }

    /// Renders until the limits are met, and returns the film. Each round is planned by `sampler` and traced with
    /// `integrator`, which learns from training passes.
    ///
    /// # Errors
    ///
    /// For limits that are invalid or that the sampler cannot meet, an invalid plan, and an exhausted point set. Also
    /// for an invalid sample under [`InvalidSample::Fail`](crate::InvalidSample), and a panic of the integrator;
    /// [`Error::Panicked`] carries the samples finished before.
    pub fn run(self, integrator: &mut dyn Integrator, sampler: &mut dyn Sampler) -> Result<Film, Error> {
        let meter = Meter::new(self.limits, &self.frame)?;
        let needs = self.all_needs(sampler, &meter);
        let film = Film::new(self.frame, needs);
        let state = State { film, round: 0, open: None, passes: Vec::new(), holdout: None };
        self.drive(state, Clock::start(0.0), meter, integrator, sampler)
    }

    /// Resumes a render from a [`Snapshot`]. The film has the bits of an uninterrupted render, on any number of
    /// threads. That requires the same frame, and a sampler and an integrator made with the same options.
    ///
    /// The budget may differ: a larger one continues the render, and a time limit includes the seconds before the
    /// snapshot. All statistics in [`Render::needs`] must have been recorded from the start. The caller must pass the
    /// same integrator (scene, depth, …); this is not checked.
    ///
    /// # Errors
    ///
    /// The errors of [`Render::run`]. [`Error::OtherRender`] if sampler, points, frame, bounds of counts or needs
    /// differ, or if more samples are already planned than the budget allows. [`Error::BadSnapshot`] for inconsistent
    /// bytes.
    pub fn resume(
        self,
        snapshot: Snapshot,
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Film, Error> {
        let mut meter = Meter::new(self.limits, &self.frame)?;
        let needs = self.all_needs(sampler, &meter);
        snapshot.check(sampler, &needs, &self.frame, self.limits)?;
        let Snapshot { film, round, open, passes, total, seconds, sampler_state, holdout, .. } = snapshot;
        let planned = open.as_ref().map_or(film.record.samples, |open| open.before + open.plan.total());
        meter.restore(&film, total, planned)?;
        sampler.restore(&sampler_state)?;
        if let Some(open) = &open {
            let rest = open.rest(self.frame.size()[0] as usize);
            if rest.total() > 0 {
                check(&rest, &film, sampler, &meter.left(&film))?;
            }
        }
        passes.iter().for_each(|pass| integrator.learn(pass));
        self.drive(State { film, round, open, passes, holdout }, Clock::start(seconds), meter, integrator, sampler)
    }

    /// The statistics that sampler, limits, an error limit's filter and the caller need.
    fn all_needs(&self, sampler: &dyn Sampler, meter: &Meter) -> Needs {
        let needs = self.needs.and(sampler.needs()).and(meter.needs());
        match self.filter {
            Some(filter) if meter.goal().is_some() => needs.and(filter.needs()),
            _ => needs,
        }
    }

    fn drive(
        self,
        mut state: State,
        mut clock: Clock,
        mut meter: Meter,
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Film, Error> {
        let limits = self.limits;
        let mut filter = self.filter;
        let mut unwatched = NoMonitor;
        let monitor = self.monitor.unwrap_or(&mut unwatched);
        loop {
            let open = match state.open.take() {
                Some(open) => Some(open),
                None => plan(&mut state, &mut meter, &mut filter, sampler, &clock)?,
            };
            let total = meter.left(&state.film).total;
            let limit = meter.seconds();
            let mut context = MonitorContext {
                monitor: &mut *monitor,
                clock: &mut clock,
                round: state.round,
                expected: total,
                limit,
                sampler: &*sampler,
                limits,
            };
            let Some(mut open) = open else {
                // A resumed render plans this round again.
                let shown = state.film.record.budgets.pop();
                context.end(&state);
                state.film.record.budgets.extend(shown);
                break;
            };
            let tracing = context.clock.seconds() - open.traced_seconds;
            let stopped = round::trace(integrator, &mut state, &mut open, tracing, &mut context)?;
            let film = &mut state.film;
            film.record.rounds.push(RoundRecord {
                samples: film.record.samples - open.before,
                kept: open.plan.retention == Retention::Keep,
                plan_seconds: open.plan_seconds,
                trace_seconds: clock.seconds() - tracing,
            });
            match stopped {
                Stopped::No => state.round += 1,
                Stopped::Within => {
                    film.record.interrupted = true;
                    break;
                }
                Stopped::AtEnd => {
                    let spent = film.record.samples >= total;
                    let predicted = predict(&mut state, &meter, &mut filter)?;
                    let more = meter.extend(&state.film, clock.seconds(), predicted);
                    state.film.record.interrupted = !spent || more;
                    break;
                }
            }
        }
        Ok(state.film)
    }
}

/// The state of a render between slices.
struct State {
    film: Film,
    round: u32,
    /// The round being traced, if any; the next one is planned after it.
    open: Option<OpenRound>,
    /// The data of all training passes so far, to replay on resuming.
    passes: Vec<TrainingData>,
    /// The filtered image of the last prediction, if an error limit concerns a filtered image.
    holdout: Option<Holdout>,
}

/// Requests the plan of the next round from the sampler; `None` at the end of the render.
fn plan(
    state: &mut State,
    meter: &mut Meter,
    filter: &mut Option<&dyn Filter>,
    sampler: &mut dyn Sampler,
    clock: &Clock,
) -> Result<Option<OpenRound>, Error> {
    let planning = clock.seconds();
    loop {
        let State { film, round, .. } = state;
        let budget = meter.show(film, *round, clock.seconds());
        film.record.budgets.push(budget.total);
        let mut plan = Plan::empty(film.frame.pixels());
        let progress = sampler.next_round(&crate::Feedback { round: *round, film, budget }, &mut plan)?;
        let plan_seconds = clock.seconds() - planning;
        if progress == Progress::Trace {
            check(&plan, film, sampler, &budget)?;
            return Ok(Some(begin(plan, film, plan_seconds)));
        }
        let predicted = predict(state, meter, filter)?;
        if !meter.extend(&state.film, clock.seconds(), predicted) {
            // The time of the last prediction belongs to the last round.
            if let Some(last) = state.film.record.rounds.last_mut() {
                last.plan_seconds += clock.seconds() - planning;
            }
            return Ok(None);
        }
    }
}

/// Predicts the error that an error limit concerns; `None` without such a limit. Clears a filter without an estimate.
fn predict(state: &mut State, meter: &Meter, filter: &mut Option<&dyn Filter>) -> Result<Option<Prediction>, Error> {
    if meter.goal().is_none() {
        return Ok(None);
    }
    if let Some(by) = *filter {
        state.holdout = Holdout::next(state.holdout.take(), &state.film, by)?;
        if let Some(holdout) = &state.holdout {
            let prediction = holdout.prediction();
            state.film.record.filtered_relmse = Some(prediction.relmse);
            return Ok(Some(prediction));
        }
        *filter = None;
    }
    Ok(Some(Prediction::unfiltered(&state.film)))
}

/// Applies a plan's withdrawals and discarding to the film, and returns the round to trace.
fn begin(plan: Plan, film: &mut Film, plan_seconds: f64) -> OpenRound {
    if plan.retention == Retention::Discard {
        film.open_discarded();
    }
    if let Some(withdrawn) = &plan.withdraw {
        film.withdraw(withdrawn);
    }
    film.combine = plan.combine;
    let (cursor, before) = (Cursor::default(), film.record.samples);
    OpenRound { plan, cursor, pending: Vec::new(), before, plan_seconds, traced_seconds: 0.0 }
}

/// A stopwatch for wall time that leaves out the time in the monitor.
struct Clock {
    start: Instant,
    away: f64,
}

impl Clock {
    /// Starts a stopwatch that shows `seconds` now.
    fn start(seconds: f64) -> Self {
        Self { start: Instant::now(), away: -seconds }
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64() - self.away
    }
}

/// The monitor with the parts of [`Status`] that stay constant during a round.
struct MonitorContext<'a> {
    monitor: &'a mut dyn Monitor,
    clock: &'a mut Clock,
    round: u32,
    expected: u64,
    limit: Option<f64>,
    sampler: &'a dyn Sampler,
    limits: &'a Limits,
}

impl MonitorContext<'_> {
    fn seconds(&self) -> f64 {
        self.clock.seconds()
    }

    /// Calls the monitor between two slices.
    fn slice(&mut self, state: &State, open: &OpenRound) -> Control {
        self.show(state, Some(open), |monitor, status| monitor.slice(status))
    }

    fn end(&mut self, state: &State) {
        self.show(state, None, |monitor, status| monitor.end(status));
    }

    fn show<T>(
        &mut self,
        state: &State,
        open: Option<&OpenRound>,
        show: impl FnOnce(&mut dyn Monitor, &Status<'_>) -> T,
    ) -> T {
        let seconds = self.clock.seconds();
        let Self { round, expected: total, sampler, limits, .. } = *self;
        let State { film, passes, holdout, .. } = state;
        let status = Status {
            film,
            round,
            samples: film.record.samples,
            expected: total,
            seconds,
            seconds_limit: self.limit,
            view: View { film, round, open, passes, holdout: holdout.as_ref(), total, seconds, sampler, limits },
        };
        let answer = show(self.monitor, &status);
        self.clock.away += self.clock.seconds() - seconds;
        answer
    }
}

/// Checks that a plan is valid, and that the point set has enough samples.
fn check(plan: &Plan, film: &Film, sampler: &dyn Sampler, budget: &crate::BudgetLeft) -> Result<(), Error> {
    let bad = |what: String| Err(Error::BadPlan { sampler: sampler.describe(), what });
    let pixels = film.frame.pixels();
    let second = plan.second_half.as_deref();
    if plan.counts.len() != pixels || second.is_some_and(|s| s.len() != pixels) {
        return bad(format!("it has {} counts for {pixels} pixels", plan.counts.len()));
    }
    if second.is_some() && film.kept.len() != 2 {
        return bad("it has a second half, but needs() has no halves".into());
    }
    match plan.total() {
        0 => return bad("it has no samples".into()),
        total if total > budget.left() => {
            return bad(format!("it has {total} samples, but {} are left", budget.left()));
        }
        _ => {}
    }
    let kept = plan.retention == Retention::Keep;
    let withdraw = plan.withdraw.as_deref();
    if withdraw.is_some_and(|w| w.len() != pixels || !kept) {
        return bad("it withdraws samples without a mark for each pixel, or in a round that is not kept".into());
    }
    let banks = if kept { &film.kept } else { &film.discarded };
    let mut deepest = 0;
    for i in 0..pixels {
        let (first, others) = (u64::from(plan.counts[i]), second.map(|s| u64::from(s[i])));
        let more = first + others.unwrap_or(0);
        let withdrawn = withdraw.is_some_and(|w| w[i]);
        if withdrawn && more == 0 {
            return bad("it withdraws all samples of a pixel and traces none".into());
        }
        let before = if withdrawn { 0 } else { film.count(i) };
        if kept && more > 0 && before + more > u64::from(budget.max_spp) {
            return bad(format!("a pixel gets {} samples, above max_spp = {}", before + more, budget.max_spp));
        }
        let more = match others {
            Some(others) => Planned::Halves(first, others),
            None if film.kept.len() == 2 => Planned::Alternating(first),
            None => Planned::Whole(first),
        };
        deepest = deepest.max(used_after(banks, i, more, withdrawn));
    }
    let points = sampler.points();
    if deepest > points.capacity() {
        let (points, capacity) = (points.describe(), points.capacity());
        return Err(Error::SequenceExhausted { points, capacity, requested: deepest });
    }
    Ok(())
}

/// The number of additional samples of a pixel in a round, by half.
enum Planned {
    Whole(u64),
    Alternating(u64),
    Halves(u64, u64),
}

/// The number of points that pixel `i` will have used after `more` samples beyond those in `banks`: the larger number
/// of its two streams (point sequences).
fn used_after(banks: &[Bank], i: usize, more: Planned, withdrawn: bool) -> u64 {
    let used = |half: usize| banks.get(half).map_or(0, |b| b.next_index(i));
    let counted = |half: usize| banks.get(half).filter(|_| !withdrawn).map_or(0, |b| b.counts[i]);
    let [first, second] = match more {
        Planned::Whole(n) => [n, 0],
        Planned::Halves(a, b) => [a, b],
        Planned::Alternating(n) => {
            // Samples go to the half with fewer of them until both are level.
            let (a, b) = (counted(0), counted(1));
            let first = (a + b + n).div_ceil(2).clamp(a, a + n) - a;
            [first, n - first]
        }
    };
    (used(0) + first).max(used(1) + second)
}
