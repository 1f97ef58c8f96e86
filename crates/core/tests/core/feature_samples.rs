//! Samples of features alone, halves of films as films, and features per half.

use crate::common::{Independent, Points, ToySampler, Traced, everything, frame, numbers, on_threads, run, uniform};
use dapple_core::limits::Schedule;
use dapple_core::plan::{Combine, Feedback, Plan, Progress, Retention};
use dapple_core::point_set::streams;
use dapple_core::render::{Control, Status};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Error, Estimate, Film, FirstHit, Integrator, Limits, Methods, Needs, PointSet, Render, SampleId,
    Sampler, Session, Snapshot, SurfaceFeatures, Worker,
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
    let mut sampler = ToySampler {
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
fn rows_and_snapshots_keep_the_emission_alone() {
    let whole = lit(16, 4.0, edges());
    let rows = whole.of_rows(5..9).unwrap();
    assert!((0..64).any(|i| rows.emission_alone(1, i).is_some()));
    assert!((0..64).all(|i| rows.emission_alone(1, i) == whole.emission_alone(1, i + 80)));
    let (mut saved, limits) = (Vec::new(), Limits::spp(4.0).with_schedule(Schedule::default().with_progress_spp(1)));
    let render = Render::new(frame(16, 16), &limits).needs(edges());
    let mut stop = |status: &Status<'_>| {
        saved = status.snapshot();
        Control::Stop
    };
    render.monitor(&mut stop).run(&mut Lamp, &mut uniform(3)).unwrap();
    let snapshot = Snapshot::from_bytes(&saved).unwrap();
    let render = Render::new(frame(16, 16), &limits).needs(edges());
    let resumed = render.resume(snapshot, &mut Lamp, &mut uniform(3)).unwrap();
    assert!((0..256).all(|i| resumed.emission_alone(0, i) == whole.emission_alone(0, i)));
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

/// Noise with hits, emission, splats, costs and rejected samples.
fn trace(draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
    let [a, b, c, d] = numbers(draws);
    let [x, y] = draws.pixel();
    worker.splat([x, y + 1], [b; 3]);
    let hit = FirstHit::new([a, b, c], [0.0, 0.0, 1.0], 1.0 + d).with_albedo([b; 3]).with_footprint(0.1);
    let behind = SurfaceFeatures::from(&hit);
    let value = if c < 0.1 { -1.0 } else { a };
    let estimate =
        Estimate::new([value, b, 0.5 + d]).with_emission([0.1; 3]).with_indirect([c, 0.5 * b, 0.5]).with_cost(x % 3);
    let estimate = estimate.with_first_hit((d > 0.3).then_some(hit));
    if d > 0.3 && a > 0.5 { estimate.with_features(behind) } else { estimate }
}

/// The points of one stream, in whatever stream they are asked for.
fn one_stream(points: Independent, stream: u32) -> impl PointSet {
    Points(move |id: SampleId, block| points.block(SampleId::new(id.pixel, stream, id.index), block))
}

fn all() -> Needs {
    everything().with_splats()
}

fn render(points: impl PointSet, needs: Needs, spp: f64) -> Film {
    run(&mut Traced(trace), &mut Uniform::new(points), needs, frame(9, 7), &Limits::spp(spp)).unwrap()
}

/// All statistics of a pixel that do not depend on streams of other samples.
fn statistics(film: &Film, i: usize) -> String {
    let radiance = (film.count(i), film.mean(i), film.moments(i), film.discarded(i));
    let beside = (film.features(i), film.emission(0, i), film.half_indirect(0, i));
    format!("{radiance:?} {beside:?}")
}

#[test]
fn a_uniform_half_film_equals_a_render_of_that_stream_alone() {
    let points = Independent::new(8);
    // Seven samples: four in the first half, three in the second.
    let film = render(points, all(), 7.0);
    for (half, spp) in [(0, 4.0), (1, 3.0)] {
        let part = film.half_film(half).unwrap();
        let alone = render(one_stream(points, streams::HALVES[half]), *part.needs(), spp);
        let other = render(one_stream(points, streams::HALVES[1 - half]), *part.needs(), spp);
        assert_eq!((part.needs(), part.frame()), (alone.needs(), film.frame()));
        assert_eq!(part.record().samples, alone.record().samples);
        let mut differ = 0;
        for i in 0..film.frame().pixels() {
            assert_eq!(statistics(&part, i), statistics(&alone, i), "half {half}, pixel {i}");
            assert_eq!(part.first_hits(i), film.first_hits(i));
            differ += usize::from(statistics(&part, i) != statistics(&other, i));
        }
        assert_eq!(differ, film.frame().pixels(), "control: the other stream gives other statistics");
        assert!(part.cost(0).is_none() && part.half(0, 0).is_none() && part.squared_error(0).is_none());
        // Rejected samples can be replayed, so they keep their streams.
        assert!(part.rejected().iter().all(|r| r.sample.stream == streams::HALVES[half]));
        assert_eq!(part.record().rejected, alone.record().rejected);
    }
}

#[test]
fn half_films_hold_what_the_half_discarded() {
    let points = Independent::new(8);
    let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
        let counts = [[1, 3], [2, 0], [4, 2]].get(seen.round as usize);
        let Some(&[first, second]) = counts else { return Progress::Done };
        plan.counts.fill(first);
        plan.second_half = Some(vec![second; seen.pixels()]);
        plan.combine = Combine::Equally;
        plan.retention = if seen.round == 0 { Retention::Discard } else { Retention::Keep };
        Progress::Trace
    };
    let mut sampler = ToySampler { points, needs: all(), plan };
    let film = run(&mut Traced(trace), &mut sampler, all(), frame(9, 7), &Limits::spp(20.0)).unwrap();
    for (half, kept, discarded) in [(0, 6, 1), (1, 2, 3)] {
        let part = film.half_film(half).unwrap();
        assert_eq!((part.combine(), part.record().samples), (Combine::ByCount, 63 * (kept + discarded)));
        for i in 0..63 {
            assert_eq!((part.count(i), part.discarded(i).count), (kept, discarded));
            assert_eq!(part.mean(i), film.half(half, i).unwrap().mean);
            assert_eq!(part.features(i), film.half_features(half, i));
            assert_eq!(part.features(i).map(|f| u64::from(f.samples)), Some(kept + discarded));
        }
    }
}

#[test]
fn features_per_half_are_recorded_on_request_and_change_no_other_bit() {
    let points = Independent::new(3);
    let plain = Needs::none().with_half_variance().with_features();
    let (without, with) = (render(points, plain, 6.0), render(points, plain.with_feature_halves(), 6.0));
    assert_eq!(plain.with_feature_halves(), plain.and(Needs::none().with_feature_halves()));
    assert_eq!(Film::bytes_per_pixel(with.needs()), Film::bytes_per_pixel(&plain) + 2 * 60);
    let mut differ = 0;
    for i in 0..63 {
        assert_eq!(statistics(&with, i), statistics(&without, i));
        assert_eq!((without.half_features(0, i), with.half(0, i)), (None, without.half(0, i)));
        let [a, b] = [0, 1].map(|half| with.half_features(half, i).unwrap());
        let pooled = with.features(i).unwrap();
        assert_eq!((a.samples + b.samples, a.hits + b.hits), (pooled.samples, pooled.hits));
        let depth = (a.hits as f32 * a.depth + b.hits as f32 * b.depth) / pooled.hits.max(1) as f32;
        assert!((depth - pooled.depth).abs() < 1e-5, "{depth} is not {}", pooled.depth);
        differ += usize::from(a != b);
    }
    assert_eq!(differ, 63);
    // Without them, a half film has the features of both halves.
    assert_eq!(without.half_film(1).unwrap().features(5), without.features(5));
    assert_ne!(with.half_film(1).unwrap().features(5), with.features(5));
    // Threads and single samples give the same.
    let threads = on_threads(3, || render(points, plain.with_feature_halves(), 6.0));
    assert!((0..63).all(|i| threads.half_features(1, i) == with.half_features(1, i)));
}

#[test]
fn missing_halves_are_named() {
    let film = render(Independent::new(1), Needs::none().with_features(), 2.0);
    let refused = film.half_film(0).unwrap_err();
    assert!(refused.to_string().starts_with("half_film reads independent halves"), "{refused}");
    let refused = film.require("reader", &Needs::none().with_feature_halves()).unwrap_err();
    assert!(matches!(refused, Error::NotRecorded { what: "independent halves", .. }), "{refused}");
    let halves = render(Independent::new(1), Needs::none().with_features().with_halves(), 2.0);
    let refused = halves.require("reader", &Needs::none().with_feature_halves()).unwrap_err();
    assert!(matches!(refused, Error::NotRecorded { what: "first-hit features per half", .. }), "{refused}");
}

/// A film of radiance alone is refused by readers of features, and so are its halves.
#[test]
fn half_films_know_whether_hits_were_reported() {
    let needs = Needs::none().with_feature_halves();
    let mut film = Film::new(frame(1, 1), needs);
    (0..4).for_each(|k| film.push(0, k & 1, [1.0; 3]));
    let reads = Needs::none().with_features();
    assert!(matches!(film.half_film(0).unwrap().require("reader", &reads), Err(Error::NoneReported { .. })));
    let wall = FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 2.0);
    film.push_estimate(0, 1, &Estimate::new([1.0; 3]).with_first_hit(wall));
    assert!((0..2).all(|half| film.half_film(half).unwrap().require("reader", &reads).is_ok()));
    assert_eq!(film.half_features(1, 0).map(|f| f.hits), Some(1));
    assert_eq!(film.half_features(0, 0).map(|f| f.hits), Some(0));
}
