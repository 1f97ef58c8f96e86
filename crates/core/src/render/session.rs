//! The engine of a render: rounds that a sampler plans and the caller traces.

use super::budget;
use super::budget::{Meter, Stopwatch};
use super::filtered_error::{FilteredError, Prediction};
use super::methods::Methods;
use super::monitor::{Control, Monitor, Status};
use super::plan::{begin, check};
use super::pull::Round;
use super::repeats::Repeats;
use super::state::{OpenRound, State, Stopped};
use crate::film::RoundRecord;
use crate::filter::filled;
use crate::plan::{Feedback, Plan, Progress, Retention};
use crate::snapshot::{Planner, View};
use crate::{Clock, Error, Film, Filter, Filtered, Frame, Integrator, Limits, Needs, Sampler, Snapshot, Unfiltered};

/// A render whose loop belongs to the caller. The caller requests rounds, traces their samples in any way, and submits the
/// results.
///
/// A session starts no threads and needs no integrator. For any order of results, the image is bit-identical to that of a
/// [`Render`](crate::Render).
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Golden;
/// # impl PointSet for Golden {
/// #     fn describe(&self) -> String { "golden".into() }
/// #     fn block(&self, id: SampleId, _: u32) -> [f32; 4] { [(id.index as f32 * 0.618_034).fract(); 4] }
/// #     fn capacity(&self) -> u64 { 1 << 20 }
/// # }
/// # let points = Golden;
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Frame, Limits, Rng, Session};
///
/// /// Somebody's renderer: half of each pixel is lit.
/// fn radiance(pixel: [u32; 2], rng: &mut Rng<'_>) -> [f32; 3] {
///     if rng.next_f32() < 0.5 { [1.0; 3] } else { [0.0; 3] }
/// }
///
/// let mut session = Session::new(Frame::new(64, 48)?, Limits::spp(16.0), Uniform::new(points))?;
/// while let Some(round) = session.next_round()? {
///     std::thread::scope(|threads| {
///         for _ in 0..2 {
///             threads.spawn(|| {
///                 while let Some(mut tile) = round.next_tile() {
///                     for sample in tile.samples() {
///                         tile.add(&sample, radiance(sample.pixel(), &mut sample.rng()));
///                     }
///                     round.submit(tile).expect("each sample is added once");
///                 }
///             });
///         }
///     });
/// }
/// let image = session.finish()?;
/// assert!(image.radiance.iter().all(|rgb| (rgb[0] - 0.5).abs() < 0.1));
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// The host's loop makes intermediate images and checkpoints between rounds, which end at every doubling of the samples.
/// [`Round::image`] and [`Round::snapshot`] make them within a round, for previews every few seconds.
///
/// ```
/// # use dapple_core::{PointSet, SampleId, samplers::Uniform, Frame, Limits, Methods, Session, Snapshot};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// # let mut session = Session::new(Frame::new(8, 4)?, Limits::spp(16.0), Uniform::new(Centre))?;
/// # let (mut shown, mut saved) = (Vec::new(), Vec::new());
/// while let Some(round) = session.next_round()? {
///     round.trace(|sample| [sample.pixel()[0] as f32; 3])?;
///     drop(round);
///     shown.push(session.image()?); // after 1, 2, 4, ... samples per pixel
///     saved = session.snapshot(); // the bytes of a checkpoint
/// }
/// # assert_eq!(shown.len(), 5);
/// # assert!(Snapshot::from_bytes(&saved).is_ok());
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// # Guarantees
///
/// * The first round has one sample in each pixel that gets any. A later round has at most as many samples as all rounds
///   before it; under a time limit, at most a quarter of the remaining samples. So [`Session::image`] is available early,
///   and then at every doubling.
/// * [`Session::image`], [`Round::image`] and snapshots do not change the result.
/// * Only submitted tiles count. A tile that is lost or dropped is handed out again.
/// * Sample counts add up to the budget exactly, as in [`Render`](crate::Render).
/// * All computations run in the caller's rayon pool: `pool.install(|| session.finish())`.
/// * [`Session::snapshot`] and [`Round::snapshot`] save the state; [`Session::resume`] continues from it, bit-identically.
///
/// # Limits
///
/// * There are no training passes; a renderer that learns organises its own.
pub struct Session<'a> {
    pub(super) state: State,
    pub(super) limits: Limits,
    pub(super) sampler: Box<dyn Sampler + 'a>,
    pub(super) filter: Option<Box<dyn Filter + 'a>>,
    /// True while an error limit applies to the filtered image.
    pub(super) judged: bool,
    pub(super) meter: Meter,
    pub(super) clock: Stopwatch,
    /// The reading of the clock at which the open round would have begun without interruption.
    pub(super) began: f64,
    /// True when no round is left.
    pub(super) over: bool,
    /// The number of samples that were left in the open round when it was last handed out.
    given_out: Option<u64>,
    tile_side: u32,
}

impl<'a> Session<'a> {
    /// A session for `frame` within `limits`. `methods` is a sampler, a pair of sampler and filter, or [`Methods`].
    ///
    /// The film records what sampler and filter need. An error limit applies to the filtered image.
    ///
    /// # Errors
    ///
    /// For invalid limits.
    pub fn new(frame: Frame, limits: Limits, methods: impl Into<Methods<'a>>) -> Result<Self, Error> {
        Self::of_render(frame, &limits, methods.into().with_filter_needs(), None)
    }

    /// Continues a session or a [`Render`](crate::Render) from its snapshot, under the conditions of
    /// [`Render::resume`](crate::Render::resume).
    ///
    /// # Errors
    ///
    /// The errors of [`Render::resume`](crate::Render::resume).
    pub fn resume(
        frame: Frame,
        limits: Limits,
        methods: impl Into<Methods<'a>>,
        snapshot: Snapshot,
    ) -> Result<Self, Error> {
        Self::of_render(frame, &limits, methods.into().with_filter_needs(), Some(snapshot.of_window()?))
    }

    /// Makes the session of a new or resumed render. The film records what `methods`, the limits and the filter of an error
    /// limit need.
    pub(super) fn of_render(
        frame: Frame,
        limits: &Limits,
        methods: Methods<'a>,
        snapshot: Option<Snapshot>,
    ) -> Result<Self, Error> {
        let Methods { mut sampler, filter, needs, mut recorders } = methods;
        let mut meter = Meter::new(limits, &frame)?;
        let judged = filter.is_some() && meter.goal().is_some();
        let mut needs = needs.and(sampler.needs()).and(meter.needs());
        recorders.extend(sampler.recorders());
        if let Some(filter) = filter.as_ref().filter(|_| judged) {
            needs = needs.and(filter.needs());
            recorders.extend(filter.recorders());
        }
        let (state, seconds) = match snapshot {
            None => {
                let (film, passes) = (Film::with_recorders(frame, needs, recorders), Vec::new());
                let (filtered_error, repeats) = (None, Repeats::default());
                (
                    State { film, round: 0, open: None, passes, filtered_error, prepared: None, stage: None, repeats },
                    0.0,
                )
            }
            Some(mut snapshot) => {
                snapshot.state.film.resume_recorders(recorders)?;
                continued(snapshot, &mut *sampler, &mut meter, (&needs, limits), &frame)?
            }
        };
        // Only a time limit reads the clock, unless the caller sets one.
        let clock = if meter.seconds().is_some() { Clock::of_machine() } else { Clock::none() };
        let (clock, limits) = (Stopwatch::start(clock, seconds), limits.clone());
        let (began, over, given_out, tile_side) = (0.0, false, None, 32);
        Ok(Self { state, limits, sampler, filter, judged, meter, clock, began, over, given_out, tile_side })
    }

    /// Plans the next round, or returns the open one if only a part of it was submitted; `None` when the limits are met.
    ///
    /// # Errors
    ///
    /// [`Error::NothingSubmitted`] if no tile of the last round was submitted. Also for limits that the sampler cannot
    /// meet, an invalid plan, and an exhausted point set. [`Error::NoneReported`] if the filter reads features and no
    /// sample of the first round reports a hit or a miss.
    pub fn next_round(&mut self) -> Result<Option<Round<'_>>, Error> {
        if let Some(open) = &mut self.state.open {
            open.keep_rest(self.state.film.frame.size()[0] as usize);
            if self.given_out.is_some() {
                open.traced_seconds = self.clock.seconds() - self.began;
            }
            match open.plan.total() {
                0 => self.finish_part()?,
                left if self.given_out == Some(left) => return Err(Error::NothingSubmitted { left }),
                _ => {}
            }
        }
        if let Some(pixels) = self.state.repeats.found() {
            return Err(Error::RepeatedNumbers { pixels });
        }
        if self.over || !self.open()? {
            self.over = true;
            return Ok(None);
        }
        let is_timed = self.meter.seconds().is_some();
        let (film, open) = (&self.state.film, &mut self.state.open);
        self.given_out = open.as_mut().map(|open| {
            if open.later.is_none() {
                open.split(part_of(open, film.record.samples, is_timed));
            }
            open.plan.total()
        });
        let Self { state, limits, sampler, filter, meter, clock, tile_side, .. } = self;
        let (total, features) = (meter.left(&state.film).total, meter.features(state.round));
        let filter: &dyn Filter = filter.as_deref().unwrap_or(&Unfiltered);
        Ok(Some(Round::new(state, (&**sampler, filter), limits, clock, (total, *tile_side, features))))
    }

    /// Ends a part of the open round; the last part ends the round. Fails if the filter reads first hits and no sample
    /// reports a hit or a miss.
    fn finish_part(&mut self) -> Result<(), Error> {
        self.given_out = None;
        match &mut self.state.open {
            Some(open) if open.later.is_some() => open.join(),
            _ => _ = self.close(Stopped::No)?,
        }
        let Some(filter) = &self.filter else { return Ok(()) };
        self.state.film.require(filter.name(), &filter.needs())
    }

    /// Sets the side, in pixels, of the square tiles that [`Round::next_tile`] hands out; 32 by default, at least 1.
    #[must_use]
    pub fn with_tile_side(self, side: u32) -> Self {
        Self { tile_side: side.max(1), ..self }
    }

    /// Sets the clock for [`Limits::seconds`], and for the seconds in the film's [`Record`](crate::film::Record). By
    /// default, a time limit uses [`Clock::of_machine`]. Other limits use no clock, and the record's seconds are 0.
    #[must_use]
    pub fn with_clock(self, clock: Clock) -> Self {
        Self { clock: Stopwatch::start(clock, self.clock.seconds()), ..self }
    }

    /// The film so far: per-pixel statistics of the samples submitted.
    pub fn film(&self) -> &Film {
        &self.state.film
    }

    /// The image of the samples submitted so far, filtered if the session has a filter. A pixel without samples, or whose
    /// samples [were all rejected](Film::is_rejected), is filled from the nearest pixel with valid samples. During a round,
    /// use [`Round::image`].
    ///
    /// # Errors
    ///
    /// The errors of [`Filter::apply`].
    pub fn image(&self) -> Result<Filtered, Error> {
        filled(self.filter.as_deref().unwrap_or(&Unfiltered), &self.state.film)
    }

    /// Traces all rounds with `trace` and returns the image: [`Session::next_round`] until the limits are met, then
    /// [`Session::finish`]. With [`Limits::open`], it does not return.
    ///
    /// # Errors
    ///
    /// The errors of `trace`, [`Session::next_round`] and [`Session::finish`].
    pub fn run(mut self, mut trace: impl FnMut(&Round<'_>) -> Result<(), Error>) -> Result<Filtered, Error> {
        while let Some(round) = self.next_round()? {
            trace(&round)?;
        }
        self.finish()
    }

    /// Ends the session and returns its image. If the limits are not met yet, this is the image of the samples so far.
    ///
    /// # Errors
    ///
    /// The errors of [`Filter::apply`].
    pub fn finish(self) -> Result<Filtered, Error> {
        self.image()
    }

    /// Ends the session and returns its film, marked as interrupted if the limits are not met yet.
    pub fn into_film(mut self) -> Film {
        self.state.film.record.interrupted |= !self.over;
        self.state.film
    }

    /// The state of the session as bytes for [`Snapshot::from_bytes`]. At the end of the render, the snapshot lacks the last
    /// element of [`Record::budgets`](crate::film::Record::budgets), which a resumed session adds again.
    pub fn snapshot(&mut self) -> Vec<u8> {
        let shown = if self.over { self.state.film.record.budgets.pop() } else { None };
        let bytes = self.view(self.clock.seconds()).write();
        self.state.film.record.budgets.extend(shown);
        bytes
    }

    /// The content of a snapshot.
    pub(super) fn view(&self, seconds: f64) -> View<'_> {
        let (state, sampler) = (&self.state, Planner::Sampler(&*self.sampler));
        let (bounds, total) = ([self.limits.min_spp, self.limits.max_spp], self.meter.left(&state.film).total);
        View { state, sampler, bounds, total, seconds }
    }

    /// Calls [`Integrator::learn`] with each training pass so far, in order.
    pub fn teach(&self, integrator: &mut dyn Integrator) {
        self.state.passes.iter().for_each(|pass| integrator.learn(pass));
    }

    /// Plans the next round, unless one is open already. Returns `false` at the end of the render.
    pub(super) fn open(&mut self) -> Result<bool, Error> {
        if self.state.open.is_none() {
            self.state.open = self.plan()?;
        }
        match &self.state.open {
            Some(open) => self.began = self.clock.seconds() - open.traced_seconds,
            None => self.over = true,
        }
        Ok(!self.over)
    }

    /// Closes the open round after it was traced or stopped. Returns `true` if the render ends here because it was stopped.
    pub(super) fn close(&mut self, stopped: Stopped) -> Result<bool, Error> {
        let Some(open) = self.state.open.take() else { return Ok(true) };
        let (film, trace_seconds) = (&mut self.state.film, self.clock.seconds() - self.began);
        let (samples, kept) = (film.record.samples - open.before, open.plan.retention == Retention::Keep);
        film.record.rounds.push(RoundRecord { samples, kept, plan_seconds: open.plan_seconds, trace_seconds });
        if stopped == Stopped::Within {
            return Ok(true);
        }
        self.state.round += 1;
        if stopped == Stopped::AtEnd {
            let film = &self.state.film;
            let spent = film.record.samples >= self.meter.left(film).total;
            self.reserve_for_filter()?;
            let predicted = self.predict()?;
            let more = self.meter.extend(&self.state.film, self.clock.seconds(), predicted);
            self.over = spent && !more;
        }
        Ok(stopped == Stopped::AtEnd)
    }

    /// Calls the monitor between two slices. The monitor's time does not count as time of the render.
    fn show<T>(&mut self, monitor: &mut dyn Monitor, show: impl FnOnce(&mut dyn Monitor, &Status<'_>) -> T) -> T {
        let seconds = self.clock.seconds();
        let view = self.view(seconds);
        let status = Status {
            film: &view.state.film,
            round: view.state.round,
            samples: view.state.film.record.samples,
            expected: view.total,
            seconds,
            seconds_limit: self.meter.seconds(),
            filter_seconds: self.meter.filter_seconds,
            view,
        };
        let answer = show(monitor, &status);
        self.clock.leave_out_since(seconds);
        answer
    }

    /// Passes the state of the session to [`Monitor::progress`], and returns the monitor's decision.
    pub fn show_to(&mut self, monitor: &mut dyn Monitor) -> Control {
        self.show(monitor, |monitor, status| monitor.progress(status))
    }

    /// Passes the final state of the render to [`Monitor::end`], without the last element of
    /// [`Record::budgets`](crate::film::Record::budgets), which a resumed render adds again.
    pub fn show_end_to(&mut self, monitor: &mut dyn Monitor) {
        let shown = self.state.film.record.budgets.pop();
        self.show(monitor, |monitor, status| monitor.end(status));
        self.state.film.record.budgets.extend(shown);
    }
}

impl Session<'_> {
    /// Requests the plan of the next round from the sampler; `None` at the end of the render.
    pub(super) fn plan(&mut self) -> Result<Option<OpenRound>, Error> {
        if self.meter.seconds().is_some() && !self.clock.clock.runs() {
            return Err(Error::NoClock);
        }
        self.reserve_for_filter()?;
        let planning = self.clock.seconds();
        loop {
            let seconds = self.clock.seconds();
            let State { film, round, .. } = &mut self.state;
            let budget = self.meter.show(film, *round, seconds);
            film.record.budgets.push(budget.total);
            let mut plan = Plan::empty(film.frame.pixels());
            let seen = Feedback { round: *round, film, budget };
            if self.sampler.next_round(&seen, &mut plan)? == Progress::Trace {
                check(&plan, film, &*self.sampler, &budget)?;
                return Ok(Some(begin(plan, film, self.clock.seconds() - planning)));
            }
            let predicted = self.predict()?;
            if !self.meter.extend(&self.state.film, self.clock.seconds(), predicted) {
                // The time of the last prediction belongs to the last round.
                if let Some(last) = self.state.film.record.rounds.last_mut() {
                    last.plan_seconds += self.clock.seconds() - planning;
                }
                return Ok(None);
            }
        }
    }

    /// Reserves a part of a time limit for the filter, measured after the first round.
    pub(super) fn reserve_for_filter(&mut self) -> Result<(), Error> {
        let film = &self.state.film;
        let Some(limit) = self.meter.seconds().filter(|_| film.record.samples > 0) else { return Ok(()) };
        if self.meter.filter_seconds.is_some() {
            return Ok(());
        }
        let mut seconds = 0.0;
        if let Some(filter) = &self.filter {
            let part = film.of_rows(budget::timed_rows(&film.frame))?;
            let measured = budget::time_of(filter, &part, film.frame.size()[1], &self.clock.clock);
            let spp = film.record.samples as f64 / film.frame.pixels() as f64;
            let traced: f64 = film.record.rounds.iter().map(|round| round.trace_seconds).sum();
            seconds = measured * budget::growth(filter, &film.needs, spp, limit / traced);
        }
        self.meter.filter_seconds = Some(seconds);
        Ok(())
    }

    /// Predicts the error of the image that an error limit applies to; `None` without such a limit. If the filter has no
    /// error estimate, the limit applies to the unfiltered image.
    pub(super) fn predict(&mut self) -> Result<Option<Prediction>, Error> {
        if self.meter.goal().is_none() {
            return Ok(None);
        }
        let State { film, filtered_error, .. } = &mut self.state;
        if let Some(filter) = self.filter.as_ref().filter(|_| self.judged) {
            *filtered_error = FilteredError::next(filtered_error.take(), film, filter)?;
            if let Some(filtered_error) = filtered_error {
                let prediction = filtered_error.prediction;
                film.record.filtered_relmse = Some(prediction.relmse);
                return Ok(Some(prediction));
            }
            self.judged = false;
        }
        Ok(Some(Prediction::unfiltered(film)))
    }
}

/// The divisor of a round's remaining samples that limits its next part under a time limit.
const TIMED: u64 = 4;

/// The samples per pixel of the next part of a round, after `traced` samples. A part has at most as many samples as were
/// traced before; the first part has one sample per pixel.
fn part_of(open: &OpenRound, traced: u64, is_timed: bool) -> u32 {
    let most = if is_timed { traced.min(open.plan.total() / TIMED) } else { traced };
    let (mut depth, mut above) = (1, open.longest() + 1);
    while above - depth > 1 {
        let middle = depth + (above - depth) / 2;
        *(if open.before(middle) <= most { &mut depth } else { &mut above }) = middle;
    }
    depth
}

/// The state of a snapshot and the seconds before it, checked against the render that continues it.
fn continued(
    snapshot: Snapshot,
    sampler: &mut dyn Sampler,
    meter: &mut Meter,
    (needs, limits): (&Needs, &Limits),
    frame: &Frame,
) -> Result<(State, f64), Error> {
    snapshot.restore_sampler(sampler, needs, frame, limits)?;
    let Snapshot { state, total, seconds, .. } = snapshot;
    let (film, open) = (&state.film, state.open.as_ref());
    let planned = open.map_or(film.record.samples, |open| open.before + open.submitted + open.plan.total());
    meter.restore(total, planned)?;
    // The rows of a stage were checked where they were planned.
    if let Some(open) = open.filter(|_| state.stage.is_none()) {
        let rest = open.rest(frame.size()[0] as usize);
        if rest.total() > 0 {
            check(&rest, film, sampler, &meter.left(film))?;
        }
    }
    Ok((state, seconds))
}
