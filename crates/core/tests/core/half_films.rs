//! Halves of films as films, and features per half.

use crate::common::{Independent, Planned, Points, Traced, everything, frame, numbers, on_threads, run};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Combine, Draws, Error, Estimate, Feedback, Film, FirstHit, Limits, Needs, Plan, PointSet, Progress, Retention,
    SampleId, SurfaceFeatures, Worker, streams,
};

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
    let beside = (film.features(i), film.emission(0, i), film.indirect(0, i));
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
    let mut sampler = Planned { points, needs: all(), plan };
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
    let plain = Needs::none().with_variance().with_halves().with_features();
    let (without, with) = (render(points, plain, 6.0), render(points, plain.with_feature_halves(), 6.0));
    assert_eq!(plain.with_feature_halves(), plain.and(Needs::none().with_feature_halves()));
    assert_eq!(Film::bytes_per_pixel(with.needs()), Film::bytes_per_pixel(&plain) + 2 * 120);
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
