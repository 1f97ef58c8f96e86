//! Checks of a sampler's plan.

use crate::film::Bank;
use crate::{BudgetLeft, Error, Film, Plan, Retention, Sampler};

/// Checks that a plan is valid, and that the point set has enough samples. `total` are the samples of all processes.
pub(super) fn check(
    (plan, total): (&Plan, u64),
    film: &Film,
    sampler: &dyn Sampler,
    budget: &BudgetLeft,
) -> Result<(), Error> {
    let bad = |what: String| Err(Error::BadPlan { sampler: sampler.describe(), what });
    let pixels = film.frame.pixels();
    let second = plan.second_half.as_deref();
    if plan.counts.len() != pixels || second.is_some_and(|s| s.len() != pixels) {
        return bad(format!("it has {} counts for {pixels} pixels", plan.counts.len()));
    }
    if second.is_some() && film.kept.len() != 2 {
        return bad("it has a second half, but needs() has no halves".into());
    }
    match total {
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
    let banks = if kept { &film.kept } else { &film.discarded };
    let mut deepest = 0;
    // Other processes check their rows.
    for i in (0..pixels).filter(|&i| film.held.has(i)) {
        let (first, others) = (u64::from(plan.counts[i]), second.map(|s| u64::from(s[i])));
        let more = first + others.unwrap_or(0);
        let withdrawn = withdraw.is_some_and(|w| w[i]);
        if withdrawn && more == 0 {
            return bad("it withdraws all samples of a pixel and traces none".into());
        }
        let before = if withdrawn { 0 } else { film.count(i) };
        if kept && more > 0 && before + more > u64::from(budget.max_spp) {
            return bad(format!("a pixel gets {} samples, above max_spp = {}", before + more, budget.max_spp));
        }
        let more = match others {
            Some(others) => Planned::Halves(first, others),
            None if film.kept.len() == 2 => Planned::Alternating(first),
            None => Planned::Whole(first),
        };
        deepest = deepest.max(used_after(banks, film.held.at(i), more, withdrawn));
    }
    let points = sampler.points();
    if deepest > points.capacity() {
        let (points, capacity) = (points.describe(), points.capacity());
        return Err(Error::SequenceExhausted { points, capacity, requested: deepest });
    }
    Ok(())
}

/// The number of additional samples of a pixel in a round, by half.
enum Planned {
    Whole(u64),
    Alternating(u64),
    Halves(u64, u64),
}

/// The number of points that the pixel at place `i` will have used after `more` samples beyond those in `banks`: the larger number
/// of its two streams (point sequences).
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
