//! The engine of a render: rounds planned by a sampler, traced by whoever asks for them.

use super::budget::Meter;
use super::check::check;
use super::clock::Clock;
use super::halos::held_at_first;
use super::holdout::Holdout;
use super::methods::Methods;
use super::pull::Round;
use super::round::{Stopped, failed};
use super::team::Team;
use super::{Monitor, NoMonitor};
use crate::exchange::message::Standing;
use crate::snapshot::film::put_bands;
use crate::snapshot::{OpenRound, Planner, View};
use crate::{
    Budget, Error, Film, Filter, Filtered, Frame, Limits, Needs, Retention, RoundRecord, Sampler, Shard, Snapshot,
    TrainingData, Unfiltered,
};

/// The state of a render between slices.
pub(super) struct State {
    pub(super) film: Film,
    pub(super) round: u32,
    /// The round being traced, if any; the next one is planned after it.
    pub(super) open: Option<OpenRound>,
    /// The data of all training passes so far, to replay on resuming.
    pub(super) passes: Vec<TrainingData>,
    /// The filtered image of the last prediction, if an error limit concerns a filtered image.
    pub(super) holdout: Option<Holdout>,
    /// The number of the pass that the integrator is prepared for; `None` before the first and after a resumption.
    pub(super) prepared: Option<u32>,
}

/// A render whose loop belongs to the caller: it asks for rounds, traces their samples where and how it likes, and gives
/// the results back.
///
/// It is the engine of [`Render`](crate::Render), without threads and integrator. The image has the same bits as that of
/// `Render`, in whatever order samples come back.
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
/// # Guarantees
///
/// * A round counts only what is submitted. A tile that is lost or dropped is traced again by whoever asks for it.
/// * Sample counts add up to the budget exactly, as in [`Render`](crate::Render).
/// * [`Session::snapshot`] and [`Round::snapshot`] save the state; [`Session::resume`] continues with the same bits.
///
/// # Limits
///
/// * There are no training passes: a renderer that learns does so by itself.
pub struct Session<'a> {
    pub(super) state: State,
    pub(super) limits: Limits,
    pub(super) sampler: Box<dyn Sampler + 'a>,
    pub(super) filter: Option<Box<dyn Filter + 'a>>,
    /// True while an error limit concerns the image of `filter`.
    pub(super) judged: bool,
    pub(super) meter: Meter,
    pub(super) clock: Clock,
    /// The reading of the clock at which the open round would have begun without interruption.
    began: f64,
    /// True when no round is left.
    over: bool,
    /// The samples that were left in the open round when it was last given out.
    given_out: Option<u64>,
    /// The samples of all processes of the render, estimated while they trace a round.
    pub(super) everyones: Option<u64>,
    /// Training passes to learn from instead of this render's own.
    pub(super) training: Vec<TrainingData>,
    tile_side: u32,
}

impl<'a> Session<'a> {
    /// A session for `frame` within `limits`: with a sampler, a pair of sampler and filter, or [`Methods`].
    ///
    /// The film records what both need. An error limit concerns the filter's image.
    ///
    /// # Errors
    ///
    /// For invalid limits.
    pub fn new(frame: Frame, limits: Limits, methods: impl Into<Methods<'a>>) -> Result<Self, Error> {
        let methods = methods.into().with_filter_needs();
        Self::of_render(frame, &limits, methods, None, None)
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
        let methods = methods.into().with_filter_needs();
        Self::of_render(frame, &limits, methods, Some(snapshot), None)?.with_its_rows(None)
    }

    /// The session of a render. It records what the methods ask for, and what sampler, limits and an error limit's filter need.
    /// If a process of several plans its rows, the film holds these and the rows around them.
    pub(super) fn of_render(
        frame: Frame,
        limits: &Limits,
        methods: Methods<'a>,
        snapshot: Option<Snapshot>,
        share: Option<Shard>,
    ) -> Result<Self, Error> {
        let Methods { mut sampler, filter, needs } = methods;
        let mut meter = Meter::new(limits, &frame)?;
        let judged = filter.is_some() && meter.goal().is_some();
        let judge = filter.as_ref().filter(|_| judged).map_or(Needs::none(), |f| f.needs());
        let needs = needs.and(sampler.needs()).and(meter.needs()).and(judge);
        let halo = halo(&*sampler, &meter, &needs);
        let held =
            share.filter(|share| share.of() > 1).zip(halo).map(|(share, halo)| held_at_first(&frame, share, halo));
        let (mut state, seconds) = match snapshot {
            None => {
                let film = Film::of_held(frame, needs, held.clone().unwrap_or_default());
                (State { film, round: 0, open: None, passes: Vec::new(), holdout: None, prepared: None }, 0.0)
            }
            Some(snapshot) => continued(snapshot, &mut *sampler, &mut meter, (&needs, limits), &frame)?,
        };
        if let Some(held) = held.filter(|held| *held != state.film.held) {
            if !state.film.held.has_own_of(&held) {
                return Err(rows_missing());
            }
            state.film.hold(held);
        }
        let (clock, limits) = (Clock::start(seconds), limits.clone());
        let (began, over, given_out, tile_side) = (0.0, false, None, 32);
        let (everyones, training) = (None, Vec::new());
        Ok(Self {
            state,
            limits,
            sampler,
            filter,
            judged,
            meter,
            clock,
            began,
            over,
            given_out,
            everyones,
            training,
            tile_side,
        })
    }

    /// The session if the film has the rows of process `share`. A single process, or one that plans the whole image, needs all.
    pub(super) fn with_its_rows(self, share: Option<Shard>) -> Result<Self, Error> {
        let is_part = share.is_some_and(|share| share.of() > 1) && self.halo().is_some();
        if is_part || self.state.film.is_whole() { Ok(self) } else { Err(rows_missing()) }
    }

    /// Plans the next round, or returns the open one if only a part of it was submitted; `None` when the limits are met.
    ///
    /// # Errors
    ///
    /// [`Error::NothingSubmitted`] if the last round was given out and nothing of it was submitted. For limits that the
    /// sampler cannot meet, an invalid plan, and an exhausted point set. [`Error::NoneReported`] if the filter reads
    /// features and no sample of the first round reports a hit or a miss.
    pub fn next_round(&mut self) -> Result<Option<Round<'_>>, Error> {
        if let Some(open) = &mut self.state.open {
            open.keep_rest(self.state.film.frame.size()[0] as usize);
            match open.plan.total() {
                0 => self.finish_round()?,
                left if self.given_out == Some(left) => return Err(Error::NothingSubmitted { left }),
                _ => {}
            }
        }
        if self.over || !self.open(None)? {
            self.over = true;
            return Ok(None);
        }
        self.given_out = self.state.open.as_ref().map(|open| open.plan.total());
        let Self { state, limits, sampler, meter, clock, tile_side, .. } = self;
        let (total, features) = (meter.left(&state.film).total, meter.features(state.round));
        Ok(Some(Round::new(state, &**sampler, limits, clock, (total, *tile_side, features))))
    }

    /// Ends the open round. Refuses samples that report neither hits nor misses if the filter reads hits.
    fn finish_round(&mut self) -> Result<(), Error> {
        self.given_out = None;
        self.close(Stopped::No, &mut NoMonitor, None)?;
        match &self.filter {
            Some(filter) => self.state.film.require(filter.name(), &filter.needs()),
            None => Ok(()),
        }
    }

    /// Sets the side, in pixels, of the square tiles that [`Round::next_tile`] hands out; 32 by default, at least 1.
    #[must_use]
    pub fn with_tile_side(self, side: u32) -> Self {
        Self { tile_side: side.max(1), ..self }
    }

    /// The film so far: per-pixel statistics of the samples submitted.
    pub fn film(&self) -> &Film {
        &self.state.film
    }

    /// The image of the samples submitted so far, filtered if the session has a filter.
    ///
    /// # Errors
    ///
    /// The errors of [`Filter::apply`].
    pub fn image(&self) -> Result<Filtered, Error> {
        match &self.filter {
            Some(filter) => filter.apply(&self.state.film),
            None => Unfiltered.apply(&self.state.film),
        }
    }

    /// Ends the session and returns its image. Before the limits are met it is the image of the samples so far.
    ///
    /// # Errors
    ///
    /// The errors of [`Filter::apply`].
    pub fn finish(self) -> Result<Filtered, Error> {
        self.image()
    }

    /// Ends the session and returns its film, marked as interrupted before the limits are met.
    pub fn into_film(mut self) -> Film {
        self.state.film.record.interrupted |= !self.over;
        self.state.film
    }

    /// The state of the session as bytes for [`Snapshot::from_bytes`]. A session that continues the end plans the last round
    /// again, so the budget shown for it is left out.
    pub fn snapshot(&mut self) -> Vec<u8> {
        let shown = if self.over { self.state.film.record.budgets.pop() } else { None };
        let bytes = self.view(self.clock.seconds()).write();
        self.state.film.record.budgets.extend(shown);
        bytes
    }

    /// The state of the session as bytes, without the planes of pixels, and these planes for each band of 16 rows.
    pub(super) fn snapshot_in_bands(&mut self) -> (Vec<u8>, Vec<Vec<u8>>) {
        let shown = if self.over { self.state.film.record.budgets.pop() } else { None };
        let film = self.state.film.without_pixels();
        let bytes = View { film: &film, ..self.view(self.clock.seconds()) }.write();
        self.state.film.record.budgets.extend(shown);
        (bytes, put_bands(&self.state.film))
    }

    /// The content of a snapshot.
    pub(super) fn view(&self, seconds: f64) -> View<'_> {
        let State { film, round, open, passes, holdout, .. } = &self.state;
        let (open, holdout) = (open.as_ref(), holdout.as_ref());
        let (total, sampler, limits) = (self.meter.left(film).total, Planner::Sampler(&*self.sampler), &self.limits);
        View { film, round: *round, open, passes, holdout, total, seconds, sampler, limits }
    }

    /// The settings that all processes of a render must share, as pairs of name and value.
    pub(super) fn settings(&self) -> Vec<(String, String)> {
        let State { film, round, passes, .. } = &self.state;
        let ([x, y], [w, h], [full_w, full_h]) = (film.frame.origin(), film.frame.size(), film.frame.resolution());
        // Processes may have spent different times before; the first one's limit counts.
        let budget = match &self.limits.budget {
            Budget::Seconds(_) => "a time".into(),
            given => format!("{given:?}"),
        };
        let pairs = [
            ("version of dapple-core", env!("CARGO_PKG_VERSION").into()),
            ("window", format!("{w}x{h} pixels at {x},{y} of {full_w}x{full_h}")),
            ("sampler", self.sampler.describe()),
            ("point set", self.sampler.points().describe()),
            ("filter of an error limit", self.filter.as_ref().map_or("none".into(), |filter| filter.describe())),
            ("statistics", format!("{:?}", film.needs)),
            ("budget", budget),
            ("samples per pixel", format!("{} to {}", self.limits.min_spp, self.limits.max_spp)),
            ("invalid samples", format!("{:?}", self.limits.invalid)),
            (
                "samples before",
                format!("{} in {round} rounds and {} training passes", film.record.samples, passes.len()),
            ),
        ];
        pairs.map(|(name, value): (&str, String)| (name.to_owned(), value)).into()
    }

    /// The rows beyond its own ones that a process reads to plan them; `None` if every process plans the whole image.
    pub(super) fn halo(&self) -> Option<u32> {
        halo(&*self.sampler, &self.meter, &self.state.film.needs)
    }

    pub(super) fn seconds(&self) -> f64 {
        self.clock.seconds()
    }

    /// The reading of the clock at which the open round would have begun without interruption.
    pub(super) fn began(&self) -> f64 {
        self.began
    }

    /// Notes the seconds that the open round has taken to trace.
    pub(super) fn set_traced(&mut self, seconds: f64) {
        if let Some(open) = &mut self.state.open {
            open.traced_seconds = seconds;
        }
    }

    /// Opens a round to trace: the one that is open already, or the next. Returns `false` at the end of the render.
    pub(super) fn open(&mut self, mut team: Option<&mut Team<'_>>) -> Result<bool, Error> {
        if self.state.open.is_none() {
            self.state.open = self.plan(team.as_deref_mut())?;
        }
        let State { film, open, .. } = &mut self.state;
        match (team, open.as_mut()) {
            (Some(team), Some(open)) => team.begin(film, open)?,
            (Some(team), None) if !team.keeps_bands => team.complete(film)?,
            _ => {}
        }
        let Some(open) = &self.state.open else {
            self.over = true;
            return Ok(false);
        };
        self.began = self.clock.seconds() - open.traced_seconds;
        Ok(true)
    }

    /// Closes the round that was traced, or stopped: by this process or another one of the team. Returns `true` if the
    /// render ends here because it was stopped.
    pub(super) fn close(
        &mut self,
        stopped: Stopped,
        monitor: &mut dyn Monitor,
        mut team: Option<&mut Team<'_>>,
    ) -> Result<bool, Error> {
        let (stopped, plan_seconds, trace_seconds) = self.gather(stopped, team.as_deref_mut())?;
        let Some(open) = self.state.open.take() else { return Ok(true) };
        let film = &mut self.state.film;
        let (samples, kept) = (film.record.samples - open.before, open.plan.retention == Retention::Keep);
        film.record.rounds.push(RoundRecord { samples, kept, plan_seconds, trace_seconds });
        if stopped == Stopped::Within {
            return Ok(true);
        }
        self.state.round += 1;
        if let Some(team) = team.as_deref_mut() {
            let times = team.times().to_vec();
            self.show(monitor, |monitor, status| monitor.barrier(status, &times));
            // After the last round, the end follows at once, and saves.
            let ends = stopped == Stopped::No && self.limits.budget.is_of_samples() && self.is_spent();
            if !ends {
                self.save(monitor, team)?;
            }
            self.show_rows(monitor, team)?;
        }
        if stopped == Stopped::AtEnd {
            let spent = self.is_spent();
            self.reserve_for_filter(team.as_deref_mut())?;
            let predicted = self.predict()?;
            let seconds = self.agreed_seconds(team)?;
            let more = self.meter.extend(&self.state.film, seconds, predicted);
            self.over = spent && !more;
        }
        Ok(stopped == Stopped::AtEnd)
    }

    /// True if all samples of the budget are traced. A limit of time or error may add to it.
    fn is_spent(&self) -> bool {
        let film = &self.state.film;
        film.record.samples >= self.meter.left(film).total
    }

    /// Gathers the results of the round from all processes. Returns where the round was stopped, and the seconds of planning
    /// and tracing it.
    fn gather(&mut self, stopped: Stopped, team: Option<&mut Team<'_>>) -> Result<(Stopped, f64, f64), Error> {
        let seconds = self.clock.seconds();
        let State { film, round, open: Some(open), .. } = &mut self.state else { return Ok((stopped, 0.0, 0.0)) };
        let mut times = [seconds, open.plan_seconds, seconds - self.began];
        let mut stopped = stopped;
        if let Some(team) = team {
            let gathered = team.round(film, (*round, open), stopped != Stopped::Within, times)?;
            (self.everyones, times) = (None, gathered.seconds);
            stopped = match gathered.standing {
                Standing::Going => Stopped::No,
                Standing::Stopped if gathered.whole => Stopped::AtEnd,
                Standing::Stopped => Stopped::Within,
                trouble => return Err(failed(trouble, film, self.sampler.points())),
            };
        }
        Ok((stopped, times[1], times[2]))
    }
}

/// The rows beyond its own ones that a process reads to plan them; `None` if every process plans the whole image.
///
/// The error of a filtered image concerns the whole film, and splats of one process fall on all pixels.
pub(super) fn halo(sampler: &dyn Sampler, meter: &Meter, needs: &Needs) -> Option<u32> {
    let reads_all = meter.goal().is_some() || needs.splats;
    sampler.halo().filter(|_| !reads_all)
}

/// The error for a snapshot that lacks rows of this process.
fn rows_missing() -> Error {
    let what = "it has the rows of another process; read it by Render::read_snapshot with the same exchange".into();
    Error::OtherRender { what }
}

/// The state of a snapshot, checked against the render that continues it, and the seconds that it took.
fn continued(
    snapshot: Snapshot,
    sampler: &mut dyn Sampler,
    meter: &mut Meter,
    (needs, limits): (&Needs, &Limits),
    frame: &Frame,
) -> Result<(State, f64), Error> {
    snapshot.restore_sampler(sampler, needs, frame, limits)?;
    let Snapshot { film, round, open, passes, total, seconds, holdout, .. } = snapshot;
    let planned = open.as_ref().map_or(film.record.samples, |open| open.before + open.submitted + open.plan.total());
    meter.restore(&film, total, planned)?;
    if let Some(open) = &open {
        let rest = open.rest(frame.size()[0] as usize);
        if rest.total() > 0 {
            check((&rest, rest.total()), &film, sampler, &meter.left(&film))?;
        }
    }
    Ok((State { film, round, open, passes, holdout, prepared: None }, seconds))
}
