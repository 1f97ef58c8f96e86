//! Snapshots: the state of a render between two slices, as bytes.

pub(crate) mod bytes;
mod film;

use crate::render::{Stage, holdout::Holdout};
use crate::{Error, Film, Frame, Integrator, Limits, Needs, Plan, Sampler, TrainingData, TrainingSum, container};
use bytes::{Reader, Writer};
use film::{put_combine, put_film, put_frame, put_training, take_combine, take_film, take_frame, take_training};

/// The reason why bytes are not a snapshot, as the end of a sentence.
#[derive(Debug)]
pub(crate) struct Broken(pub(crate) &'static str);

impl From<Broken> for Error {
    fn from(Broken(what): Broken) -> Self {
        Self::BadSnapshot { what }
    }
}

/// The progress within a round. Pixels in rows before `row` have `end` samples of the round traced, the others `start`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cursor {
    pub(crate) start: u32,
    pub(crate) end: u32,
    pub(crate) row: u32,
}

/// A round (a batch of planned samples) that is partly traced.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OpenRound {
    pub(crate) plan: Plan,
    pub(crate) cursor: Cursor,
    /// The sums of the unfinished training pass. For each traced row of 16x16-pixel blocks: the index of the row of
    /// blocks, and the sums by key.
    pub(crate) pending: Vec<(usize, Vec<TrainingSum>)>,
    /// The number of samples traced before this round.
    pub(crate) before: u64,
    /// The number of this round's samples that are traced and no longer in `plan`.
    pub(crate) submitted: u64,
    pub(crate) plan_seconds: f64,
    /// Seconds of tracing this round before the snapshot.
    pub(crate) traced_seconds: f64,
}

impl OpenRound {
    /// The largest number of samples of a pixel.
    pub(crate) fn longest(&self) -> u32 {
        self.counts().max().unwrap_or(0)
    }

    /// The samples among the first `start` of each pixel.
    pub(crate) fn before(&self, start: u32) -> u64 {
        self.counts().map(|count| u64::from(count.min(start))).sum()
    }

    /// The number of pixels with more than `start` samples; those of both halves count twice.
    pub(crate) fn above(&self, start: u32) -> u64 {
        self.counts().filter(|count| *count > start).count() as u64
    }

    /// The counts in the plan, of both halves.
    fn counts(&self) -> impl Iterator<Item = u32> + '_ {
        self.plan.counts.iter().chain(self.plan.second_half.iter().flatten()).copied()
    }

    /// The number of this round's samples already traced in each pixel of `row`.
    pub(crate) fn done(&self, row: usize) -> u32 {
        if row < self.cursor.row as usize { self.cursor.end } else { self.cursor.start }
    }

    /// Keeps only the untraced rest in the plan.
    pub(crate) fn keep_rest(&mut self, width: usize) {
        if self.cursor == Cursor::default() {
            return;
        }
        let rest = self.rest(width);
        self.submitted += self.plan.total() - rest.total();
        (self.plan, self.cursor) = (rest, Cursor::default());
    }

    /// The untraced rest of the round as a plan. It withdraws no samples: withdrawals happen when the round begins.
    pub(crate) fn rest(&self, width: usize) -> Plan {
        let left = |counts: &[u32]| -> Vec<u32> {
            counts.iter().enumerate().map(|(i, n)| n.saturating_sub(self.done(i / width))).collect()
        };
        let Plan { counts, second_half, retention, combine, withdraw: _ } = &self.plan;
        let second_half = second_half.as_deref().map(left);
        Plan { counts: left(counts), second_half, retention: *retention, combine: *combine, withdraw: None }
    }
}

/// Borrowed state of a render, complete enough to resume it; the content of a snapshot.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) film: &'a Film,
    pub(crate) round: u32,
    pub(crate) open: Option<&'a OpenRound>,
    pub(crate) passes: &'a [TrainingData],
    pub(crate) holdout: Option<&'a Holdout>,
    pub(crate) total: u64,
    pub(crate) seconds: f64,
    pub(crate) sampler: Planner<'a>,
    pub(crate) limits: &'a Limits,
    /// The stage of which the film has some rows; `None` for a film of the whole window.
    pub(crate) stage: Option<&'a Stage>,
}

/// A sampler, or what a snapshot says of it.
#[derive(Clone, Copy)]
pub(crate) enum Planner<'a> {
    Sampler(&'a dyn Sampler),
    Saved(&'a SavedSampler),
}

/// The description and state of a sampler during one round.
pub(crate) struct SavedSampler {
    sampler: String,
    points: String,
    state: Vec<u8>,
}

impl SavedSampler {
    pub(crate) fn of(sampler: &dyn Sampler) -> Self {
        Self { sampler: sampler.describe(), points: sampler.points().describe(), state: sampler.save() }
    }
}

/// The sections of a state: the sampler and the limits, the film, and what is open.
const SECTIONS: [&str; 3] = ["render", "film", "open"];

impl View<'_> {
    pub(crate) fn write(&self) -> Vec<u8> {
        let mut head = Writer::with_capacity(4096);
        let state = self.put_head(&mut head);
        let mut film = Writer::with_capacity(film::size(self.film));
        put_film(&mut film, self.film);
        let mut end = Writer::with_capacity(self.open.map_or(0, |open| 8 * open.plan.counts.len()));
        self.put_end(&mut end, &state);
        let parts = [head, film, end].map(Writer::finish);
        let mut bytes = container::begin(parts.iter().map(Vec::len).sum());
        SECTIONS.iter().zip(parts).for_each(|(name, part)| container::append(&mut bytes, name, &part));
        bytes
    }

    /// Writes what precedes the film. Returns the sampler's state, which follows it.
    fn put_head(&self, to: &mut Writer) -> Vec<u8> {
        let saved;
        let SavedSampler { sampler, points, state } = match self.sampler {
            Planner::Saved(saved) => saved,
            Planner::Sampler(sampler) => {
                saved = SavedSampler::of(sampler);
                &saved
            }
        };
        to.text(sampler);
        to.text(points);
        to.number([self.limits.min_spp, self.limits.max_spp]);
        to.number(self.round);
        to.number(self.total);
        to.number(self.seconds);
        state.clone()
    }

    /// Writes what follows the film.
    fn put_end(&self, to: &mut Writer, state: &[u8]) {
        to.list(state);
        to.number(self.passes.len() as u64);
        self.passes.iter().for_each(|pass| put_training(to, pass.entries()));
        to.flag(self.open.is_some());
        if let Some(open) = self.open {
            put_round(to, open);
        }
        to.flag(self.holdout.is_some());
        if let Some(holdout) = self.holdout {
            holdout.put(to);
        }
        to.flag(self.stage.is_some());
        if let Some(stage) = self.stage {
            put_frame(to, &stage.frame);
            to.number(stage.rows);
            to.list(&stage.ends);
        }
    }
}

/// The state of a render between two slices, with everything needed to resume it.
///
/// [`Status::snapshot`](crate::Status::snapshot) makes the bytes, and [`Render::resume`](crate::Render::resume)
/// continues from them. This crate does no file I/O: a [`Monitor`](crate::Monitor) stores the bytes. Reading checks
/// their version, checksums and consistency.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// #     fn capacity(&self) -> u64 { u64::MAX }
/// # }
/// # use dapple_core::{Draws, Estimate, Integrator, Worker};
/// # struct Ramp;
/// # impl Integrator for Ramp {
/// #     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
/// #         Estimate::new([draws.pixel()[0] as f32; 3])
/// #     }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Control, Frame, Limits, Render, Schedule, Snapshot, Status};
///
/// let frame = Frame::new(8, 6)?;
/// let limits = Limits::samples(4 * 8 * 6).with_schedule(Schedule::default().with_slice_spp(1));
///
/// // Stop after the first slice of one sample per pixel.
/// let mut saved = Vec::new();
/// let mut stop = |status: &Status<'_>| {
///     saved = status.snapshot();
///     Control::Stop
/// };
/// let part = Render::new(frame, &limits).monitor(&mut stop).run(&mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(part.record().samples, 8 * 6);
///
/// let snapshot = Snapshot::from_bytes(&saved)?;
/// let whole = Render::new(frame, &limits).resume(snapshot, &mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(whole.record().samples, 4 * 8 * 6);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    pub(crate) film: Film,
    pub(crate) round: u32,
    pub(crate) open: Option<OpenRound>,
    pub(crate) passes: Vec<TrainingData>,
    pub(crate) holdout: Option<Holdout>,
    pub(crate) total: u64,
    pub(crate) seconds: f64,
    pub(crate) sampler_state: Vec<u8>,
    pub(crate) stage: Option<Stage>,
    sampler: String,
    points: String,
    bounds: [u32; 2],
}

impl Snapshot {
    /// Reads the bytes of [`Status::snapshot`](crate::Status::snapshot). Allocates at most a few times as many bytes as
    /// it reads, even for invalid bytes.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bytes of another kind or version, truncated or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        Ok(Self::read(bytes)?)
    }

    fn read(bytes: &[u8]) -> Result<Self, Broken> {
        let found = container::sections(bytes).map_err(|fault| Broken(fault.text()))?;
        let section =
            |name: &str| found.iter().find(|(known, _)| *known == name).map(|(_, section)| Reader::new(section));
        let [Some(mut head), Some(mut film), Some(mut end)] = SECTIONS.map(section) else {
            return Err(Broken("they hold no state of a render"));
        };
        let (head, film) = (Head::take(&mut head)?, take_film(&mut film)?);
        Self::take_end(&mut end, head, film)
    }

    /// Reads what follows the film.
    fn take_end(from: &mut Reader<'_>, head: Head, film: Film) -> Result<Self, Broken> {
        let Head { sampler, points, bounds, round, total, seconds } = head;
        let sampler_state = from.list()?;
        let count = from.count(8)?;
        let mut passes = Vec::new();
        for _ in 0..count {
            let pass = TrainingData::sorted(take_training(from)?);
            passes.push(pass.ok_or(Broken("training data is out of order"))?);
        }
        let open = if from.flag()? { Some(take_round(from, &film)?) } else { None };
        let holdout = if from.flag()? { Some(Holdout::take(from, &film)?) } else { None };
        let stage = if from.flag()? { Some(take_stage(from, &film)?) } else { None };
        if !from.is_empty() {
            return Err(Broken("there are bytes after the end"));
        }
        Ok(Self { stage, film, round, open, passes, holdout, total, seconds, sampler_state, sampler, points, bounds })
    }

    /// The film (per-pixel statistics) at the time of the snapshot, with valid statistics in every pixel.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// The snapshot, unless it has some rows of a stage alone.
    pub(crate) fn of_window(self) -> Result<Self, Error> {
        match self.stage {
            None => Ok(self),
            Some(_) => Err(Error::OtherRender { what: "it has rows of a stage alone; trace and join them".into() }),
        }
    }

    /// Makes an integrator learn the training passes so far.
    pub fn teach(&self, integrator: &mut dyn Integrator) {
        self.passes.iter().for_each(|pass| integrator.learn(pass));
    }

    /// Restores the sampler's state, and checks that the snapshot belongs to a render with this sampler, frame and limits, and records these `needs`.
    pub(crate) fn restore_sampler(
        &self,
        sampler: &mut dyn Sampler,
        needs: &Needs,
        frame: &Frame,
        limits: &Limits,
    ) -> Result<(), Error> {
        if self.sampler == sampler.describe() {
            // First, since the point set may depend on the state.
            sampler.restore(&self.sampler_state)?;
        }
        let mut differ = Vec::new();
        let mut compare = |what: &str, was: &str, is: &str| {
            if was != is {
                differ.push(format!("the {what} was {was}, not {is}"));
            }
        };
        compare("sampler", &self.sampler, &sampler.describe());
        compare("point set", &self.points, &sampler.points().describe());
        let window = |f: &Frame| {
            let ([x, y], [w, h], [full_w, full_h]) = (f.origin(), f.size(), f.resolution());
            format!("{w}x{h} pixels at {x},{y} of {full_w}x{full_h}")
        };
        let own = self.stage.as_ref().map_or(*self.film.frame(), |stage| stage.frame);
        compare("window", &window(&own), &window(frame));
        let bounds = |[min, max]: [u32; 2]| format!("{min} to {max}");
        compare("range of samples per pixel", &bounds(self.bounds), &bounds([limits.min_spp, limits.max_spp]));
        let halves = |halves: bool| if halves { "two halves" } else { "one sequence" };
        compare("kind of samples", halves(self.film.needs().halves), halves(needs.halves));
        let missing = Needs { halves: false, ..*needs };
        if let Err(Error::NotRecorded { what, .. }) = self.film.require("", &missing) {
            differ.push(format!("{what} was not recorded and is now needed"));
        }
        if differ.is_empty() { Ok(()) } else { Err(Error::OtherRender { what: differ.join("; ") }) }
    }
}

/// The part of a snapshot before the film.
struct Head {
    sampler: String,
    points: String,
    bounds: [u32; 2],
    round: u32,
    total: u64,
    seconds: f64,
}

impl Head {
    fn take(from: &mut Reader<'_>) -> Result<Self, Broken> {
        let (sampler, points) = (from.text()?, from.text()?);
        let bounds = from.number()?;
        let (round, total, seconds) = (from.number()?, from.number()?, from.number::<f64>()?);
        match seconds.is_finite() && seconds >= 0.0 {
            true => Ok(Self { sampler, points, bounds, round, total, seconds }),
            false => Err(Broken("a time is not a number of seconds")),
        }
    }
}

fn put_round(to: &mut Writer, open: &OpenRound) {
    let Plan { counts, second_half, retention, combine, withdraw: _ } = &open.plan;
    to.flag(*retention == crate::Retention::Discard);
    put_combine(to, *combine);
    to.numbers(counts);
    to.flag(second_half.is_some());
    to.numbers(second_half.as_deref().unwrap_or(&[]));
    let Cursor { start, end, row } = open.cursor;
    to.number([start, end, row]);
    to.number([open.before, open.submitted]);
    to.number([open.plan_seconds, open.traced_seconds]);
    to.number(open.pending.len() as u64);
    for (block, observed) in &open.pending {
        to.number(*block as u64);
        put_training(to, observed);
    }
}

fn take_round(from: &mut Reader<'_>, film: &Film) -> Result<OpenRound, Broken> {
    let [width, height] = film.frame().size().map(|n| n as usize);
    let mut plan = Plan::empty(0);
    plan.retention = if from.flag()? { crate::Retention::Discard } else { crate::Retention::Keep };
    plan.combine = take_combine(from)?;
    plan.counts = from.numbers(width * height)?;
    plan.second_half = if from.flag()? { Some(from.numbers(width * height)?) } else { None };
    let [start, end, row] = from.number()?;
    let [before, submitted] = from.number()?;
    let [plan_seconds, traced_seconds] = from.number::<[f64; 2]>()?;
    let count = from.count(16)?;
    let mut pending = Vec::with_capacity(count);
    for _ in 0..count {
        let block = usize::try_from(from.number::<u64>()?).map_err(|_| Broken("a block is out of range"))?;
        pending.push((block, take_training(from)?));
    }
    let cursor = Cursor { start, end, row };
    let open = OpenRound { plan, cursor, pending, before, submitted, plan_seconds, traced_seconds };
    if end < start || row as usize >= height || !(plan_seconds.is_finite() && traced_seconds.is_finite()) {
        return Err(Broken("the place within a round is out of range"));
    }
    if open.plan.second_half.is_some() && film.kept.len() != 2 {
        return Err(Broken("a plan is for two halves, but the film has one"));
    }
    if open.plan.retention == crate::Retention::Discard && film.discarded.is_empty() {
        return Err(Broken("a round discards samples, but the film has no place for them"));
    }
    let traced = open.plan.total() - open.rest(width).total();
    let all = before.checked_add(submitted).and_then(|n| n.checked_add(traced));
    if all != Some(film.record.samples) {
        return Err(Broken("the place within a round is out of range"));
    }
    Ok(open)
}

fn take_stage(from: &mut Reader<'_>, film: &Film) -> Result<Stage, Broken> {
    let (frame, rows, ends) = (take_frame(from)?, from.number()?, from.list()?);
    let stage = Stage { frame, rows, ends };
    let (own, window) = (film.frame(), &stage.frame);
    let top = own.origin()[1].checked_sub(window.origin()[1]);
    let fits = top.and_then(|top| window.rows(top..top + own.size()[1]).ok()).is_some_and(|rows| rows == *own);
    let is_sound = fits && rows[0] < rows[1] && stage.ends.is_sorted() && !stage.ends.is_empty();
    if is_sound { Ok(stage) } else { Err(Broken("a stage is of another window")) }
}
