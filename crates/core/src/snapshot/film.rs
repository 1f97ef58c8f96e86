//! Encoding of films as bytes.

use super::Broken;
use super::bytes::{Reader, Writer};
use super::decode::{take_bank, take_beside};
use super::planes::{put_bank, put_beside};
use crate::bands::{BAND, bands};
use crate::film::{Bank, HeldRows, Picked, REJECTED_LISTED, Splats};
use crate::{
    Combine, Film, Frame, Needs, Record, Rejected, RejectedReason, RoundRecord, SampleId, Sums, TrainingSum, Trajectory,
};
use std::ops::Range;

/// The approximate number of bytes that encode a film.
pub(crate) fn size(film: &Film) -> usize {
    let discarded = if film.discarded.is_empty() { 0 } else { Film::bytes_per_pixel(&film.needs) };
    let pixels = film.kept[0].counts.len();
    pixels * (Film::bytes_per_pixel(&film.needs) + discarded)
        + if film.needs.trajectories { 28 } else { 12 } * film.samples_kept()
        + 4096
}

pub(crate) fn put_film(to: &mut Writer, film: &Film) {
    put_film_head(to, film);
    film.kept.iter().for_each(|bank| put_bank(to, bank));
    to.flag(!film.discarded.is_empty());
    film.discarded.iter().for_each(|bank| put_bank(to, bank));
    put_beside(to, film);
    put_film_end(to, film);
}

/// Writes what precedes the planes.
pub(super) fn put_film_head(to: &mut Writer, film: &Film) {
    put_frame(to, &film.frame);
    put_needs(to, &film.needs);
    put_combine(to, film.combine);
    put_record(to, &film.record);
    put_rejected(to, &film.rejected);
}

/// Writes what follows the planes.
pub(super) fn put_film_end(to: &mut Writer, film: &Film) {
    film.splats.sums.iter().for_each(|sums| to.numbers(sums));
    to.number(film.splats.samples);
    to.number(film.unreported);
}

/// Reads a film whose planes have `pixels(frame)` pixels, fewer than the frame's for a shard.
pub(crate) fn take_film(from: &mut Reader<'_>, pixels: impl FnOnce(&Frame) -> usize) -> Result<Film, Broken> {
    let film = take_unchecked(from, pixels)?;
    check(&film)?;
    Ok(film)
}

/// The planes of each band of 16 rows as bytes.
pub(crate) fn put_bands(film: &Film) -> Vec<Vec<u8>> {
    let planes = |band| {
        let part = film.pick(Picked(&numbers_of(&film.frame, band)), None);
        let mut to = Writer::with_capacity(size(&part));
        part.kept.iter().chain(&part.discarded).for_each(|bank| put_bank(&mut to, bank));
        put_beside(&mut to, &part);
        to.finish()
    };
    (0..bands(film.frame.size()[1] as usize)).map(planes).collect()
}

/// Reads a film without planes, and puts the planes of some bands into it. It does not hold other bands.
pub(crate) fn take_in_bands(from: &mut Reader<'_>, given: &[(usize, Vec<u8>)]) -> Result<Film, Broken> {
    let hollow = take_unchecked(from, |_| 0)?;
    let (needs, frame, all) = (hollow.needs, hollow.frame, hollow.record.samples);
    let is_whole = given.len() == bands(frame.size()[1] as usize);
    let held = if is_whole { HeldRows::default() } else { held(&frame, given)? };
    let mut film = Film::of_held(frame, needs, held);
    if !hollow.discarded.is_empty() {
        film.open_discarded();
    }
    let (kept, discarded) = (hollow.kept.len(), hollow.discarded.len());
    (film.combine, film.record, film.rejected) = (hollow.combine, hollow.record, hollow.rejected);
    (film.splats, film.unreported) = (hollow.splats, hollow.unreported);
    let mut samples = 0_u64;
    for (band, bytes) in given {
        let numbers = numbers_of(&frame, *band);
        let mut from = Reader::new(bytes);
        let mut part = Film::without_planes(frame, needs);
        let mut banks = |count: usize| -> Result<Vec<Bank>, Broken> {
            (0..count).map(|_| take_bank(&mut from, numbers.len(), &needs)).collect()
        };
        (part.kept, part.discarded) = (banks(kept)?, banks(discarded)?);
        for bank in part.kept.iter().chain(&part.discarded) {
            samples = samples.checked_add(check_bank(bank, all)?).ok_or(Broken("counts overflow"))?;
        }
        take_beside(&mut from, &mut part, numbers.len())?;
        if !from.is_empty() || !film.place(Picked(&numbers), part) {
            return Err(Broken("a band is of another size"));
        }
    }
    if samples > all || is_whole && samples != all || film.unreported > all {
        return Err(Broken("counts do not add up to the samples traced"));
    }
    Ok(film)
}

/// The rows of the bands of a list.
fn held(frame: &Frame, given: &[(usize, Vec<u8>)]) -> Result<HeldRows, Broken> {
    let height = frame.size()[1] as usize;
    if given.windows(2).any(|two| two[0].0 >= two[1].0) || given.iter().any(|(band, _)| *band >= bands(height)) {
        return Err(Broken("bands of the film are out of order"));
    }
    let runs: Vec<_> = given.iter().map(|(band, _)| band * BAND..((band + 1) * BAND).min(height)).collect();
    Ok(HeldRows::some(frame, &runs, &[]))
}

/// The numbers of the pixels of a band of 16 rows.
fn numbers_of(frame: &Frame, band: usize) -> Vec<u32> {
    let (width, pixels) = (frame.size()[0] as usize, frame.pixels());
    ((band * BAND * width).min(pixels)..((band + 1) * BAND * width).min(pixels)).map(|i| i as u32).collect()
}

fn take_unchecked(from: &mut Reader<'_>, pixels: impl FnOnce(&Frame) -> usize) -> Result<Film, Broken> {
    let mut film = take_film_head(from)?;
    let (pixels, needs) = (pixels(&film.frame), film.needs);
    let halves = if needs.halves { 2 } else { 1 };
    let banks = |from: &mut Reader<'_>| -> Result<Vec<Bank>, Broken> {
        (0..halves).map(|_| take_bank(from, pixels, &needs)).collect()
    };
    film.kept = banks(from)?;
    film.discarded = if from.flag()? { banks(from)? } else { Vec::new() };
    take_beside(from, &mut film, pixels)?;
    take_film_end(from, &mut film)?;
    Ok(film)
}

/// Reads what precedes the planes, as a film without planes.
pub(super) fn take_film_head(from: &mut Reader<'_>) -> Result<Film, Broken> {
    let frame = take_frame(from)?;
    let needs = take_needs(from)?;
    let combine = take_combine(from)?;
    let record = take_record(from)?;
    let rejected = take_rejected(from)?;
    Ok(Film { combine, record, rejected, ..Film::without_planes(frame, needs) })
}

/// Reads what follows the planes.
pub(super) fn take_film_end(from: &mut Reader<'_>, film: &mut Film) -> Result<(), Broken> {
    let planes = if film.needs.splats { film.kept.len() } else { 0 };
    let sums = (0..planes).map(|_| from.numbers(film.frame.pixels())).collect::<Result<_, _>>()?;
    film.splats = Splats { sums, samples: from.number()? };
    film.unreported = from.number()?;
    Ok(())
}

/// Checks the invariants that readers of a film rely on, such as finite means.
fn check(film: &Film) -> Result<(), Broken> {
    check_counts(film, check_banks(film)?)
}

/// Checks all banks; returns the sum of their counts.
pub(super) fn check_banks(film: &Film) -> Result<u64, Broken> {
    let mut samples = film.kept.iter().chain(&film.discarded).map(|bank| check_bank(bank, film.record.samples));
    samples.try_fold(0_u64, |sum, more| sum.checked_add(more?).ok_or(Broken("counts overflow")))
}

/// Compares the sum of all counts with the record.
pub(super) fn check_counts(film: &Film, samples: u64) -> Result<(), Broken> {
    if film.unreported > samples {
        return Err(Broken("more samples report no hits than there are"));
    }
    if samples != film.record.samples {
        return Err(Broken("counts do not add up to the samples traced"));
    }
    Ok(())
}

/// Checks the invariants of a bank in a film of `all` samples; returns the sum of its counts.
pub(crate) fn check_bank(bank: &Bank, all: u64) -> Result<u64, Broken> {
    check_pixels(bank, &(0..bank.counts.len()), all)
}

/// Checks the invariants of some pixels of a bank, by their places, in a film of `all` samples; returns the sum of their counts.
pub(crate) fn check_pixels(bank: &Bank, pixels: &Range<usize>, all: u64) -> Result<u64, Broken> {
    fn cut<'p, T>(plane: &'p [T], bank: &Bank, pixels: &Range<usize>) -> &'p [T] {
        let each = plane.len() / bank.counts.len().max(1);
        &plane[pixels.start * each..pixels.end * each]
    }
    let mut samples = 0_u64;
    for i in pixels.clone() {
        let (count, ahead) = (bank.counts[i], bank.ahead.get(i).copied().unwrap_or(0));
        samples = samples.checked_add(count).ok_or(Broken("counts overflow"))?;
        if count.checked_add_signed(ahead).is_none() || ahead.unsigned_abs() > all {
            return Err(Broken("an index is out of range"));
        }
    }
    let of = |plane| cut(plane, bank, pixels);
    let mut sums = of(&bank.means).iter().chain(of(&bank.m2)).chain(of(&bank.sums.values)).flatten();
    let samples_kept = cut(&bank.samples.rows, bank, pixels).iter().flatten();
    let single = cut(&bank.emission, bank, pixels).iter().chain(samples_kept).flatten();
    let mut single = single.chain(cut(&bank.channels, bank, pixels)).chain(cut(&bank.channels_m2, bank, pixels));
    if !(sums.all(|v| v.is_finite()) && single.all(|v| v.is_finite())) {
        return Err(Broken("a mean is NaN or infinite"));
    }
    if !cut(&bank.samples.trajectories, bank, pixels).iter().flatten().all(Trajectory::is_sound) {
        return Err(Broken("a trajectory is NaN, infinite or behind the camera"));
    }
    Ok(samples)
}

fn put_frame(to: &mut Writer, frame: &Frame) {
    to.number([frame.resolution(), frame.origin(), frame.size()]);
}

fn take_frame(from: &mut Reader<'_>) -> Result<Frame, Broken> {
    let [[w, h], [x, y], [cw, ch]] = from.number::<[[u32; 2]; 3]>()?;
    let window = || Some((x.checked_add(cw)?, y.checked_add(ch)?));
    let (x1, y1) = window().ok_or(Broken("a window is out of range"))?;
    let frame = Frame::new(w, h).and_then(|full| full.crop(x, y, x1, y1));
    frame.map_err(|_| Broken("a window is out of range"))
}

fn put_needs(to: &mut Writer, needs: &Needs) {
    let Needs {
        variance,
        extrema,
        halves,
        features,
        first_hits,
        cost,
        emission,
        indirect,
        splats,
        channels,
        sums,
        feature_halves,
        samples,
        trajectories,
    } = *needs;
    [variance, extrema, halves, features, cost, emission, splats, feature_halves]
        .into_iter()
        .for_each(|need| to.flag(need));
    to.number(first_hits);
    to.number(channels);
    let kept = if samples > 0 { SAMPLES } else { 0 } | if trajectories { TRAJECTORIES } else { 0 };
    let kept = kept | if indirect { INDIRECT } else { 0 };
    to.number(sums.bits() | kept);
    if samples > 0 {
        to.number(samples);
    }
}

fn take_needs(from: &mut Reader<'_>) -> Result<Needs, Broken> {
    let mut needs = Needs::none();
    let Needs { variance, extrema, halves, features, cost, emission, splats, feature_halves, .. } = &mut needs;
    for need in [variance, extrema, halves, features, cost, emission, splats, feature_halves] {
        *need = from.flag()?;
    }
    needs.first_hits = from.number()?;
    needs.channels = from.number()?;
    let bits: u8 = from.number()?;
    needs.sums =
        Sums::from_bits(bits & !(SAMPLES | TRAJECTORIES | INDIRECT)).ok_or(Broken("a kind of sums is unknown"))?;
    needs.trajectories = bits & TRAJECTORIES > 0;
    needs.indirect = bits & INDIRECT > 0;
    if bits & SAMPLES > 0 {
        needs.samples = from.number()?;
    }
    Ok(needs)
}

/// The flag, in the byte that names the kinds of sums, of a film that keeps samples one by one.
const SAMPLES: u8 = 0x80;
/// The flag, in the same byte, of a film that keeps trajectories.
const TRAJECTORIES: u8 = 0x40;
/// The flag, in the same byte, of a film that keeps the indirect light.
const INDIRECT: u8 = 0x20;

pub(crate) fn put_combine(to: &mut Writer, combine: Combine) {
    let (kind, weight) = match combine {
        Combine::ByCount => (0_u8, 0.0),
        Combine::Equally => (1, 0.0),
        Combine::Fixed(weight) => (2, weight),
    };
    to.number(kind);
    to.number(weight);
}

pub(crate) fn take_combine(from: &mut Reader<'_>) -> Result<Combine, Broken> {
    let (kind, weight) = (from.number::<u8>()?, from.number::<f64>()?);
    match kind {
        0 => Ok(Combine::ByCount),
        1 => Ok(Combine::Equally),
        2 if weight.is_finite() => Ok(Combine::Fixed(weight)),
        _ => Err(Broken("the rule to combine halves is unknown")),
    }
}

fn put_record(to: &mut Writer, record: &Record) {
    let Record { budgets, rounds, samples, rays, blocks, passes, prepare_rays, prepare_seconds, rejected, .. } = record;
    to.list(budgets);
    to.number(rounds.len() as u64);
    for r in rounds {
        to.number(r.samples);
        to.flag(r.kept);
        to.number([r.plan_seconds, r.trace_seconds]);
    }
    to.number([*samples, *rays, *blocks, *rejected]);
    to.number(*passes);
    to.number(*prepare_rays);
    to.number(*prepare_seconds);
}

fn take_record(from: &mut Reader<'_>) -> Result<Record, Broken> {
    let budgets = from.list()?;
    let count = from.count(25)?;
    let mut rounds = Vec::with_capacity(count);
    for _ in 0..count {
        let (samples, kept) = (from.number()?, from.flag()?);
        let [plan_seconds, trace_seconds] = from.number::<[f64; 2]>()?;
        if !(plan_seconds.is_finite() && trace_seconds.is_finite()) {
            return Err(Broken("a time is not a number of seconds"));
        }
        rounds.push(RoundRecord { samples, kept, plan_seconds, trace_seconds });
    }
    let [samples, rays, blocks, rejected] = from.number()?;
    let (passes, prepare_rays, prepare_seconds) = (from.number()?, from.number()?, from.number::<f64>()?);
    if !prepare_seconds.is_finite() {
        return Err(Broken("a time is not a number of seconds"));
    }
    let record = Record { budgets, rounds, samples, rays, blocks, rejected, ..Record::default() };
    Ok(Record { passes, prepare_rays, prepare_seconds, ..record })
}

pub(crate) fn put_rejected(to: &mut Writer, rejected: &[Rejected]) {
    to.number(rejected.len() as u64);
    for Rejected { sample, reason } in rejected {
        put_sample(to, sample);
        to.flag(*reason == RejectedReason::Negative);
    }
}

pub(crate) fn put_sample(to: &mut Writer, sample: &SampleId) {
    to.number(sample.pixel);
    to.number(sample.stream);
    to.number(sample.index);
}

pub(crate) fn take_sample(from: &mut Reader<'_>) -> Result<SampleId, Broken> {
    Ok(SampleId { pixel: from.number()?, stream: from.number()?, index: from.number()? })
}

pub(crate) fn take_rejected(from: &mut Reader<'_>) -> Result<Vec<Rejected>, Broken> {
    let count = from.count(21)?;
    if count > REJECTED_LISTED {
        return Err(Broken("the list of rejected samples is too long"));
    }
    let one = |from: &mut Reader<'_>| {
        let sample = take_sample(from)?;
        let reason = if from.flag()? { RejectedReason::Negative } else { RejectedReason::NotFinite };
        Ok(Rejected { sample, reason })
    };
    (0..count).map(|_| one(from)).collect()
}

/// Writes training data: the number of entries, then four numbers per entry.
pub(crate) fn put_training(to: &mut Writer, entries: &[TrainingSum]) {
    to.number(entries.len() as u64);
    for e in entries {
        to.number([e.key, e.count]);
        to.number([e.sum, e.sum_of_squares]);
    }
}

pub(crate) fn take_training(from: &mut Reader<'_>) -> Result<Vec<TrainingSum>, Broken> {
    let count = from.count(32)?;
    let one = |from: &mut Reader<'_>| {
        let [key, count] = from.number()?;
        let [sum, sum_of_squares] = from.number()?;
        Ok(TrainingSum { key, count, sum, sum_of_squares })
    };
    (0..count).map(|_| one(from)).collect()
}
