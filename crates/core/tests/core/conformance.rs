//! The samplers and the filter of this crate pass what every other must pass; broken ones do not.

use crate::common::{Independent, Points, ToyFilter, ToySampler, mix};
use dapple_conformance as conformance;
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Filter, Filtered, Needs, Sampler, Unfiltered};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU32, Ordering};

#[test]
fn uniform_conforms() {
    conformance::sampler(|| Box::new(Uniform::new(Independent::new(1))));
}

#[test]
fn a_threshold_sampler_conforms() {
    conformance::threshold_sampler(|| Box::new(planned(|seen, plan| level(seen, plan, seen.budget.total * 3 / 4))));
}

#[test]
fn unfiltered_conforms() {
    conformance::filter(|| Box::new(Unfiltered));
}

/// Runs what must fail, quietly, and returns its message.
fn failure(work: impl FnOnce()) -> String {
    let caught = catch_unwind(AssertUnwindSafe(work)).expect_err("a broken one passed");
    let text = caught.downcast_ref::<String>().cloned();
    text.or_else(|| caught.downcast_ref::<&str>().map(|s| (*s).to_owned())).unwrap_or_default()
}

fn planned<F: FnMut(&Feedback<'_>, &mut Plan) -> Progress + Send>(plan: F) -> ToySampler<F> {
    ToySampler { points: Independent::new(1), needs: Needs::none(), plan }
}

/// Levels all pixels to `total` in all, at least the floor and at most the ceiling.
fn level(seen: &Feedback<'_>, plan: &mut Plan, total: u64) -> Progress {
    let pixels = seen.pixels() as u64;
    let total = total.max(pixels * u64::from(seen.budget.min_spp)).min(pixels * u64::from(seen.budget.max_spp));
    if seen.budget.total < pixels * u64::from(seen.budget.min_spp) || seen.budget.left() == 0 {
        return Progress::Done;
    }
    for (i, n) in plan.counts.iter_mut().enumerate() {
        let wanted = total / pixels + u64::from((i as u64) < total % pixels);
        *n = wanted.saturating_sub(seen.film.count(i)) as u32;
    }
    if plan.total() == 0 { Progress::Done } else { Progress::Trace }
}

fn rejected<F, S: Sampler + 'static>(make: F, expected: &str)
where
    F: Fn() -> S,
{
    let message = failure(|| conformance::sampler(|| Box::new(make())));
    assert!(message.contains(expected), "rejected for {message:?}, not for {expected:?}");
}

#[test]
fn the_control_passes() {
    conformance::sampler(|| Box::new(planned(|seen, plan| level(seen, plan, seen.budget.total))));
}

#[test]
fn broken_samplers_are_rejected() {
    rejected(|| planned(|s, p| level(s, p, s.budget.total - u64::from(s.budget.total > 30))), "not spent exactly");
    rejected(|| planned(|s, p| level(s, p, s.budget.total + 1)), "made an invalid plan");
    let ends_of_scale = |s: &Feedback<'_>, p: &mut Plan| {
        if s.budget.left() == 0 {
            return Progress::Done;
        }
        level(s, p, s.budget.total);
        // All samples of the first pixel go to the last.
        let last = p.counts.len() - 1;
        let moved = std::mem::take(&mut p.counts[0]);
        p.counts[last] += moved;
        Progress::Trace
    };
    rejected(move || planned(ends_of_scale), "below min_spp");
    let no_ceiling = |s: &Feedback<'_>, p: &mut Plan| {
        if s.round > 0 {
            return level(s, p, s.budget.total);
        }
        let pixels = s.pixels() as u64;
        level(s, p, pixels * u64::from(s.budget.min_spp));
        p.counts[0] += (s.budget.total - p.total()) as u32;
        Progress::Trace
    };
    rejected(move || planned(no_ceiling), "above max_spp");
    rejected(|| planned(|s, p| if s.round > 0 { Progress::Done } else { level(s, p, s.budget.total) }), "not spent");
    rejected(
        || {
            planned(|s, p| {
                p.retention = Retention::Discard;
                level(s, p, s.budget.total)
            })
        },
        "below min_spp",
    );
}

/// A sampler that does not save its state from the first round.
#[test]
fn a_sampler_that_does_not_save_its_state_is_rejected() {
    let forgetful = || {
        let mut first = None;
        planned(move |s: &Feedback<'_>, p: &mut Plan| {
            if s.round < 2 {
                first = if s.round == 0 { None } else { Some(s.film.record().samples) };
                let third = level(s, p, s.budget.total * (u64::from(s.round) + 1) / 3);
                if third == Progress::Trace {
                    return third;
                }
            }
            let progress = level(s, p, s.budget.total);
            let pixels = p.counts.len();
            let turn = first.get_or_insert(s.film.record().samples).wrapping_rem(pixels as u64) as usize;
            p.counts.rotate_left(if s.budget.max_spp == u32::MAX { turn } else { 0 });
            progress
        })
    };
    rejected(forgetful, "resumed");
}

/// Counts that depend on something besides the film.
#[test]
fn samplers_with_counts_that_vary_from_run_to_run_are_rejected() {
    static RUNS: AtomicU32 = AtomicU32::new(0);
    let moody = || {
        let mood = RUNS.fetch_add(1, Ordering::Relaxed) as usize;
        planned(move |s: &Feedback<'_>, p: &mut Plan| {
            let progress = level(s, p, s.budget.total);
            let k = mix(mood as u64) as usize % p.counts.len();
            let uneven = s.round == 0 && !s.budget.total.is_multiple_of(p.counts.len() as u64);
            p.counts.rotate_left(if uneven { k } else { 0 });
            progress
        })
    };
    rejected(moody, "gives a different result");
    let by_threads = || {
        planned(|s: &Feedback<'_>, p: &mut Plan| {
            let progress = level(s, p, s.budget.total);
            let uneven = s.round == 0 && !s.budget.total.is_multiple_of(p.counts.len() as u64);
            p.counts.rotate_left(if uneven { rayon::current_num_threads() } else { 0 });
            progress
        })
    };
    rejected(by_threads, "threads give a different result");
}

#[test]
fn a_sampler_with_a_cursor_is_rejected() {
    let cursor = || {
        let place = AtomicU32::new(0);
        Points(move |_, _| {
            let n = place.fetch_add(1, Ordering::Relaxed);
            [0, 1, 2, 3].map(|k| (mix(u64::from(4 * n + k)) >> 40) as f32 / (1u64 << 24) as f32)
        })
    };
    rejected(|| Uniform::new(cursor()), "different result");
}

fn unfiltered(film: &Film) -> Filtered {
    Unfiltered.apply(film).unwrap()
}

#[test]
fn broken_filters_are_rejected() {
    let rejected = |filter: fn(&Film) -> Filtered, needs: Needs, expected: &str| {
        let made = || ToyFilter { name: "made", needs, apply: filter };
        let message = failure(|| conformance::filter(|| Box::new(made())));
        assert!(message.contains(expected), "rejected for {message:?}, not for {expected:?}");
    };
    let scaled = |film: &Film| {
        let mut image = unfiltered(film);
        image.radiance.iter_mut().flatten().for_each(|v| *v *= 1.001);
        image
    };
    rejected(scaled, Needs::none(), "of a constant");
    let divides = |film: &Film| {
        let mut image = unfiltered(film);
        for (i, x) in image.radiance.iter_mut().enumerate() {
            *x = x.map(|v| v * film.count(i) as f32 / film.count(i) as f32);
        }
        image
    };
    rejected(divides, Needs::none(), "NaN");
    let squares = |film: &Film| {
        let mut image = unfiltered(film);
        image.radiance.iter_mut().flatten().for_each(|v| *v = (*v * *v).sqrt());
        image
    };
    rejected(squares, Needs::none(), "inf");
    let short = |film: &Film| {
        let mut image = unfiltered(film);
        image.radiance.pop();
        image
    };
    rejected(short, Needs::none(), "number of pixels");
    let threads = |film: &Film| {
        let mut image = unfiltered(film);
        image.error = Some(vec![rayon::current_num_threads() as f32; image.radiance.len()]);
        image
    };
    rejected(threads, Needs::none(), "threads give a different result");
    rejected(unfiltered, Needs::none().with_variance(), "not refused");
}
