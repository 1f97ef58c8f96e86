//! Decisions on made-up films, without rendering.

use crate::support::*;
use dapple_conformance::toys::Traced;
use dapple_core::plan::{BudgetLeft, Feedback, Plan, Progress};
use dapple_core::{Block, Draws, Error, Estimate, Film, FirstHit, Integrator, Limits, Needs, Sampler, Worker};
use dapple_low_discrepancy::Random;
use dapple_mitchell::{
    Extrema, Mitchell, MitchellOptions, MitchellPbrt, MitchellPbrtOptions, PbrtTest, PilotPolicy, Rates, Rule,
    Stopping, TwoRates, contrast, deviation,
};

/// True if a rule that adds `more` samples refines a pixel with these samples.
fn asks(mut sampler: impl Sampler, more: u64, samples: &[[f32; 3]]) -> bool {
    let film = film(frame(1, 1), &sampler, &[samples.to_vec()]);
    let total = ask(&mut sampler, &film, 100).total();
    assert!([0, more].contains(&total), "{total} samples");
    total > 0
}

/// True if Mitchell's rule refines a pixel with these samples.
fn mitchell_asks(samples: &[[f32; 3]]) -> bool {
    asks(mitchell(alone(samples.len() as u32, 5, Stopping::Threshold, PilotPolicy::Keep), 1), 5, samples)
}

/// True if pbrt-v2's rule refines a pixel with these four samples.
fn pbrt_asks(samples: [[f32; 3]; 4]) -> bool {
    asks(pbrt(pbrt_options(4, 16, Stopping::Threshold, PilotPolicy::Keep), 1), 12, &samples)
}

fn only(channel: usize, values: &[f32]) -> Vec<[f32; 3]> {
    values.iter().map(|&v| std::array::from_fn(|c| if c == channel { v } else { 0.0 })).collect()
}

#[test]
fn mitchell_refines_where_a_channel_exceeds_its_threshold() {
    assert!(mitchell_asks(&only(1, &[0.2, 0.2, 0.2, 0.8])));
    assert!(!mitchell_asks(&only(1, &[0.5, 0.6])));
    // Contrasts of 0.35, 0.5 and 0.65: red's threshold is 0.4, green's 0.3, blue's 0.6.
    let contrasts = [[0.65, 1.35], [0.5, 1.5], [0.35, 1.65]];
    let asked = |channel| contrasts.map(|values| mitchell_asks(&only(channel, &values)));
    assert_eq!([asked(0), asked(1), asked(2)], [[false, true, true], [true, true, true], [false, false, true]]);
    // One channel is enough, whatever the others.
    assert!(mitchell_asks(&[[1.0, 1.0, 0.2], [1.0, 1.0, 1.0]]));
}

#[test]
fn pbrt_refines_where_luminance_leaves_the_mean() {
    assert!(pbrt_asks([1.0, 1.0, 1.0, 1.9].map(|v| [v; 3])));
    assert!(!pbrt_asks([1.0, 1.0, 1.0, 1.7].map(|v| [v; 3])));
    // Luminance decides, not a channel. Blue alone doubles it in no pixel, and swapped channels of equal luminance make
    // no difference.
    assert!(!pbrt_asks([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 4.0]]));
    let red = [0.7152 / 0.2126, 0.0, 0.0];
    assert!(!pbrt_asks([red, [0.0, 1.0, 0.0], red, [0.0, 1.0, 0.0]]));
    // Exactly at the threshold is not above it: the mean is 2, and 3 and 1 deviate by a half.
    assert!(!pbrt_asks([1.0, 2.0, 2.0, 3.0].map(|v| [v; 3])));
    // Deviations downwards count as well.
    assert!(pbrt_asks([1.0, 1.0, 1.0, 0.25].map(|v| [v; 3])));
}

#[test]
fn decisions_do_not_depend_on_scale() {
    for seed in 0..200u64 {
        let value = |k: u64| (mix(seed * 12 + k) >> 40) as f32 / (1u64 << 24) as f32 + 0.4;
        let samples: [[f32; 3]; 4] = [0u64, 3, 6, 9].map(|k| [value(k), value(k + 1), value(k + 2)]);
        let decision = |k: f32| {
            let scaled = samples.map(|s| s.map(|v| v * k));
            (mitchell_asks(&scaled), pbrt_asks(scaled))
        };
        // Powers of two change no bit of a contrast.
        for k in [2f32.powi(-60), 0.5, 2f32.powi(60)] {
            assert_eq!(decision(k), decision(1.0), "{samples:?} times {k}");
        }
        assert_eq!(
            contrast([samples[0].map(|v| v * 0.25), samples[1].map(|v| v * 0.25)]),
            contrast([samples[0], samples[1]])
        );
    }
    assert_ne!(mitchell_asks(&only(1, &[0.5, 0.6])), mitchell_asks(&only(1, &[0.5, 1.6])));
}

#[test]
fn pixels_without_light_have_no_contrast_a05() {
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    assert_eq!(contrast([[0.0; 3]; 2]), [0.0; 3]);
    assert_eq!(contrast([[0.5, 0.0, 0.2], [1.5, 0.0, 0.2]]), [0.5, 0.0, 0.0]);
    // The naive rule, as a control.
    let naive = |min: f32, max: f32| (max - min) / (max + min);
    assert!(naive(0.0, 0.0).is_nan() && naive(-1.0, 0.5) < 0.0);
    for min in [0.0, -0.0, -1.0, nan, inf, -inf, f32::MAX, f32::MIN_POSITIVE, 1e-45, 0.3] {
        for max in [0.0, -0.0, -2.0, nan, inf, -inf, f32::MAX, f32::MIN_POSITIVE, 1e-45, 0.7] {
            for value in contrast([[min; 3], [max; 3]]) {
                assert!((0.0..=1.0).contains(&value), "contrast {value} of {min}, {max}");
            }
            for mean in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300, 1e-300, 0.5] {
                let value = deviation([min, max], mean);
                assert!(value >= 0.0 && !value.is_nan(), "deviation {value} of {min}, {max} from {mean}");
            }
        }
    }
    // In a film, invalid samples count as zero, and thus differ from any light.
    for bad in [nan, inf, -inf, -1.0] {
        assert!(mitchell_asks(&[[0.5; 3], [bad, 0.5, 0.5]]));
        assert!(!mitchell_asks(&[[0.0; 3], [bad, 0.0, 0.0]]));
    }
    // A single sample and an empty pixel have no contrast.
    assert_eq!(contrast([[0.4; 3]; 2]), [0.0; 3]);
    assert_eq!(deviation([0.4; 2], 0.4), 0.0);
    let mut sampler = mitchell(threshold(1).initial(1).additional(5), 1);
    let film = film(frame(1, 1), &sampler, &[vec![[0.4; 3]]]);
    assert_eq!(ask(&mut sampler, &film, 100).total(), 0);
}

fn threshold(radius: u32) -> MitchellOptions {
    alone(2, 3, Stopping::Threshold, PilotPolicy::Keep).radius(radius)
}

#[test]
fn windows_match_brute_force() {
    for (size, radius) in [([7, 5], 0), ([7, 5], 1), ([7, 5], 2), ([1, 9], 1), ([9, 1], 3), ([4, 3], 64)] {
        let [w, h] = size;
        let frame = frame(w, h);
        let mut sampler = mitchell(threshold(radius), 1);
        // A mostly flat image, in which windows matter.
        let value = |i: u64, k: u64| if mix(i * 2 + k).is_multiple_of(9) { 0.3 } else { 1.0 };
        let samples: Vec<Vec<[f32; 3]>> =
            (0..frame.pixels() as u64).map(|i| vec![[value(i, 0); 3], [value(i, 1); 3]]).collect();
        let film = film(frame, &sampler, &samples);
        let plan = ask(&mut sampler, &film, 100 * frame.pixels() as u64);
        for (i, &count) in plan.counts.iter().enumerate() {
            let (x, y) = ((i as u32 % w).cast_signed(), (i as u32 / w).cast_signed());
            let near = samples.iter().enumerate().filter(|(k, _)| {
                let (kx, ky) = ((*k as u32 % w).cast_signed(), (*k as u32 / w).cast_signed());
                (kx - x).abs() <= radius.cast_signed() && (ky - y).abs() <= radius.cast_signed()
            });
            let values = near.flat_map(|(_, s)| s.iter().map(|s| s[0]));
            let differ = values.clone().any(|v| v < 1.0) && values.clone().any(|v| v == 1.0);
            assert_eq!(count, if differ { 3 } else { 0 }, "pixel {x}, {y} of {size:?}, radius {radius}");
        }
    }
}

/// A row of pixels, each with two samples of the given contrast.
fn row(sampler: &dyn Sampler, contrasts: &[f32]) -> Film {
    let samples: Vec<_> = contrasts.iter().map(|&c| vec![[1.0 - c; 3], [1.0 + c; 3]]).collect();
    film(frame(contrasts.len() as u32, 1), sampler, &samples)
}

#[test]
fn a_ceiling_goes_to_the_highest_contrast() {
    let mut sampler = mitchell(threshold(0), 1);
    let film = row(&sampler, &[0.1, 0.5, 0.9, 0.2, 0.4, 0.0]);
    let mut counts = |total| ask(&mut sampler, &film, total).counts;
    assert_eq!(counts(1000), [0, 3, 3, 0, 3, 0]);
    assert_eq!(counts(12 + 9), [0, 3, 3, 0, 3, 0]);
    assert_eq!(counts(12 + 8), [0, 3, 3, 0, 2, 0]);
    assert_eq!(counts(12 + 4), [0, 1, 3, 0, 0, 0]);
    assert_eq!(counts(12), [0; 6]);
}

#[test]
fn a_budget_goes_down_the_ranks_and_round_again() {
    let mut sampler = mitchell(threshold(0).mode(Stopping::Budget), 1);
    let film = row(&sampler, &[0.1, 0.5, 0.9, 0.2, 0.4, 0.0]);
    let mut counts = |total| ask(&mut sampler, &film, total).counts;
    assert_eq!(counts(12 + 4), [0, 1, 3, 0, 0, 0]);
    assert_eq!(counts(12 + 13), [1, 3, 3, 3, 3, 0]);
    assert_eq!(counts(12 + 18), [3; 6]);
    assert_eq!(counts(12 + 18 + 7), [3, 6, 6, 3, 4, 3]);
    assert_eq!(counts(12 + 18 * 100 + 7), [300, 303, 303, 300, 301, 300]);
}

/// pbrt-v2's policy removes refined pilots from the image, and counts them in the budget.
#[test]
fn refined_pilots_are_withdrawn_and_paid_for() {
    let mut sampler = mitchell(threshold(0).policy(PilotPolicy::Refined), 1);
    let film = row(&sampler, &[0.1, 0.5, 0.9, 0.2, 0.4, 0.0]);
    let plan = ask(&mut sampler, &film, 1000);
    assert_eq!(plan.counts, [0, 5, 5, 0, 5, 0]);
    assert_eq!(plan.withdraw, Some(vec![false, true, true, false, true, false]));
    // The rest after two pixels is not a whole step: the third keeps its pilot.
    let plan = ask(&mut sampler, &film, 12 + 14);
    assert_eq!(plan.counts, [0, 5, 5, 0, 4, 0]);
    assert_eq!(plan.withdraw, Some(vec![false, true, true, false, false, false]));
    let mut sampler = mitchell(threshold(0).mode(Stopping::Budget).policy(PilotPolicy::Refined), 1);
    let plan = ask(&mut sampler, &film, 12 + 30 + 4);
    assert_eq!(plan.counts, [5, 6, 8, 5, 5, 5]);
    assert_eq!(plan.withdraw, Some(vec![true; 6]));
}

/// Contrast saturates at 1, so ties are common. They do not favour the top of the image.
#[test]
fn ties_are_spread_over_the_image() {
    let mut sampler = mitchell(threshold(0), 1);
    let film = row(&sampler, &[vec![1.0; 1000], vec![0.0; 24]].concat());
    let counts = ask(&mut sampler, &film, 2 * 1024 + 3 * 500).counts;
    let first = counts[..500].iter().filter(|&&n| n > 0).count();
    // 500 of 1000 drawn: 250 with a standard deviation of 7.9; this fixed draw is within 4 of them.
    assert!((first as f64 - 250.0).abs() < 32.0, "{first} of 500 refined pixels in the first half");
    assert_eq!(counts, ask(&mut sampler, &film, 2 * 1024 + 3 * 500).counts);
}

#[test]
fn descriptions_name_every_parameter() {
    let described = Mitchell::new(Random::new(1)).describe();
    assert_eq!(
        described,
        "mitchell:initial=0,additional=0,red=0.4,green=0.3,blue=0.6,radius=1,mode=budget,policy=keep"
    );
    let described = MitchellPbrt::new(Random::new(1)).describe();
    assert_eq!(described, "mitchell-pbrt:min=4,max=32,threshold=0.5,mode=budget,policy=refined,test=contrast");
    // Rates are rounded up to powers of two, and kept apart.
    let rounded = |min, max| pbrt(pbrt_options(min, max, Stopping::Threshold, PilotPolicy::Keep), 1).describe();
    assert!(rounded(3, 17).starts_with("mitchell-pbrt:min=4,max=32,"));
    assert!(rounded(8, 8).starts_with("mitchell-pbrt:min=8,max=16,"));
}

/// The name of the option that is refused.
fn refused<O: Rule>(options: O) -> &'static str {
    match TwoRates::with_options(Random::new(1), options) {
        Err(Error::OutOfRange { name, .. }) => name,
        _ => "taken",
    }
}

#[test]
fn parameters_out_of_range_are_refused() {
    let plain = MitchellOptions::default().initial(4).additional(6);
    for (options, expected) in [
        (plain, "taken"),
        (plain.initial(0), "initial"),
        (plain.additional(0), "additional"),
        (plain.additional(u32::MAX), "additional"),
        (plain.initial(1), "taken"),
        (plain.initial(1).radius(0), "initial"),
        (plain.radius(65), "radius"),
    ] {
        assert_eq!(refused(options), expected, "{options:?}");
    }
    for bad in [0.0, -0.1, 1.0 + 1e-9, f64::NAN, f64::INFINITY] {
        let refused = [plain.red(bad), plain.green(bad), plain.blue(bad)].map(refused);
        assert_eq!(refused, ["red", "green", "blue"], "{bad}");
    }
    let plain = MitchellPbrtOptions::default();
    let shapes = plain.max(300).test(PbrtTest::ShapeId);
    for (options, expected) in [
        (plain, "taken"),
        (plain.min(1), "min"),
        (plain.max(3), "max"),
        (plain.max(u32::MAX), "max"),
        (shapes.min(128), "taken"),
        (shapes.min(129), "min"),
    ] {
        assert_eq!(refused(options), expected, "{options:?}");
    }
    for threshold in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(refused(plain.threshold(threshold)), "threshold");
    }
}

#[test]
fn films_without_extrema_and_budgets_below_the_floor_are_refused() {
    let without = Film::new(frame(3, 3), Needs::none().with_variance());
    let with = Film::with_recorders(frame(3, 3), Needs::none(), Extrema::list());
    for mode in [Stopping::Budget, Stopping::Threshold] {
        let one = &mut mitchell(MitchellOptions::default().mode(mode), 1);
        let other = &mut pbrt(MitchellPbrtOptions::default().mode(mode), 1);
        for sampler in [one as &mut dyn Sampler, other] {
            let mut next = |film, total| {
                let budget = BudgetLeft::new(total).with_min_spp(4).with_max_spp(9);
                sampler.next_round(&Feedback::new(0, film, budget), &mut Plan::empty(9))
            };
            assert!(matches!(next(&without, 36), Err(Error::NotRecorded { what: "the extrema", .. })));
            assert!(matches!(next(&with, 35), Err(Error::BudgetTooSmall { needed: 36, .. })));
            assert!(matches!(next(&with, 36), Ok(Progress::Trace)));
        }
    }
}

/// A constant image in which the first number of a sample decides the triangle that it hits.
fn triangles(hit: impl Fn(f32) -> Option<[u32; 2]> + Sync) -> impl Integrator {
    Traced(move |draws: &Draws<'_>, _: &mut Worker| {
        let first = |[shape, primitive]: [u32; 2]| {
            FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0).with_shape(shape).with_primitive(primitive)
        };
        Estimate::new([0.5; 3]).with_first_hit(hit(draws.block(Block::new(0))[0]).map(first))
    })
}

/// The share of 128x128 pixels that are refined.
fn refined(test: PbrtTest, policy: PilotPolicy, hit: impl Fn(f32) -> Option<[u32; 2]> + Sync) -> f64 {
    let size = frame(128, 128);
    let options = pbrt_options(4, 32, Stopping::Threshold, policy).test(test);
    let film = run(&mut triangles(hit), &mut pbrt(options, 7), size, &Limits::spp(1000.0));
    let refined = film.counts().iter().filter(|&&n| n == 32).count();
    let others = film.counts().iter().filter(|&&n| n == 4).count();
    assert_eq!(refined + others, size.pixels());
    refined as f64 / size.pixels() as f64
}

#[test]
fn pixels_on_an_edge_are_refined_with_the_probability_that_samples_fall_to_both_sides() {
    for policy in POLICIES {
        for a in [0.5f32, 0.2, 0.03] {
            let closed = 1.0 - f64::from(a).powi(4) - f64::from(1.0 - a).powi(4);
            let error = (closed * (1.0 - closed) / 16384.0).sqrt();
            let triangles = |u: f32| Some([0, u32::from(u < a)]);
            let shapes = |u: f32| Some([u32::from(u < a), 0]);
            let silhouette = |u: f32| (u >= a).then_some([0, 0]);
            for found in [
                refined(PbrtTest::ShapeId, policy, triangles),
                refined(PbrtTest::ShapeId, policy, shapes),
                refined(PbrtTest::Shape, policy, shapes),
                refined(PbrtTest::ShapeId, policy, silhouette),
            ] {
                // 36 comparisons within 5 standard errors fail by chance with probability 2e-5.
                assert!((found - closed).abs() < 5.0 * error, "{policy:?}, {a}: {found} for {closed}");
            }
            // The control: edges within a shape do not count.
            assert_eq!(refined(PbrtTest::Shape, policy, triangles), 0.0);
        }
        for hit in [Some([3, 5]), None] {
            assert_eq!(refined(PbrtTest::ShapeId, policy, |_| hit), 0.0, "{policy:?}: pixels within one triangle");
        }
    }
}

#[test]
fn pixels_with_more_changes_come_first_within_a_budget() {
    let size = frame(64, 64);
    let options = pbrt_options(4, 32, Stopping::Budget, PilotPolicy::Keep).test(PbrtTest::ShapeId);
    // Refinement of all pixels would take 32 samples each.
    let mut scene = triangles(|u: f32| Some([0, u32::from(u < 0.5)]));
    let film = run(&mut scene, &mut pbrt(options, 3), size, &Limits::spp(10.0));
    let changes = |i: usize| film.first_hits(i).windows(2).filter(|w| w[0] != w[1]).count();
    let least = (0..size.pixels()).filter(|&i| film.count(i) == 32).map(changes).min().unwrap();
    let most = (0..size.pixels()).filter(|&i| film.count(i) == 4).map(changes).max().unwrap();
    assert!(least >= most && least > 0, "{least} {most}");
}

#[test]
fn presets_are_the_thesis_table_and_others_lie_between() {
    let rates = |mean| {
        let Rates { initial, additional } = Rates::for_mean(mean);
        (initial, additional)
    };
    assert_eq!([8, 16, 32, 64].map(rates), [(4, 6), (4, 16), (12, 24), (16, 54)]);
    assert_eq!([12, 24, 48, 128].map(rates), [(4, 11), (8, 20), (14, 39), (32, 108)]);
    assert_eq!([0, 1, 2, 4].map(rates), [(1, 1), (1, 1), (1, 2), (2, 3)]);
    for mean in 1..2000 {
        let (initial, additional) = rates(mean);
        assert!(u64::from(initial) <= mean && u64::from(initial + additional) >= mean, "{mean}");
        assert!(initial <= rates(mean + 1).0 && additional <= rates(mean + 1).1, "{mean}");
    }
    assert!(rates(u64::MAX).1 > 1 << 31);
}
