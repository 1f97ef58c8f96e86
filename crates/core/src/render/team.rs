//! One process among several that render an image together.

use super::meeting;
use crate::allocate::mix;
use crate::bands::{BAND, BandCost, Deal, bands, expected};
use crate::exchange::Exchange;
use crate::exchange::message::{Found, Kind, Message, Standing, Step, unreadable};
use crate::film::{Picked, Splats, keep_first};
use crate::snapshot::{Broken, OpenRound};
use crate::{Error, Film, Plan, Record, Rejected, TrainingSum};
use std::time::Instant;

/// Training sums by row of blocks.
pub(super) type Sums = Vec<(usize, Vec<TrainingSum>)>;

/// This process' part of a render by several processes.
pub(crate) struct Team<'a> {
    pub(super) exchange: &'a mut dyn Exchange,
    pub(super) me: u32,
    pub(super) threads: Vec<u32>,
    /// True if the film is gathered after each training pass too, since processes keep nothing from pass to pass.
    staged: bool,
    pub(super) deal: Deal,
    /// The measured cost of each band.
    pub(super) measured: Vec<BandCost>,
    /// The nanoseconds that this process took for each band since the last gathering of films.
    pub(super) taken: Vec<u64>,
    /// The samples by which an own band that came from another process within the round lags the cursor.
    pub(super) lags: Vec<i64>,
    /// The time at which processes deal bands anew within the round.
    pub(super) meeting: Option<Instant>,
    /// The least expected seconds of the slowest process that are worth a meeting.
    pub(super) least: f64,
    /// The seconds that this process took to move bands within a round, at most.
    pub(super) moving: f64,
    /// The samples of the round that each pixel had when films were last gathered.
    since: u32,
    /// The film's record and lists of that time. The lists are empty in the film meanwhile, so that it shows what is new.
    before: Option<Before>,
    /// This process' samples of the open round, and everyone's.
    pub(super) planned: [u64; 2],
    /// The rows beyond its own ones that each process reads to plan these; `None` if each plans the whole image.
    pub(super) halo: Option<u32>,
    /// True if the film is to hold the own rows only, at the end too.
    pub(super) keeps_bands: bool,
    standing: Standing,
    /// The number of messages so far.
    messages: u32,
    /// The seconds of tracing that each process took for the last round.
    times: Vec<f64>,
    /// The start of tracing after the last gathering of films.
    began: Instant,
    /// The seconds of tracing the round in earlier stages.
    traced: f64,
}

struct Before {
    record: Record,
    unreported: u64,
    rejected: Vec<Rejected>,
    splats: Splats,
}

/// The result of gathering films.
pub(super) struct Gathered {
    /// True if all samples up to this step are traced.
    pub(super) whole: bool,
    /// The first process' readings in seconds: clock, planning, tracing.
    pub(super) seconds: [f64; 3],
    /// The first process' trouble or stop; [`Standing::Going`] without one.
    pub(super) standing: Standing,
}

impl<'a> Team<'a> {
    pub(super) fn new(exchange: &'a mut dyn Exchange, rows: usize) -> Self {
        let share = exchange.share();
        Self {
            me: share.index(),
            threads: vec![1; share.of() as usize],
            exchange,
            staged: false,
            deal: Deal::in_turn(rows, share.of()),
            measured: vec![BandCost::default(); bands(rows)],
            taken: vec![0; bands(rows)],
            lags: vec![0; bands(rows)],
            meeting: None,
            least: meeting::LEAST,
            moving: 0.0,
            since: 0,
            before: None,
            planned: [1; 2],
            halo: None,
            keeps_bands: false,
            standing: Standing::Going,
            messages: 0,
            times: Vec::new(),
            began: Instant::now(),
            traced: 0.0,
        }
    }

    /// The part `me` of a render in stages, after `number` of them; `traced` are the seconds of the open round.
    pub(super) fn at_stage(self, number: u32, (costs, traced): (&[BandCost], f64), me: u32) -> Self {
        let measured = if costs.len() == self.measured.len() { costs.to_vec() } else { self.measured };
        Self { staged: true, messages: number, me, measured, traced, ..self }
    }

    /// Puts back what was taken aside, and ends the stage.
    pub(super) fn end(&mut self, film: &mut Film) {
        if let Some(before) = self.before.take() {
            (film.rejected, film.splats) = (before.rejected, before.splats);
        }
    }

    /// The measured cost of each band, and the seconds of tracing the open round.
    pub(super) fn into_costs(self) -> (Vec<BandCost>, f64) {
        (self.measured, self.traced)
    }

    /// True if training passes and rounds are stages of their own.
    pub(super) fn is_staged(&self) -> bool {
        self.staged
    }

    pub(super) fn standing(&self) -> &Standing {
        &self.standing
    }

    /// Makes each process plan its own rows, with `halo` rows around them. `None` leaves the whole image to each. With
    /// `keeps_bands`, films are not gathered at the end.
    pub(super) fn planning_own_rows(self, halo: Option<u32>, keeps_bands: bool) -> Self {
        Self { halo: halo.filter(|_| self.threads.len() > 1), keeps_bands, ..self }
    }

    /// Deals the bands of an opened round by the cost of the rounds before, and notes the state of the film.
    pub(super) fn begin(&mut self, film: &mut Film, open: &mut OpenRound) -> Result<(), Error> {
        if self.me > 0 {
            // The sums of a pass that was interrupted are everyone's; one of them reports them.
            open.pending.clear();
        }
        let width = film.frame.size()[0] as usize;
        self.since = open.cursor.start;
        let mut to_come = to_come(open, self.measured.len(), width);
        if open.of_all.is_some() {
            self.part(&film.frame).add(&mut to_come)?;
        }
        let costs = expected(&self.measured, &to_come);
        let deal = match (self.halo, &open.of_all) {
            (None, _) => Deal::by_cost(&costs, &self.threads),
            (Some(_), Some(_)) => self.deal.clone().rebalanced(&costs, &self.threads, |_| usize::MAX),
            // The rest of a round that others had begun: everyone has its plan.
            (Some(_), None) => self.deal.clone(),
        };
        let before = std::mem::replace(&mut self.deal, deal);
        if self.halo.is_some() {
            self.move_rows(film, open, &before)?;
        }
        self.planned = [self.deal.of(self.me).map(|band| to_come[band]).sum(), to_come.iter().sum()];
        self.note(film);
        self.lags.fill(0);
        if !self.staged && self.threads.len() > 1 {
            self.set_first_meeting(&costs);
        }
        Ok(())
    }

    /// Takes the film's record and lists aside.
    fn note(&mut self, film: &mut Film) {
        self.began = Instant::now();
        let empty = Splats::like(&film.splats);
        self.before = Some(Before {
            record: film.record.clone(),
            unreported: film.unreported,
            rejected: std::mem::take(&mut film.rejected),
            splats: std::mem::replace(&mut film.splats, empty),
        });
    }

    /// The record from which this process' samples are counted.
    pub(super) fn record_before(&mut self) -> Option<&mut Record> {
        self.before.as_mut().map(|before| &mut before.record)
    }

    /// Returns true if this process traces a row of pixels.
    pub(super) fn owns(&self, row: usize) -> bool {
        self.deal.owner(row) == self.me
    }

    /// Adds the time that a task took for rows of one band.
    pub(super) fn add_time(&mut self, row: usize, nanoseconds: u64) {
        self.taken[row / BAND] += nanoseconds;
    }

    /// Sets the state that the next message reports.
    pub(super) fn set_standing(&mut self, standing: Standing) {
        self.standing = standing;
    }

    /// The seconds of tracing that each process took for the last round.
    pub(super) fn times(&self) -> &[f64] {
        &self.times
    }

    /// The samples that this process traced since films were last gathered.
    pub(super) fn own_samples(&self, samples: u64) -> u64 {
        samples.saturating_sub(self.before.as_ref().map_or(samples, |before| before.record.samples))
    }

    /// Everyone's samples so far, estimated from those of this process.
    pub(super) fn estimate(&self, samples: u64) -> u64 {
        let [mine, all] = self.planned;
        let own = self.own_samples(samples);
        samples - own + (u128::from(own) * u128::from(all) / u128::from(mine.max(1))) as u64
    }

    /// Exchanges the sums of a training pass. Returns everyone's; `None` if a process stopped or failed.
    pub(super) fn pass(
        &mut self,
        film: &mut Film,
        (round, open): (u32, &OpenRound),
        own: Sums,
    ) -> Result<Option<Sums>, Error> {
        let whole = self.standing == Standing::Going;
        let found = self.staged.then(|| self.found(film, open));
        let seconds = [0.0, 0.0, self.began.elapsed().as_secs_f64(), 0.0, 0.0];
        let message = self.message(Kind::Pass, (round, &open.plan), whole, seconds);
        let mut all = self.gather(Message { training: own, found, ..message }, film, Some(open))?;
        if all.iter().any(|one| one.standing != Standing::Going) {
            return Ok(None);
        }
        if self.staged {
            self.place(film, open, &mut all);
            self.since = open.cursor.start;
            self.note(film);
            self.traced += slowest(&all);
        }
        Ok(Some(all.into_iter().flat_map(|one| one.training).collect()))
    }

    /// Exchanges the results of a round: with pixels unless processes plan their own rows, and no process stopped or failed.
    /// `whole` is true if this process has traced all of its samples, `seconds` are the clock and the time of planning and
    /// tracing.
    pub(super) fn round(
        &mut self,
        film: &mut Film,
        (round, open): (u32, &OpenRound),
        whole: bool,
        [clock, plan, trace]: [f64; 3],
    ) -> Result<Gathered, Error> {
        if self.staged && !(0..open.plan.counts.len()).any(|i| longest(&open.plan, i) > self.since) {
            // The round ended with a training pass.
            self.end(film);
            let seconds = [clock, plan, std::mem::take(&mut self.traced)];
            return Ok(Gathered { whole, seconds, standing: Standing::Going });
        }
        let found = Some(self.found(film, open));
        let trace = if self.staged { self.began.elapsed().as_secs_f64() } else { trace };
        let message = self.message(Kind::Round, (round, &open.plan), whole, [clock, plan, trace, 0.0, 0.0]);
        let mut all = self.gather(Message { found, ..message }, film, Some(open))?;
        self.place(film, open, &mut all);
        if !self.keeps_bands && all.iter().any(|one| one.standing != Standing::Going) {
            self.complete(film)?;
        }
        self.times = all.iter().map(|one| one.seconds[2]).collect();
        self.threads = if self.staged { vec![1; all.len()] } else { all.iter().map(|one| one.threads).collect() };
        let [clock, plan, mut trace, ..] = all[0].seconds;
        if self.staged {
            trace = std::mem::take(&mut self.traced) + slowest(&all);
        }
        let whole = all.iter().all(|one| one.whole);
        // A failure of one process comes before a stop of another.
        let rank = |standing: &Standing| match standing {
            Standing::Going => 2,
            Standing::Stopped => 1,
            _ => 0,
        };
        let standing = all.into_iter().map(|one| one.standing).min_by_key(rank).unwrap_or(Standing::Going);
        Ok(Gathered { whole, seconds: [clock, plan, trace], standing })
    }

    /// Exchanges readings of the clock; returns those of the first process: clock, reserve for the filter, time limit.
    pub(super) fn clock(
        &mut self,
        film: &Film,
        round: u32,
        [clock, filter, limit]: [f64; 3],
    ) -> Result<[f64; 3], Error> {
        let message = self.message(Kind::Clock, (round, &Plan::empty(0)), true, [clock, 0.0, 0.0, filter, limit]);
        let all = self.gather(message, film, None)?;
        let [clock, _, _, filter, limit] = all[0].seconds;
        Ok([clock, filter, limit])
    }

    /// A digest of a plan, by which processes that planned differently are found. Of own rows, it is the number of samples of
    /// all.
    fn digest(&self, plan: &Plan) -> u64 {
        if self.halo.is_some() { mix(self.planned[1]) } else { digest(plan) }
    }

    pub(super) fn message(&self, kind: Kind, (round, plan): (u32, &Plan), whole: bool, seconds: [f64; 5]) -> Message {
        Message {
            step: Step { kind, number: self.messages, round, since: self.since, plan: self.digest(plan) },
            share: [self.me, self.threads.len() as u32],
            standing: self.standing.clone(),
            whole,
            seconds,
            threads: rayon::current_num_threads() as u32,
            training: Vec::new(),
            left: Vec::new(),
            found: None,
        }
    }

    /// The results of this process since films were last gathered.
    fn found(&self, film: &Film, open: &OpenRound) -> Found {
        let mut found = Found::of(film, &self.numbers(film, open, self.me), open.plan.retention);
        if let Some(Before { record, unreported, .. }) = &self.before {
            let then = [record.samples, record.rays, record.blocks, record.rejected, *unreported];
            found.totals.iter_mut().zip(then).for_each(|(now, then)| *now -= then);
        }
        let width = film.frame.size()[0] as usize;
        let cost = |band| BandCost { nanoseconds: self.taken[band], samples: self.samples_of(open, band, width)[0] };
        found.costs = self.deal.of(self.me).map(cost).collect();
        found
    }

    /// The samples of an own band that were traced since films were last gathered, and those to come.
    pub(super) fn samples_of(&self, open: &OpenRound, band: usize, width: usize) -> [u64; 2] {
        let [all, to_come] =
            [self.since, self.traced_of_each(open, band)].map(|since| planned(&open.plan, band, width, since));
        [all - to_come, to_come]
    }

    /// The pixels of a process that the plan gives samples since films were last gathered; none if processes plan their own
    /// rows.
    fn numbers(&self, film: &Film, open: &OpenRound, who: u32) -> Vec<u32> {
        if self.halo.is_some() {
            return Vec::new();
        }
        let width = film.frame.size()[0] as usize;
        let pixels = |band: usize| band_pixels(band, width, open.plan.counts.len());
        let gets = |i: &usize| longest(&open.plan, *i) > self.since;
        self.deal.of(who).flat_map(pixels).filter(gets).map(|i| i as u32).collect()
    }

    /// Sends a message to all processes and returns everyone's, in order.
    pub(super) fn gather(
        &mut self,
        mut mine: Message,
        film: &Film,
        open: Option<&OpenRound>,
    ) -> Result<Vec<Message>, Error> {
        let (step, of, mine_has_pixels) = (mine.step, mine.share[1], mine.found.is_some());
        self.messages += 1;
        let gathered = self.exchange.all_gather(mine.write())?;
        if let Some(found) = &mut mine.found {
            // The film has them.
            found.planes = Film::without_planes(film.frame, film.needs);
        }
        let mut mine = Some(mine);
        let mut all = Vec::with_capacity(gathered.len());
        for (rank, bytes) in gathered.into_iter().enumerate() {
            let (mut message, rest) = Message::read(&bytes).map_err(|e| unreadable(rank, &e))?;
            if message.share != [rank as u32, of] || message.step != step {
                return Err(Error::Exchange { what: out_of_step(rank, &message.step, &step) });
            }
            if rest.is_some() != mine_has_pixels {
                return Err(unreadable(rank, &Broken("its pixels are missing")));
            }
            if let Some(mine) = mine.take_if(|_| rank == self.me as usize) {
                all.push(mine);
                continue;
            }
            if let (Some(mut from), Some(open)) = (rest, open) {
                let pixels = self.numbers(film, open, rank as u32).len();
                let found = Found::take(&mut from, film, pixels, open.plan.retention);
                message.found = Some(found.map_err(|e| unreadable(rank, &e))?);
            }
            all.push(message);
        }
        if all.len() == of as usize { Ok(all) } else { Err(unreadable(all.len(), &Broken("it is missing"))) }
    }

    /// Puts what all processes found into the film.
    fn place(&mut self, film: &mut Film, open: &OpenRound, all: &mut [Message]) {
        if let Some(Before { record, unreported, rejected, splats }) = self.before.take() {
            (film.record, film.unreported, film.rejected, film.splats) = (record, unreported, rejected, splats);
        }
        for (rank, found) in all.iter_mut().enumerate().filter_map(|(rank, one)| Some((rank, one.found.take()?))) {
            let Record { samples: all_samples, rays: all_rays, blocks: all_blocks, rejected, .. } = &mut film.record;
            let sums = [all_samples, all_rays, all_blocks, rejected, &mut film.unreported];
            sums.into_iter().zip(found.totals).for_each(|(sum, more)| *sum = sum.saturating_add(more));
            film.rejected.extend(found.rejected);
            film.splats.add_sums(&found.splats, found.splatting);
            if rank != self.me as usize {
                let numbers = self.numbers(film, open, rank as u32);
                // The planes were read for these numbers, so they fit.
                film.place(Picked(&numbers), found.planes);
            }
            for (band, cost) in self.deal.of(rank as u32).zip(found.costs) {
                if cost.samples > 0 {
                    self.measured[band] = cost;
                }
            }
        }
        keep_first(&mut film.rejected);
        self.taken.fill(0);
    }
}

/// The deal of an open round to processes that have everyone's pixels, by their numbers of threads.
pub(super) fn deal(open: &OpenRound, measured: &[BandCost], width: usize, threads: &[u32]) -> Deal {
    Deal::by_cost(&expected(measured, &to_come(open, measured.len(), width)), threads)
}

/// The samples to come of each band.
fn to_come(open: &OpenRound, bands: usize, width: usize) -> Vec<u64> {
    (0..bands).map(|band| planned(&open.plan, band, width, open.cursor.start)).collect()
}

/// The seconds of tracing of the slowest process.
fn slowest(all: &[Message]) -> f64 {
    all.iter().map(|one| one.seconds[2]).fold(0.0, f64::max)
}

/// The samples of a band that a plan has left after the first `since` of each pixel.
fn planned(plan: &Plan, band: usize, width: usize, since: u32) -> u64 {
    let left = |counts: &[u32]| -> u64 {
        counts[band_pixels(band, width, counts.len())].iter().map(|n| u64::from(n.saturating_sub(since))).sum()
    };
    left(&plan.counts) + plan.second_half.as_deref().map_or(0, left)
}

pub(super) fn band_pixels(band: usize, width: usize, pixels: usize) -> std::ops::Range<usize> {
    (band * BAND * width).min(pixels)..((band + 1) * BAND * width).min(pixels)
}

fn longest(plan: &Plan, i: usize) -> u32 {
    plan.counts[i].max(plan.second_half.as_ref().map_or(0, |second| second[i]))
}

/// A digest of a plan's counts, by which processes that planned differently are found.
fn digest(plan: &Plan) -> u64 {
    plan.counts.iter().chain(plan.second_half.iter().flatten()).fold(0, |sum, &n| mix(sum ^ u64::from(n)))
}

fn out_of_step(rank: usize, there: &Step, here: &Step) -> String {
    let what = match (there.plan == here.plan, there.round == here.round) {
        (_, false) => format!("it is at round {}, not {}", there.round, here.round),
        (false, true) => "it has another plan".into(),
        (true, true) => "it is at another step of the round".into(),
    };
    format!("rank {rank}: {what}")
}
