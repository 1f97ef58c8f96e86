//! Samples of features alone: where they are traced, and where not.

use crate::common::{Independent, Planned, frame, uniform};
use dapple_core::{
    Block, Draws, Estimate, Feedback, Film, FirstHit, Integrator, Limits, Methods, Needs, Plan, Progress, Render,
    Sampler, Session, Worker, streams,
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
    render.run(&mut Walls { alone }, &mut uniform(5)).unwrap()
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
    let (mut sampler, walls) = (uniform(5), Walls { alone: true });
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

/// A lamp that covers a share of each pixel, which depends on the column, before a wall that scatters little light.
struct Lamp;

const SHARES: [f32; 4] = [0.0, 0.06, 0.5, 1.0];

impl Lamp {
    fn emission(draws: &Draws<'_>) -> [f32; 3] {
        let [u, v, ..] = draws.block(PLACE);
        let is_lit = u < SHARES[draws.pixel()[0] as usize % 4];
        // A lamp whose radiance varies by less than a factor of 2.
        if is_lit { [8.0 + 4.0 * v, 4.0, 2.0] } else { [0.0; 3] }
    }
}

impl Integrator for Lamp {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let emission = Self::emission(draws);
        Estimate::new(emission.map(|e| e + 0.1)).with_emission(emission).with_first_hit(Walls::hit(draws))
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        let hit = FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0);
        Some(Estimate::new([0.0; 3]).with_emission(Self::emission(draws)).with_first_hit(hit))
    }
}

fn lit(side: u32, spp: f64, needs: Needs) -> Film {
    let limits = Limits::spp(spp);
    Render::new(frame(side, side), &limits).needs(needs).run(&mut Lamp, &mut uniform(3)).unwrap()
}

fn edges() -> Needs {
    Needs::none().with_features().with_emission().with_halves().with_variance()
}

#[test]
fn emission_alone_is_sampled_at_edges_of_lamps() {
    let film = lit(16, 4.0, edges());
    let counts = |i: usize| [0, 1].map(|half| film.emission_alone(half, i).map(|(n, _)| n));
    let mut found = [0; 4];
    for i in 0..256 {
        assert!([[None; 2], [Some(32); 2]].contains(&counts(i)), "{i}: {:?}", counts(i));
        found[i % 4] += usize::from(counts(i)[0].is_some());
        assert_eq!(film.features(i).unwrap().samples > 60, counts(i)[0].is_some());
    }
    // Four samples find both sides in 22 and 87 % of the pixels of the middle columns.
    assert!(found[0] == 0 && found[3] == 0, "{found:?}");
    assert!((6..25).contains(&found[1]) && (48..64).contains(&found[2]), "{found:?}");
    let halves = Needs::none().with_halves();
    for (needs, refined) in [(edges(), true), (halves.with_features(), false), (halves.with_emission(), false)] {
        let film = lit(16, 4.0, needs);
        assert_eq!((0..256).any(|i| film.refined_mean(i) != film.mean(i)), refined);
        let changes = |i| film.refined_half(1, i).unwrap().mean != film.half(1, i).unwrap().mean;
        assert_eq!((0..256).any(changes), refined);
        assert_eq!((0..256).any(|i| film.features(i).is_some_and(|f| f.samples > 60)), refined);
    }
    let whole = lit(16, 4.0, Needs::none().with_features().with_emission());
    assert_eq!(whole.emission_alone(0, 2), whole.emission_alone(1, 2));
    assert!((0..256).filter_map(|i| whole.emission_alone(0, i)).all(|(n, _)| n == 64));
}

/// The samples by which edges are found are not among those that are averaged. With them, columns of which a lamp covers 6 %
/// would lose light. The errors are at most 4 standard errors: 8 comparisons raise a false alarm once in 2000 seeds.
#[test]
fn refined_means_have_the_light_of_plain_ones_and_less_noise() {
    let film = lit(256, 4.0, edges());
    for (column, share) in SHARES.into_iter().enumerate() {
        let pixels: Vec<usize> = (0..256 * 256).filter(|i| i % 4 == column).collect();
        let statistics = |of: &dyn Fn(usize) -> f64| {
            let n = pixels.len() as f64;
            let mean = pixels.iter().map(|&i| of(i)).sum::<f64>() / n;
            let variance = pixels.iter().map(|&i| (of(i) - mean).powi(2)).sum::<f64>() / (n - 1.0);
            [mean, variance]
        };
        let [plain, refined] = [statistics(&|i| film.mean(i)[0]), statistics(&|i| film.refined_mean(i)[0])];
        let wanted = f64::from(share) * 10.0 + 0.1;
        for [mean, variance] in [plain, refined] {
            let error = (variance / pixels.len() as f64).sqrt();
            assert!((mean - wanted).abs() <= 4.0 * error + 1e-6, "{column}: {mean}, not {wanted} +- {error}");
        }
        let less = refined[1] / plain[1];
        match column {
            1 | 2 => assert!(less < [0.9, 0.25][column - 1], "{column}: {less} of the variance"),
            _ => assert_eq!(plain, refined),
        }
        for i in pixels {
            let halves = [0, 1].map(|half| film.refined_half(half, i).unwrap().mean);
            let seen = [0, 1].map(|half| film.refined_emission(half, i).unwrap());
            for c in 0..3 {
                let mean = 0.5 * (halves[0][c] + halves[1][c]);
                assert!((mean - film.refined_mean(i)[c]).abs() < 1e-5 * (1.0 + mean));
                assert!((halves[0][c] - f64::from(seen[0][c]) - 0.1).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn a_film_of_one_half_has_the_emission_alone_of_that_half() {
    let film = lit(8, 4.0, edges());
    for half in [0, 1] {
        let own = film.half_film(half).unwrap();
        for i in 0..64 {
            assert_eq!(own.emission_alone(0, i), film.emission_alone(half, i));
            assert_eq!(own.refined_mean(i), film.refined_half(half, i).unwrap().mean);
        }
    }
}

#[test]
fn a_time_limit_samples_features_in_the_second_round_if_it_leaves_enough_samples() {
    let film = |limits: Limits| {
        let render = Render::new(frame(6, 4), &limits).needs(Needs::none().with_features());
        render.run(&mut Walls { alone: true }, &mut uniform(5)).unwrap()
    };
    let timed = |max_spp| Limits::seconds(60.0).with_max_spp(max_spp);
    let sampled_alone = |limits| {
        let film = film(limits);
        samples(&film)
            .iter()
            .zip(film.counts())
            .map(|(samples, count)| u64::from(*samples) - count)
            .collect::<Vec<u64>>()
    };
    assert_eq!(sampled_alone(timed(3)), [0; 24]);
    for max_spp in [4, 12] {
        let alone = sampled_alone(timed(max_spp));
        // One sample of light is there already.
        assert!(alone.iter().enumerate().all(|(i, n)| *n == 3 || i % 2 == 1 && *n == 11), "{alone:?}");
        assert!(alone.contains(&11), "{alone:?}");
    }
    assert!(sampled_alone(Limits::spp(4.0)).iter().all(|n| *n >= 4));
}
