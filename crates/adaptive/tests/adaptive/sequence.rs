//! Two samplers in sequence: budgets, bits, states and descriptions.

use crate::support::frame;
use dapple_adaptive::{Adaptive, AdaptiveOptions, Cycles, CyclesOptions, Sequence};
use dapple_conformance::toys::{Field, Independent, ToySampler};
use dapple_conformance::{bits, sampler, threshold_sampler};
use dapple_core::film::RgbMoments;
use dapple_core::limits::Schedule;
use dapple_core::options::{nested, unnested};
use dapple_core::plan::{BudgetLeft, Feedback, PilotPolicy, Plan, Progress, Retention, Stopping};
use dapple_core::point_set::streams;
use dapple_core::render::{Control, Status};
use dapple_core::samplers::Uniform;
use dapple_core::{Error, Film, Limits, Needs, PointSet, Render, SampleId, Sampler, Snapshot};

/// Grey noise whose spread grows to the right.
fn noise([x, _]: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    [0.1 + 0.05 * x as f32 * u[0], u[1], u[2] * u[3]]
}

const POINTS: fn() -> Independent = || Independent::new(3);

fn adaptive(policy: PilotPolicy) -> Adaptive<Independent> {
    let options = AdaptiveOptions::default().policy(policy).pilot(4).gain(1.0);
    Adaptive::with_options(POINTS(), options).unwrap()
}

fn cycles(mode: Stopping) -> Cycles<Independent> {
    Cycles::with_options(POINTS(), CyclesOptions::default().min(4).step(3).mode(mode)).unwrap()
}

/// Counts from the floor to 6 above it by the pixel's index, in one round.
fn uneven() -> impl Sampler {
    let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
        let BudgetLeft { min_spp, max_spp, .. } = seen.budget;
        let mut left = seen.budget.left().saturating_sub(u64::from(min_spp) * seen.pixels() as u64);
        if seen.round > 0 {
            return Progress::Done;
        }
        for (i, n) in plan.counts.iter_mut().enumerate() {
            let more = (i as u64 % 7).min(left).min(u64::from(max_spp - min_spp));
            *n = min_spp + more as u32;
            left -= more;
        }
        if plan.total() == 0 { Progress::Done } else { Progress::Trace }
    };
    ToySampler { points: POINTS(), needs: Needs::none(), plan }
}

/// A quiet left half and a noisy right half.
fn two_halves([x, _]: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    if x < 9 { [0.5 + 0.01 * u[0]; 3] } else { [u[0] * u[1], u[2], f32::from(u8::from(u[3] < 0.2))] }
}

fn rendered(mut sampler: impl Sampler, spp: f64) -> Film {
    let (frame, limits) = (frame(19, 12), Limits::spp(spp));
    Render::new(frame, &limits).run(&mut Field(two_halves), &mut sampler).unwrap()
}

#[test]
fn a_uniform_first_stage_that_is_the_seconds_own_pilot_gives_the_seconds_bits() {
    let uniform = || Uniform::new(POINTS());
    for policy in [PilotPolicy::Keep, PilotPolicy::Neighbours, PilotPolicy::Cross] {
        let alone = rendered(adaptive(policy), 16.25);
        assert!(
            bits(&rendered(Sequence::new(uniform(), 4, adaptive(policy)).unwrap(), 16.25)) == bits(&alone),
            "{policy:?}"
        );
        assert_ne!(alone.counts().iter().min(), alone.counts().iter().max());
        // Control: a longer first stage gives other counts.
        let longer = rendered(Sequence::new(uniform(), 9, adaptive(policy)).unwrap(), 16.25);
        assert_ne!(longer.counts(), alone.counts());
    }
    for mode in [Stopping::Budget, Stopping::Threshold] {
        let alone = rendered(cycles(mode), 16.25);
        assert!(bits(&rendered(Sequence::new(uniform(), 4, cycles(mode)).unwrap(), 16.25)) == bits(&alone), "{mode:?}");
    }
}

#[test]
fn sequences_conform_and_spend_budgets_exactly() {
    sampler(|| Box::new(Sequence::new(Uniform::new(POINTS()), 4, adaptive(PilotPolicy::Neighbours)).unwrap()));
    sampler(|| Box::new(Sequence::new(Uniform::new(POINTS()), 3, adaptive(PilotPolicy::Discard)).unwrap()));
    sampler(|| Box::new(Sequence::new(uneven(), 5, adaptive(PilotPolicy::Keep)).unwrap()));
    sampler(|| Box::new(Sequence::new(uneven(), 5, cycles(Stopping::Budget)).unwrap()));
    sampler(|| Box::new(Sequence::new(cycles(Stopping::Threshold), 9, adaptive(PilotPolicy::Cross)).unwrap()));
    threshold_sampler(|| Box::new(Sequence::new(uneven(), 2, cycles(Stopping::Threshold)).unwrap()));
    sampler(|| {
        let inner = Sequence::new(uneven(), 2, Uniform::new(POINTS())).unwrap();
        Box::new(Sequence::new(inner, 7, adaptive(PilotPolicy::Neighbours)).unwrap())
    });
}

#[test]
fn uniform_levels_what_another_sampler_left_uneven_or_discarded() {
    sampler(|| Box::new(Sequence::new(uneven(), 5, Uniform::new(POINTS())).unwrap()));
    let film = rendered(Sequence::new(uneven(), 5, Uniform::new(POINTS())).unwrap(), 7.0);
    assert_eq!(film.counts(), vec![7; 19 * 12]);
    // Pixels with more than the mean keep their samples.
    let counts = rendered(Sequence::new(uneven(), 4, Uniform::new(POINTS())).unwrap(), 5.0).counts();
    assert_eq!(
        (counts.iter().sum::<u64>(), counts.iter().min(), counts.iter().max()),
        (5 * 19 * 12, Some(&4), Some(&7))
    );
    let discarding = || {
        let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
            (plan.retention, plan.counts) = (Retention::Discard, vec![2; seen.pixels()]);
            if seen.round == 0 { Progress::Trace } else { Progress::Done }
        };
        ToySampler { points: POINTS(), needs: Needs::none(), plan }
    };
    let film = rendered(Sequence::new(discarding(), 3, Uniform::new(POINTS())).unwrap(), 7.0);
    assert_eq!((film.counts(), film.discarded(3).count, film.record().samples), (vec![5; 19 * 12], 2, 7 * 19 * 12));
}

/// The first sampler sees its share as the budget, and a floor that the share can meet.
#[test]
fn the_first_stage_ends_at_its_share() {
    // Where floors take most of the budget, no pixel may go beyond its floor in the first stage.
    for (min_spp, bounds) in [(2, (2, 50)), (8, (3, 8))] {
        let mut shown = Vec::new();
        let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
            shown.push((seen.budget.total, (seen.budget.min_spp, seen.budget.max_spp)));
            plan.counts.fill(1);
            Progress::Trace
        };
        let first = ToySampler { points: POINTS(), needs: Needs::none(), plan };
        let limits = Limits::samples(9 * 8 + 3).with_max_spp(50).with_min_spp(min_spp);
        let mut sequence = Sequence::new(first, 3, Uniform::new(POINTS())).unwrap();
        let film = Render::new(frame(4, 2), &limits).run(&mut Field(noise), &mut sequence).unwrap();
        let samples: Vec<u64> = film.record().rounds.iter().map(|round| round.samples).collect();
        assert_eq!(samples, [8, 8, 8, 6 * 8 + 3]);
        drop(sequence);
        assert_eq!(shown, [(24, bounds); 3]);
    }
}

#[test]
fn the_description_names_both_samplers_and_their_policies() {
    let sequence = Sequence::new(uneven(), 5, adaptive(PilotPolicy::Discard)).unwrap();
    let described = sequence.describe();
    assert!(described.starts_with("sequence:first=planned,spp=5,second=adaptive/by=variance/pilot=4/"), "{described}");
    assert!(described.contains("/policy=discard/"), "{described}");
    let second = unnested(described.split_once(",second=").unwrap().1);
    assert_eq!(second, adaptive(PilotPolicy::Discard).describe());
    assert_eq!(sequence.needs(), adaptive(PilotPolicy::Discard).needs());
    let inside = Sequence::new(sequence, 6, Uniform::new(POINTS())).unwrap();
    assert_eq!(inside.describe(), format!("sequence:first={},spp=6,second=uniform", nested(&described)));
    let refused = Sequence::new(Uniform::new(POINTS()), 0, Uniform::new(POINTS())).err().unwrap().to_string();
    assert_eq!(refused, "spp = 0 is out of range; allowed: at least 1 sample per pixel for the first sampler");
}

#[test]
fn states_of_other_samplers_are_refused() {
    let make = || Sequence::new(Uniform::new(POINTS()), 2, Uniform::new(POINTS())).unwrap();
    let saved = make().save();
    assert!(make().restore(&saved).is_ok());
    for wrong in [&saved[1..], &[saved.clone(), vec![0]].concat(), &[2; 17], &[]] {
        assert!(matches!(make().restore(wrong), Err(Error::BadSnapshot { .. })), "{wrong:?}");
    }
}

/// Each stage has points of its own, also after it is resumed.
#[test]
fn stages_with_different_points_are_resumed() {
    let (frame, limits) = (frame(5, 4), Limits::spp(9.0).with_schedule(Schedule::default().with_progress_spp(2)));
    let make = || Sequence::new(Uniform::new(POINTS()), 4, Uniform::new(Independent::new(77))).unwrap();
    let mut slices = Vec::new();
    let mut keep = |status: &Status<'_>| {
        slices.push(Snapshot::from_bytes(&status.snapshot()).unwrap());
        Control::Continue
    };
    let whole = Render::new(frame, &limits).monitor(&mut keep).run(&mut Field(noise), &mut make()).unwrap();
    assert_eq!(slices.len(), 5);
    for snapshot in slices.clone() {
        let film = Render::new(frame, &limits).resume(snapshot, &mut Field(noise), &mut make()).unwrap();
        assert!(bits(&film) == bits(&whole));
    }
    // The second stage's samples are those of its own points.
    let of = |stage: Independent, index| noise([2, 1], stage.block(SampleId::new([2, 1], streams::WHOLE, index), 0));
    let mut moments = RgbMoments::default();
    (0..4).for_each(|index| moments.push(of(POINTS(), index)));
    (4..9).for_each(|index| moments.push(of(Independent::new(77), index)));
    assert_eq!(whole.mean(7), moments.mean);
    // Other points are refused all the same.
    let other = || Sequence::new(Uniform::new(POINTS()), 4, Uniform::new(Independent::new(78))).unwrap();
    let last = slices.remove(4);
    let refused = Render::new(frame, &limits).resume(last, &mut Field(noise), &mut other()).unwrap_err();
    assert!(refused.to_string().contains("the point set was independent:seed=77"), "{refused}");
}

/// A sampler's second render begins with the first stage.
#[test]
fn a_sequence_renders_twice() {
    let (frame, limits) = (frame(5, 4), Limits::spp(9.0));
    let mut sequence = Sequence::new(uneven(), 5, cycles(Stopping::Budget)).unwrap();
    let mut render = || bits(&Render::new(frame, &limits).run(&mut Field(noise), &mut sequence).unwrap());
    assert!(render() == render());
    let budget = BudgetLeft::new(20 * 9);
    let mut plan = Plan::empty(20);
    sequence.next_round(&Feedback::new(0, &Film::new(frame, sequence.needs()), budget), &mut plan).unwrap();
    assert_eq!(plan.counts[..8], [1, 2, 3, 4, 5, 6, 7, 1]);
}
