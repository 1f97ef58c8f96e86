//! Tracing one round: slices of bands of rows.

use super::session::State;
use super::{Monitor, Session, prepare};
use crate::allocate::mix;
use crate::film::{
    Bank, BankRows, FeatureMoments, REJECTED_LISTED, SampleRows, Splats, SumRows, first_hits_of, keep_first,
    record_first_hit, reserve_samples,
};
use crate::integrator::TrainingSum;
use crate::snapshot::{Cursor, OpenRound};
use crate::{
    Control, Draws, Error, Film, FirstHit, Integrator, InvalidSample, Limits, Needs, Plan, PointSet, Prepares,
    Rejected, Retention, SampleId, TrainingData, Worker, streams,
};
use rayon::prelude::*;
use std::any::Any;
use std::cell::Cell;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::slice::ChunksMut;
use std::sync::{Mutex, PoisonError};

/// The side, in pixels, of the blocks in which training data is summed.
const BLOCK: usize = 16;
/// The target duration in seconds of a slice, the work between two calls of the monitor. A single row of pixels may
/// take longer.
const SLICE_SECONDS: f64 = 0.2;
/// The number of samples in a round's first slice. It takes a millisecond at 1 us per sample, and a second at 1 ms per
/// sample.
const FIRST_SLICE: f64 = 1024.0;
/// The largest number of samples in a slice, as a multiple of the samples already traced in the round.
const GROWTH: f64 = 8.0;

/// The inputs that all tasks of a slice share: integrator, points, plan and flags.
struct Inputs<'a> {
    integrator: &'a dyn Integrator,
    points: &'a dyn PointSet,
    plan: &'a Plan,
    width: usize,
    origin: [u32; 2],
    streams: [u32; 2],
    needs: Needs,
    wants_training: bool,
    /// The samples that this slice traces in each pixel: first index and end, counted from the start of the round.
    part: [u32; 2],
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

/// A band of rows: the pixels that one task writes.
struct Band<'a> {
    /// The index, in the window, of the band's first pixel.
    first: usize,
    banks: Vec<BankRows<'a>>,
    features: &'a mut [FeatureMoments],
    /// Two per pixel, one for each half.
    half_features: &'a mut [FeatureMoments],
    first_hits: &'a mut [Option<FirstHit>],
    costs: &'a mut [u64],
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

/// Traces the rest of the open round into the film.
pub(super) fn trace(
    integrator: &mut dyn Integrator,
    session: &mut Session<'_>,
    monitor: &mut dyn Monitor,
) -> Result<Stopped, Error> {
    let began = session.began();
    let height = session.state.film.frame.size()[1];
    loop {
        let seconds = session.seconds() - began;
        let Session { state, sampler, limits, .. } = &mut *session;
        let Some(open) = &mut state.open else { return Ok(Stopped::AtEnd) };
        let (points, longest) = (sampler.points(), longest_pixel(&open.plan));
        if open.cursor.start >= longest {
            return Ok(Stopped::No);
        }
        let wants_training = integrator.wants_training();
        let pass = match (wants_training, integrator.prepares()) {
            (true, _) => Some(pass_length(&state.film)),
            (false, Prepares::EveryPass) => Some(prepare::pass_length(open, state.film.frame.pixels())),
            _ => None,
        };
        let (length, rows) = next_slice(open, &state.film, (pass, wants_training), seconds, limits);
        let begins = open.cursor.row == 0;
        if begins {
            open.cursor.end = open.cursor.start.saturating_add(length).min(longest);
        }
        prepare::prepare(&mut *integrator, points, state, begins)?;
        let State { film, open: Some(open), passes, .. } = state else { return Ok(Stopped::AtEnd) };
        let cursor = &mut open.cursor;
        let rows = [cursor.row, cursor.row.saturating_add(rows).min(height)];
        let range = Slice { samples: [cursor.start, cursor.end], rows };
        let tallies = slice(&*integrator, points, &open.plan, film, limits, range);
        if open.plan.retention == Retention::Keep {
            tallies.iter().for_each(|tally| film.splats.count(tally.samples));
        }
        let panicked = add_up(film, tallies, limits, points, &mut open.pending)?;
        if let Some((sample, message)) = panicked {
            let film = Box::new(std::mem::replace(film, Film::new(*film.frame(), crate::Needs::none())));
            return Err(Error::Panicked { sample, message, points: points.describe(), film });
        }
        cursor.row = rows[1] % height;
        if cursor.row == 0 {
            cursor.start = cursor.end;
            let mut pending = std::mem::take(&mut open.pending);
            if wants_training {
                pending.sort_by_key(|(row, _)| *row);
                let rows: Vec<_> = pending.into_iter().map(|(_, sums)| sums).collect();
                let pass = TrainingData::merge(&rows);
                integrator.learn(&pass);
                passes.push(pass);
            }
        }
        let more = open.cursor.start < longest;
        let seconds = session.seconds();
        session.set_traced(seconds - began);
        if session.show(monitor, |monitor, status| monitor.slice(status)) == Control::Stop {
            return Ok(if more { Stopped::Within } else { Stopped::AtEnd });
        }
    }
}

fn longest_pixel(plan: &Plan) -> u32 {
    let second = plan.second_half.iter().flatten();
    plan.counts.iter().chain(second).copied().max().unwrap_or(0)
}

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
    let second = open.plan.second_half.iter().flatten();
    let active = open.plan.counts.iter().chain(second).filter(|&&n| n > start).count() as f64;
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

/// Samples per pixel of the next training pass: the mean number of all samples before, so that passes double in length.
/// Depends on the plans only, not on time.
fn pass_length(film: &Film) -> u32 {
    let mean = film.record.samples / film.frame.pixels() as u64;
    u32::try_from(mean).unwrap_or(u32::MAX).max(1)
}

/// The range of samples of each pixel, and the range of pixel rows, that are traced between two calls of the monitor.
#[derive(Clone, Copy)]
struct Slice {
    samples: [u32; 2],
    rows: [u32; 2],
}

fn slice(
    integrator: &dyn Integrator,
    points: &dyn PointSet,
    plan: &Plan,
    film: &mut Film,
    limits: &Limits,
    Slice { samples: part, rows }: Slice,
) -> Vec<Tally> {
    let [width, _] = film.frame.size().map(|n| n as usize);
    let halves = film.kept.len() == 2;
    let round = Inputs {
        integrator,
        points,
        plan,
        width,
        origin: film.frame.origin(),
        streams: match (plan.retention, halves) {
            (Retention::Keep, false) => [streams::WHOLE; 2],
            (Retention::Keep, true) => streams::HALVES,
            (Retention::Discard, false) => [streams::DISCARDED; 2],
            (Retention::Discard, true) => streams::DISCARDED_HALVES,
        },
        needs: film.needs,
        wants_training: integrator.wants_training(),
        part,
        workers: Mutex::default(),
    };
    let tile = limits.schedule.tile_rows.max(1) as usize;
    let tile = if round.wants_training { tile.next_multiple_of(BLOCK) } else { tile };
    let [top, bottom] = rows.map(|row| row as usize * width);
    let mut bands = bands(film, plan.retention, top..bottom, tile * width);
    if limits.schedule.shuffle != 0 {
        bands.sort_by_key(|b| mix(b.first as u64 ^ limits.schedule.shuffle));
    }
    let mut tallies: Vec<(usize, Tally)> =
        bands.into_par_iter().with_max_len(1).map(|band| (band.first, trace_band(&round, band))).collect();
    tallies.sort_by_key(|(first, _)| *first);
    tallies.into_iter().map(|(_, tally)| tally).collect()
}

/// Splits the given pixels of the film into bands of `size` pixels each.
fn bands(film: &mut Film, retention: Retention, pixels: Range<usize>, size: usize) -> Vec<Band<'_>> {
    let k = usize::from(film.needs.first_hits);
    let banks = if retention == Retention::Keep { &mut film.kept } else { &mut film.discarded };
    let each = usize::from(film.needs.channels);
    let wide = pixels.start * each..pixels.end * each;
    let kinds = film.needs.sums.values();
    let wider = pixels.start * kinds..pixels.end * kinds;
    let mut banks: Vec<_> = banks
        .iter_mut()
        .map(|Bank { counts, means, m2, ranges, emission, channels, channels_m2, sums: plane, samples, ahead }| {
            let sums = (chunks(counts, &pixels, size), chunks(means, &pixels, size), chunks(m2, &pixels, size));
            let ahead = if ahead.is_empty() { &[][..] } else { &ahead[pixels.clone()] };
            let more = (chunks(ranges, &pixels, size), chunks(emission, &pixels, size));
            let beside = (chunks(channels, &wide, size * each.max(1)), chunks(channels_m2, &wide, size * each.max(1)));
            let plane = (plane.kinds, chunks(&mut plane.values, &wider, size * kinds.max(1)));
            let paths = chunks(&mut samples.trajectories, &pixels, size);
            let samples = (samples.limit, chunks(&mut samples.rows, &pixels, size), paths);
            (sums, more, beside, (plane, samples), ahead.chunks(size))
        })
        .collect();
    let mut features = chunks(&mut film.features, &pixels, size);
    let mut half_features = chunks(&mut film.half_features, &(2 * pixels.start..2 * pixels.end), 2 * size);
    let mut first_hits = chunks(&mut film.first_hits, &(pixels.start * k..pixels.end * k), size * k.max(1));
    let mut costs = chunks(&mut film.costs, &pixels, size);
    pixels
        .step_by(size)
        .map(|first| Band {
            first,
            banks: banks
                .iter_mut()
                .map(|((counts, means, m2), (ranges, emission), (channels, channels_m2), (sums, samples), ahead)| {
                    BankRows {
                        counts: counts.next().unwrap_or_default(),
                        means: means.next().unwrap_or_default(),
                        m2: m2.next().unwrap_or_default(),
                        ranges: ranges.next().unwrap_or_default(),
                        emission: emission.next().unwrap_or_default(),
                        channels: channels.next().unwrap_or_default(),
                        channels_m2: channels_m2.next().unwrap_or_default(),
                        sums: SumRows { kinds: sums.0, values: sums.1.next().unwrap_or_default() },
                        samples: SampleRows::next(samples.0, &mut samples.1, &mut samples.2),
                        ahead: ahead.next().unwrap_or_default(),
                    }
                })
                .collect(),
            features: features.next().unwrap_or_default(),
            half_features: half_features.next().unwrap_or_default(),
            first_hits: first_hits.next().unwrap_or_default(),
            costs: costs.next().unwrap_or_default(),
        })
        .collect()
}

/// Splits the given pixels of a plane into chunks of `size`; no chunks if the film does not record the plane.
fn chunks<'a, T>(plane: &'a mut [T], pixels: &Range<usize>, size: usize) -> ChunksMut<'a, T> {
    let share = if plane.is_empty() { plane } else { &mut plane[pixels.clone()] };
    share.chunks_mut(size)
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
    let [start, end] = round.part;
    let first = round.plan.counts[i];
    let second = round.plan.second_half.as_ref().map_or(0, |s| s[i]);
    let last = first.max(second).min(end);
    if start >= last {
        return;
    }
    let pixel = [round.origin[0] + (i % round.width) as u32, round.origin[1] + (i / round.width) as u32];
    if round.needs.samples > 0 {
        let rest = round.plan.second_half.as_ref().map(|_| second.saturating_sub(start));
        reserve_samples(&mut band.banks, local, (first.saturating_sub(start), rest));
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
    let bank = &mut band.banks[half];
    let id = SampleId::new(pixel, round.streams[half], bank.next_index(local));
    current.set(Some(id));
    let draws = Draws::of_round(round.points, id, &round.needs);
    let channels = usize::from(round.needs.channels);
    if channels > 0 {
        worker.begin_channels(channels);
    }
    let estimate = round.integrator.estimate(&draws, worker);
    if let Some(reason) = bank.add(local, &estimate) {
        tally.reject(Rejected { sample: id, reason }, estimate.radiance);
    }
    if channels > 0 {
        bank.add_channels(local, worker.channels());
    }
    if worker.has_splats() {
        worker.take_splats().for_each(|(to, radiance)| tally.splat(round, id, (half, to, radiance)));
    }
    tally.samples[half] += 1;
    tally.rays += u64::from(estimate.cost);
    tally.blocks += u64::from(draws.blocks_requested());
    if round.needs.wants_first_hit() {
        let Band { banks, features, half_features, first_hits, .. } = band;
        // Kept and discarded samples fill the places in the order of tracing. This bank's indices give the next place,
        // as long as all rounds have the same retention, which is usual.
        let seen = banks.iter().map(|b| b.next_index(local)).sum::<u64>() - 1;
        let hits = first_hits_of(first_hits, local, usize::from(round.needs.first_hits));
        let features = [features.get_mut(local), half_features.get_mut(2 * local + half)];
        record_first_hit(features, hits, seen, &estimate);
    }
    if let Some(cost) = band.costs.get_mut(local) {
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

/// Adds the results of tasks to the film, in the order of the bands. Returns the sample and message of the first panic,
/// if there was one.
fn add_up(
    film: &mut Film,
    tallies: Vec<Tally>,
    limits: &Limits,
    points: &dyn PointSet,
    pending: &mut Vec<(usize, Vec<TrainingSum>)>,
) -> Result<Option<(SampleId, String)>, Error> {
    let mut panicked = None;
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
        panicked = panicked.or(tally.panicked);
    }
    Ok(panicked)
}
