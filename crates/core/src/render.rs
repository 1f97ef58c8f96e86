//! The render loop: round, barrier, round, …

mod budget;
mod round;

use crate::film::Bank;
use crate::{Error, Film, Frame, Integrator, Limits, Needs, Plan, Progress, RoundRecord, Sampler};
use budget::Meter;
use round::Stopped;
use std::time::Instant;

/// What a watch sees between two slices of a round.
#[derive(Clone, Copy)]
pub struct Status<'a> {
    /// What was rendered so far; every pixel's statistics are whole.
    pub film: &'a Film,
    /// The round being traced.
    pub round: u32,
    /// Samples traced.
    pub samples: u64,
    /// Samples to trace in all, as far as is known.
    pub expected: u64,
    /// Seconds of planning and tracing so far; time spent in the watch does not count.
    pub seconds: f64,
    /// The time limit, if there is one.
    pub seconds_limit: Option<f64>,
}

/// Whether to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Go on.
    Continue,
    /// Stop here and return the film as it is.
    Stop,
}

/// Looks on while a picture is made: progress, previews, checkpoints, Ctrl-C. Called between slices,
/// some five times a second.
pub trait Watch {
    /// Sees the state, and says whether to go on.
    fn slice(&mut self, status: &Status<'_>) -> Control;
}

/// Nobody looks on.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoWatch;

impl Watch for NoWatch {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }
}

impl<F: FnMut(&Status<'_>) -> Control> Watch for F {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self(status)
    }
}

/// Renders until the limits are met: asks `sampler` for a round, traces it with `integrator` on the
/// current rayon pool, lets the integrator learn, and asks again.
///
/// The film records what the sampler needs and what `needs` (a filter's, say) asks for besides. An
/// error limit adds halves.
///
/// # Errors
///
/// When the limits make no sense, the sampler cannot meet them or breaks its word, the point set is
/// exhausted, a sample is invalid under [`InvalidSample::Fail`](crate::InvalidSample), or the
/// integrator panics ([`Error::Panicked`] carries what was finished).
pub fn render(
    integrator: &mut dyn Integrator,
    sampler: &mut dyn Sampler,
    needs: Needs,
    frame: Frame,
    limits: &Limits,
    watch: &mut dyn Watch,
) -> Result<Film, Error> {
    let mut meter = Meter::new(limits, &frame)?;
    let needs = needs.and(sampler.needs()).and(meter.needs());
    let mut film = Film::new(frame, needs);
    let mut clock = Clock::start();
    let mut round = 0;
    loop {
        let planning = clock.seconds();
        let budget = meter.show(&film, round, planning);
        film.record.budgets.push(budget.total);
        let mut plan = Plan::empty(frame.pixels());
        let progress = sampler.next_round(&crate::Feedback { round, film: &film, budget }, &mut plan)?;
        let plan_seconds = clock.seconds() - planning;
        if progress == Progress::Done {
            match meter.extend(&film, clock.seconds()) {
                true => continue,
                false => break,
            }
        }
        check(&plan, &film, sampler, &budget)?;
        let tracing = clock.seconds();
        let mut look = Look { watch, clock: &mut clock, round, expected: budget.total, limit: meter.seconds() };
        let before = film.record.samples;
        let stopped = round::trace(integrator, sampler.points(), &plan, &mut film, limits, &mut look)?;
        film.record.rounds.push(RoundRecord {
            samples: film.record.samples - before,
            kept: plan.fate == crate::Fate::Keep,
            plan_seconds,
            trace_seconds: clock.seconds() - tracing,
        });
        match stopped {
            Stopped::No => round += 1,
            Stopped::Within => {
                film.record.interrupted = true;
                break;
            }
            Stopped::AtEnd => {
                let spent = film.record.samples >= budget.total;
                film.record.interrupted = !spent || meter.extend(&film, clock.seconds());
                break;
            }
        }
    }
    Ok(film)
}

/// Wall time without what the watch took.
struct Clock {
    start: Instant,
    away: f64,
}

impl Clock {
    fn start() -> Self {
        Self { start: Instant::now(), away: 0.0 }
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64() - self.away
    }
}

/// The watch with what it is told.
struct Look<'a> {
    watch: &'a mut dyn Watch,
    clock: &'a mut Clock,
    round: u32,
    expected: u64,
    limit: Option<f64>,
}

impl Look<'_> {
    fn seconds(&self) -> f64 {
        self.clock.seconds()
    }

    fn slice(&mut self, film: &Film) -> Control {
        let seconds = self.clock.seconds();
        let status = Status {
            film,
            round: self.round,
            samples: film.record.samples,
            expected: self.expected,
            seconds,
            seconds_limit: self.limit,
        };
        let control = self.watch.slice(&status);
        self.clock.away += self.clock.seconds() - seconds;
        control
    }
}

/// Holds a sampler to its word, and a point set to its capacity.
fn check(plan: &Plan, film: &Film, sampler: &dyn Sampler, budget: &crate::BudgetLeft) -> Result<(), Error> {
    let bad = |what: String| Err(Error::BadPlan { sampler: sampler.describe(), what });
    let pixels = film.frame.pixels();
    let second = plan.second_half.as_deref();
    if plan.counts.len() != pixels || second.is_some_and(|s| s.len() != pixels) {
        return bad(format!("a plan of {} counts for {pixels} pixels", plan.counts.len()));
    }
    if second.is_some() && film.kept.len() != 2 {
        return bad("a plan for two halves without asking for halves".into());
    }
    match plan.total() {
        0 => return bad("a round without samples".into()),
        total if total > budget.left() => {
            return bad(format!("a round of {total} samples with {} left", budget.left()));
        }
        _ => {}
    }
    let kept = plan.fate == crate::Fate::Keep;
    let withdraw = plan.withdraw.as_deref();
    if withdraw.is_some_and(|w| w.len() != pixels || !kept) {
        return bad("samples are withdrawn without a mark for each pixel, or in a round that is not kept".into());
    }
    let banks = if kept { &film.kept } else { &film.discarded };
    let mut deepest = 0;
    for i in 0..pixels {
        let (first, others) = (u64::from(plan.counts[i]), second.map(|s| u64::from(s[i])));
        let more = first + others.unwrap_or(0);
        let withdrawn = withdraw.is_some_and(|w| w[i]);
        if withdrawn && more == 0 {
            return bad("all samples of a pixel are withdrawn and none are traced".into());
        }
        let before = if withdrawn { 0 } else { film.count(i) };
        if kept && more > 0 && before + more > u64::from(budget.max_spp) {
            return bad(format!("{} samples in a pixel that may have {}", before + more, budget.max_spp));
        }
        let more = match others {
            Some(others) => Planned::Halves(first, others),
            None if film.kept.len() == 2 => Planned::Alternating(first),
            None => Planned::Whole(first),
        };
        deepest = deepest.max(used_after(banks, i, more, withdrawn));
    }
    let points = sampler.points();
    if deepest > points.capacity() {
        let (points, capacity) = (points.describe(), points.capacity());
        return Err(Error::SequenceExhausted { points, capacity, asked: deepest });
    }
    Ok(())
}

/// A pixel's samples of a round, by the halves they go to.
enum Planned {
    Whole(u64),
    Alternating(u64),
    Halves(u64, u64),
}

/// Points of either stream that pixel `i` will have used after `more` samples have followed what `banks`
/// hold of it.
fn used_after(banks: &[Bank], i: usize, more: Planned, withdrawn: bool) -> u64 {
    let used = |half: usize| banks.get(half).map_or(0, |b| b.next_index(i));
    let counted = |half: usize| banks.get(half).filter(|_| !withdrawn).map_or(0, |b| b.counts[i]);
    let [first, second] = match more {
        Planned::Whole(n) => [n, 0],
        Planned::Halves(a, b) => [a, b],
        Planned::Alternating(n) => {
            // Samples go to the half with fewer of them until both are level.
            let (a, b) = (counted(0), counted(1));
            let first = (a + b + n).div_ceil(2).clamp(a, a + n) - a;
            [first, n - first]
        }
    };
    (used(0) + first).max(used(1) + second)
}
