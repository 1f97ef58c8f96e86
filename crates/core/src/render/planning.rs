//! Planning of a session's rounds: budgets, clocks and predictions before a plan.

use super::check::check;
use super::filter_time;
use super::holdout::{Holdout, Prediction};
use super::session::{Session, State};
use super::team::Team;
use crate::snapshot::{Cursor, OpenRound};
use crate::{Error, Feedback, Film, Plan, Progress, Retention};

impl Session<'_> {
    /// The reading of the clock by which a budget of time is spent: the first process' if there are several.
    pub(super) fn agreed_seconds(&mut self, team: Option<&mut Team<'_>>) -> Result<f64, Error> {
        let seconds = self.clock.seconds();
        let (Some(team), Some(limit)) = (team, self.meter.seconds()) else { return Ok(seconds) };
        let reserved = self.meter.filter_seconds();
        // No reserve is written as a negative number.
        let read = team.clock(&self.state.film, self.state.round, [seconds, reserved.unwrap_or(-1.0), limit])?;
        self.meter.follow(read[2], Some(read[1]).filter(|seconds| *seconds >= 0.0));
        Ok(read[0])
    }

    /// Requests the plan of the next round from the sampler; `None` at the end of the render.
    pub(super) fn plan(&mut self, mut team: Option<&mut Team<'_>>) -> Result<Option<OpenRound>, Error> {
        self.reserve_for_filter(team.as_deref_mut())?;
        let planning = self.clock.seconds();
        loop {
            let seconds = self.agreed_seconds(team.as_deref_mut())?;
            let State { film, round, .. } = &mut self.state;
            let budget = self.meter.show(film, *round, seconds);
            film.record.budgets.push(budget.total);
            let mut plan = Plan::empty(film.frame.pixels());
            let mut planner = team.as_deref_mut().filter(|team| team.plans_own_rows());
            let (progress, total) = match &mut planner {
                Some(team) => team.plan(film, &mut *self.sampler, (*round, budget), &mut plan)?,
                None => {
                    let progress = self.sampler.next_round(&Feedback { round: *round, film, budget }, &mut plan)?;
                    (progress, plan.total())
                }
            };
            if progress == Progress::Trace {
                let checked = check((&plan, total), film, &*self.sampler, &budget);
                let of_all = planner.map(|team| team.agree_on(&checked, &plan)).transpose();
                checked?;
                let open = begin(plan, film, self.clock.seconds() - planning);
                return Ok(Some(OpenRound { of_all: of_all?, ..open }));
            }
            let predicted = self.predict()?;
            let seconds = self.agreed_seconds(team.as_deref_mut())?;
            if !self.meter.extend(&self.state.film, seconds, predicted) {
                // The time of the last prediction belongs to the last round.
                if let Some(last) = self.state.film.record.rounds.last_mut() {
                    last.plan_seconds += self.clock.seconds() - planning;
                }
                return Ok(None);
            }
        }
    }

    /// Measures the filter after the first samples of a render with a time limit, so that the limit includes the filter. The
    /// first of several processes measures it.
    pub(super) fn reserve_for_filter(&mut self, team: Option<&mut Team<'_>>) -> Result<(), Error> {
        let film = &self.state.film;
        let Some(limit) = self.meter.seconds().filter(|_| film.record.samples > 0) else { return Ok(()) };
        if self.meter.filter_seconds().is_some() {
            return Ok(());
        }
        let mut seconds = 0.0;
        if let Some(filter) = &self.filter {
            let rows = filter_time::rows(&film.frame);
            let part = match team.filter(|team| team.plans_own_rows()) {
                Some(team) => film.gather(Some(rows).filter(|_| team.me == 0), &film.needs, &mut *team.exchange)?,
                None => Some(film.of_rows(rows)?),
            };
            let measured = part.map_or(0.0, |part| filter_time::estimate(filter, &part, film.frame.size()[1]));
            let spp = film.record.samples as f64 / film.frame.pixels() as f64;
            let traced: f64 = film.record.rounds.iter().map(|round| round.trace_seconds).sum();
            seconds = measured * filter_time::growth(filter, &film.needs, spp, limit / traced);
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
    OpenRound {
        plan,
        cursor,
        pending: Vec::new(),
        before,
        submitted: 0,
        plan_seconds,
        traced_seconds: 0.0,
        of_all: None,
    }
}
