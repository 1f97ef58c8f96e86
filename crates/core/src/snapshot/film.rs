//! Encoding of films as bytes.

use super::Broken;
use super::bytes::{Reader, Writer};
use crate::film::{Bank, Beside, EmissionAlone, FeatureMoments, REJECTED_LISTED, Splats, Value};
use crate::recorder::Recorders;
use crate::{
    Combine, Film, FirstHit, Frame, Needs, Record, Rejected, RejectedReason, RoundRecord, SampleId, TrainingSum,
};

/// The number of bytes of a film, about.
pub(super) fn size(film: &Film) -> usize {
    let discarded = if film.discarded.is_empty() { 0 } else { Film::bank_bytes_per_pixel(&film.needs) };
    let banks = film.kept.iter().chain(&film.discarded);
    let words: usize = banks.flat_map(|bank| &bank.words).map(|words| 4 * words.len()).sum();
    film.frame.pixels() * (Film::bytes_per_pixel(&film.needs) + discarded) + words + 4096
}

pub(super) fn put_film(to: &mut Writer, film: &Film) {
    put_frame(to, &film.frame);
    film.needs.put(to);
    to.number(film.recorders.names().len() as u64);
    film.recorders.names().iter().for_each(|name| to.text(name));
    put_combine(to, film.combine);
    put_record(to, &film.record);
    put_rejected(to, &film.rejected);
    film.kept.iter().for_each(|bank| bank.put(to));
    to.flag(!film.discarded.is_empty());
    film.discarded.iter().for_each(|bank| bank.put(to));
    to.flag(!film.withdrawn.is_empty());
    film.withdrawn.iter().for_each(|counts| to.numbers(counts));
    film.beside.put(to);
    if let Some(window) = &film.splats.frame {
        // Rows of a stage splat anywhere in the image.
        put_frame(to, window);
    }
    film.splats.sums.iter().for_each(|sums| to.numbers(sums));
    to.number(film.splats.samples);
    to.number(film.unreported);
}

pub(super) fn take_film(from: &mut Reader<'_>) -> Result<Film, Broken> {
    let mut film = Film::without_planes(take_frame(from)?, Needs::take(from)?);
    let recorders = from.count(8)?;
    film.recorders = Recorders::named((0..recorders).map(|_| from.text()).collect::<Result<_, _>>()?);
    (film.combine, film.record, film.rejected) = (take_combine(from)?, take_record(from)?, take_rejected(from)?);
    let (pixels, layout) = (film.frame.pixels(), film.layout());
    let halves = if film.needs.halves { 2 } else { 1 };
    // Memory is made only for statistics that the bytes may hold.
    let of_banks = halves * Bank::least_bytes(&layout);
    from.expect(pixels, of_banks + Beside::least_bytes(&layout))?;
    let banks = |from: &mut Reader<'_>| -> Result<Vec<Bank>, Broken> {
        from.expect(pixels, of_banks)?;
        (0..halves)
            .map(|_| {
                let mut bank = Bank::new(pixels, &layout);
                bank.take(from).map(|()| bank)
            })
            .collect()
    };
    film.kept = banks(from)?;
    film.discarded = if from.flag()? { banks(from)? } else { Vec::new() };
    let withdrawn = if from.flag()? { halves } else { 0 };
    film.withdrawn = (0..withdrawn).map(|_| from.numbers(pixels)).collect::<Result<_, _>>()?;
    film.beside = Beside::new(pixels, &layout);
    film.beside.take(from)?;
    let (planes, window) = if film.needs.splats { (halves, take_frame(from)?) } else { (0, film.frame) };
    let sums = (0..planes).map(|_| from.numbers(window.pixels())).collect::<Result<_, _>>()?;
    film.splats = Splats::of_sums(window, sums, from.number()?);
    film.unreported = from.number()?;
    check(&film)?;
    Ok(film)
}

fn check(film: &Film) -> Result<(), Broken> {
    let mut counts = film.kept.iter().chain(&film.discarded).flat_map(|bank| &bank.counts);
    let samples = counts.try_fold(0_u64, |sum, n| sum.checked_add(*n)).ok_or(Broken("counts overflow"))?;
    if film.unreported > samples {
        return Err(Broken("more samples report no hits than there are"));
    }
    if !film.withdrawn.is_empty() && film.discarded.is_empty() {
        return Err(Broken("samples are withdrawn, but the film has no place for them"));
    }
    let mut withdrawn = film.withdrawn.iter().zip(&film.discarded).flat_map(|(n, bank)| n.iter().zip(&bank.counts));
    if withdrawn.any(|(withdrawn, discarded)| withdrawn > discarded) {
        return Err(Broken("more samples are withdrawn than discarded"));
    }
    if samples == film.record.samples { Ok(()) } else { Err(Broken("counts do not add up to the samples traced")) }
}

impl Value for FeatureMoments {
    const LEAST: usize = 2 * 4 + 2 * 40 + 2 * (4 + 12);

    fn put(values: &[Self], to: &mut Writer) {
        for f in values {
            to.number([f.samples, f.hits]);
            to.number([f.mean, f.m2]);
            to.number(f.emission.samples);
            to.number(f.emission.mean);
        }
    }

    fn take(from: &mut Reader<'_>, to: &mut [Self]) -> Result<(), Broken> {
        for one in to {
            let [samples, hits] = from.number()?;
            let [mean, m2] = from.number()?;
            let emission = EmissionAlone { samples: from.number()?, mean: from.number()? };
            if !emission.mean.as_flattened().iter().all(|v| v.is_finite()) {
                return Err(Broken("a mean emission is NaN or infinite"));
            }
            *one = Self { samples, hits, mean, m2, emission };
        }
        Ok(())
    }
}

impl Value for Option<FirstHit> {
    const LEAST: usize = 1 + 4 * 12 + 3 * 4 + 3 * 4;

    fn put(values: &[Self], to: &mut Writer) {
        for hit in values {
            to.flag(hit.is_some());
            let h = hit.unwrap_or(FirstHit::new([0.0; 3], [0.0; 3], 0.0));
            to.number([h.position, h.geometric_normal, h.shading_normal, h.albedo]);
            to.number([h.depth, h.footprint, h.roughness]);
            to.number([h.material, h.shape, h.primitive]);
        }
    }

    fn take(from: &mut Reader<'_>, to: &mut [Self]) -> Result<(), Broken> {
        for one in to {
            let there = from.flag()?;
            let [position, geometric_normal, shading_normal, albedo] = from.number()?;
            let [depth, footprint, roughness] = from.number()?;
            let [material, shape, primitive] = from.number()?;
            let hit = FirstHit {
                geometric_normal,
                shading_normal,
                albedo,
                footprint,
                roughness,
                material,
                shape,
                primitive,
                ..FirstHit::new(position, geometric_normal, depth)
            };
            if !hit.is_finite() {
                return Err(Broken("a first hit is NaN or infinite"));
            }
            *one = there.then_some(hit);
        }
        Ok(())
    }
}

pub(super) fn put_frame(to: &mut Writer, frame: &Frame) {
    to.number([frame.resolution(), frame.origin(), frame.size()]);
}

pub(super) fn take_frame(from: &mut Reader<'_>) -> Result<Frame, Broken> {
    let [[w, h], [x, y], [cw, ch]] = from.number::<[[u32; 2]; 3]>()?;
    let window = || Some((x.checked_add(cw)?, y.checked_add(ch)?));
    let (x1, y1) = window().ok_or(Broken("a window is out of range"))?;
    let frame = Frame::new(w, h).and_then(|full| full.crop(x, y, x1, y1));
    frame.map_err(|_| Broken("a window is out of range"))
}

pub(super) fn put_combine(to: &mut Writer, combine: Combine) {
    let (kind, weight) = match combine {
        Combine::ByCount => (0_u8, 0.0),
        Combine::Equally => (1, 0.0),
        Combine::Fixed(weight) => (2, weight),
    };
    to.number(kind);
    to.number(weight);
}

pub(super) fn take_combine(from: &mut Reader<'_>) -> Result<Combine, Broken> {
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

pub(super) fn put_rejected(to: &mut Writer, rejected: &[Rejected]) {
    to.number(rejected.len() as u64);
    for Rejected { sample, reason } in rejected {
        put_sample(to, sample);
        to.flag(*reason == RejectedReason::Negative);
    }
}

pub(super) fn put_sample(to: &mut Writer, sample: &SampleId) {
    to.number(sample.pixel);
    to.number(sample.stream);
    to.number(sample.index);
}

pub(super) fn take_sample(from: &mut Reader<'_>) -> Result<SampleId, Broken> {
    Ok(SampleId { pixel: from.number()?, stream: from.number()?, index: from.number()? })
}

pub(super) fn take_rejected(from: &mut Reader<'_>) -> Result<Vec<Rejected>, Broken> {
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
pub(super) fn put_training(to: &mut Writer, entries: &[TrainingSum]) {
    to.number(entries.len() as u64);
    for e in entries {
        to.number([e.key, e.count]);
        to.number([e.sum, e.sum_of_squares]);
    }
}

pub(super) fn take_training(from: &mut Reader<'_>) -> Result<Vec<TrainingSum>, Broken> {
    let count = from.count(32)?;
    let one = |from: &mut Reader<'_>| {
        let [key, count] = from.number()?;
        let [sum, sum_of_squares] = from.number()?;
        Ok(TrainingSum { key, count, sum, sum_of_squares })
    };
    (0..count).map(|_| one(from)).collect()
}
