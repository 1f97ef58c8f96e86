//! Tracing one round: slices of bands of rows.

use super::band::{Band, bands};
use super::feature_samples::{self, Turn};
use super::meeting::is_free;
use super::session::State;
use super::slicing::{next_slice, pass_length};
use super::team::Team;
use super::{Monitor, Session, prepare};
use crate::allocate::mix;
use crate::bands::BAND;
use crate::exchange::message::Standing;
use crate::film::{REJECTED_LISTED, Splats, first_hits_of, keep_first, record_first_hit, reserve_samples};
use crate::integrator::TrainingSum;
use crate::{
    Control, Draws, Error, Film, Integrator, InvalidSample, Limits, Needs, Plan, PointSet, Prepares, Rejected,
    Retention, SampleId, TrainingData, Worker, streams,
};
use rayon::prelude::*;
use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// The side, in pixels, of the blocks in which training data is summed.
pub(super) const BLOCK: usize = BAND;
/// The inputs that all tasks of a slice share: integrator, points, plan and flags.
struct Inputs<'a> {
    integrator: &'a dyn Integrator,
    points: &'a dyn PointSet,
    plan: &'a Plan,
    width: usize,
    origin: [u32; 2],
    streams: [u32; 2],
    needs: Needs,
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
    /// The time that it took; 0 unless several processes share the image.
    nanoseconds: u64,
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

/// Traces the rest of the open round into the film: all of it, or the bands of this process.
pub(super) fn trace(
    integrator: &mut dyn Integrator,
    session: &mut Session<'_>,
    monitor: &mut dyn Monitor,
    mut team: Option<&mut Team<'_>>,
) -> Result<Stopped, Error> {
    let began = session.began();
    let height = session.state.film.frame.size()[1];
    loop {
        let seconds = session.seconds() - began;
        let Session { state, sampler, limits, training, meter, .. } = &mut *session;
        let features = meter.features(state.round);
        let Some(open) = &mut state.open else { return Ok(Stopped::AtEnd) };
        let points = sampler.points();
        let longest = team.as_deref().map_or_else(|| open.longest(), |team| team.longest(open));
        if open.cursor.start >= longest {
            return Ok(Stopped::No);
        }
        let wants_training = integrator.wants_training();
        let pass = match (wants_training, integrator.prepares()) {
            (true, _) => Some(pass_length(open)),
            (false, Prepares::EveryPass) => Some(prepare::pass_length(open, state.film.frame.pixels())),
            _ => None,
        };
        let (length, rows) = next_slice(open, &state.film, (pass, wants_training), seconds, (limits, team.as_deref()));
        let begins = open.cursor.row == 0;
        if begins {
            open.cursor.end = open.cursor.start.saturating_add(length).min(longest);
        }
        prepare::prepare(&mut *integrator, points, (&mut *state, team.as_deref_mut()), begins)?;
        let State { film, open: Some(open), passes, .. } = state else { return Ok(Stopped::AtEnd) };
        let cursor = &mut open.cursor;
        let rows = [cursor.row, cursor.row.saturating_add(rows).min(height)];
        let range = Slice { samples: [cursor.start, cursor.end], rows };
        let tallies = slice(&*integrator, points, &open.plan, film, (limits, team.as_deref_mut()), (range, features));
        if open.plan.retention == Retention::Keep {
            tallies.iter().for_each(|tally| film.splats.count(tally.samples));
        }
        let trouble = add_up(film, tallies, limits, &mut open.pending);
        if let Some(trouble) = trouble {
            let Some(team) = team else { return Err(failed(trouble, film, points)) };
            team.set_standing(trouble);
            if wants_training {
                team.pass(film, (state.round, open), Vec::new())?;
            } else if is_free(&*integrator) && team.will_meet() {
                team.meet(film, state.round, open)?;
            }
            return Ok(Stopped::Within);
        }
        cursor.row = rows[1] % height;
        if cursor.row == 0 {
            cursor.start = cursor.end;
            let mut pending = std::mem::take(&mut open.pending);
            if wants_training {
                if let Some(team) = &mut team {
                    match team.pass(film, (state.round, open), pending)? {
                        Some(of_all) => pending = of_all,
                        // Another process stopped or failed.
                        None => return Ok(Stopped::Within),
                    }
                }
                pending.sort_by_key(|(row, _)| *row);
                let rows: Vec<_> = pending.into_iter().map(|(_, sums)| sums).collect();
                let pass = training.get(passes.len()).cloned().unwrap_or_else(|| TrainingData::merge(&rows));
                integrator.learn(&pass);
                passes.push(pass);
            }
        }
        let mut more = open.cursor.start < longest;
        if let Some(team) = team.as_deref_mut().filter(|_| !wants_training && is_free(&*integrator)) {
            if !team.meet_in_time(film, state.round, open)? {
                return Ok(Stopped::Within);
            }
            more = open.cursor.start < team.longest(open);
        }
        if wants_training && open.cursor.row == 0 && team.as_ref().is_some_and(|team| team.is_staged()) {
            // The next pass is a stage of its own.
            return Ok(if more { Stopped::Within } else { Stopped::No });
        }
        let seconds = session.seconds();
        session.set_traced(seconds - began);
        session.everyones = team.as_ref().map(|team| team.estimate(session.state.film.record.samples));
        if session.show(monitor, |monitor, status| monitor.slice(status)) == Control::Stop {
            let State { film, round, open, .. } = &mut session.state;
            if let (Some(team), Some(open)) = (team, open) {
                team.set_standing(Standing::Stopped);
                // The others' next message is that of a pass, unless none is to come in this round.
                if more && integrator.wants_training() {
                    team.pass(film, (*round, open), Vec::new())?;
                } else if more && is_free(integrator) && team.will_meet() {
                    team.meet(film, *round, open)?;
                }
            }
            return Ok(if more { Stopped::Within } else { Stopped::AtEnd });
        }
    }
}

/// The error for a panic or an invalid sample. A panic's carries the film.
pub(super) fn failed(trouble: Standing, film: &mut Film, points: &dyn PointSet) -> Error {
    match trouble {
        Standing::Invalid(sample, value) => Error::InvalidSample { sample, value, points: points.describe() },
        Standing::Panicked(sample, message) => {
            let film = Box::new(std::mem::replace(film, Film::without_planes(film.frame, Needs::none())));
            Error::Panicked { sample, message, points: points.describe(), film }
        }
        Standing::Going | Standing::Stopped => Error::Gone { what: "it stopped".into() },
    }
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
    (limits, mut team): (&Limits, Option<&mut Team<'_>>),
    (Slice { samples, rows }, features): (Slice, Turn),
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
        features: features.of_film(&film.needs, plan.retention),
        wants_training: integrator.wants_training(),
        workers: Mutex::default(),
    };
    let tile = limits.schedule.tile_rows.max(1) as usize;
    let tile = match &team {
        Some(_) if tile >= BLOCK || round.wants_training => BLOCK,
        Some(_) => 1,
        None if round.wants_training => tile.next_multiple_of(BLOCK),
        None => tile,
    };
    let [top, bottom] = rows.map(|row| row as usize * width);
    let mut bands = bands(film, plan.retention, (top..bottom, samples), tile * width);
    if let Some(team) = &team {
        bands.retain(|band| team.owns(band.first / width));
        bands.iter_mut().for_each(|band| band.samples = team.shifted(band.first / width, samples));
    }
    if limits.schedule.shuffle != 0 {
        bands.sort_by_key(|b| mix(b.first as u64 ^ limits.schedule.shuffle));
    }
    let is_timed = team.is_some();
    let timed = |band: Band<'_>| {
        let (first, clock) = (band.first, is_timed.then(Instant::now));
        let tally = trace_band(&round, band);
        (first, Tally { nanoseconds: clock.map_or(0, |clock| clock.elapsed().as_nanos() as u64), ..tally })
    };
    let mut tallies: Vec<(usize, Tally)> = bands.into_par_iter().with_max_len(1).map(timed).collect();
    tallies.sort_by_key(|(first, _)| *first);
    if let Some(team) = &mut team {
        tallies.iter().for_each(|(first, tally)| team.add_time(first / width, tally.nanoseconds));
    }
    tallies.into_iter().map(|(_, tally)| tally).collect()
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
    if round.needs.samples > 0 {
        let rest = round.plan.second_half.as_ref().map(|_| second.saturating_sub(start));
        reserve_samples(&mut band.banks, local, (first.saturating_sub(start), rest));
    }
    if round.features != Turn::Never
        && round.features.is_now(
            &band.features[local],
            band.banks.iter().map(|bank| bank.counts[local]).sum(),
            start == 0,
        )
    {
        let cost = feature_samples::add(&mut band.features[local], round.points, pixel, &round.needs, |draws| {
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

/// Adds the results of tasks to the film, in the order of the bands. Returns the first panic or, if invalid samples are
/// refused, the first invalid sample.
fn add_up(
    film: &mut Film,
    tallies: Vec<Tally>,
    limits: &Limits,
    pending: &mut Vec<(usize, Vec<TrainingSum>)>,
) -> Option<Standing> {
    let mut panicked = None;
    for tally in tallies {
        film.record.samples += tally.samples.iter().sum::<u64>();
        film.record.rays += tally.rays;
        film.record.blocks += tally.blocks;
        film.add_splats(tally.splats);
        if limits.invalid == InvalidSample::Fail
            && let Some((sample, value)) = tally.first_rejected
        {
            return Some(Standing::Invalid(sample, value));
        }
        if tally.rejections > 0 {
            film.list_rejected(tally.rejections, tally.rejected);
        }
        pending.extend(tally.training);
        panicked = panicked.or(tally.panicked);
    }
    panicked.map(|(sample, message)| Standing::Panicked(sample, message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Frame, HostNumbers};

    /// The error takes the film; a second one of its size would double the memory of a render that failed.
    #[test]
    fn a_panic_takes_the_film_and_leaves_none_in_its_place() {
        let mut film = Film::new(Frame::new(64, 48).unwrap(), Needs::none());
        let all = film.bytes();
        let panicked = Standing::Panicked(SampleId::new([0; 2], 0, 0), "broken".into());
        match failed(panicked, &mut film, &HostNumbers) {
            Error::Panicked { film: taken, .. } => assert_eq!(taken.bytes(), all),
            other => panic!("{other}"),
        }
        assert!(film.kept.is_empty() && film.features.is_empty());
    }
}
