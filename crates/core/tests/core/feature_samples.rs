//! Samples of features alone: where they are traced, and where not.

use crate::common::{Independent, Planned, frame};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Budget, Draws, Estimate, Feedback, Film, FirstHit, Integrator, Limits, Methods, Needs, Plan, Progress,
    Render, Sampler, Session, Worker, streams,
};

const PLACE: Block = Block::new(0);

/// Two walls that meet within each pixel of odd columns, and one wall in the others.
struct Walls {
    alone: bool,
}

impl Walls {
    fn hit(draws: &Draws<'_>) -> FirstHit {
        let [u, ..] = draws.block(PLACE);
        let normal = if draws.pixel()[0] % 2 == 1 && u < 0.3 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        FirstHit::new([0.0; 3], normal, 1.0)
    }
}

impl Integrator for Walls {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        assert_ne!(draws.id().stream, streams::FEATURES);
        Estimate::new([draws.block(PLACE)[1]; 3]).with_first_hit(Self::hit(draws)).with_cost(3)
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        assert_eq!(draws.id().stream, streams::FEATURES);
        self.alone.then(|| Estimate::new([9.0; 3]).with_first_hit(Self::hit(draws)))
    }
}

fn film(alone: bool, spp: f64, needs: Needs) -> Film {
    let limits = Limits::spp(spp);
    let render = Render::new(frame(6, 4), &limits).needs(needs);
    render.run(&mut Walls { alone }, &mut Uniform::new(Independent::new(5))).unwrap()
}

fn samples(film: &Film) -> Vec<u32> {
    (0..24).map(|i| film.features(i).unwrap().samples).collect()
}

#[test]
fn features_are_sampled_without_light_before_the_first_sample() {
    let needs = Needs::none().with_features();
    let (with, without) = (film(true, 4.0, needs), film(false, 4.0, needs));
    assert_eq!(with.image(), without.image());
    assert_eq!(samples(&without), [4; 24]);
    let found = samples(&with);
    // 4 samples miss the second wall in 24 % of the odd columns.
    assert!(found.iter().enumerate().all(|(i, n)| *n == 8 || i % 2 == 1 && *n == 16), "{found:?}");
    assert!((5..12).contains(&found.iter().filter(|n| **n == 16).count()), "{found:?}");
    assert_eq!(with.record().samples, without.record().samples);
    let alone: u32 = found.iter().map(|n| n - 4).sum();
    assert_eq!(with.record().rays, without.record().rays + u64::from(alone));
}

#[test]
fn films_without_features_or_with_those_of_halves_get_none() {
    for needs in [Needs::none().with_feature_halves(), Needs::none().with_first_hits(1)] {
        let [with, without] = [true, false].map(|alone| film(alone, 4.0, needs));
        assert_eq!(with.record().rays, without.record().rays, "{needs:?}");
        assert_eq!(with.features(1), without.features(1));
    }
}

/// Slices cut both rounds.
#[test]
fn a_later_round_samples_no_features_alone() {
    let mut sampler = Planned {
        points: Independent::new(5),
        needs: Needs::none().with_features(),
        plan: |seen: &Feedback<'_>, plan: &mut Plan| {
            plan.counts.fill(if seen.round == 0 { 4 } else { 8 });
            if seen.round < 2 { Progress::Trace } else { Progress::Done }
        },
    };
    let (frame, limits) = (frame(64, 64), Limits::spp(12.0));
    let film = Render::new(frame, &limits).run(&mut Walls { alone: true }, &mut sampler).unwrap();
    for i in 0..64 * 64 {
        let samples = film.features(i).unwrap().samples;
        assert!(samples == 16 || samples == 24 && i % 2 == 1, "{i}: {samples}");
    }
}

#[test]
fn a_tile_refuses_features_after_samples() {
    let (mut sampler, walls) = (Uniform::new(Independent::new(5)), Walls { alone: true });
    let methods = Methods::from(&mut sampler as &mut dyn Sampler).with_needs(Needs::none().with_features());
    let mut session = Session::new(frame(2, 1), Limits::spp(1.0), methods).unwrap();
    let round = session.next_round().unwrap().unwrap();
    let mut tile = round.next_tile().unwrap();
    let samples: Vec<_> = tile.samples().collect();
    samples.iter().for_each(|draws| tile.add(draws, walls.estimate(draws, &mut Worker::default())));
    tile.sample_features(|draws| walls.features_alone(draws));
    let error = round.submit(tile).unwrap_err().to_string();
    assert!(error.contains("sample features first"), "{error}");
}

/// Budgets that begin with one sample per pixel are those of a time limit.
#[test]
fn a_time_limit_samples_features_in_the_second_round_if_it_leaves_enough_samples() {
    let film = |budgets: &[u64]| {
        let limits = Limits::new(Budget::Recorded(budgets.iter().map(|spp| 24 * spp).collect()));
        let render = Render::new(frame(6, 4), &limits).needs(Needs::none().with_features());
        render.run(&mut Walls { alone: true }, &mut Uniform::new(Independent::new(5))).unwrap()
    };
    let sampled_alone = |budgets: &[u64]| {
        let film = film(budgets);
        samples(&film)
            .iter()
            .zip(film.counts())
            .map(|(samples, count)| u64::from(*samples) - count)
            .collect::<Vec<u64>>()
    };
    assert_eq!(sampled_alone(&[1, 3, 12]), [0; 24]);
    for budgets in [&[1, 4][..], &[1, 4, 12]] {
        let alone = sampled_alone(budgets);
        // One sample of light is there already.
        assert!(alone.iter().enumerate().all(|(i, n)| *n == 3 || i % 2 == 1 && *n == 11), "{alone:?}");
        assert!(alone.contains(&11), "{alone:?}");
    }
    assert!(sampled_alone(&[2, 4]).iter().all(|n| *n >= 4));
}

#[test]
fn the_recorded_budgets_of_a_time_limit_replay_its_features() {
    let draw = |budget: Budget| {
        let limits = Limits::new(budget).with_max_spp(6);
        let render = Render::new(frame(64, 48), &limits).needs(Needs::none().with_features());
        render.run(&mut Walls { alone: true }, &mut Uniform::new(Independent::new(5))).unwrap()
    };
    let timed = draw(Budget::Seconds(60.0));
    let replayed = draw(Budget::Recorded(timed.record().budgets.clone()));
    assert_eq!(timed.record().samples, 6 * 64 * 48);
    assert_eq!(timed.record().rays, replayed.record().rays);
    assert!(timed.record().rays > 3 * 6 * 64 * 48, "no features alone");
    assert!((0..64 * 48).all(|i| timed.features(i) == replayed.features(i)));
}
