//! Samples that are withdrawn from the image pixel by pixel: nothing is lost, nothing restarts.

use crate::common::{self, Field, Independent, ToySampler, everything, frame, noise, numbers, on_threads, run};
use dapple_core::film::RgbMoments;
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::point_set::streams;
use dapple_core::{Draws, Error, Estimate, Film, FirstHit, Limits, Needs, Sampler, Worker};
use std::sync::Mutex;

/// One round: the same count for every pixel, its retention, and whether pixel 1 is withdrawn before.
type Round = (u32, Retention, bool);

fn rounds(rounds: Vec<Round>, needs: Needs) -> impl Sampler {
    let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
        let Some(&(count, retention, withdraw)) = rounds.get(seen.round as usize) else { return Progress::Done };
        plan.counts.fill(count);
        plan.retention = retention;
        plan.withdraw = withdraw.then(|| (0..plan.counts.len()).map(|i| i == 1).collect());
        Progress::Trace
    };
    ToySampler { points: Independent::new(5), needs, plan }
}

/// Stream, index and radiance of a sample.
type Traced = (u32, u64, [f32; 3]);

/// Pixels 0 and 1 side by side, and what was traced in pixel 1, in order.
fn trace(plan: &[Round], needs: Needs) -> (Film, Vec<Traced>) {
    let seen = Mutex::new(Vec::new());
    let mut spy = common::Traced(|draws: &Draws<'_>, _: &mut Worker| {
        let ([r, g, b, _], id) = (numbers(draws), draws.id());
        if id.pixel == [1, 0] {
            seen.lock().unwrap().push((id.stream, id.index, [r, g, b]));
        }
        let hit = FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], id.index as f32).with_albedo([0.5; 3]).with_footprint(1.0);
        let mut estimate = Estimate::new([r, g, b]).with_first_hit(hit);
        estimate.emission = [0.5 * r, 0.0, b];
        estimate
    });
    let mut sampler = rounds(plan.to_vec(), needs);
    let film = on_threads(1, || run(&mut spy, &mut sampler, needs, frame(2, 1), &Limits::samples(1000))).unwrap();
    (film, seen.into_inner().unwrap())
}

const KEEP: Retention = Retention::Keep;
const DISCARD: Retention = Retention::Discard;
const DISCARDS: [Round; 4] = [(3, DISCARD, false), (9, KEEP, false), (2, DISCARD, false), (7, KEEP, false)];
const WITHDRAWS: [Round; 4] = [(4, KEEP, false), (5, KEEP, true), (1, KEEP, false), (6, KEEP, false)];
const BOTH: [Round; 4] = [(4, KEEP, false), (5, KEEP, true), (5, DISCARD, false), (7, KEEP, false)];

#[test]
fn indices_continue_in_every_stream() {
    let indices =
        |traced: &[Traced], stream: u32| -> Vec<u64> { traced.iter().filter(|s| s.0 == stream).map(|s| s.1).collect() };
    for (plan, discarded) in [(DISCARDS, 5), (WITHDRAWS, 0), (BOTH, 5)] {
        let (_, traced) = trace(&plan, Needs::none());
        assert_eq!(indices(&traced, streams::WHOLE), (0..16).collect::<Vec<_>>());
        assert_eq!(indices(&traced, streams::DISCARDED), (0..discarded).collect::<Vec<_>>());
        let (_, traced) = trace(&plan, Needs::none().with_halves());
        let both = |pair: [u32; 2]| {
            let [a, b] = pair.map(|s| indices(&traced, s));
            assert!(a.iter().copied().eq(0..a.len() as u64) && b.iter().copied().eq(0..b.len() as u64));
            (a.len() + b.len()) as u64
        };
        assert_eq!([both(streams::HALVES), both(streams::DISCARDED_HALVES)], [16, discarded]);
    }
}

#[test]
fn withdrawn_samples_are_discarded_ones_and_nothing_is_lost() {
    let plain = Needs::none().with_variance().with_first_hits(20).with_cost().with_emission();
    for (plan, is_kept) in [
        (DISCARDS, (|sample: &Traced| sample.0 != streams::DISCARDED) as fn(&Traced) -> bool),
        // Only the samples before the withdrawal are not in the image.
        (WITHDRAWS, |sample: &Traced| sample.1 >= 4),
        (BOTH, |sample: &Traced| sample.0 != streams::DISCARDED && sample.1 >= 4),
    ] {
        let (film, traced) = trace(&plan, plain);
        let (kept, discarded): (Vec<Traced>, Vec<Traced>) = traced.iter().partition(|sample| is_kept(sample));
        for (samples, moments) in [(kept, film.moments(1)), (discarded, film.discarded(1))] {
            let mut expected = RgbMoments::default();
            samples.iter().for_each(|s| expected.push(s.2));
            assert_eq!((moments.count, moments.mean), (expected.count, expected.mean));
            assert!((0..3).all(|c| (moments.m2[c] / expected.m2[c] - 1.0).abs() < 3e-7), "{moments:?}");
        }
        let ([r, _, b], emission) = (film.moments(1).mean, film.emission(0, 1).unwrap().map(f64::from));
        assert!((emission[0] - 0.5 * r).abs() + emission[1] + (emission[2] - b).abs() < 1e-6, "{emission:?}");
        // In halves, each half has as many.
        let (halves, traced) = trace(&plan, everything());
        assert_eq!((halves.count(1), halves.discarded(1).count), (film.count(1), film.discarded(1).count));
        let sum = |moments: RgbMoments| moments.count as f64 * moments.mean[0];
        let all: f64 = traced.iter().map(|s| f64::from(s.2[0])).sum();
        assert!((sum(halves.moments(1)) + sum(halves.discarded(1)) - all).abs() < 1e-12);
        let total = plan.iter().map(|round| u64::from(round.0)).sum::<u64>();
        for film in [&film, &halves] {
            assert_eq!((film.record().samples, film.cost(1)), (2 * total, Some(total)));
        }
        assert_eq!(halves.features(1).map(|f| u64::from(f.samples)), Some(total));
        // Kept samples fill the places by index, so a withdrawal overwrites none.
        let depths: Vec<f32> = film.first_hits(1)[..16].iter().map(|h| h.unwrap().depth).collect();
        assert!(depths.iter().copied().eq((0..16).map(|k| k as f32)));
        // The next pixel is the same as without withdrawals.
        let without: Vec<Round> = plan.iter().map(|&(n, retention, _)| (n, retention, false)).collect();
        let (other, _) = trace(&without, plain);
        assert_eq!((film.moments(0), film.discarded(0)), (other.moments(0), other.discarded(0)));
        assert_eq!((film.count(0), other.count(1)), (16, 16));
    }
}

#[test]
fn invalid_withdrawals_are_refused() {
    let refused = |mark: Option<Vec<bool>>, retention: Retention, counts: [u32; 2]| {
        let plan = move |_: &Feedback<'_>, plan: &mut Plan| {
            plan.counts = counts.to_vec();
            (plan.withdraw, plan.retention) = (mark.clone(), retention);
            Progress::Trace
        };
        let mut sampler = ToySampler { points: Independent::new(1), needs: Needs::none(), plan };
        match run(&mut Field(noise), &mut sampler, Needs::none(), frame(2, 1), &Limits::samples(2)) {
            Err(Error::BadPlan { what, .. }) => what,
            other => panic!("{other:?}"),
        }
    };
    assert!(refused(Some(vec![true]), KEEP, [1, 1]).contains("wrong number of pixels"));
    assert!(refused(Some(vec![true; 2]), DISCARD, [1, 1]).contains("discards its samples"));
    assert!(refused(Some(vec![true; 2]), KEEP, [2, 0]).contains("plans no new ones"));
    // A pixel withdraws once, and before it has discarded samples.
    for plan in
        [[(1, KEEP, false), (1, KEEP, true), (1, KEEP, true)], [(1, DISCARD, false), (1, KEEP, false), (1, KEEP, true)]]
    {
        let mut sampler = rounds(plan.to_vec(), Needs::none());
        let answer = run(&mut Field(noise), &mut sampler, Needs::none(), frame(2, 1), &Limits::samples(6));
        assert!(matches!(answer, Err(Error::BadPlan { .. })), "{plan:?}");
    }
}

#[test]
fn withdrawn_samples_use_up_points_but_no_ceiling() {
    let draw = |needs: Needs, capacity, max_spp, second| {
        let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
            plan.counts[0] = if seen.round == 0 { 5 } else { second };
            plan.withdraw = (seen.round == 1).then(|| vec![true, false]);
            if seen.round < 2 { Progress::Trace } else { Progress::Done }
        };
        let mut sampler = ToySampler { points: Independent { seed: 1, capacity }, needs, plan };
        let mut limits = Limits::samples(12);
        (limits.min_spp, limits.max_spp) = (0, max_spp);
        run(&mut Field(noise), &mut sampler, needs, frame(2, 1), &limits)
    };
    let (whole, halves) = (Needs::none(), Needs::none().with_halves());
    assert_eq!(draw(whole, 12, 7, 7).unwrap().count(0), 7);
    assert!(matches!(draw(whole, 11, 7, 7), Err(Error::SequenceExhausted { requested: 12, .. })));
    assert!(matches!(draw(whole, 12, 6, 7), Err(Error::BadPlan { .. })));
    // Halves of 3 and 2 continue with 4 and 3, so 7 points of the first are used.
    assert_eq!(draw(halves, 7, 7, 7).unwrap().count(0), 7);
    assert!(matches!(draw(halves, 6, 7, 7), Err(Error::SequenceExhausted { requested: 7, .. })));
}
