//! Processes that plan their own rows: what they send each other instead of the pixels of each round.
//!
//! The film of each holds its own rows and those that it reads around them. Before a plan, each sends the statistics of the rows
//! that others read around theirs. A band that gets another owner moves with its pixels and its plan. Films
//! are whole at the end only, unless the render stays in bands.

use super::Monitor;
use super::team::{Team, band_pixels};
use crate::bands::Deal;
use crate::exchange::agree;
use crate::exchange::message::{put_pixels, take_pixels};
use crate::film::{Bank, HeldRows, Picked, both};
use crate::own_rows::unreadable;
use crate::snapshot::bytes::{Reader, Writer};
use crate::snapshot::stream::AT_ONCE;
use crate::snapshot::{Broken, OpenRound};
use crate::{BudgetLeft, Error, Feedback, Film, Frame, Needs, OwnRows, Plan, Progress, Sampler, Shard};
use std::collections::BTreeMap;
use std::ops::Range;

/// The rows of a frame that the film of a process holds before the first deal by cost: its bands, and `halo` rows around them.
pub(super) fn held_at_first(frame: &Frame, share: Shard, halo: u32) -> HeldRows {
    held(&Deal::in_turn(frame.size()[1] as usize, share.of()), frame, share.index(), halo)
}

/// The runs of rows of each process before the first deal by cost.
pub(super) fn runs_at_first(frame: &Frame, of: u32) -> Vec<Vec<Range<usize>>> {
    let rows = frame.size()[1] as usize;
    let deal = Deal::in_turn(rows, of);
    (0..of).map(|who| deal.runs(who, rows)).collect()
}

/// The own rows of process `me`, and `halo` rows around them.
fn held(deal: &Deal, frame: &Frame, me: u32, halo: u32) -> HeldRows {
    let rows = frame.size()[1] as usize;
    HeldRows::some(frame, &deal.runs(me, rows), &deal.halo(me, rows, halo as usize))
}

impl Team<'_> {
    /// True if each process plans its own rows.
    pub(super) fn plans_own_rows(&self) -> bool {
        self.halo.is_some()
    }

    /// The own rows, and the way to combine numbers with the others.
    pub(super) fn part(&mut self, frame: &Frame) -> OwnRows<'_> {
        OwnRows::of(frame, self.deal.runs(self.me, frame.size()[1] as usize), &mut *self.exchange)
    }

    /// Plans the own rows. Returns the progress and the number of samples that all processes planned.
    pub(super) fn plan(
        &mut self,
        film: &mut Film,
        sampler: &mut dyn Sampler,
        (round, budget): (u32, BudgetLeft),
        plan: &mut Plan,
    ) -> Result<(Progress, u64), Error> {
        if budget.left() > 0 {
            self.send_halos(film)?;
        }
        let mut part = self.part(&film.frame);
        let progress = sampler.next_round_of_rows(&Feedback { round, film, budget }, plan, &mut part)?;
        let [total] = part.sums([plan.total()])?;
        Ok((progress, total))
    }

    /// The counts of everyone's pixels, each with the number of pixels; or ends the render of all if the check of one
    /// process' plan failed.
    pub(super) fn agree_on(&mut self, checked: &Result<(), Error>, plan: &Plan) -> Result<Vec<(u32, u64)>, Error> {
        let mut pixels = BTreeMap::new();
        for &count in plan.counts.iter().chain(plan.second_half.iter().flatten()).filter(|count| **count > 0) {
            *pixels.entry(count).or_insert(0_u64) += 1;
        }
        let mut to = Writer::with_capacity(12 * pixels.len());
        for (count, pixels) in pixels {
            to.number(count);
            to.number(pixels);
        }
        let mine = checked.as_ref().map(|()| to.finish()).map_err(ToString::to_string);
        let mut of_all = BTreeMap::new();
        for (rank, bytes) in agree(&mut *self.exchange, mine)?.iter().enumerate() {
            let mut from = Reader::new(bytes);
            while !from.is_empty() {
                let take = |from: &mut Reader<'_>| Ok((from.number::<u32>()?, from.number::<u64>()?));
                let (count, pixels) = take(&mut from).map_err(|e| unreadable(rank, &e))?;
                *of_all.entry(count).or_insert(0) += pixels;
            }
        }
        Ok(of_all.into_iter().collect())
    }

    /// Sends the rows that others read around theirs, and puts theirs into the film: counts, means and squared deviations.
    fn send_halos(&mut self, film: &mut Film) -> Result<(), Error> {
        // At first no pixel has samples.
        let Some(halo) = self.halo.filter(|_| film.record.samples > 0) else { return Ok(()) };
        let [width, height] = film.frame.size().map(|n| n as usize);
        let mut to_each = Vec::new();
        for who in 0..self.processes() {
            let mut to = Writer::with_capacity(0);
            for row in self.deal.halo(who, height, halo as usize) {
                if self.deal.owner(row) == self.me {
                    put_row(&mut to, film, row * width..(row + 1) * width);
                }
            }
            to_each.push(to.finish());
        }
        let sent = self.exchange.all_to_all(to_each)?;
        let mut from: Vec<_> = sent.iter().map(|bytes| Reader::new(bytes)).collect();
        for row in self.deal.halo(self.me, height, halo as usize) {
            let owner = self.deal.owner(row) as usize;
            let Some(from) = from.get_mut(owner) else { return Err(unreadable(owner, &Broken("it is missing"))) };
            take_row(from, film, row * width..(row + 1) * width).map_err(|e| unreadable(owner, &e))?;
        }
        Ok(())
    }

    /// Moves the rows of bands that got another owner: their pixels, and their plan unless everyone has it.
    pub(super) fn move_rows(&mut self, film: &mut Film, open: &mut OpenRound, before: &Deal) -> Result<(), Error> {
        if before == &self.deal {
            return Ok(());
        }
        let (halo, width, pixels) = (self.halo, film.frame.size()[0] as usize, film.frame.pixels());
        let moved = |from: u32, to: u32| -> Vec<u32> {
            let owners = before.owners().iter().zip(self.deal.owners()).enumerate();
            let bands = owners.filter(|(_, owners)| *owners == (&from, &to) && from != to);
            bands.flat_map(|(band, _)| band_pixels(band, width, pixels)).map(|i| i as u32).collect()
        };
        let mut to_each = Vec::new();
        for who in 0..self.processes() {
            let numbers = moved(self.me, who);
            let mut to = Writer::with_capacity(0);
            if !numbers.is_empty() {
                put_pixels(&mut to, film, Picked(&numbers));
            }
            for counts in counts(open, halo).into_iter().flatten() {
                to.numbers(&numbers.iter().map(|&i| std::mem::take(&mut counts[i as usize])).collect::<Vec<u32>>());
            }
            to_each.push(to.finish());
        }
        let sent = self.exchange.all_to_all(to_each)?;
        if let Some(halo) = halo {
            film.hold(held(&self.deal, &film.frame, self.me, halo));
        }
        let gained: Vec<Vec<u32>> = (0..self.processes()).map(|who| moved(who, self.me)).collect();
        for (who, (bytes, numbers)) in sent.iter().zip(gained).enumerate() {
            let mut from = Reader::new(bytes);
            let mut take = || -> Result<(), Broken> {
                if !numbers.is_empty() {
                    take_pixels(&mut from, film, Picked(&numbers))?;
                }
                for counts in counts(open, halo).into_iter().flatten() {
                    let theirs: Vec<u32> = from.numbers(numbers.len())?;
                    numbers.iter().zip(theirs).for_each(|(&i, n)| counts[i as usize] = n);
                }
                Ok(())
            };
            take().map_err(|e| unreadable(who, &e))?;
        }
        Ok(())
    }

    /// Gathers everyone's pixels, unless the film has them.
    pub(super) fn complete(&mut self, film: &mut Film) -> Result<(), Error> {
        if self.halo.is_some() {
            let rows = Some(0..film.frame.size()[1]);
            if let Some(whole) = film.gather_banks(rows, (&film.needs, true), &mut *self.exchange)? {
                *film = whole;
            }
        }
        Ok(())
    }

    /// Shows everyone's rows to the monitors that read them, some at a time.
    pub(super) fn show_rows(&mut self, film: &Film, monitor: &mut dyn Monitor) -> Result<(), Error> {
        let reads = monitor.reads_rows();
        if film.is_whole() {
            if reads {
                monitor.rows(film);
            }
            return Ok(());
        }
        let readers = self.exchange.all_gather(vec![u8::from(reads)])?;
        if readers.iter().all(|reads| reads != &[1]) {
            return Ok(());
        }
        let ([width, height], needs) = (film.frame.size(), Needs::none().with_variance());
        let bytes = width as usize * Film::bytes_per_pixel(&both(&film.needs, &needs));
        let step = (AT_ONCE / bytes.max(1)).max(1) as u32;
        for top in (0..height).step_by(step as usize) {
            let rows = top..(top + step).min(height);
            if let Some(rows) = film.gather(reads.then_some(rows), &needs, &mut *self.exchange)? {
                monitor.rows(&rows);
            }
        }
        Ok(())
    }

    fn processes(&self) -> u32 {
        self.exchange.share().of()
    }
}

/// The counts of the plan that move with a band, if processes plan their own rows.
fn counts(open: &mut OpenRound, halo: Option<u32>) -> [Option<&mut Vec<u32>>; 2] {
    let OpenRound { plan: Plan { counts, second_half, .. }, .. } = open;
    if halo.is_some() { [Some(counts), second_half.as_mut()] } else { [None, None] }
}

/// The places of a row of pixels in the planes.
fn places(film: &Film, row: &Range<usize>) -> Range<usize> {
    let first = film.held.at(row.start);
    first..first + row.len()
}

/// The banks whose statistics samplers read.
fn banks(film: &mut Film) -> impl Iterator<Item = &mut Bank> {
    film.kept.iter_mut().chain(&mut film.discarded)
}

/// Writes counts, means and squared deviations of a row of pixels.
fn put_row(to: &mut Writer, film: &Film, row: Range<usize>) {
    let row = places(film, &row);
    for bank in film.kept.iter().chain(&film.discarded) {
        to.numbers(&bank.counts[row.clone()]);
        to.numbers(&bank.means[row.clone()]);
        to.numbers(if bank.m2.is_empty() { &[] } else { &bank.m2[row.clone()] });
    }
}

/// Reads counts, means and squared deviations of a row of pixels.
fn take_row(from: &mut Reader<'_>, film: &mut Film, row: Range<usize>) -> Result<(), Broken> {
    let row = places(film, &row);
    for bank in banks(film) {
        bank.counts[row.clone()].copy_from_slice(&from.numbers::<u64>(row.len())?);
        bank.means[row.clone()].copy_from_slice(&from.numbers::<[f64; 3]>(row.len())?);
        if !bank.m2.is_empty() {
            bank.m2[row.clone()].copy_from_slice(&from.numbers::<[f64; 3]>(row.len())?);
        }
    }
    Ok(())
}
