//! Tracing one round: slices of bands of rows.

use super::feature_samples::{self, Turn};
use super::session::State;
use super::{Monitor, Session};
use crate::film::{BankRows, BesideRows, REJECTED_LISTED, Splats, keep_first, record_first_hit, reserve};
use crate::integrator::TrainingSum;
use crate::snapshot::{Cursor, OpenRound};
use crate::{
    Control, Draws, Error, Film, Integrator, InvalidSample, Limits, Needs, Pass, Plan, PointSet, Prepares, Recorder,
    Rejected, Retention, SampleId, TrainingData, Worker, mix, streams,
};
use rayon::prelude::*;
use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// The side, in pixels, of the blocks in whose order training data is summed.
pub(super) const BLOCK: usize = 16;
/// The inputs that all tasks of a slice share: integrator, points, plan and flags.
struct Inputs<'a> {
    integrator: &'a dyn Integrator,
    points: &'a dyn PointSet,
    plan: &'a Plan,
    width: usize,
    origin: [u32; 2],
    streams: [u32; 2],
    needs: Needs,
    recorders: &'a [Arc<dyn Recorder>],
    features: Turn,
    wants_training: bool,
    /// Workers that no task holds, so that their memory lasts longer than a band.
    workers: Mutex<Vec<Worker>>,
}

impl Inputs<'_> {
    fn take_worker(&self) -> Worker {
        self.workers.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn give_back(&self, mut worker: Worker) {
        worker.forget_notes();
        self.workers.lock().unwrap_or_else(PoisonError::into_inner).push(worker);
    }
}

/// The totals of one task: samples, rays, rejected samples, training sums, and a panic if there was one.
#[derive(Default)]
struct Tally {
    /// The number of samples in each half.
    samples: [u64; 2],
    rays: u64,
    blocks: u64,
    /// The number of rejected samples.
    rejections: u64,
    /// The first rejected samples in order of pixel, stream and index; fewer than twice as many as the film lists.
    rejected: Vec<Rejected>,
    /// The first rejected sample in the order of tracing, with its radiance.
    first_rejected: Option<(SampleId, [f32; 3])>,
    training: Vec<(usize, Vec<TrainingSum>)>,
    /// Half, pixel and radiance of splats.
    splats: Vec<(usize, [u32; 2], [f32; 3])>,
    panicked: Option<(SampleId, String)>,
}

/// The result of tracing a round: stopped by a monitor, and where, or not stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stopped {
    No,
    /// The monitor stopped the render while samples of the round remained to be traced.
    Within,
    /// The monitor stopped the render after the last slice of the round.
    AtEnd,
}

/// Traces the rest of the open round into the film: all of it, or the rows of a stage.
pub(super) fn trace(
    integrator: &mut dyn Integrator,
    session: &mut Session<'_>,
    monitor: &mut dyn Monitor,
) -> Result<Stopped, Error> {
    let began = session.began();
    loop {
        let seconds = session.seconds() - began;
        let Session { state, sampler, limits, meter, .. } = &mut *session;
        let features = meter.features(state.round);
        let Some(open) = &mut state.open else { return Ok(Stopped::AtEnd) };
        let (points, height) = (sampler.points(), state.film.frame.size()[1]);
        let longest = state.stage.as_ref().map_or_else(|| open.longest(), |stage| stage.end());
        if open.cursor.start >= longest {
            return Ok(Stopped::No);
        }
        let wants_training = integrator.wants_training();
        let pass = match (&state.stage, wants_training, integrator.prepares()) {
            (Some(stage), ..) => Some(stage.pass_length(open.cursor.start)),
            (None, true, _) => Some(training_length(open)),
            (None, false, Prepares::EveryPass) => {
                Some(prepared_length(open, open.cursor.start, state.film.frame.pixels()))
            }
            _ => None,
        };
        let (length, rows) = next_slice(open, &state.film, (pass, wants_training), seconds, limits);
        let begins = open.cursor.row == 0;
        if begins {
            open.cursor.end = open.cursor.start.saturating_add(length).min(longest);
        }
        // Rows below those that are traced already belong to the pass that was interrupted there.
        let begins = begins && state.stage.as_ref().is_none_or(|stage| stage.rows().start == 0);
        prepare(&mut *integrator, points, &mut *state, begins)?;
        let State { film, open: Some(open), passes, stage, .. } = state else { return Ok(Stopped::AtEnd) };
        let cursor = &mut open.cursor;
        let rows = [cursor.row, cursor.row.saturating_add(rows).min(height)];
        let range = Slice { samples: [cursor.start, cursor.end], rows };
        let tallies = slice(&*integrator, points, &open.plan, film, limits, (range, features));
        if open.plan.retention == Retention::Keep {
            tallies.iter().for_each(|tally| film.splats.count(tally.samples));
        }
        add_up(film, tallies, (limits, points), &mut open.pending)?;
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
        let seconds = session.seconds();
        session.set_traced(seconds - began);
        if session.show(monitor, |monitor, status| monitor.slice(status)) == Control::Stop {
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

/// The error of a panic, which takes the film and leaves none in its place.
fn panicked((sample, message): (SampleId, String), film: &mut Film, points: &dyn PointSet) -> Error {
    let film = Box::new(std::mem::replace(film, Film::without_planes(film.frame, Needs::none())));
    Error::Panicked { sample, message, points: points.describe(), film }
}

/// Samples per pixel of the next training pass: the mean number of all samples before, so that passes double in length.
/// Follows from the plans alone, not from time.
pub(super) fn training_length(open: &OpenRound) -> u32 {
    let traced = open.before(open.cursor.start);
    let mean = (open.before + open.submitted + traced) / open.plan.counts.len() as u64;
    u32::try_from(mean).unwrap_or(u32::MAX).max(1)
}

/// Samples per pixel of a pass of an integrator that prepares for each: one for each half of the film, so that the halves can
/// have preparations of their own.
const PREPARED: usize = 2;

/// Samples per pixel of the pass from sample `start`: about [`PREPARED`] for each pixel of the image, handed to the pixels that
/// still have samples in the round. Follows from the plan alone, not from time.
pub(super) fn prepared_length(open: &OpenRound, start: u32, pixels: usize) -> u32 {
    let active = open.above(start) as usize;
    // With counts for each half, a step traces a sample of both.
    let least = if open.plan.second_half.is_some() { 1 } else { PREPARED };
    u32::try_from((PREPARED * pixels / active.max(1)).max(least)).unwrap_or(u32::MAX)
}

/// Prepares the integrator for the slice at the cursor, unless it is prepared for it. Rays and seconds go to the record,
/// but for the repetition after a resumption.
fn prepare(
    integrator: &mut dyn Integrator,
    points: &dyn PointSet,
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
    let clock = Instant::now();
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
        film.record.prepare_seconds += clock.elapsed().as_secs_f64();
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
/// Both follow from the sampling rate of this round, which took `seconds` so far. If one sample in every pixel takes
/// longer than a slice should, the slice covers only some rows. The samples per pixel then belong to the whole pass
/// over the rows.
/// `pass` are the samples per pixel of a training pass or of an integrator's pass, if there is one.
fn next_slice(
    open: &OpenRound,
    film: &Film,
    (pass, wants_training): (Option<u32>, bool),
    seconds: f64,
    limits: &Limits,
) -> (u32, u32) {
    let height = film.frame.size()[1];
    let fixed = limits.schedule.slice_spp;
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

/// The range of samples of each pixel, and the range of pixel rows, that are traced between two calls of the monitor.
#[derive(Clone, Copy)]
struct Slice {
    samples: [u32; 2],
    rows: [u32; 2],
}

/// Traces the samples of a slice in parallel, and returns what its bands report, from the top.
fn slice(
    integrator: &dyn Integrator,
    points: &dyn PointSet,
    plan: &Plan,
    film: &mut Film,
    limits: &Limits,
    (Slice { samples, rows }, features): (Slice, Turn),
) -> Vec<Tally> {
    let width = film.frame.size()[0] as usize;
    let recorders = film.recorders.active.clone();
    let round = Inputs {
        integrator,
        points,
        plan,
        width,
        origin: film.frame.origin(),
        streams: streams_of(plan.retention, film.kept.len() == 2),
        needs: film.needs,
        recorders: &recorders,
        features: features.of_film(&film.needs, plan.retention),
        wants_training: integrator.wants_training(),
        workers: Mutex::default(),
    };
    let tile = limits.schedule.tile_rows.max(1) as usize;
    let tile = if round.wants_training { tile.next_multiple_of(BLOCK) } else { tile };
    let pixels = rows.map(|row| row as usize * width);
    let mut bands = bands(film, plan.retention, (pixels, samples), tile * width);
    if limits.schedule.shuffle != 0 {
        bands.sort_by_key(|b| mix(b.first as u64 ^ limits.schedule.shuffle));
    }
    let traced = |band: Band<'_>| (band.first, trace_band(&round, band));
    let mut tallies: Vec<(usize, Tally)> = bands.into_par_iter().with_max_len(1).map(traced).collect();
    tallies.sort_by_key(|(first, _)| *first);
    tallies.into_iter().map(|(_, tally)| tally).collect()
}

/// The streams of a round's samples, for each half.
pub(super) fn streams_of(retention: Retention, halves: bool) -> [u32; 2] {
    match (retention, halves) {
        (Retention::Keep, false) => [streams::WHOLE; 2],
        (Retention::Keep, true) => streams::HALVES,
        (Retention::Discard, false) => [streams::DISCARDED; 2],
        (Retention::Discard, true) => streams::DISCARDED_HALVES,
    }
}

/// A band of rows of a film, which one task writes.
struct Band<'a> {
    /// The index of its first pixel in the window.
    first: usize,
    /// The samples of the slice: of each pixel, those from `samples[0]` to below `samples[1]`.
    samples: [u32; 2],
    banks: Vec<BankRows<'a>>,
    beside: BesideRows<'a>,
    /// The counts of each half's withdrawn samples, whose indices precede those of kept ones; empty without such samples.
    withdrawn: Vec<&'a [u64]>,
    retention: Retention,
}

impl Band<'_> {
    /// The index of a pixel's next sample in the stream of a half.
    #[inline]
    fn next_index(&self, half: usize, local: usize) -> u64 {
        let (count, withdrawn) =
            (self.banks[half].counts[local], self.withdrawn.get(half).map_or(0, |counts| counts[local]));
        if self.retention == Retention::Keep { count + withdrawn } else { count - withdrawn }
    }
}

/// Cuts some pixels of a film into bands of `size` pixels.
fn bands(
    film: &mut Film,
    retention: Retention,
    ([from, to], samples): ([usize; 2], [u32; 2]),
    size: usize,
) -> Vec<Band<'_>> {
    let pixels = film.frame.pixels();
    let banks = if retention == Retention::Keep { &mut film.kept } else { &mut film.discarded };
    let mut banks: Vec<_> = banks.iter_mut().map(|bank| bank.rows().split(from, pixels).1).collect();
    let mut beside = film.beside.rows().split(from, pixels).1;
    let mut bands = Vec::with_capacity((to - from).div_ceil(size));
    for first in (from..to).step_by(size) {
        let (size, left) = (size.min(to - first), pixels - first);
        let own = banks.iter_mut().map(|bank| {
            let (own, rest) = std::mem::take(bank).split(size, left);
            *bank = rest;
            own
        });
        let own = own.collect();
        let (of_all, rest) = beside.split(size, left);
        beside = rest;
        let withdrawn = film.withdrawn.iter().map(|counts| &counts[first..first + size]).collect();
        bands.push(Band { first, samples, banks: own, beside: of_all, withdrawn, retention });
    }
    bands
}

fn trace_band(round: &Inputs<'_>, mut band: Band<'_>) -> Tally {
    let mut tally = Tally::default();
    let current = Cell::new(None);
    let caught = catch_unwind(AssertUnwindSafe(|| {
        if round.wants_training {
            trace_blocks(round, &mut band, &mut tally, &current);
        } else {
            let mut worker = round.take_worker();
            for local in 0..band.banks[0].counts.len() {
                trace_pixel(round, &mut band, local, &mut tally, &mut worker, &current);
            }
            round.give_back(worker);
        }
    }));
    if let Err(payload) = caught {
        let message = panic_message(&*payload);
        let nowhere = SampleId::new([0; 2], 0, 0);
        tally.panicked = Some((current.get().unwrap_or(nowhere), message));
    }
    tally
}

/// The message of a panic.
pub(super) fn panic_message(payload: &(dyn Any + Send)) -> String {
    (payload.downcast_ref::<String>().cloned())
        .or_else(|| payload.downcast_ref::<&str>().map(|s| (*s).to_owned()))
        .unwrap_or_else(|| "no message".into())
}

/// Traces the band in blocks of 16x16 pixels. Training notes are summed per block, then per row of blocks, so that only
/// one sum per key and row of blocks is kept.
fn trace_blocks(round: &Inputs<'_>, band: &mut Band<'_>, tally: &mut Tally, current: &Cell<Option<SampleId>>) {
    let width = round.width;
    let rows = band.banks[0].counts.len() / width;
    let first_row = band.first / width;
    let mut worker = round.take_worker();
    for top in (0..rows).step_by(BLOCK) {
        let mut blocks = Vec::with_capacity(width.div_ceil(BLOCK));
        for left in (0..width).step_by(BLOCK) {
            for row in top..(top + BLOCK).min(rows) {
                for column in left..(left + BLOCK).min(width) {
                    trace_pixel(round, band, row * width + column, tally, &mut worker, current);
                }
            }
            blocks.push(worker.summarise());
        }
        let row = TrainingData::merge_here(&blocks);
        tally.training.push(((first_row + top) / BLOCK, row.into_entries()));
    }
    round.give_back(worker);
}

/// Traces all samples of one pixel in this slice, in index order.
#[inline]
fn trace_pixel(
    round: &Inputs<'_>,
    band: &mut Band<'_>,
    local: usize,
    tally: &mut Tally,
    worker: &mut Worker,
    current: &Cell<Option<SampleId>>,
) {
    let i = band.first + local;
    let [start, end] = band.samples;
    let first = round.plan.counts[i];
    let second = round.plan.second_half.as_ref().map_or(0, |s| s[i]);
    let last = first.max(second).min(end);
    if start >= last {
        return;
    }
    let pixel = [round.origin[0] + (i % round.width) as u32, round.origin[1] + (i / round.width) as u32];
    if !round.recorders.is_empty() {
        let rest = round.plan.second_half.as_ref().map(|_| second.saturating_sub(start));
        reserve(&mut band.banks, local, (first.saturating_sub(start), rest), round.recorders);
    }
    if round.features != Turn::Never
        && round.features.is_now(
            &band.beside.features[local],
            band.banks.iter().map(|bank| bank.counts[local]).sum(),
            start == 0,
        )
    {
        let cost = feature_samples::add(&mut band.beside.features[local], round.points, pixel, &round.needs, |draws| {
            current.set(Some(draws.id()));
            round.integrator.features_alone(draws)
        });
        tally.rays += cost.rays;
        tally.blocks += cost.blocks;
    }
    let alternate = band.banks.len() == 2 && round.plan.second_half.is_none();
    for step in start..last {
        if alternate {
            let half = usize::from(band.banks[1].counts[local] < band.banks[0].counts[local]);
            trace_sample(round, band, Place { local, pixel, half }, tally, worker, current);
        } else {
            if step < first {
                trace_sample(round, band, Place { local, pixel, half: 0 }, tally, worker, current);
            }
            if step < second {
                trace_sample(round, band, Place { local, pixel, half: 1 }, tally, worker, current);
            }
        }
    }
}

/// A pixel's index in the band, its coordinates in the full image, and the half of the current sample.
#[derive(Clone, Copy)]
struct Place {
    local: usize,
    pixel: [u32; 2],
    half: usize,
}

#[inline]
fn trace_sample(
    round: &Inputs<'_>,
    band: &mut Band<'_>,
    Place { local, pixel, half }: Place,
    tally: &mut Tally,
    worker: &mut Worker,
    current: &Cell<Option<SampleId>>,
) {
    let id = SampleId::new(pixel, round.streams[half], band.next_index(half, local));
    current.set(Some(id));
    let draws = Draws::for_film(round.points, id, round.needs);
    let estimate = round.integrator.estimate(&draws, worker);
    let bank = &mut band.banks[half];
    if let Some(reason) = bank.add(local, &estimate, round.recorders) {
        tally.reject(Rejected { sample: id, reason }, estimate.radiance);
    }
    if worker.has_splats() {
        worker.take_splats().for_each(|(to, radiance)| tally.splat(round, id, (half, to, radiance)));
    }
    tally.samples[half] += 1;
    tally.rays += u64::from(estimate.cost);
    tally.blocks += u64::from(draws.blocks_requested());
    if round.needs.wants_first_hit() {
        // Kept and discarded samples fill the places in the order of tracing. This bank's indices give the next place,
        // as long as all rounds have the same retention, which is usual.
        let seen = (0..band.banks.len()).map(|half| band.next_index(half, local)).sum::<u64>() - 1;
        let (BesideRows { features, half_features, first_hits, .. }, k) =
            (&mut band.beside, usize::from(round.needs.first_hits));
        let features = [features.get_mut(local), half_features.get_mut(2 * local + half)];
        record_first_hit(features, &mut first_hits[k * local..k * (local + 1)], seen, &estimate);
    }
    if let Some(cost) = band.beside.costs.get_mut(local) {
        *cost += u64::from(estimate.cost);
    }
}

impl Tally {
    /// Keeps a splat of a sample that enters the image, if the film records splats.
    #[cold]
    fn splat(&mut self, round: &Inputs<'_>, id: SampleId, splat: (usize, [u32; 2], [f32; 3])) {
        if round.needs.splats && round.plan.retention == Retention::Keep {
            match Splats::reason_to_reject(splat.2) {
                Some(reason) => self.reject(Rejected { sample: id, reason }, splat.2),
                None => self.splats.push(splat),
            }
        }
    }

    /// Counts and lists a rejected sample. Outlined because it is rare. The list holds at most twice as many samples as
    /// the film's list.
    #[cold]
    #[inline(never)]
    fn reject(&mut self, rejected: Rejected, value: [f32; 3]) {
        self.rejections += 1;
        self.first_rejected.get_or_insert((rejected.sample, value));
        self.rejected.push(rejected);
        if self.rejected.len() == 2 * REJECTED_LISTED {
            keep_first(&mut self.rejected);
        }
    }
}

/// Adds the tallies of a slice to the film, in the order of bands.
///
/// # Errors
///
/// For a panic, and for a rejected sample if the limits refuse such.
fn add_up(
    film: &mut Film,
    tallies: Vec<Tally>,
    (limits, points): (&Limits, &dyn PointSet),
    pending: &mut Vec<(usize, Vec<TrainingSum>)>,
) -> Result<(), Error> {
    let mut first_panic = None;
    for tally in tallies {
        film.record.samples += tally.samples.iter().sum::<u64>();
        film.record.rays += tally.rays;
        film.record.blocks += tally.blocks;
        film.add_splats(tally.splats);
        if limits.invalid == InvalidSample::Fail
            && let Some((sample, value)) = tally.first_rejected
        {
            return Err(Error::InvalidSample { sample, value, points: points.describe() });
        }
        if tally.rejections > 0 {
            film.list_rejected(tally.rejections, tally.rejected);
        }
        pending.extend(tally.training);
        first_panic = first_panic.or(tally.panicked);
    }
    first_panic.map_or(Ok(()), |panic| Err(panicked(panic, film, points)))
}
