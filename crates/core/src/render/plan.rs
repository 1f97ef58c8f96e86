//! Checks of plans, and the start of rounds.

use super::state::{Cursor, OpenRound};
use super::turns::{Order, Turns};
use crate::plan::{BudgetLeft, Plan, Retention};
use crate::{Error, Film, Sampler};

/// Applies a plan's withdrawals to the film, makes room for discarded samples, and returns the round to trace.
pub(super) fn begin(plan: Plan, film: &mut Film, plan_seconds: f64) -> OpenRound {
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
        later: None,
        cursor,
        pending: Vec::new(),
        before,
        submitted: 0,
        plan_seconds,
        traced_seconds: 0.0,
    }
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
        return bad("it has counts for a second half, but the sampler's needs() do not include halves".into());
    }
    match plan.total() {
        0 => return bad("it has no samples".into()),
        total if total > budget.left() => {
            return bad(format!("it has {total} samples, but only {} are left in the budget", budget.left()));
        }
        _ => {}
    }
    let kept = plan.retention == Retention::Keep;
    let withdraw = plan.withdraw.as_deref();
    if withdraw.is_some_and(|w| w.len() != pixels || !kept) {
        return bad("its withdrawals have the wrong number of pixels, or the round discards its samples".into());
    }
    if withdraw.is_some_and(|w| (0..pixels).any(|i| w[i] && film.discarded(i).count > 0)) {
        return bad("it withdraws samples of a pixel that already has discarded samples".into());
    }
    let mut deepest = 0;
    for i in 0..pixels {
        let more = u64::from(plan.counts[i]) + second.map_or(0, |s| u64::from(s[i]));
        let withdrawn = withdraw.is_some_and(|w| w[i]);
        if withdrawn && more == 0 {
            return bad("it withdraws the samples of a pixel and plans no new ones there".into());
        }
        let before = if withdrawn { 0 } else { film.count(i) };
        if kept && more > 0 && before + more > u64::from(budget.max_spp) {
            return bad(format!("a pixel gets {} samples, above max_spp = {}", before + more, budget.max_spp));
        }
        let halves = if kept { &film.kept } else { &film.discarded };
        let of = |half: usize| {
            halves
                .get(half)
                .map_or([0; 2], |planes| [planes.counts[i].into(), film.next_index(plan.retention, half, i)])
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
