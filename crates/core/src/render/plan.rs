//! Planning of a session's rounds: budgets, clocks and predictions before a plan, and checks of the plan.

use super::budget;
use super::holdout::{Holdout, Prediction};
use super::session::{Session, State};
use super::turns::{Order, Turns};
use crate::snapshot::{Cursor, OpenRound};
use crate::{BudgetLeft, Error, Feedback, Film, Plan, Progress, Retention, Sampler};

impl Session<'_> {
    /// Requests the plan of the next round from the sampler; `None` at the end of the render.
    pub(super) fn plan(&mut self) -> Result<Option<OpenRound>, Error> {
        self.reserve_for_filter()?;
        let planning = self.clock.seconds();
        loop {
            let seconds = self.clock.seconds();
            let State { film, round, .. } = &mut self.state;
            let budget = self.meter.show(film, *round, seconds);
            film.record.budgets.push(budget.total);
            let mut plan = Plan::empty(film.frame.pixels());
            let seen = Feedback { round: *round, film, budget };
            if self.sampler.next_round(&seen, &mut plan)? == Progress::Trace {
                check(&plan, film, &*self.sampler, &budget)?;
                return Ok(Some(begin(plan, film, self.clock.seconds() - planning)));
            }
            let predicted = self.predict()?;
            if !self.meter.extend(&self.state.film, self.clock.seconds(), predicted) {
                // The time of the last prediction belongs to the last round.
                if let Some(last) = self.state.film.record.rounds.last_mut() {
                    last.plan_seconds += self.clock.seconds() - planning;
                }
                return Ok(None);
            }
        }
    }

    /// Reserves a part of a time limit for the filter, measured after the first round.
    pub(super) fn reserve_for_filter(&mut self) -> Result<(), Error> {
        let film = &self.state.film;
        let Some(limit) = self.meter.seconds().filter(|_| film.record.samples > 0) else { return Ok(()) };
        if self.meter.filter_seconds().is_some() {
            return Ok(());
        }
        let mut seconds = 0.0;
        if let Some(filter) = &self.filter {
            let part = film.of_rows(budget::timed_rows(&film.frame))?;
            let measured = budget::time_of(filter, &part, film.frame.size()[1]);
            let spp = film.record.samples as f64 / film.frame.pixels() as f64;
            let traced: f64 = film.record.rounds.iter().map(|round| round.trace_seconds).sum();
            seconds = measured * budget::growth(filter, &film.needs, spp, limit / traced);
        }
        self.meter.reserve(seconds);
        Ok(())
    }

    /// Predicts the error that an error limit concerns; `None` without such a limit. A filter without an estimate leaves the
    /// limit with the unfiltered image.
    pub(super) fn predict(&mut self) -> Result<Option<Prediction>, Error> {
        if self.meter.goal().is_none() {
            return Ok(None);
        }
        let State { film, holdout, .. } = &mut self.state;
        if let Some(filter) = self.filter.as_ref().filter(|_| self.judged) {
            *holdout = Holdout::next(holdout.take(), film, filter)?;
            if let Some(holdout) = holdout {
                let prediction = holdout.prediction();
                film.record.filtered_relmse = Some(prediction.relmse);
                return Ok(Some(prediction));
            }
            self.judged = false;
        }
        Ok(Some(Prediction::unfiltered(film)))
    }
}

/// Applies a plan's withdrawals and discarding to the film, and returns the round to trace.
fn begin(plan: Plan, film: &mut Film, plan_seconds: f64) -> OpenRound {
    if plan.retention == Retention::Discard {
        film.open_discarded();
    }
    if let Some(withdrawn) = &plan.withdraw {
        film.withdraw(withdrawn);
    }
    film.combine = plan.combine;
    let (cursor, before) = (Cursor::default(), film.record.samples);
    OpenRound { plan, cursor, pending: Vec::new(), before, submitted: 0, plan_seconds, traced_seconds: 0.0 }
}

/// Checks that a plan is valid, and that the point set has enough samples.
pub(super) fn check(plan: &Plan, film: &Film, sampler: &dyn Sampler, budget: &BudgetLeft) -> Result<(), Error> {
    let bad = |what: String| Err(Error::BadPlan { sampler: sampler.describe(), what });
    let pixels = film.frame.pixels();
    let second = plan.second_half.as_deref();
    if plan.counts.len() != pixels || second.is_some_and(|s| s.len() != pixels) {
        return bad(format!("it has {} counts for {pixels} pixels", plan.counts.len()));
    }
    if second.is_some() && film.kept.len() != 2 {
        return bad("it has a second half, but needs() has no halves".into());
    }
    match plan.total() {
        0 => return bad("it has no samples".into()),
        total if total > budget.left() => {
            return bad(format!("it has {total} samples, but {} are left", budget.left()));
        }
        _ => {}
    }
    let kept = plan.retention == Retention::Keep;
    let withdraw = plan.withdraw.as_deref();
    if withdraw.is_some_and(|w| w.len() != pixels || !kept) {
        return bad("it withdraws samples without a mark for each pixel, or in a round that is not kept".into());
    }
    if withdraw.is_some_and(|w| (0..pixels).any(|i| w[i] && film.discarded(i).count > 0)) {
        return bad("it withdraws samples of a pixel that has discarded ones".into());
    }
    let mut deepest = 0;
    for i in 0..pixels {
        let more = u64::from(plan.counts[i]) + second.map_or(0, |s| u64::from(s[i]));
        let withdrawn = withdraw.is_some_and(|w| w[i]);
        if withdrawn && more == 0 {
            return bad("it withdraws all samples of a pixel and traces none".into());
        }
        let before = if withdrawn { 0 } else { film.count(i) };
        if kept && more > 0 && before + more > u64::from(budget.max_spp) {
            return bad(format!("a pixel gets {} samples, above max_spp = {}", before + more, budget.max_spp));
        }
        let banks = if kept { &film.kept } else { &film.discarded };
        let of = |half: usize| {
            banks.get(half).map_or([0; 2], |bank| [bank.counts[i], film.next_index(plan.retention, half, i)])
        };
        let [[a, next_a], [b, next_b]] = [0, 1].map(of);
        let lead = if withdrawn { 0 } else { a as i64 - b as i64 };
        let turns = Turns { counts: [plan.counts[i], second.map_or(0, |s| s[i])], next: [next_a, next_b], lead };
        let [more_a, more_b] = turns.halves(Order::of(plan, film.kept.len() == 2));
        deepest = deepest.max(next_a + more_a).max(next_b + more_b);
    }
    let points = sampler.points();
    if deepest > points.capacity() {
        let (points, capacity) = (points.describe(), points.capacity());
        return Err(Error::SequenceExhausted { points, capacity, requested: deepest });
    }
    Ok(())
}
