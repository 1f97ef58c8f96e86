//! Samples that are withdrawn from the image pixel by pixel: nothing is lost, nothing restarts.

use crate::common::*;
use dapple_core::{
    Draws, Error, Estimate, Feedback, Film, FirstHit, Integrator, Limits, Needs, Plan, Progress, Retention, RgbMoments,
    Sampler, Worker, luminance, streams,
};
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
    Planned { points: Independent::new(5), needs, plan }
}

/// Stream, index and radiance of a sample.
type Traced = (u32, u64, [f32; 3]);

/// Writes down the column of every sample, and what was traced.
#[derive(Default)]
struct Spy(Mutex<Vec<(u32, Traced)>>);

impl Integrator for Spy {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [r, g, b, _] = draws.block(dapple_core::Block::new(0));
        let id = draws.id();
        self.0.lock().unwrap().push((id.pixel[0], (id.stream, id.index, [r, g, b])));
        let depth = id.index as f32;
        let (position, normal) = ([0.0; 3], [0.0, 0.0, 1.0]);
        let hit = FirstHit::new(position, normal, depth).with_albedo([0.5; 3]).with_footprint(1.0);
        Estimate::new([r, g, b]).with_first_hit(hit)
    }
}

/// Pixels 0 and 1 side by side, and what was traced in pixel 1, in order.
fn trace(plan: &[Round], needs: Needs) -> (Film, Vec<Traced>) {
    let mut spy = Spy::default();
    let mut sampler = rounds(plan.to_vec(), needs);
    let film = on_threads(1, || run(&mut spy, &mut sampler, needs, frame(2, 1), &Limits::samples(1000))).unwrap();
    let all = spy.0.into_inner().unwrap();
    (film, all.into_iter().filter(|s| s.0 == 1).map(|s| s.1).collect())
}

const KEEP: Retention = Retention::Keep;
const DISCARD: Retention = Retention::Discard;
const PLAN: [Round; 6] =
    [(3, DISCARD, false), (4, KEEP, false), (5, KEEP, true), (2, DISCARD, false), (1, KEEP, false), (6, KEEP, true)];

#[test]
fn indices_continue_in_every_stream() {
    let indices =
        |traced: &[Traced], stream: u32| -> Vec<u64> { traced.iter().filter(|s| s.0 == stream).map(|s| s.1).collect() };
    let (_, traced) = trace(&PLAN, Needs::none());
    assert_eq!(indices(&traced, streams::WHOLE), (0..16).collect::<Vec<_>>());
    assert_eq!(indices(&traced, streams::DISCARDED), (0..5).collect::<Vec<_>>());
    let (_, traced) = trace(&PLAN, Needs::none().with_halves());
    let both = |pair: [u32; 2]| {
        let [a, b] = pair.map(|s| indices(&traced, s));
        assert!(a.iter().copied().eq(0..a.len() as u64) && b.iter().copied().eq(0..b.len() as u64));
        a.len() + b.len()
    };
    assert_eq!([both(streams::HALVES), both(streams::DISCARDED_HALVES)], [16, 5]);
}

#[test]
fn withdrawn_samples_are_discarded_ones_and_nothing_is_lost() {
    for needs in [everything(), Needs::none().with_variance().with_extrema().with_first_hits(20).with_cost()] {
        let (film, traced) = trace(&PLAN, needs);
        // Only the last round's six are in the image.
        let (discarded, kept) = traced.split_at(traced.len() - 6);
        for (samples, moments, range, luminances) in [
            (kept, film.moments(1), film.range(1), film.luminance_range(1)),
            (discarded, film.discarded(1), film.discarded_range(1), film.discarded_luminance_range(1)),
        ] {
            let mut expected = RgbMoments::default();
            samples.iter().for_each(|s| expected.push(s.2));
            assert_eq!(moments.count, expected.count);
            let (range, luminances) = (range.unwrap(), luminances.unwrap());
            for (c, [low, high]) in [0, 1, 2].map(|c| (c, range.map(|v| v[c]))) {
                assert!((moments.mean[c] - expected.mean[c]).abs() < 1e-14, "{moments:?} for {expected:?}");
                assert!((moments.m2[c] - expected.m2[c]).abs() < 1e-13, "{moments:?} for {expected:?}");
                let values = samples.iter().map(|s| s.2[c]);
                assert_eq!(low, values.clone().fold(f32::INFINITY, f32::min));
                assert_eq!(high, values.fold(f32::NEG_INFINITY, f32::max));
            }
            let of = samples.iter().map(|s| luminance(s.2.map(f64::from)) as f32);
            assert_eq!(luminances, [of.clone().fold(f32::INFINITY, f32::min), of.fold(0.0, f32::max)]);
        }
        assert_eq!(film.record().samples, 2 * 21);
        assert_eq!(film.cost(1), Some(21));
        if needs.features {
            assert_eq!(film.features(1).unwrap().samples, 21);
        }
        if needs.first_hits == 20 {
            // Kept samples fill the places by index, so a withdrawal overwrites none.
            let depths: Vec<f32> = film.first_hits(1)[..16].iter().map(|h| h.unwrap().depth).collect();
            assert_eq!(depths, (0..16).map(|k| k as f32).collect::<Vec<_>>());
        }
        // The next pixel is the same as without withdrawals.
        let without: Vec<Round> = PLAN.iter().map(|&(n, retention, _)| (n, retention, false)).collect();
        let (other, _) = trace(&without, needs);
        assert_eq!((film.moments(0), film.discarded(0)), (other.moments(0), other.discarded(0)));
        assert_eq!((film.count(0), film.range(0)), (16, other.range(0)));
        assert_eq!(other.count(1), 16);
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
        let mut sampler = Planned { points: Independent::new(1), needs: Needs::none(), plan };
        match run(&mut Field(noise), &mut sampler, Needs::none(), frame(2, 1), &Limits::samples(2)) {
            Err(Error::BadPlan { what, .. }) => what,
            other => panic!("{other:?}"),
        }
    };
    assert!(refused(Some(vec![true]), KEEP, [1, 1]).contains("mark for each pixel"));
    assert!(refused(Some(vec![true; 2]), DISCARD, [1, 1]).contains("not kept"));
    assert!(refused(Some(vec![true; 2]), KEEP, [2, 0]).contains("traces none"));
}

#[test]
fn withdrawn_samples_use_up_points_but_no_ceiling() {
    let draw = |needs: Needs, capacity, max_spp, second| {
        let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
            plan.counts[0] = if seen.round == 0 { 5 } else { second };
            plan.withdraw = (seen.round == 1).then(|| vec![true, false]);
            if seen.round < 2 { Progress::Trace } else { Progress::Done }
        };
        let mut sampler = Planned { points: Independent { seed: 1, capacity }, needs, plan };
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
