//! Bands dealt anew while a round is traced: a process that is slower than expected leaves some of its bands to others.
//!
//! Processes meet when most of the expected time is over, tell what they have left, and move whole bands with their pixels and
//! plans. A band that moves goes on at its next sample, whatever sample its new owner has reached elsewhere. So clocks decide
//! who traces a sample, and no bit of the image.

use super::team::Team;
use crate::bands::BAND;
use crate::exchange::message::{Kind, Left, Message, Standing};
use crate::snapshot::{Cursor, OpenRound};
use crate::{Error, Film, Integrator, Prepares};
use std::time::{Duration, Instant};

/// The part of the expected time after which processes meet.
const PART: f64 = 0.75;
/// The least expected seconds that are worth a meeting, and that are worth moving bands.
pub(super) const LEAST: f64 = 0.1;
const MOVED: f64 = 0.02;
/// The least expected seconds that are worth a meeting, per second that moving bands takes.
const PER_SECOND: f64 = 20.0;
/// The most bands that a process gets within a round, relative to equal shares by threads: their film takes memory.
const MORE: f64 = 1.25;

/// Returns true if no band depends on its owner's cursor: training data is summed by pass, and a pass may need preparation.
pub(super) fn is_free(integrator: &dyn Integrator) -> bool {
    !integrator.wants_training() && integrator.prepares() != Prepares::EveryPass
}

impl Team<'_> {
    /// Sets the first meeting of a round, by the expected costs of all bands in nanoseconds. If none is known, processes meet
    /// when they have measured some.
    pub(super) fn set_first_meeting(&mut self, costs: &[u64]) {
        if costs.iter().all(|cost| *cost == 0) {
            self.meeting = Some(Instant::now() + Duration::from_secs_f64(LEAST));
        } else {
            self.set_meeting(costs);
        }
    }

    /// Sets the next meeting, if one is worth it.
    fn set_meeting(&mut self, costs: &[u64]) {
        let seconds = self.expected(costs);
        let wait = Duration::try_from_secs_f64(PART * seconds).ok().filter(|_| seconds >= self.least);
        self.meeting = wait.and_then(|wait| Instant::now().checked_add(wait));
    }

    /// The seconds that all processes take if none waits for another. It is less than the slowest one takes where bands are few.
    fn expected(&self, costs: &[u64]) -> f64 {
        let all: u128 = costs.iter().map(|cost| u128::from(*cost)).sum();
        all as f64 * 1e-9 / self.threads_of_all()
    }

    fn threads_of_all(&self) -> f64 {
        self.threads.iter().map(|threads| f64::from(*threads)).sum::<f64>().max(1.0)
    }

    /// The seconds until the next meeting, 0 if it is late; `None` without one.
    pub(super) fn until_meeting(&self) -> Option<f64> {
        self.meeting.map(|meeting| meeting.saturating_duration_since(Instant::now()).as_secs_f64())
    }

    /// Returns true if the next message of a round in which bands are free is that of a meeting.
    pub(super) fn will_meet(&self) -> bool {
        self.meeting.is_some()
    }

    /// Meets the others as long as it is time to, or as this process has no samples left. Returns false if a process stopped or
    /// failed.
    pub(super) fn meet_in_time(&mut self, film: &mut Film, round: u32, open: &mut OpenRound) -> Result<bool, Error> {
        while self.until_meeting().is_some_and(|left| left == 0.0 || open.cursor.start >= self.longest(open)) {
            if !self.meet(film, round, open)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Deals the bands anew by what all processes have left. Returns false if a process stopped or failed.
    pub(super) fn meet(&mut self, film: &mut Film, round: u32, open: &mut OpenRound) -> Result<bool, Error> {
        self.meeting = None;
        let width = film.frame.size()[0] as usize;
        let left = self.work_left(open, width);
        let whole = *self.standing() == Standing::Going;
        let message = self.message(Kind::Meeting, (round, &open.plan), whole, [self.moving, 0.0, 0.0, 0.0, 0.0]);
        let all = self.gather(Message { left, ..message }, film, Some(open))?;
        if all.iter().any(|one| one.standing != Standing::Going) {
            return Ok(false);
        }
        self.least = all.iter().map(|one| PER_SECOND * one.seconds[0]).fold(LEAST, f64::max);
        let mut bands = vec![Left::default(); self.lags.len()];
        for (rank, one) in all.into_iter().enumerate() {
            self.deal.of(rank as u32).zip(one.left).for_each(|(band, left)| bands[band] = left);
        }
        let costs: Vec<u64> = bands.iter().map(|left| left.nanoseconds).collect();
        if self.expected(&costs) >= MOVED {
            self.deal_anew(film, open, &bands, &costs)?;
        }
        let to_come: u64 = self.deal.of(self.me).map(|band| self.samples_of(open, band, width)[1]).sum();
        self.planned[0] = self.own_samples(film.record.samples) + to_come;
        self.set_meeting(&costs);
        Ok(true)
    }

    /// Deals the bands anew by the work left in them.
    fn deal_anew(&mut self, film: &mut Film, open: &mut OpenRound, bands: &[Left], costs: &[u64]) -> Result<(), Error> {
        let clock = Instant::now();
        let share = |who: usize| costs.len() as f64 * f64::from(self.threads[who]) / self.threads_of_all();
        let most = |who: usize| (MORE * share(who)).ceil() as usize;
        let deal = self.deal.clone().rebalanced(costs, &self.threads, most);
        let before = std::mem::replace(&mut self.deal, deal);
        self.move_rows(film, open, &before)?;
        for (band, left) in bands.iter().enumerate() {
            if before.owners()[band] == self.deal.owners()[band] {
                continue;
            }
            let mine = self.deal.owners()[band] == self.me;
            self.taken[band] = if mine { left.taken } else { 0 };
            self.lags[band] = if mine { i64::from(reached(&open.cursor, band)) - i64::from(left.traced) } else { 0 };
        }
        self.moving = self.moving.max(clock.elapsed().as_secs_f64());
        Ok(())
    }

    /// The work that is left in each own band.
    fn work_left(&self, open: &OpenRound, width: usize) -> Vec<Left> {
        let bands: Vec<_> =
            self.deal.of(self.me).map(|band| (band, self.taken[band], self.samples_of(open, band, width))).collect();
        let sum =
            bands.iter().fold((0, 0), |(taken, done), (_, of_band, samples)| (taken + of_band, done + samples[0]));
        let one = |(band, taken, [done, to_come]): (usize, u64, [u64; 2])| {
            let before = self.measured[band];
            let known = [(taken, done), (before.nanoseconds, before.samples)];
            let (spent, samples) = known.into_iter().find(|(_, samples)| *samples > 0).unwrap_or(sum);
            let nanoseconds = u128::from(spent) * u128::from(to_come) / u128::from(samples.max(1));
            Left { nanoseconds: nanoseconds as u64, taken, traced: self.traced_of_each(open, band) }
        };
        bands.into_iter().map(one).collect()
    }

    /// The samples that each pixel of an own band has of this round.
    pub(super) fn traced_of_each(&self, open: &OpenRound, band: usize) -> u32 {
        (i64::from(reached(&open.cursor, band)) - self.lags[band]).max(0) as u32
    }

    /// The range of samples of a row's pixels for a range that the cursor passes.
    pub(super) fn shifted(&self, row: usize, samples: [u32; 2]) -> [u32; 2] {
        samples.map(|sample| (i64::from(sample) - self.lags[row / BAND]).max(0) as u32)
    }

    /// The sample at which the cursor has passed all samples of the own bands.
    pub(super) fn longest(&self, open: &OpenRound) -> u32 {
        let lag = self.deal.of(self.me).map(|band| self.lags[band]).max().unwrap_or(0).max(0);
        open.longest().saturating_add(u32::try_from(lag).unwrap_or(u32::MAX))
    }
}

/// The sample that the cursor has reached in a band.
fn reached(cursor: &Cursor, band: usize) -> u32 {
    if band * BAND < cursor.row as usize { cursor.end } else { cursor.start }
}
