//! Tracing of one round, in slices that consist of bands of rows.

use super::feature_samples::{self, Turn};
use super::state::{Cursor, OpenRound, State, Stopped};
use super::turns::{Order, Tally, Turns, streams_of};
use super::{Monitor, Session};
use crate::film::Rejected;
use crate::film::Strip;
use crate::integrator::TrainingSum;
use crate::integrator::{Pass, Prepares, TrainingData};
use crate::plan::{Plan, Retention};
use crate::point_set::{mix, streams};
use crate::render::Control;
use crate::{
    Clock, Draws, Error, Film, Integrator, InvalidSample, Limits, Needs, PointSet, SampleId, Worker, parallel,
};
use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, PoisonError};

/// The side, in pixels, of the blocks in whose order training data is summed.
pub(super) const BLOCK: usize = 16;
/// The inputs that all tasks of a slice share: integrator, points, plan and flags.
struct Inputs<'a> {
    integrator: &'a dyn Integrator,
    points: &'a dyn PointSet,
    plan: &'a Plan,
    width: usize,
    origin: [u32; 2],
    /// The range of samples of each pixel in the slice: from `samples[0]` to below `samples[1]`.
    samples: [u32; 2],
    streams: [u32; 2],
    order: Order,
    needs: Needs,
    features: Turn,
    wants_training: bool,
    /// Workers that no task holds. Later bands reuse their memory.
    workers: Mutex<Vec<Worker>>,
}

impl Inputs<'_> {
    /// Returns `true` if pixel `i` has samples in the slice.
    #[inline]
    fn has(&self, i: usize) -> bool {
        let is_above = |counts: &Vec<u32>| counts[i] > self.samples[0];
        is_above(&self.plan.counts) || self.plan.second_half.as_ref().is_some_and(is_above)
    }
}

/// The results of one band of a slice, besides the film.
struct Traced {
    tally: Tally,
    training: Vec<(usize, Vec<TrainingSum>)>,
    panicked: Option<(SampleId, String)>,
}

/// Traces the rest of the open round into the film: all of it, or the rows of a stage.
pub(super) fn trace(
    integrator: &mut dyn Integrator,
    session: &mut Session<'_>,
    monitor: &mut dyn Monitor,
) -> Result<Stopped, Error> {
    let began = session.began;
    loop {
        let Session { state, sampler, limits, meter, clock, .. } = &mut *session;
        let seconds = clock.seconds() - began;
        let features = meter.features(state.round);
        let Some(open) = &mut state.open else { return Ok(Stopped::AtEnd) };
        let (points, height) = (sampler.points(), state.film.frame.size()[1]);
        let longest = state.stage.as_ref().map_or_else(|| open.longest(), |stage| stage.end());
        if open.cursor.start >= longest {
            return Ok(Stopped::No);
        }
        let wants_training = integrator.wants_training();
        let pass = match &state.stage {
            Some(stage) => Some(stage.pass_length(open.cursor.start)),
            None => pass_length(integrator, open, open.cursor.start, state.film.frame.pixels()),
        };
        let (length, rows) = next_slice(open, &state.film, (pass, wants_training), seconds, limits);
        let begins = open.cursor.row == 0;
        if begins {
            open.cursor.end = open.cursor.start.saturating_add(length).min(longest);
        }
        // Rows below the traced ones already belong to the pass that was interrupted there.
        let begins = begins && state.stage.as_ref().is_none_or(|stage| stage.rows().start == 0);
        prepare(&mut *integrator, (points, &clock.clock), &mut *state, begins)?;
        let State { film, open: Some(open), passes, stage, .. } = state else { return Ok(Stopped::AtEnd) };
        let rows = [open.cursor.row, open.cursor.row.saturating_add(rows).min(height)];
        let bands = slice(&*integrator, points, open, film, limits, (rows, features));
        let cursor = &mut open.cursor;
        add_up(film, bands, (limits, points), (open.plan.retention, &mut open.pending))?;
        cursor.row = rows[1] % height;
        if cursor.row == 0 {
            cursor.start = cursor.end;
            if wants_training && stage.is_none() {
                learn(integrator, &mut open.pending, passes);
            } else if wants_training {
                return Ok(Stopped::No);
            }
        }
        let more = cursor.start < longest;
        open.traced_seconds = clock.seconds() - began;
        if session.show_to(monitor) == Control::Stop {
            return Ok(if more { Stopped::Within } else { Stopped::AtEnd });
        }
    }
}

/// Merges the sums of a training pass, in the order of rows of blocks, and lets the integrator learn from them.
pub(super) fn learn(
    integrator: &mut dyn Integrator,
    pending: &mut Vec<(usize, Vec<TrainingSum>)>,
    passes: &mut Vec<TrainingData>,
) {
    let mut pending = std::mem::take(pending);
    pending.sort_by_key(|(row, _)| *row);
    let rows: Vec<_> = pending.into_iter().map(|(_, sums)| sums).collect();
    let pass = TrainingData::merge(&rows);
    integrator.learn(&pass);
    passes.push(pass);
}

/// Makes the error of a panic, which takes the film and leaves an empty one.
fn panicked((sample, message): (SampleId, String), film: &mut Film, points: &dyn PointSet) -> Error {
    let film = Box::new(std::mem::replace(film, Film::without_planes(film.frame, Needs::none())));
    Error::Panicked { sample, message, points: points.describe(), film }
}

/// Samples per pixel of an integrator's pass from sample `start`; `None` if the integrator has no passes. Depends on the
/// plans only, not on time.
///
/// A training pass has as many samples per pixel as were traced before it on average, so that each pass doubles the
/// samples. For an integrator that prepares for every pass, a pass has [`PREPARED`] samples per pixel of the image, divided
/// among the pixels that still have samples in the round.
pub(super) fn pass_length(integrator: &dyn Integrator, open: &OpenRound, start: u32, pixels: usize) -> Option<u32> {
    match (integrator.wants_training(), integrator.prepares()) {
        (true, _) => {
            let mean = (open.before + open.submitted + open.before(open.cursor.start)) / open.plan.counts.len() as u64;
            Some(u32::try_from(mean).unwrap_or(u32::MAX).max(1))
        }
        (false, Prepares::EveryPass) => {
            // With counts for each half, a step traces a sample of both.
            let least = if open.plan.second_half.is_some() { 1 } else { PREPARED };
            let active = open.above(start).max(1) as usize;
            Some(u32::try_from((PREPARED * pixels / active).max(least)).unwrap_or(u32::MAX))
        }
        (false, _) => None,
    }
}

/// Samples per pixel of a pass, for an integrator that prepares for every pass: one for each half of the film, so that each
/// half can have its own preparation.
const PREPARED: usize = 2;

/// Prepares the integrator for the slice at the cursor, unless it already is prepared. The record counts rays and seconds,
/// except when a resumed render repeats a preparation.
fn prepare(
    integrator: &mut dyn Integrator,
    (points, clock): (&dyn PointSet, &Clock),
    state: &mut State,
    begins: bool,
) -> Result<(), Error> {
    let (film, prepared) = (&mut state.film, &mut state.prepared);
    let passes = film.record.passes;
    let (number, is_new) = match integrator.prepares() {
        Prepares::Never => return Ok(()),
        Prepares::Once => (0, passes == 0),
        Prepares::EveryPass if begins => (passes, true),
        Prepares::EveryPass => (passes.saturating_sub(1), false),
    };
    if *prepared == Some(number) {
        return Ok(());
    }
    let began = clock.seconds();
    let frame = state.stage.as_ref().map_or(film.frame, |stage| stage.frame());
    let pass = Pass { number, points, frame };
    let done = catch_unwind(AssertUnwindSafe(|| integrator.prepare(&pass))).map_err(|payload| {
        let sample = SampleId::new([number, 0], streams::LIGHT, 0);
        panicked((sample, panic_message(&*payload)), film, points)
    })?;
    *prepared = Some(number);
    if is_new {
        film.record.passes += 1;
        film.record.rays += done.rays;
        film.record.prepare_rays += done.rays;
        film.record.prepare_seconds += clock.seconds() - began;
    }
    Ok(())
}

/// The target duration in seconds of a slice, the work between two calls of the monitor. A single row of pixels may
/// take longer.
const SLICE_SECONDS: f64 = 0.2;
/// The number of samples in a round's first slice. It takes a millisecond at 1 us per sample, and a second at 1 ms per
/// sample.
const FIRST_SLICE: f64 = 1024.0;
/// The largest number of samples in a slice, as a multiple of the samples already traced in the round.
const GROWTH: f64 = 8.0;

/// The size of the next slice: samples per pixel, and rows of pixels.
///
/// Both follow from the sampling rate of this round, which took `seconds` so far. If one sample in every pixel would take
/// too long for a slice, the slice covers only some rows. All rows of the pass then get the same number of samples per
/// pixel. `pass` is the number of samples per pixel in a training pass or in an integrator's pass, if there is one.
fn next_slice(
    open: &OpenRound,
    film: &Film,
    (pass, wants_training): (Option<u32>, bool),
    seconds: f64,
    limits: &Limits,
) -> (u32, u32) {
    let height = film.frame.size()[1];
    let fixed = limits.schedule.progress_spp;
    if fixed > 0 {
        return (pass.unwrap_or(fixed), height);
    }
    let Cursor { start, end, row } = open.cursor;
    let active = open.above(start) as f64;
    let traced = (film.record.samples - open.before) as f64;
    // The first rows may be the quickest, so the length grows step by step.
    let promised = (traced / seconds.max(1e-3) * SLICE_SECONDS).min(GROWTH * traced);
    let samples = promised.max(FIRST_SLICE);
    let length = pass.unwrap_or((samples / active).clamp(1.0, 65536.0) as u32);
    let slices = f64::from(if row == 0 { length } else { end - start }) * active / samples;
    if slices < 2.0 && row == 0 {
        return (length, height);
    }
    let rows = (f64::from(height) / slices).clamp(1.0, f64::from(height)).round() as u32;
    (length, if wants_training { rows.next_multiple_of(BLOCK as u32) } else { rows })
}

/// Traces a slice in parallel: the samples at the cursor in some rows, between two calls of the monitor. Returns the
/// results of its bands, from top to bottom.
fn slice(
    integrator: &dyn Integrator,
    points: &dyn PointSet,
    OpenRound { plan, cursor, .. }: &OpenRound,
    film: &mut Film,
    limits: &Limits,
    (rows, features): ([u32; 2], Turn),
) -> Vec<Traced> {
    let (width, halves) = (film.frame.size()[0] as usize, film.kept.len() == 2);
    let round = Inputs {
        integrator,
        points,
        plan,
        width,
        origin: film.frame.origin(),
        samples: [cursor.start, cursor.end],
        streams: streams_of(plan.retention, halves),
        order: Order::of(plan, halves),
        needs: film.needs,
        features: features.of_film(&film.needs, plan.retention),
        wants_training: integrator.wants_training(),
        workers: Mutex::default(),
    };
    let tile = limits.schedule.tile_rows.max(1) as usize;
    let tile = if round.wants_training { tile.next_multiple_of(BLOCK) } else { tile };
    let [from, to] = rows.map(|row| row as usize * width);
    let mut rest = film.strip(plan.retention).split(from).1;
    let mut bands = Vec::with_capacity((to - from).div_ceil(tile * width));
    for first in (from..to).step_by(tile * width) {
        let (strip, others) = rest.split((tile * width).min(to - first));
        bands.push(Band { first, strip });
        rest = others;
    }
    if limits.schedule.shuffle != 0 {
        bands.sort_by_key(|b| mix(b.first as u64 ^ limits.schedule.shuffle));
    }
    let traced = |band: Band<'_>| (band.first, trace_band(&round, band));
    let mut all: Vec<(usize, Traced)> = parallel::map_parts(bands.into_iter(), traced);
    all.sort_by_key(|(first, _)| *first);
    all.into_iter().map(|(_, traced)| traced).collect()
}

/// A band of rows of a film, which one task writes.
struct Band<'a> {
    /// The index of its first pixel in the window.
    first: usize,
    strip: Strip<'a>,
}

fn trace_band(round: &Inputs<'_>, mut band: Band<'_>) -> Traced {
    let (mut tally, mut training) = (Tally::default(), Vec::new());
    let (current, first) = (Cell::new(None), band.first);
    let caught = catch_unwind(AssertUnwindSafe(|| {
        let workers = || round.workers.lock().unwrap_or_else(PoisonError::into_inner);
        let mut worker = workers().pop().unwrap_or_default();
        if round.wants_training {
            training = trace_blocks(round, &mut band, &mut tally, &mut worker, &current);
        } else {
            for local in (0..band.strip.pixels()).filter(|local| round.has(first + local)) {
                trace_pixel(round, &mut band, local, &mut tally, &mut worker, &current);
            }
        }
        // No training pass reads the notes that are left.
        worker.notes.clear();
        workers().push(worker);
    }));
    let panicked = caught.err().map(|payload| {
        let nowhere = SampleId::new([0; 2], 0, 0);
        (current.get().unwrap_or(nowhere), panic_message(&*payload))
    });
    Traced { tally, training, panicked }
}

/// The message of a panic.
pub(super) fn panic_message(payload: &(dyn Any + Send)) -> String {
    (payload.downcast_ref::<String>().cloned())
        .or_else(|| payload.downcast_ref::<&str>().map(|s| (*s).to_owned()))
        .unwrap_or_else(|| "no message".into())
}

/// Traces the band in blocks of 16x16 pixels. Training notes are summed per block, then per row of blocks, so that only
/// one sum per key and row of blocks is kept.
fn trace_blocks(
    round: &Inputs<'_>,
    band: &mut Band<'_>,
    tally: &mut Tally,
    worker: &mut Worker,
    current: &Cell<Option<SampleId>>,
) -> Vec<(usize, Vec<TrainingSum>)> {
    let width = round.width;
    let (rows, first_row) = (band.strip.pixels() / width, band.first / width);
    let of_row = |top: usize| {
        let mut blocks = Vec::with_capacity(width.div_ceil(BLOCK));
        for left in (0..width).step_by(BLOCK) {
            for row in top..(top + BLOCK).min(rows) {
                for column in left..(left + BLOCK).min(width) {
                    trace_pixel(round, band, row * width + column, tally, worker, current);
                }
            }
            blocks.push(worker.summarise());
        }
        ((first_row + top) / BLOCK, TrainingData::merge(&blocks).entries)
    };
    (0..rows).step_by(BLOCK).map(of_row).collect()
}

/// Traces all samples of one pixel in this slice, in index order.
#[inline]
fn trace_pixel(
    round: &Inputs<'_>,
    Band { first, strip }: &mut Band<'_>,
    local: usize,
    tally: &mut Tally,
    worker: &mut Worker,
    current: &Cell<Option<SampleId>>,
) {
    let i = *first + local;
    let turns = Turns::new(round.plan, i, round.samples, strip, local);
    if turns.total() == 0 {
        return;
    }
    let start = round.samples[0];
    let pixel = [round.origin[0] + (i % round.width) as u32, round.origin[1] + (i / round.width) as u32];
    if strip.has_recorders() {
        let rest = Turns::new(round.plan, i, [start, u32::MAX], strip, local);
        strip.reserve(local, rest.halves(round.order));
    }
    if round.features != Turn::Never
        && round.features.is_now(&strip.beside.features[local], strip.counts(local).iter().sum(), start == 0)
    {
        let moments = &mut strip.beside.features[local];
        let added = feature_samples::add(moments, round.points, pixel, &round.needs, |draws| {
            current.set(Some(draws.id()));
            round.integrator.features_alone(draws)
        });
        tally.add_features(pixel, added);
    }
    for turn in 0..turns.total() {
        let (half, index) = turns.sample(round.order, turn);
        let id = SampleId::new(pixel, round.streams[half], index);
        current.set(Some(id));
        let draws = Draws::for_film(round.points, id, round.needs);
        let estimate = round.integrator.estimate(&draws, worker);
        if let Some(reason) = strip.add(half, local, &estimate) {
            tally.reject(Rejected { sample: id, reason }, estimate.radiance);
        }
        if !worker.splats.is_empty() {
            let wanted = round.needs.splats && round.plan.retention == Retention::Keep;
            let splats = worker.splats.drain(..).filter(|_| wanted);
            splats.for_each(|(to, radiance)| tally.splat(id, half, to, radiance));
        }
        tally.count(half, estimate.cost, draws.blocks_requested());
    }
}

/// Adds the results of a slice's bands to the film, in their order.
///
/// # Errors
///
/// For a panic, and for a rejected sample under [`InvalidSample::Fail`].
fn add_up(
    film: &mut Film,
    bands: Vec<Traced>,
    (limits, points): (&Limits, &dyn PointSet),
    (retention, pending): (Retention, &mut Vec<(usize, Vec<TrainingSum>)>),
) -> Result<(), Error> {
    let mut first_panic = None;
    for Traced { tally, training, panicked } in bands {
        if let (InvalidSample::Fail, Some((sample, value))) = (limits.invalid, tally.first_rejected) {
            return Err(Error::InvalidSample { sample, value, points: points.describe() });
        }
        tally.add_to(film, retention);
        pending.extend(training);
        first_panic = first_panic.or(panicked);
    }
    first_panic.map_or(Ok(()), |panic| Err(panicked(panic, film, points)))
}
