//! The messages of a render by several processes.

use crate::bands::BandCost;
use crate::film::{Bank, Picked};
use crate::snapshot::Broken;
use crate::snapshot::bytes::{Reader, Writer};
use crate::snapshot::decode::{take_bank, take_beside};
use crate::snapshot::film::{
    check_bank, put_rejected, put_sample, put_training, take_rejected, take_sample, take_training,
};
use crate::snapshot::planes::{put_bank, put_beside};
use crate::{Error, Film, Rejected, Retention, SampleId, TrainingSum};

/// The version of the messages. It changes with their layout and contents.
const VERSION: u32 = 4;

/// The place in the render at which a message is sent. All messages of one gathering have the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Step {
    pub(crate) kind: Kind,
    /// The number of messages before.
    pub(crate) number: u32,
    pub(crate) round: u32,
    /// The samples of the round that each pixel had at the step before.
    pub(crate) since: u32,
    /// A digest of the plan.
    pub(crate) plan: u64,
}

/// The kind of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The end of a training pass within a round.
    Pass,
    /// The end of a round.
    Round,
    /// A reading of the clock before a plan.
    Clock,
    /// A meeting within a round.
    Meeting,
}

/// The work that is left in a band within a round.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Left {
    /// The expected nanoseconds of one thread.
    pub(crate) nanoseconds: u64,
    /// The nanoseconds that it took in this round.
    pub(crate) taken: u64,
    /// The samples of the round that each of its pixels has, unless the plan gives it fewer.
    pub(crate) traced: u32,
}

/// The state of a process: going on, or the reason why it does not.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Standing {
    Going,
    /// A monitor stopped it.
    Stopped,
    /// The integrator panicked at this sample.
    Panicked(SampleId, String),
    /// A sample was invalid, under [`InvalidSample::Fail`](crate::InvalidSample).
    Invalid(SampleId, [f32; 3]),
}

/// The results of a process in its bands.
pub(crate) struct Found {
    /// Numbers of samples, rays, blocks, rejected samples, and samples without a hit or miss.
    pub(crate) totals: [u64; 5],
    /// The samples that could splat, by half.
    pub(crate) splatting: [u64; 2],
    pub(crate) rejected: Vec<Rejected>,
    /// The sums of splats: half, pixel, red, green and blue.
    pub(crate) splats: Vec<(u32, u32, [i128; 3])>,
    /// The cost of each of its bands.
    pub(crate) costs: Vec<BandCost>,
    /// The planes of its pixels.
    pub(crate) planes: Film,
}

/// One process' part of a gathering.
pub(crate) struct Message {
    pub(crate) step: Step,
    /// The number of the process, and of all processes.
    pub(crate) share: [u32; 2],
    pub(crate) standing: Standing,
    /// True if all its samples up to this step are traced.
    pub(crate) whole: bool,
    /// Readings in seconds: clock, planning the round, tracing it, reserve for the filter, and time limit. At a meeting, the
    /// first is the time that moving bands takes.
    pub(crate) seconds: [f64; 5],
    pub(crate) threads: u32,
    /// Training sums by row of blocks.
    pub(crate) training: Vec<(usize, Vec<TrainingSum>)>,
    /// The work left in each of its bands, at a meeting.
    pub(crate) left: Vec<Left>,
    pub(crate) found: Option<Found>,
}

impl Message {
    pub(crate) fn write(&self) -> Vec<u8> {
        let mut to = Writer::with_capacity(1024);
        to.number(VERSION);
        let Step { kind, number, round, since, plan } = self.step;
        to.number([kind as u32, number, round, since]);
        to.number(plan);
        to.number(self.share);
        put_standing(&mut to, &self.standing);
        to.flag(self.whole);
        to.number(self.seconds);
        to.number(self.threads);
        to.number(self.training.len() as u64);
        for (row, sums) in &self.training {
            to.number(*row as u64);
            put_training(&mut to, sums);
        }
        to.list(&self.left.iter().map(|left| [left.nanoseconds, left.taken, left.traced.into()]).collect::<Vec<_>>());
        to.flag(self.found.is_some());
        if let Some(found) = &self.found {
            found.put(&mut to);
        }
        to.finish()
    }

    /// Reads everything but the pixels, whose number depends on the plan.
    pub(crate) fn read<'b>(bytes: &'b [u8]) -> Result<(Self, Option<Reader<'b>>), Broken> {
        let mut from = Reader::new(bytes);
        if from.number::<u32>()? != VERSION {
            return Err(Broken("another version of dapple-core wrote them"));
        }
        let [kind, number, round, since] = from.number()?;
        let kinds = [Kind::Pass, Kind::Round, Kind::Clock, Kind::Meeting];
        let kind = kinds.into_iter().find(|k| *k as u32 == kind).ok_or(Broken("a step is unknown"))?;
        let step = Step { kind, number, round, since, plan: from.number()? };
        let share = from.number()?;
        let standing = take_standing(&mut from)?;
        let whole = from.flag()?;
        let (seconds, threads) = (from.number::<[f64; 5]>()?, from.number()?);
        if !seconds.iter().all(|s| s.is_finite()) {
            return Err(Broken("a time is not a number of seconds"));
        }
        let count = from.count(16)?;
        let mut training = Vec::with_capacity(count);
        for _ in 0..count {
            let row = usize::try_from(from.number::<u64>()?).map_err(|_| Broken("a row is out of range"))?;
            training.push((row, take_training(&mut from)?));
        }
        let left = |[nanoseconds, taken, traced]: [u64; 3]| -> Result<Left, Broken> {
            let traced = traced.try_into().map_err(|_| Broken("a number of samples is out of range"))?;
            Ok(Left { nanoseconds, taken, traced })
        };
        let left = from.list()?.into_iter().map(left).collect::<Result<_, _>>()?;
        let rest = from.flag()?.then_some(from);
        Ok((Self { step, share, standing, whole, seconds, threads, training, left, found: None }, rest))
    }
}

impl Found {
    /// The results of a process: the pixels `numbers` of its film. A round of retention `of` writes only one kind of banks.
    pub(crate) fn of(film: &Film, numbers: &[u32], retention: Retention) -> Self {
        let mut splats = Vec::new();
        for (half, sums) in film.splats.sums.iter().enumerate() {
            let lit = sums.iter().enumerate().filter(|(_, sum)| **sum != [0; 3]);
            splats.extend(lit.map(|(pixel, sum)| (half as u32, pixel as u32, *sum)));
        }
        let record = &film.record;
        Self {
            totals: [record.samples, record.rays, record.blocks, record.rejected, film.unreported],
            splatting: film.splats.samples,
            rejected: film.rejected.clone(),
            splats,
            costs: Vec::new(),
            planes: film.pick(Picked(numbers), Some(retention)),
        }
    }

    fn put(&self, to: &mut Writer) {
        to.number(self.totals);
        to.number(self.splatting);
        put_rejected(to, &self.rejected);
        to.number(self.splats.len() as u64);
        for (half, pixel, sum) in &self.splats {
            to.number([*half, *pixel]);
            to.number(*sum);
        }
        to.list(&self.costs.iter().map(|cost| [cost.nanoseconds, cost.samples]).collect::<Vec<_>>());
        self.planes.kept.iter().chain(&self.planes.discarded).for_each(|bank| put_bank(to, bank));
        put_beside(to, &self.planes);
    }

    /// Reads what a process found in `pixels` pixels of a film like `film`.
    pub(crate) fn take(
        from: &mut Reader<'_>,
        film: &Film,
        pixels: usize,
        retention: Retention,
    ) -> Result<Self, Broken> {
        let (totals, splatting) = (from.number()?, from.number()?);
        let rejected = take_rejected(from)?;
        let count = from.count(56)?;
        let mut splats = Vec::with_capacity(count);
        for _ in 0..count {
            let ([half, pixel], sum) = (from.number::<[u32; 2]>()?, from.number()?);
            if half as usize >= film.splats.sums.len() || pixel as usize >= film.frame.pixels() {
                return Err(Broken("a splat is out of range"));
            }
            splats.push((half, pixel, sum));
        }
        let cost = |[nanoseconds, samples]: [u64; 2]| BandCost { nanoseconds, samples };
        let costs = from.list::<[u64; 2]>()?.into_iter().map(cost).collect();
        let mut planes = Film::without_planes(film.frame, film.needs);
        for _ in 0..film.kept.len() {
            let bank: Bank = take_bank(from, pixels, &film.needs)?;
            check_bank(&bank, u64::MAX >> 1)?;
            if retention == Retention::Keep { planes.kept.push(bank) } else { planes.discarded.push(bank) }
        }
        take_beside(from, &mut planes, pixels)?;
        match from.is_empty() {
            true => Ok(Self { totals, splatting, rejected, splats, costs, planes }),
            false => Err(Broken("there are bytes after the end")),
        }
    }
}

/// Writes all planes of some pixels of a film.
pub(crate) fn put_pixels(to: &mut Writer, film: &Film, pixels: Picked<'_>) {
    let part = film.pick(pixels, None);
    part.kept.iter().chain(&part.discarded).for_each(|bank| put_bank(to, bank));
    put_beside(to, &part);
}

/// Reads all planes of some pixels into a film.
pub(crate) fn take_pixels(from: &mut Reader<'_>, film: &mut Film, pixels: Picked<'_>) -> Result<(), Broken> {
    let mut part = Film::without_planes(film.frame, film.needs);
    for kept in (0..film.kept.len()).map(|_| true).chain((0..film.discarded.len()).map(|_| false)) {
        let bank: Bank = take_bank(from, pixels.0.len(), &film.needs)?;
        check_bank(&bank, u64::MAX >> 1)?;
        if kept { part.kept.push(bank) } else { part.discarded.push(bank) }
    }
    take_beside(from, &mut part, pixels.0.len())?;
    // The planes were read for these numbers, so they fit.
    film.place(pixels, part);
    Ok(())
}

fn put_standing(to: &mut Writer, standing: &Standing) {
    match standing {
        Standing::Going => to.number(0_u8),
        Standing::Stopped => to.number(1_u8),
        Standing::Panicked(sample, message) => {
            to.number(2_u8);
            put_sample(to, sample);
            to.text(message);
        }
        Standing::Invalid(sample, value) => {
            to.number(3_u8);
            put_sample(to, sample);
            to.number(*value);
        }
    }
}

fn take_standing(from: &mut Reader<'_>) -> Result<Standing, Broken> {
    Ok(match from.number::<u8>()? {
        0 => Standing::Going,
        1 => Standing::Stopped,
        2 => Standing::Panicked(take_sample(from)?, from.text()?),
        3 => Standing::Invalid(take_sample(from)?, from.number()?),
        _ => return Err(Broken("the state of a process is unknown")),
    })
}

/// The error for a gathering that cannot be read.
pub(crate) fn unreadable(rank: usize, Broken(what): &Broken) -> Error {
    Error::Gone { what: format!("the message of rank {rank} cannot be read: {what}") }
}
