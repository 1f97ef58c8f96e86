//! Sums of functions of samples: against two passes, over halves, discarded and withdrawn samples, and never for nothing.

use crate::common::{Field, Independent, Planned, everything, frame, mix, noise, on_threads, run};
use dapple_conformance::bits;
use dapple_core::samplers::Uniform;
use dapple_core::{
    Error, Feedback, Film, Filter, Limits, Needs, Plan, PointSet, Progress, Retention, SampleId, SampleSums, Schedule,
    Sums, ThirdMoments, Unfiltered, streams,
};

const ALL: Sums = Sums::LOG.and(Sums::ROOT).and(Sums::ROOT_MOMENTS);

/// Sums of a list of samples in two passes.
fn two_passes(samples: &[[f32; 3]]) -> SampleSums {
    let n = samples.len();
    let of = |f: &dyn Fn(f64) -> f64| -> [f64; 3] {
        [0, 1, 2].map(|c: usize| samples.iter().map(|x| f(f64::from(x[c]))).sum::<f64>())
    };
    let root = |x: f64| 2.0 * (x.sqrt() - 1.0);
    let mean = of(&root).map(|sum| sum / n.max(1) as f64);
    let power = |k: i32| {
        [0, 1, 2].map(|c: usize| samples.iter().map(|x| (root(f64::from(x[c])) - mean[c]).powi(k)).sum::<f64>())
    };
    let mut moments = ThirdMoments::default();
    (moments.count, moments.mean, moments.m2, moments.m3) = (n as u64, mean, power(2), power(3));
    let mut sums = SampleSums::default();
    sums.count = n as u64;
    sums.log = Some(of(&|x| if x > 0.0 { x * x.ln() } else { 0.0 }));
    sums.root = Some(of(&f64::sqrt));
    sums.root_moments = Some(moments);
    sums
}

/// All values of the sums in order.
fn values(sums: &SampleSums) -> Vec<f64> {
    let moments = sums.root_moments.map(|m| [m.mean, m.m2, m.m3]);
    let rows = [sums.log, sums.root].into_iter().flatten().chain(moments.into_iter().flatten());
    rows.flatten().collect()
}

#[track_caller]
fn close(found: &SampleSums, samples: &[[f32; 3]]) {
    let expected = two_passes(samples);
    assert_eq!(found.count, expected.count);
    assert_eq!(found.root_moments.map(|m| m.count), Some(expected.count));
    let (found, expected) = (values(found), values(&expected));
    assert_eq!(found.len(), 15);
    for (k, (a, b)) in found.iter().zip(&expected).enumerate() {
        assert!((a - b).abs() <= 1e-11 * (1.0 + b.abs()), "value {k}: {a} is not {b}");
    }
}

/// Values over a wide range, some of them 0.
fn samples(count: u64, seed: u64) -> Vec<[f32; 3]> {
    let unit = |k: u64| (mix(seed.wrapping_add(k)) >> 40) as f32 / (1 << 24) as f32;
    let of = |k: u64| [unit(3 * k), 40.0 * unit(3 * k + 1).powi(5), if unit(3 * k + 2) < 0.5 { 0.0 } else { 2.0 }];
    (0..count).map(of).collect()
}

#[test]
fn sums_agree_with_two_passes_for_any_number_of_samples() {
    for count in [0, 1, 2, 3, 7, 500] {
        let all = samples(count, 11);
        let mut film = Film::new(frame(2, 1), Needs::none().with_sums(ALL));
        all.iter().for_each(|&x| film.push(1, 0, x));
        close(&film.sums(1), &all);
        assert_eq!(values(&film.sums(0)), [0.0; 15]);
        assert_eq!((film.half_sums(0, 1), film.discarded_sums(1).count), (None, 0));
    }
}

#[test]
fn only_the_kinds_asked_for_are_recorded() {
    let all = samples(20, 5);
    let film = |kinds: Sums| {
        let mut film = Film::new(frame(1, 1), Needs::none().with_sums(kinds));
        all.iter().for_each(|&x| film.push(0, 0, x));
        film.sums(0)
    };
    let whole = film(ALL);
    for (log, root, moments) in (0..8).map(|k| (k & 1 > 0, k & 2 > 0, k & 4 > 0)) {
        let kinds = [(log, Sums::LOG), (root, Sums::ROOT), (moments, Sums::ROOT_MOMENTS)];
        let kinds = kinds.iter().filter(|kind| kind.0).fold(Sums::NONE, |all, kind| all | kind.1);
        let mut expected = whole;
        expected.log = expected.log.filter(|_| log);
        expected.root = expected.root.filter(|_| root);
        expected.root_moments = expected.root_moments.filter(|_| moments);
        assert_eq!(film(kinds), expected, "{kinds:?}");
        let needs = Needs::none().with_sums(kinds);
        let bytes = 24 * (usize::from(log) + usize::from(root) + 3 * usize::from(moments));
        assert_eq!(Film::bytes_per_pixel(&needs), 32 + bytes);
        assert_eq!(Film::bytes_per_pixel(&needs.with_halves()), 2 * (32 + bytes));
    }
}

#[test]
fn rejected_samples_count_as_zero_in_the_sums() {
    let mut film = Film::new(frame(1, 1), Needs::none().with_sums(ALL));
    for x in [[0.25; 3], [f32::NAN; 3], [4.0; 3], [-1.0; 3]] {
        film.push(0, 0, x);
    }
    close(&film.sums(0), &[[0.25; 3], [0.0; 3], [4.0; 3], [0.0; 3]]);
}

#[test]
fn merged_moments_are_those_of_all_values() {
    let all = samples(40, 3);
    for cut in [0, 1, 2, 13, 39, 40] {
        let [a, b] = [&all[..cut], &all[cut..]].map(|part| two_passes(part).root_moments.unwrap());
        let mut merged = a;
        merged.merge(&b);
        let mut whole = two_passes(&all);
        whole.root_moments = Some(merged);
        close(&whole, &all);
    }
}

/// The samples of a pixel's stream, in order.
fn of_stream(points: &Independent, pixel: [u32; 2], stream: u32, indices: std::ops::Range<u64>) -> Vec<[f32; 3]> {
    indices.map(|index| noise(pixel, points.block(SampleId::new(pixel, stream, index), 0))).collect()
}

#[test]
fn discarded_and_withdrawn_samples_keep_their_sums_in_either_half() {
    let points = Independent::new(5);
    // Discards 2, keeps 4, then withdraws these of pixel 1 and keeps 6.
    let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
        plan.counts.fill([2, 4, 6, 0][seen.round.min(3) as usize]);
        plan.retention = if seen.round == 0 { Retention::Discard } else { Retention::Keep };
        plan.withdraw = (seen.round == 2).then(|| vec![false, true]);
        if seen.round < 3 { Progress::Trace } else { Progress::Done }
    };
    for halves in [false, true] {
        let needs = Needs::none().with_variance().with_sums(ALL);
        let needs = if halves { needs.with_halves() } else { needs };
        let mut sampler = Planned { points, needs, plan };
        let film = run(&mut Field(noise), &mut sampler, needs, frame(2, 1), &Limits::samples(100)).unwrap();
        for x in [0, 1] {
            let i = x as usize;
            let of = |stream, indices| of_stream(&points, [x, 0], stream, indices);
            let kept_from = |withdrawn: u64| if x == 1 { withdrawn } else { 0 };
            if halves {
                for half in [0, 1] {
                    let kept = of(streams::HALVES[half], kept_from(2)..5);
                    close(&film.half_sums(half, i).unwrap(), &kept);
                }
                let kept: Vec<_> = [0, 1].into_iter().flat_map(|h| of(streams::HALVES[h], kept_from(2)..5)).collect();
                close(&film.sums(i), &kept);
                let thrown = |h: usize| {
                    let mut all = of(streams::DISCARDED_HALVES[h], 0..1);
                    all.extend(of(streams::HALVES[h], 0..kept_from(2)));
                    all
                };
                close(&film.discarded_sums(i), &[thrown(0), thrown(1)].concat());
            } else {
                close(&film.sums(i), &of(streams::WHOLE, kept_from(4)..10));
                let mut thrown = of(streams::DISCARDED, 0..2);
                thrown.extend(of(streams::WHOLE, 0..kept_from(4)));
                close(&film.discarded_sums(i), &thrown);
            }
        }
    }
}

/// All that a film says but its sums, in bits.
fn without_sums(film: &Film) -> Vec<u64> {
    let mut bits: Vec<u64> = film.image().iter().flatten().map(|x| u64::from(x.to_bits())).collect();
    for i in 0..film.frame().pixels() {
        let half = |half| film.half(half, i).unwrap_or_default();
        let rest = (film.moments(i), half(0), half(1), film.range(i), film.features(i), film.first_hits(i));
        bits.extend(format!("{rest:?} {:?}", (film.cost(i), film.emission(0, i))).bytes().map(u64::from));
    }
    bits
}

#[test]
fn sums_change_no_other_bit_and_depend_on_no_threads_tiles_or_cuts() {
    let (frame, mut plain) = (frame(19, 17), everything());
    plain.sums = Sums::NONE;
    let render = |needs: Needs, threads: usize, schedule: Schedule| {
        let limits = Limits::samples(9 * 19 * 17 + 5).with_schedule(schedule);
        let mut sampler = Uniform::new(Independent::new(4));
        on_threads(threads, || run(&mut Field(noise), &mut sampler, needs, frame, &limits)).unwrap()
    };
    for needs in [plain, Needs::none()] {
        let whole = render(needs.with_sums(ALL), 1, Schedule::default());
        assert!(without_sums(&whole) == without_sums(&render(needs, 1, Schedule::default())));
        for (threads, rows, slice, shuffle) in [(2, 1, 0, 0), (3, 7, 1, 5), (7, 16, 2, 9)] {
            let schedule = Schedule::default().with_tile_rows(rows).with_slice_spp(slice).with_shuffle(shuffle);
            assert!(bits(&render(needs.with_sums(ALL), threads, schedule)) == bits(&whole));
        }
    }
}

#[test]
fn films_without_the_sums_are_refused_by_readers_that_need_them() {
    let film = Film::new(frame(1, 1), Needs::none().with_sums(Sums::LOG | Sums::ROOT));
    assert!(film.require("reader", &Needs::none().with_sums(Sums::ROOT)).is_ok());
    let refused = film.require("reader", &Needs::none().with_sums(Sums::ROOT_MOMENTS));
    assert!(matches!(&refused, Err(Error::NotRecorded { .. })), "{refused:?}");
    let message = refused.unwrap_err().to_string();
    assert!(message.starts_with("reader reads sums of logarithms or roots"), "{message}");
    assert!(Unfiltered.apply(&film).is_ok());
}

#[test]
fn a_film_of_channels_has_no_sums_of_the_radiance() {
    let needs = Needs::none().with_channels(3).with_sums(ALL);
    let mut sampler = Uniform::new(Independent::new(1));
    let film = run(&mut Field(noise), &mut sampler, needs, frame(2, 2), &Limits::spp(3.0)).unwrap();
    let bands = film.with_channels_as_colour([2, 1, 0]).unwrap();
    assert!(bands.needs().sums.is_empty() && bands.sums(1).root.is_none() && bands.sums(1).count == 3);
}
