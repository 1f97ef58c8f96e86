//! Stages of a render: the samples between two barriers, whose rows can be traced separately and joined.
//!
//! A barrier needs the samples of all pixels: a sampler plans the next round, or an integrator learns from a training pass.
//! Between two barriers, the rows of the image are independent, so that any machine can trace any of them.

use super::repeats::Repeats;
use super::round::{BLOCK, learn, pass_length, trace};
use super::state::{Cursor, OpenRound, Stage, State, Stopped};
use super::{Methods, Monitor, NoMonitor, Render, Session};
use crate::{Clock, Error, Film, Frame, Integrator, Sampler, Snapshot, film::Record, film::keep_first, snapshot::View};
use std::ops::Range;

/// The state of an integrator between two calls of [`Render::trace_rows`]: the number of training passes it has learned,
/// and the last pass for which it was prepared. Each integrator needs its own, `Readiness::default()` at first.
#[derive(Clone, Debug, Default)]
pub struct Readiness {
    learned: usize,
    prepared: Option<u32>,
}

/// Traced rows of a stage, for [`Session::join`].
#[derive(Clone, Debug)]
pub struct TracedRows(State);

impl TracedRows {
    /// Reads the bytes that [`Render::trace_rows`] returns.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bytes that are of another kind or version, damaged or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        Ok(Self(Snapshot::from_bytes(bytes)?.state))
    }
}

impl Session<'_> {
    /// The next stage; `None` at the end of the render. Plans a round if none is open. The stage has the untraced samples of
    /// the open round, or of one pass if the integrator learns or the render was interrupted within a pass.
    ///
    /// # Errors
    ///
    /// The errors of [`Session::next_round`].
    pub fn next_stage(&mut self, integrator: &dyn Integrator) -> Result<Option<Stage>, Error> {
        if let Some(open) = &mut self.state.open {
            open.join();
        }
        if !self.open()? {
            return Ok(None);
        }
        // A render may be interrupted after the last sample of a round.
        if self.state.open.as_ref().is_some_and(|open| open.cursor.start >= open.longest()) {
            self.close(Stopped::No)?;
            return self.next_stage(integrator);
        }
        let (film, open) = (&self.state.film, self.state.open.as_ref());
        let Some(open) = open else { return Ok(None) };
        let (Cursor { start, end, row }, longest, height) = (open.cursor, open.longest(), film.frame.size()[1]);
        let mut ends = if row > 0 { vec![end] } else { Vec::new() };
        // Integrators learn at the end of a stage, and prepare within one.
        while ends.last().is_none_or(|at| row == 0 && *at < longest && !integrator.wants_training()) {
            let at = ends.last().copied().unwrap_or(start);
            let length = pass_length(integrator, open, at, film.frame.pixels());
            ends.push(length.map_or(longest, |length| at.saturating_add(length).min(longest)));
        }
        Ok(Some(Stage { frame: film.frame, rows: [row, height], ends }))
    }

    /// Divides the rows of a stage, from the top, into at most `parts` ranges of similar sample counts, cut only every 16 rows.
    pub fn deal(&self, stage: &Stage, parts: u32) -> Vec<Range<u32>> {
        let Some(open) = &self.state.open else { return Vec::new() };
        let samples = |band: &Range<u32>| planned(open, stage, band);
        // Training data is summed in blocks, so that no block may be cut.
        let bands: Vec<Range<u32>> = (stage.rows().start..stage.rows().end)
            .step_by(BLOCK)
            .map(|top| top..(top + BLOCK as u32).min(stage.rows().end))
            .collect();
        let total = bands.iter().map(samples).sum::<u64>().max(1);
        let (mut runs, mut before): (Vec<Range<u32>>, u64) = (Vec::new(), 0);
        for band in bands {
            // The part to which the middle of the band belongs.
            let own = samples(&band);
            let part = ((u128::from(2 * before + own) * u128::from(parts)) / u128::from(2 * total)) as usize;
            before += own;
            let is_own = part < runs.len() || runs.len() == parts as usize;
            match runs.last_mut().filter(|_| is_own) {
                Some(last) => last.end = band.end,
                None => runs.push(band),
            }
        }
        runs
    }

    /// The state of some rows of a stage.
    fn part(&self, stage: &Stage, rows: Range<u32>) -> Result<State, Error> {
        let frame = stage.frame.rows(rows.clone())?;
        let Some(open) = &self.state.open else { return Err(no_round()) };
        let film = self.state.film.rows_of(frame);
        let width = stage.frame.size()[0] as usize;
        let cut = |counts: &[u32]| counts[rows.start as usize * width..rows.end as usize * width].to_vec();
        let mut open = OpenRound {
            plan: open.plan.with_counts(cut),
            later: None,
            cursor: Cursor { start: open.cursor.start, end: open.cursor.start, row: 0 },
            pending: Vec::new(),
            before: film.record.samples,
            submitted: 0,
            plan_seconds: 0.0,
            traced_seconds: 0.0,
        };
        // Samples of this round in the rows do not count as samples before the round.
        open.before -= open.plan.total() - open.rest(width).total();
        let (round, passes, open, stage) =
            (self.state.round, self.state.passes.clone(), Some(open), Some(stage.clone()));
        let (filtered_error, prepared, repeats) = (None, self.state.prepared, Repeats::default());
        Ok(State { film, round, open, passes, filtered_error, prepared, stage, repeats })
    }

    /// The state of some rows of a stage as bytes, for [`Render::trace_rows`] on any machine.
    ///
    /// # Errors
    ///
    /// [`Error::BadCrop`] for rows outside the window.
    pub fn rows_of(&self, stage: &Stage, rows: Range<u32>) -> Result<Vec<u8>, Error> {
        Ok(View { state: &self.part(stage, rows)?, ..self.view(0.0) }.write())
    }

    /// Traces some rows of a stage in this process, for [`Session::join`]; `None` if the monitor stopped the render. The
    /// monitor gets the film of these rows.
    ///
    /// # Errors
    ///
    /// The errors of [`Render::run`].
    pub fn trace_rows_here(
        &mut self,
        stage: &Stage,
        rows: Range<u32>,
        integrator: &mut dyn Integrator,
        monitor: &mut dyn Monitor,
    ) -> Result<Option<TracedRows>, Error> {
        let part = self.part(stage, rows)?;
        let whole = std::mem::replace(&mut self.state, part);
        let traced = trace(integrator, self, monitor);
        let part = std::mem::replace(&mut self.state, whole);
        self.state.prepared = part.prepared;
        Ok((traced? == Stopped::No).then_some(TracedRows(part)))
    }

    /// Adds traced rows to the film, in any order. Returns the range of the rows.
    ///
    /// # Errors
    ///
    /// [`Error::OtherRender`] for rows of another stage, and for rows that were not traced to the end of the stage.
    pub fn join(&mut self, stage: &Stage, rows: TracedRows) -> Result<Range<u32>, Error> {
        let other = |what: &str| Err(Error::OtherRender { what: what.into() });
        let State { film: mut part, round, open: Some(traced), stage: of, .. } = rows.0 else {
            return other("the rows belong to no open round; join only traced rows");
        };
        if of.as_ref() != Some(stage) || round != self.state.round {
            return other("the rows belong to another stage; join only rows of this one");
        }
        if traced.cursor.start != stage.end() {
            return other("the rows are not traced to the end of their stage; trace these rows again");
        }
        let Some(open) = self.state.open.as_mut() else { return Err(no_round()) };
        let film = &mut self.state.film;
        if part.needs != film.needs || part.recorders != film.recorders {
            return other("the rows record other statistics; trace them with the session's needs");
        }
        let top = part.frame.origin()[1] - stage.frame.origin()[1];
        let rows = top..top + part.frame.size()[1];
        let (had, new) = (samples_in(film, part.frame), planned(open, stage, &rows));
        if part.record.samples != had + new {
            return other("the rows were joined already; join each row once");
        }
        let record = std::mem::take(&mut part.record);
        part.record = Record {
            samples: new,
            rays: record.rays - record.prepare_rays,
            blocks: record.blocks,
            rejected: record.rejected,
            ..Record::default()
        };
        if record.passes > film.record.passes {
            // All machines repeat the same preparation, which counts once.
            film.record.passes = record.passes;
            film.record.prepare_rays += record.prepare_rays;
            film.record.rays += record.prepare_rays;
            film.record.prepare_seconds += record.prepare_seconds;
        }
        film.splats.join(&part.splats);
        let first_block = top as usize / BLOCK;
        open.pending.extend(traced.pending.into_iter().map(|(block, sums)| (block + first_block, sums)));
        film.put_back(part, open.plan.retention);
        keep_first(&mut film.rejected);
        Ok(rows)
    }

    /// Ends a stage whose rows have all been joined: the integrator learns, or the round is closed.
    ///
    /// # Errors
    ///
    /// [`Error::OtherRender`] if rows are missing.
    pub fn end_stage(&mut self, stage: &Stage, integrator: &mut dyn Integrator) -> Result<(), Error> {
        let seconds = self.clock.seconds() - self.began;
        let Some(open) = &mut self.state.open else { return Ok(()) };
        if self.state.film.record.samples != open.before + open.submitted + open.before(stage.end()) {
            return Err(Error::OtherRender {
                what: "rows of the stage are missing; join all rows before the stage ends".into(),
            });
        }
        open.traced_seconds = seconds;
        open.cursor = Cursor { start: stage.end(), end: stage.end(), row: 0 };
        let is_over = stage.end() >= open.longest();
        if integrator.wants_training() {
            learn(integrator, &mut open.pending, &mut self.state.passes);
        }
        if is_over {
            self.close(Stopped::No)?;
        }
        Ok(())
    }

    /// The number of samples that are left to trace, as far as known; a time or error limit may change it.
    pub fn samples_left(&self) -> u64 {
        self.meter.left(&self.state.film).left()
    }

    /// The number of samples that a stage traces.
    pub fn samples_in(&self, stage: &Stage) -> u64 {
        let Some(open) = &self.state.open else { return 0 };
        open.before(stage.end()) - open.before(open.cursor.start)
    }
}

impl Render<'_> {
    /// Traces rows from [`Session::rows_of`] to the end of their stage. Returns the traced rows for [`Session::join`];
    /// `None` if the monitor stopped the render.
    ///
    /// The integrator learns the training passes that `ready` lacks, and is prepared for the pass unless it already is.
    ///
    /// # Errors
    ///
    /// The errors of [`Render::resume`].
    pub fn trace_rows(
        mut self,
        rows: &[u8],
        ready: &mut Readiness,
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Option<Vec<u8>>, Error> {
        let snapshot = Snapshot::from_bytes(rows)?;
        let mut unwatched = NoMonitor;
        let monitor: &mut dyn Monitor = self.monitor.take().unwrap_or(&mut unwatched);
        let methods = Methods { needs: self.needs, recorders: self.recorders, ..Methods::from(sampler) };
        let session = Session::of_render(self.frame, self.limits, methods, Some(snapshot))?;
        let mut session = session.with_clock(Clock::of_machine());
        session.state.passes.iter().skip(ready.learned).for_each(|pass| integrator.learn(pass));
        ready.learned = session.state.passes.len();
        session.state.prepared = ready.prepared;
        session.open()?;
        let stopped = trace(integrator, &mut session, monitor);
        ready.prepared = session.state.prepared;
        match stopped? {
            Stopped::No => Ok(Some(session.view(0.0).write())),
            Stopped::Within | Stopped::AtEnd => Ok(None),
        }
    }
}

/// The number of samples of a stage in some rows.
fn planned(open: &OpenRound, stage: &Stage, rows: &Range<u32>) -> u64 {
    let width = stage.frame.size()[0] as usize;
    let own = open.plan.halves().flat_map(|counts| &counts[rows.start as usize * width..rows.end as usize * width]);
    own.map(|n| u64::from((*n).min(stage.end()).saturating_sub(open.cursor.start))).sum()
}

fn no_round() -> Error {
    Error::OtherRender { what: "no round is open; use a stage from Session::next_stage".into() }
}

/// The number of kept and discarded samples in some rows of a film.
fn samples_in(film: &Film, rows: Frame) -> u64 {
    let first = (rows.origin()[1] - film.frame.origin()[1]) as usize * film.frame.size()[0] as usize;
    let halves = film.kept.iter().chain(&film.discarded);
    halves.flat_map(|planes| &planes.counts[first..first + rows.pixels()]).map(|count| u64::from(*count)).sum()
}

impl Film {
    /// The rows `frame` as a separate film, with the record of a render that has the samples of these rows.
    fn rows_of(&self, frame: Frame) -> Self {
        let mut film = self.part(frame, crate::plan::Retention::Keep);
        if film.discarded.is_empty() && !self.discarded.is_empty() {
            let part = self.part(frame, crate::plan::Retention::Discard);
            (film.discarded, film.discarded_spread) = (part.discarded, part.discarded_spread);
        }
        film.splats = self.splats.empty();
        film.record = Record { samples: samples_in(&film, frame), passes: self.record.passes, ..Record::default() };
        film
    }
}
