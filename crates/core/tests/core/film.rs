//! Statistics of a film: sums that do not stall, variances that keep their digits, bad samples that
//! do not spread.

use crate::common::*;
use dapple_core::film::{Moments, PixelStatistics, RejectedReason, RgbMoments};
use dapple_core::point_set::streams;
use dapple_core::samplers::Uniform;
use dapple_core::{
    Draws, Error, Estimate, Film, FirstHit, Frame, InvalidSample, Limits, Needs, PointSet, SampleId, SurfaceFeatures,
    Worker,
};
use rand::RngExt;

#[test]
fn sums_do_not_stall_at_2_24_samples_f01() {
    let mut moments = RgbMoments::default();
    for _ in 0..1 << 25 {
        moments.push([0.1; 3]);
    }
    assert!((moments.mean[0] / f64::from(0.1f32) - 1.0).abs() < 1e-6, "{}", moments.mean[0]);
    // Through the render loop.
    let total = 17 << 20;
    let limits = Limits::samples(total);
    let ones = &mut Field(|_, _| [1.0, 1.0, 0.1]);
    let mut sampler = constant();
    let film = run(ones, &mut sampler, Needs::none().with_variance(), frame(1, 1), &limits).unwrap();
    assert_eq!(film.count(0), total);
    assert!((film.mean(0)[0] - 1.0).abs() < 1e-6 && film.moments(0).variance().unwrap()[0] == 0.0);
    // Negative control: a sum in single precision stalls at 2^24.
    let stalled = (0..total).fold(0f32, |sum, _| sum + 1.0);
    assert_eq!(stalled, (1 << 24) as f32);
}

/// Points that cost nothing.
fn constant() -> Uniform<impl PointSet> {
    Uniform::new(Points(|_, _| [0.5; 4]))
}

#[test]
fn variance_far_from_zero_keeps_its_digits_f02() {
    let mut rng = rng(1);
    let deviations: Vec<f64> = (0..4096).map(|_| (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0).collect();
    for mean in [1e3, 1e4, 1e5] {
        let values: Vec<f32> = deviations.iter().map(|d| (mean + d) as f32).collect();
        // The true variance, in two passes over the rounded values.
        let centre = values.iter().map(|&x| f64::from(x)).sum::<f64>() / 4096.0;
        let truth = values.iter().map(|&x| (f64::from(x) - centre).powi(2)).sum::<f64>() / 4095.0;
        let mut film = Film::new(frame(1, 1), Needs::none().with_variance());
        values.iter().for_each(|&x| film.push(0, 0, [x; 3]));
        for variance in film.moments(0).variance().unwrap() {
            assert!((variance / truth - 1.0).abs() < 1e-3, "mean {mean}: {variance} instead of {truth}");
        }
        // Negative control: sums of squares in single precision are off by more than the spread.
        let (sum, squares) = values.iter().fold((0f32, 0f32), |(s, q), &x| (s + x, q + x * x));
        let naive = (squares - sum * sum / 4096.0) / 4095.0;
        assert!((f64::from(naive) / truth - 1.0).abs() > 0.5, "mean {mean}: the naive rule gives {naive}");
    }
}

#[test]
fn merged_moments_are_those_of_all_values_f03() {
    let mut rng = rng(2);
    for scale in [1.0f32, 1e-3, 1e3] {
        let values: Vec<[f32; 3]> = (0..10_000).map(|_| [rng.random::<f32>() * scale, scale, rng.random()]).collect();
        let mut whole = RgbMoments::default();
        values.iter().for_each(|&v| whole.push(v));
        for _ in 0..20 {
            let mut merged = RgbMoments::default();
            let mut rest = &values[..];
            while !rest.is_empty() {
                // Some parts have no value or one.
                let size = rng.random_range(0..4u32).pow(rng.random_range(0..6)) as usize;
                let (part, others) = rest.split_at(size.min(rest.len()));
                rest = others;
                let mut moments = RgbMoments::default();
                part.iter().for_each(|&v| moments.push(v));
                merged.merge(&moments);
            }
            assert_eq!(merged.count, whole.count);
            for c in 0..3 {
                assert!((merged.mean[c] / whole.mean[c] - 1.0).abs() < 1e-12);
                assert!((merged.m2[c] - whole.m2[c]).abs() <= 1e-12 * whole.m2[c]);
            }
            assert_eq!(merged.m2[1], 0.0, "a constant has no variance");
        }
    }
    let mut some = Moments::default();
    [1.0, 2.0, 4.0].into_iter().for_each(|x| some.push(x));
    let mut merged = some;
    merged.merge(&Moments::default());
    assert_eq!(merged, some);
    let mut merged = Moments::default();
    merged.merge(&some);
    assert_eq!(merged, some);
}

/// The film adds squares up in `f32`. The rounding errors of a million values are independent, which makes 2e-5 of the sum.
#[test]
#[cfg_attr(miri, ignore = "too many samples for Miri")]
fn variances_of_a_million_samples_are_exact_to_four_digits() {
    for needs in [Needs::none().with_variance(), Needs::none().with_variance().with_halves()] {
        let (mut rng, mut exact) = (rng(5), RgbMoments::default());
        let mut film = Film::new(frame(1, 1), needs);
        for k in 0..1_000_000 {
            let x: f32 = rng.random();
            let value = [x, 1e3 + x, -(1.0 - x).ln()];
            film.push(0, k % 2, value);
            exact.push(value);
        }
        let (found, wanted) = (film.moments(0).variance().unwrap(), exact.variance().unwrap());
        assert!((0..3).all(|c| (found[c] / wanted[c] - 1.0).abs() < 1e-4), "{found:?}, not {wanted:?}");
    }
}

#[test]
fn a_half_without_the_other_has_a_variance_if_it_is_recorded() {
    for (needs, variance) in
        [(Needs::none().with_half_variance(), Some([2.0; 3])), (Needs::none().with_halves().with_variance(), None)]
    {
        let mut film = Film::new(frame(2, 1), needs);
        for (half, value) in [(0, 1.0), (1, 5.0), (0, 3.0), (1, 5.0)] {
            (0..2).for_each(|i| film.push(i, half, [value; 3]));
        }
        let both = film.moments(0).variance();
        let without = film.without_samples(|half, i| (half, i) == (1, 0)).unwrap();
        assert_eq!((without.count(0), without.mean(0), without.moments(0).variance()), (2, [2.0; 3], variance));
        assert_eq!((without.moments(1).variance(), film.half(0, 1).unwrap().variance()), (both, variance));
        let half = film.half_film(0).unwrap();
        assert_eq!((half.moments(0).variance(), half.needs().variance), (variance, variance.is_some()));
        let none = film.without_samples(|_, i| i == 0).unwrap();
        assert_eq!((none.count(0), none.moments(0).m2), (0, [0.0; 3]));
    }
}

#[test]
fn features_count_as_known_after_65535_samples() {
    let mut film = Film::new(frame(1, 1), Needs::none().with_features());
    for k in 0..65_540 {
        let hit = FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], if k < 65_535 { 1.0 } else { 2.0 });
        film.push_estimate(0, 0, &Estimate::new([1.0; 3]).with_first_hit(hit));
    }
    let features = film.features(0).unwrap();
    assert_eq!((features.samples, features.hits, features.depth), (65_535, 65_535, 1.0));
    assert_eq!((features.variance, film.count(0)), (Some([0.0; 4]), 65_540));
}

#[test]
fn counts_beyond_32_bits_are_right_f04() {
    for start in [1u64 << 24, 1 << 32, 1 << 52] {
        let mut moments = RgbMoments::default();
        (moments.count, moments.mean) = (start - 1, [1.0; 3]);
        moments.push([1.0; 3]);
        moments.push([1.0; 3]);
        assert_eq!(moments.count, start + 1);
        assert_eq!(moments.mean, [1.0; 3]);
        let twice = moments;
        moments.merge(&twice);
        assert_eq!(moments.count, 2 * (start + 1));
    }
    let mut one = RgbMoments::default();
    assert_eq!(one.variance(), None);
    one.push([3.0; 3]);
    assert_eq!(one.variance(), None);
    one.push([3.0; 3]);
    assert_eq!(one.variance(), Some([0.0; 3]));
    // Unknown rather than zero if variance is not recorded.
    let mut film = Film::new(frame(1, 1), Needs::none());
    film.push(0, 0, [1.0; 3]);
    film.push(0, 0, [2.0; 3]);
    assert!(film.moments(0).variance().is_none() && film.moments(0).m2[0].is_nan());
}

const BAD: [(f32, RejectedReason); 4] = [
    (f32::NAN, RejectedReason::NotFinite),
    (f32::INFINITY, RejectedReason::NotFinite),
    (f32::NEG_INFINITY, RejectedReason::NotFinite),
    (-0.25, RejectedReason::Negative),
];

/// Noise, but `bad` at some samples of pixel (2, 1): those whose first coordinate is below 0.2.
fn injected(bad: f32) -> impl Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync {
    move |pixel, u| {
        let mut radiance = noise(pixel, u);
        if pixel == [2, 1] && u[0] < 0.2 {
            radiance[1] = bad;
        }
        radiance
    }
}

#[test]
fn one_bad_sample_is_rejected_and_replayed_f05() {
    let (size, spp, points) = (frame(5, 4), 40, Independent::new(3));
    for needs in [Needs::none().with_variance(), everything()] {
        let render = |field: &(dyn Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync), limits: &Limits| {
            run(&mut Field(field), &mut Uniform::new(points), needs, size, limits)
        };
        let limits = Limits::samples(20 * spp);
        let clean = render(&noise, &limits).unwrap();
        let zeroed = render(&|p, u| if p == [2, 1] && u[0] < 0.2 { [0.0; 3] } else { noise(p, u) }, &limits).unwrap();
        for (bad, reason) in BAD {
            let field = injected(bad);
            let film = render(&field, &limits).unwrap();
            assert!(film.record().rejected > 2);
            assert_eq!(film.record().rejected, film.rejected().len() as u64);
            assert_eq!(film.counts(), clean.counts(), "a rejected sample counts in n");
            for i in 0..20 {
                // The pixel is as if the sample were zero, and every other pixel is unchanged.
                assert_eq!(film.moments(i).mean, zeroed.moments(i).mean);
                assert_eq!(film.moments(i).m2, zeroed.moments(i).m2);
                assert_eq!(film.mean(i) == clean.mean(i), i != 7);
            }
            for rejected in film.rejected() {
                assert_eq!((rejected.sample.pixel, rejected.reason), ([2, 1], reason));
                assert!(points.block(rejected.sample, 0)[0] < 0.2, "the sample named does not replay");
            }
            let mut strict = limits.clone();
            strict.invalid = InvalidSample::Fail;
            let Err(Error::InvalidSample { sample, value, points: name }) = render(&field, &strict) else {
                panic!("strict mode let {bad} pass")
            };
            let (replayed, value) = (field(sample.pixel, points.block(sample, 0)), value.map(f32::to_bits));
            assert_eq!((replayed.map(f32::to_bits), name), (value, "independent:seed=3".into()));
        }
    }
}

#[test]
fn a_million_bad_samples_list_the_first_in_order_f05() {
    let limits = |progress_spp, tile_rows| {
        let mut limits = Limits::samples(1_000_000);
        (limits.schedule.progress_spp, limits.schedule.tile_rows) = (progress_spp, tile_rows);
        limits
    };
    for needs in [Needs::none(), Needs::none().with_halves()] {
        let film = |limits: &Limits| {
            let bad = &mut Field(|_, _| [f32::NAN; 3]);
            run(bad, &mut constant(), needs, frame(10, 10), limits).unwrap()
        };
        let film_a = film(&limits(0, 1));
        assert_eq!(film_a.record().rejected, 1_000_000);
        let listed: Vec<SampleId> = film_a.rejected().iter().map(|r| r.sample).collect();
        let stream = if needs.halves { streams::HALVES[0] } else { streams::WHOLE };
        let first = (0..1024).map(|index| SampleId::new([0, 0], stream, index));
        assert!(listed.into_iter().eq(first));
        assert_eq!(film_a.rejected(), film(&limits(7, 64)).rejected());
        assert!((0..100).all(|i| film_a.mean(i) == [0.0; 3]));
    }
}

#[test]
fn bad_samples_pushed_by_hand_are_rejected_f05() {
    let mut film = Film::new(frame(2, 1), Needs::none().with_variance().with_halves());
    film.push(1, 1, [1.0; 3]);
    film.push(1, 1, [f32::NAN, 1.0, 1.0]);
    assert_eq!((film.count(1), film.mean(1), film.record().rejected), (2, [0.5; 3], 1));
    let sample = SampleId::new([1, 0], streams::HALVES[1], 1);
    assert_eq!(film.rejected()[0].sample, sample);
}

#[test]
fn first_hits_with_a_nan_count_as_misses() {
    let mut hits = Traced(|draws: &Draws<'_>, _: &mut Worker| {
        let depth = if draws.id().index % 3 == 1 { f32::NAN } else { 2.0 };
        let hit = FirstHit::new([1.0; 3], [0.0, 0.0, 1.0], depth)
            .with_albedo([0.5; 3])
            .with_footprint(1.0)
            .with_material(4)
            .with_shape(5 + draws.id().index as u32)
            .with_primitive(6);
        Estimate::new([1.0; 3]).with_first_hit(draws.wants_first_hit().then_some(hit)).with_cost(3)
    });
    let needs = Needs::none().with_features().with_surfaces().with_first_hits(4).with_cost();
    let film = run(&mut hits, &mut constant(), needs, frame(1, 1), &Limits::samples(9)).unwrap();
    let features = film.features(0).unwrap();
    assert_eq!((features.samples, features.hits, features.depth), (9, 6, 2.0));
    assert_eq!(features.variance, Some([0.0; 4]));
    let found: Vec<bool> = film.first_hits(0).iter().map(Option::is_some).collect();
    assert_eq!((found, film.cost(0)), (vec![true, false, true, true], Some(27)));
    assert_eq!(film.surface(0), Some([5, 6]), "that of the first sample");
    let mut film = Film::new(frame(1, 1), Needs::none().with_surfaces());
    for depth in [f32::NAN, 1.0] {
        let hit = FirstHit::new([0.0; 3], [1.0, 0.0, 0.0], depth);
        film.push_estimate(0, 0, &Estimate::new([1.0; 3]).with_first_hit(hit));
        assert_eq!(film.surface(0), None, "the first sample misses");
    }
    let bare = run(&mut hits, &mut constant(), Needs::none(), frame(1, 1), &Limits::samples(9)).unwrap();
    assert_eq!((bare.features(0), bare.first_hits(0).len(), bare.cost(0)), (None, 0, None));
}

#[test]
fn features_replace_those_of_first_hits_unless_rare_or_nan() {
    let needs = Needs::none().with_features().with_first_hits(1);
    // The depth of the features of each sample, and true if they are rare.
    let features = |samples: [(f32, bool); 4]| {
        let mut behind = Traced(move |draws: &Draws<'_>, _: &mut Worker| {
            let (depth, rare) = samples[draws.id().index as usize];
            let features = SurfaceFeatures::new([0.0; 3], [0.0, 0.0, 1.0], depth).with_rare(rare);
            assert!(draws.wants_features() && draws.wants_first_hit());
            Estimate::new([1.0; 3])
                .with_first_hit(FirstHit::new([0.0; 3], [1.0, 0.0, 0.0], 1.0))
                .with_features(features)
        });
        let film = run(&mut behind, &mut constant(), needs, frame(1, 1), &Limits::samples(4)).unwrap();
        assert_eq!(film.first_hits(0)[0].map(|hit| hit.depth), Some(1.0));
        let features = film.features(0).unwrap();
        (features.samples, features.hits, features.depth)
    };
    assert_eq!(features([(2.0, false), (4.0, false), (9.0, true), (3.0, false)]), (3, 3, 3.0));
    assert_eq!(features([(2.0, true), (4.0, false), (9.0, true), (9.0, true)]), (2, 2, 3.0), "the first one counts");
    assert_eq!(features([(f32::NAN, false), (3.0, false), (3.0, false), (5.0, false)]), (4, 4, 3.0), "the first hit");
}

#[test]
fn a_film_without_needed_statistics_is_refused() {
    let all = [
        Needs::none().with_variance(),
        Needs::none().with_splats(),
        Needs::none().with_halves(),
        Needs::none().with_features(),
        Needs::none().with_first_hits(2),
        Needs::none().with_cost(),
    ];
    for (k, needs) in all.iter().enumerate() {
        let others = all.iter().enumerate().filter(|(j, _)| *j != k).fold(Needs::none(), |sum, (_, n)| sum.and(*n));
        let film = Film::new(frame(2, 2), others);
        assert!(matches!(film.require("somebody", needs), Err(Error::NotRecorded { .. })), "{needs:?}");
        assert!(film.require("somebody", &others).is_ok());
    }
}

#[test]
fn emission_is_averaged_within_each_half_and_bounded_by_radiance() {
    let emission = [[1.0, 0.0, 9.0], [0.5, f32::NAN, -1.0], [0.0, f32::INFINITY, 2.0]];
    let mut lamps = Traced(|draws: &Draws<'_>, _: &mut Worker| {
        Estimate::new([2.0; 3]).with_emission(emission[draws.id().index as usize % 3])
    });
    let limits = Limits::samples(6);
    let mut draw = |needs| run(&mut lamps, &mut constant(), needs, frame(1, 1), &limits).unwrap();
    let film = draw(Needs::none().with_halves().with_emission());
    let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    for half in [0, 1] {
        let emission = film.emission(half, 0).unwrap();
        assert!(near(emission, [0.5, 2.0 / 3.0, 4.0 / 3.0]), "{emission:?}");
    }
    let film = draw(Needs::none().with_emission());
    assert!(near(film.emission(0, 0).unwrap(), [0.5, 2.0 / 3.0, 4.0 / 3.0]) && film.emission(1, 0).is_some());
    let bare = draw(Needs::none().with_halves());
    assert_eq!((bare.emission(0, 0), bare.image()), (None, film.image()));
    assert!(bare.require("a filter", &Needs::none().with_emission()).is_ok(), "filters work without it");
}

#[test]
fn indirect_light_is_averaged_within_each_half_and_bounded_by_radiance() {
    let rejected = [[f32::INFINITY, 1.0, 1.0], [0.5; 3]];
    let samples = [[[2.0; 3], [1.0, 0.0, 9.0]], [[2.0; 3], [0.5, f32::NAN, -1.0]], rejected, [[2.0; 3], [1.5; 3]]];
    // (1 + 0.5 + 0 + 1.5) / 4, and so on.
    let (mean, variance) = ([0.75, 0.375, 0.875], [5.0 / 12.0, 0.5625, 1.0625]);
    let bounces = |draws: &Draws<'_>, _: &mut Worker| {
        let [radiance, indirect] = samples[draws.id().index as usize % 4];
        Estimate::new(radiance).with_indirect(indirect)
    };
    let draw = |needs| run(&mut Traced(bounces), &mut constant(), needs, frame(1, 1), &Limits::samples(8)).unwrap();
    let film = draw(Needs::none().with_half_variance().with_indirect());
    for half in [0, 1] {
        let seen = film.half_indirect(half, 0).unwrap();
        let got = (seen.mean, seen.variance().unwrap());
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(seen.count == 4 && near(got.0, mean) && near(got.1, variance), "{got:?}");
    }
    let pooled = draw(Needs::none().with_halves().with_variance().with_indirect());
    assert_eq!(pooled.indirect(0), film.indirect(0));
    assert!(pooled.half_indirect(0, 0).unwrap().m2[0].is_nan(), "no variance of the half");
    let bare = draw(Needs::none().with_halves());
    assert!(bare.indirect(0).is_none() && bare.half_indirect(0, 0).is_none());
    assert!(bare.require("a filter", &Needs::none().with_indirect()).is_ok(), "filters work without it");
    assert!(draw(Needs::none().with_indirect()).indirect(0).unwrap().m2[0].is_nan(), "no variance");
}

fn film(needs: Needs) -> Film {
    Film::new(Frame::new(2, 1).unwrap(), needs)
}

fn wall() -> FirstHit {
    FirstHit::new([1.0, 2.0, 3.0], [0.0, 0.0, -1.0], 4.0).with_albedo([0.5, 0.25, 0.125]).with_material(7)
}

/// Without this, a filter guided by features would run on colours alone and say nothing.
#[test]
fn a_film_filled_with_radiance_alone_is_refused_where_features_or_hits_are_read() {
    for (needs, what) in
        [(Needs::none().with_features(), "first-hit features"), (Needs::none().with_first_hits(1), "first hits")]
    {
        let mut film = film(needs);
        assert!(film.require("a filter", &needs).is_ok(), "an empty film lacks nothing");
        film.push(0, 0, [1.0; 3]);
        let error = film.require("a filter", &needs).unwrap_err();
        assert!(matches!(error, Error::NoneReported { .. }), "{error:?}");
        let message = error.to_string();
        assert!(message.contains(what) && message.contains("Film::push_estimate"), "{message}");
        assert!(film.require("a filter", &Needs::none()).is_ok(), "nothing of it is read");
        film.push_estimate(1, 0, &Estimate::new([1.0; 3]).with_first_hit(wall()));
        assert!(film.require("a filter", &needs).is_ok(), "one sample reports");
    }
}

#[test]
fn a_film_of_nothing_but_sky_has_its_features() {
    let needs = Needs::none().with_features().with_first_hits(1);
    let mut film = film(needs);
    (0..2).for_each(|i| film.push_estimate(i, 0, &Estimate::new([1.0; 3])));
    assert!(film.require("a filter", &needs).is_ok());
    assert_eq!(film.features(0).map(|f| (f.samples, f.hits)), Some((1, 0)));
}

#[test]
fn an_estimate_brings_all_that_the_film_records() {
    let needs = Needs::none().with_halves().with_features().with_first_hits(2).with_cost().with_emission();
    let mut film = film(needs);
    let behind = SurfaceFeatures::new([5.0; 3], [0.0, 1.0, 0.0], 9.0);
    film.push_estimate(0, 0, &Estimate::new([2.0; 3]).with_emission([1.0; 3]).with_cost(3).with_first_hit(wall()));
    film.push_estimate(0, 1, &Estimate::new([4.0; 3]).with_first_hit(wall().with_material(8)).with_features(behind));
    film.push_estimate(0, 0, &Estimate::new([0.0; 3]));
    film.push_estimate(0, 0, &Estimate::new([0.0; 3]).with_first_hit(FirstHit::new([f32::NAN; 3], [0.0; 3], 1.0)));
    assert_eq!([film.half(0, 0).unwrap().count, film.half(1, 0).unwrap().count], [3, 1]);
    assert!(film.emission(0, 0).is_some_and(|e| (e[0] - 1.0 / 3.0).abs() < 1e-6));
    let features = film.features(0).unwrap();
    assert_eq!((features.samples, features.hits, features.depth), (4, 2, 6.5));
    let materials: Vec<_> = film.first_hits(0).iter().map(|hit| hit.map(|hit| hit.material)).collect();
    assert_eq!(materials, [Some(7), Some(8)]);
    assert_eq!((film.cost(0), film.record().rays, film.record().samples), (Some(6), 6, 4));
}

#[test]
fn statistics_of_pixels_make_the_film_that_samples_would() {
    let needs = Needs::none().with_variance().with_halves().with_features().with_emission();
    let (mut pushed, mut halves) = (film(needs), film(needs.with_half_variance()));
    for (half, value) in [(0, 1.0), (0, 3.0), (1, 2.0), (1, 6.0)] {
        let estimate = Estimate::new([value; 3]).with_first_hit(wall());
        [&mut pushed, &mut halves].into_iter().for_each(|film| film.push_estimate(0, half, &estimate));
    }
    let half = |h| halves.half(h, 0).unwrap();
    let moments = [0, 1].map(|h| RgbMoments::new(2, half(h).mean, half(h).variance().unwrap()));
    let made = Film::from_pixels(*pushed.frame(), |i| match i {
        0 => PixelStatistics::new(moments).with_features((&wall()).into(), [0.0; 4], 1.0),
        _ => PixelStatistics::default(),
    })
    .unwrap();
    assert_eq!((made.moments(0), made.features(0), made.count(1)), (pushed.moments(0), pushed.features(0), 0));
    assert_eq!(made.squared_errors(), pushed.squared_errors());
    assert!(made.require("a filter", pushed.needs()).is_ok());
    assert_eq!(made.record().samples, 4);
}

#[test]
fn statistics_with_a_nan_are_refused_with_their_pixel() {
    let bad = [
        PixelStatistics::new([RgbMoments::new(1, [f64::NAN; 3], [0.0; 3]), RgbMoments::default()]),
        PixelStatistics::new([RgbMoments::new(2, [0.0; 3], [f64::INFINITY; 3]), RgbMoments::default()]),
        PixelStatistics::default().with_features(SurfaceFeatures::new([f32::NAN; 3], [0.0; 3], 1.0), [0.0; 4], 1.0),
        PixelStatistics::default().with_emission([f32::INFINITY; 3]),
    ];
    for pixel in bad {
        let of = |i| if i == 1 { pixel } else { PixelStatistics::default() };
        let message = Film::from_pixels(Frame::new(2, 1).unwrap(), of).unwrap_err().to_string();
        assert!(message.contains("pixel (1, 0)"), "{message}");
    }
}
