//! A uniform pilot whose samples stay in the image.

use dapple_core::{Feedback, Plan, saturating_u32};

/// Plans the samples that pixels lack of a pilot of `wanted` samples per pixel. Returns `true` if the plan holds any.
///
/// The pilot has at least the floor of each pixel's count, and at most its ceiling or the mean budget. Where the budget
/// does not suffice for all that is missing, nothing is planned.
pub(crate) fn plan_pilot(seen: &Feedback<'_>, wanted: u32, plan: &mut Plan) -> bool {
    let budget = seen.budget;
    let mean = saturating_u32(budget.total / seen.pixels() as u64);
    let wanted = wanted.max(budget.min_spp).min(budget.max_spp).min(mean);
    for (i, count) in plan.counts.iter_mut().enumerate() {
        *count = wanted.saturating_sub(saturating_u32(seen.film.count(i)));
    }
    let missing = plan.total() > 0 && plan.total() <= budget.left();
    if !missing {
        plan.counts.fill(0);
    }
    missing
}
