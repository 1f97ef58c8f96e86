//! Decisions of the error-driven sampler on made-up films: by error and by cost. Its memory.

use crate::support::{self, *};
use dapple_adaptive::{
    Adaptive, AdaptiveOptions, ErrorMap, PilotPolicy, PoolShape, Pooling, Sources, VarianceOptions, relative_variance,
};
use dapple_conformance::toys::Field;
use dapple_core::film::RgbMoments;
use dapple_core::options::Options as _;
use dapple_core::{Error, Estimate, Film, HostNumbers, Limits, Needs, PointSet, SampleId, Sampler};
use dapple_low_discrepancy::{Random, Sobol};

const SIDE: usize = 48;
const PILOT: u32 = 8;

/// A film of `PILOT` samples per pixel; `value` takes the pixel and four numbers.
fn film(value: impl Fn([usize; 2], [f32; 4]) -> f32) -> Film {
    let points = Random::new(9);
    support::film(SIDE as u32, Needs::none().with_variance(), PILOT, |i, index| {
        let id = SampleId::new([(i % SIDE) as u32, (i / SIDE) as u32], 0, u64::from(index));
        Estimate::new([value([i % SIDE, i / SIDE], points.block(id, 0)); 3])
    })
}

/// A sampler that plans the whole budget at once.
fn one_round() -> Adaptive<Random> {
    with(options().rounds(1))
}

/// The fraction of light at a point of column `x`: 0 on the left, 1 on the right, a penumbra between.
fn lit(x: usize) -> f64 {
    ((x as f64 - 12.0) / 24.0).clamp(0.0, 1.0)
}

fn penumbra([x, _]: [usize; 2], u: [f32; 4]) -> f32 {
    f32::from(u8::from(f64::from(u[0]) < lit(x)))
}

fn column_mean(counts: &[u32], x: usize) -> f64 {
    (0..SIDE).map(|y| f64::from(counts[y * SIDE + x])).sum::<f64>() / SIDE as f64
}

/// One flat floor with a penumbra on it. Geometry is constant there. Counts follow `sqrt(v (1 - v))`, here relative:
/// the root of `v (1 - v) / (v^2 + eps)`.
#[test]
fn counts_follow_a_penumbra() {
    let seen = film(penumbra);
    let exponent = options().exponent;
    let counts = planned(32, &mut one_round(), &seen).unwrap();
    let wanted = |x: usize| {
        let v = lit(x);
        (v * (1.0 - v) / (v * v + 0.01)).powf(1.0 / (1.0 + exponent))
    };
    let (lit_side, dark_side) = (column_mean(&counts, 44), column_mean(&counts, 3));
    for x in [16, 20, 26, 32] {
        assert!(column_mean(&counts, x) > 1.5 * lit_side.max(dark_side), "column {x}");
    }
    // Rank correlation over the penumbra; 18 unrelated columns would reach 0.8 with p < 1e-4.
    let columns: Vec<usize> = (15..33).collect();
    let rank = |f: &dyn Fn(usize) -> f64| -> Vec<f64> {
        columns.iter().map(|&a| columns.iter().filter(|&&b| f(b) < f(a)).count() as f64).collect()
    };
    let (found, wanted) = (rank(&|x| column_mean(&counts, x)), rank(&wanted));
    let squares: f64 = found.iter().zip(&wanted).map(|(a, b)| (a - b).powi(2)).sum();
    let n = columns.len() as f64;
    let correlation = 1.0 - 6.0 * squares / (n * (n * n - 1.0));
    assert!(correlation > 0.8, "{correlation}");
}

#[test]
fn no_region_starves() {
    let seen = film(|[x, _], u| if x < 4 { u[0] * 100.0 } else { 1.0 });
    let counts = planned(32, &mut with(options().rounds(1).cap(6.0)), &seen).unwrap();
    assert!(counts.iter().all(|&n| n >= PILOT), "every pixel gets the pilot, a quarter of the mean");
    assert!(counts.iter().all(|&n| n <= 6 * 32 + 1), "and no pixel gets more than the cap");
    let beyond = (0..SIDE).map(|y| counts[y * SIDE + 40]).filter(|&n| n > PILOT).count();
    assert!(beyond > 0, "some samples go where no variance was seen");
}

/// A score of 1 % of the mean is 0.005 of a noisy pixel's.
#[test]
fn pixels_without_variance_get_samples_by_the_least_score() {
    let seen = film(|[x, _], u| if x < 24 { u[0] } else { 0.5 });
    let steady = options().pool(PoolShape::Window).power(2.0);
    let counts = planned(1024, &mut with(steady.rounds(1).pilot(PILOT)), &seen).unwrap();
    let exponent = options().exponent;
    let [noisy, quiet] = [6, 40].map(|x| column_mean(&counts, x));
    let expected = 0.005f64.powf(1.0 / (1.0 + exponent));
    assert!((quiet / noisy / expected - 1.0).abs() < 0.2, "{quiet} of {noisy}, not {expected} of it");
}

/// Count, mean 1 and sample variance, as moments.
fn moments_of(count: u64, variance: f64) -> RgbMoments {
    RgbMoments::new(count, [1.0; 3], [variance; 3])
}

fn pooling(radius: u32, prior: f64, epsilon: f64, sources: Sources) -> Pooling {
    Pooling { pool: PoolShape::Window, radius, prior, power: 1.0, epsilon, sources }
}

/// Two samples of variance 1 and five of variance 7: the pool is (1 * 1 + 4 * 7) / 5 = 5.8.
#[test]
fn variances_are_pooled_and_blended_by_degrees_of_freedom() {
    let moments = [moments_of(2, 1.0), moments_of(5, 7.0)];
    for (prior, expected) in [
        (0.0, [1.0, 7.0]),
        (2.0, [(1.0 + 2.0 * 5.8) / 3.0, (28.0 + 2.0 * 5.8) / 6.0]),
        (12.0, [(1.0 + 12.0 * 5.8) / 13.0, (28.0 + 12.0 * 5.8) / 16.0]),
        (f64::INFINITY, [5.8, 5.8]),
    ] {
        let pooling = pooling(1, prior, 0.5, Sources::All);
        let found = relative_variance(&moments, [2, 1], &pooling).unwrap();
        for (found, expected) in found.iter().zip(expected) {
            // Three channels, over the squared mean and epsilon.
            assert!((found / (3.0 * expected / 1.5) - 1.0).abs() < 1e-12, "prior {prior}: {found}, not {expected}");
        }
    }
}

#[test]
fn counts_without_a_gain_are_uniform() {
    let alike = film(|_, u| u[0]);
    let counts = planned(32, &mut one_round(), &alike).unwrap();
    assert!(counts.iter().all(|&n| n == 32), "{:?}", &counts[..50]);
    // Negative control: a sampler that always adapts follows the pilot's noise.
    let always = options().gain(1.0).rounds(1);
    assert!(planned(32, &mut with(always), &alike).unwrap().iter().any(|&n| n != 32));
}

fn map(needs: Needs, of: impl Fn(&Film) -> Result<Vec<f32>, Error> + Send + 'static) -> ErrorMap {
    ErrorMap { name: "made-up".into(), needs, of: Box::new(of), bytes_per_pixel: 4 }
}

fn driven(mix: f64, of: impl Fn(&Film) -> Result<Vec<f32>, Error> + Send + 'static) -> Adaptive<Random> {
    let options = options().mix(mix).rounds(1);
    with(options).with_error_map(map(Needs::none(), of)).unwrap()
}

#[test]
fn counts_follow_a_filters_error_map() {
    let seen = film(|_, u| u[0]);
    let top =
        |film: &Film| Ok((0..film.frame().pixels()).map(|i| if i < SIDE * SIDE / 2 { 9.0 } else { 1.0 }).collect());
    let ratio = |mix: f64| {
        let counts = planned(32, &mut driven(mix, top), &seen).unwrap();
        sum(&counts[..SIDE * SIDE / 2]) as f64 / sum(&counts[SIDE * SIDE / 2..]) as f64
    };
    // Nine times the error takes 9^(1 / 2.15) = 2.8 times the samples; at half strength 1.67 times.
    let (none, half, all) = (ratio(0.0), ratio(0.5), ratio(1.0));
    assert!((none - 1.0).abs() < 0.05, "{none}");
    assert!((half - 1.67).abs() < 0.25, "{half}");
    assert!((all - 2.78).abs() < 0.45, "{all}");
}

#[test]
fn bad_error_maps_do_no_harm() {
    let seen = film(penumbra);
    for bad in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
        let counts = planned(32, &mut driven(0.5, move |film| Ok(vec![bad; film.frame().pixels()])), &seen).unwrap();
        assert_eq!(counts, planned(32, &mut one_round(), &seen).unwrap(), "{bad}");
    }
    let short = planned(32, &mut driven(0.5, |_| Ok(vec![1.0; 3])), &seen).unwrap_err().to_string();
    assert!(short.contains("made-up") && short.contains("3 values"), "{short}");
    let refused = |_: &Film| Err(Error::Mismatch { who: "filter".into(), what: "no".into() });
    assert!(planned(32, &mut driven(0.5, refused), &seen).is_err(), "its errors are returned");
}

#[test]
fn an_error_map_gets_its_needs() {
    let needs = Needs::none().with_halves().with_features();
    let sampler = with(options()).with_error_map(map(needs, |_| Ok(vec![]))).unwrap();
    assert_eq!(sampler.needs(), needs.with_variance());
    assert!(sampler.describe().starts_with("adaptive:by=made-up,"));
    let discard = options().policy(PilotPolicy::Discard);
    assert!(with(discard).with_error_map(map(needs, |_| Ok(vec![]))).is_err());
}

/// A change of one pixel's samples changes the scores of exactly the pixels that it is a source of, also at the border.
#[test]
fn sources_are_colours_of_a_chessboard() {
    let noise = |u: [f32; 4], scale: f32| scale * u[0];
    let before = film(|_, u| noise(u, 1.0));
    for at in [[0, 5], [20, 23]] {
        let after = film(|pixel, u| noise(u, if pixel == at { 9.0 } else { 1.0 }));
        for (sources, odd) in [(Sources::Odd, 1), (Sources::Even, 0)] {
            let pooling = pooling(2, 6.0, 0.01, sources);
            let [a, b] = [&before, &after].map(|film| {
                let moments: Vec<_> = (0..SIDE * SIDE).map(|i| film.moments(i)).collect();
                relative_variance(&moments, [SIDE as u32; 2], &pooling).unwrap()
            });
            for i in 0..SIDE * SIDE {
                let [dx, dy] = [(i % SIDE).abs_diff(at[0]), (i / SIDE).abs_diff(at[1])];
                let source = dx <= 2 && dy <= 2 && (dx + dy) % 2 == odd && dx + dy > 0;
                assert_eq!(a[i] != b[i], source, "{sources:?}, {at:?}, {dx} {dy}");
            }
        }
    }
}

#[test]
fn rounds_spend_the_budget_in_equal_steps() {
    let mut sampler = with(options().rounds(3));
    let mut field = Field(|[x, _]: [u32; 2], u: [f32; 4]| [x as f32 * u[0]; 3]);
    let film = run(&mut field, &mut sampler, frame(24, 24), &Limits::samples(32 * 576));
    let rounds: Vec<u64> = film.record().rounds.iter().map(|r| r.samples).collect();
    assert_eq!(rounds, [8 * 576, 8 * 576, 8 * 576, 8 * 576]);
}

#[test]
fn tiny_budgets_and_frames_are_met() {
    for (w, h, total) in [(1, 1, 1), (1, 1, 5), (3, 1, 4), (7, 5, 35), (7, 5, 36), (8, 8, 64 * 3 + 1)] {
        for policy in [PilotPolicy::Keep, PilotPolicy::Neighbours, PilotPolicy::Discard, PilotPolicy::Cross] {
            let (mut field, mut sampler) = (Field(|_, u: [f32; 4]| [u[0]; 3]), with(options().policy(policy)));
            let film = run(&mut field, &mut sampler, frame(w, h), &Limits::samples(total));
            assert_eq!(film.record().samples, total, "{w}x{h}, {total}, {policy:?}");
        }
    }
}

#[test]
fn wrong_options_are_refused() {
    let good = options();
    for bad in [
        good.pilot(1),
        good.pilot(2).policy(PilotPolicy::Cross),
        good.rounds(65),
        good.rounds(2).policy(PilotPolicy::Discard),
        good.rounds(3).policy(PilotPolicy::Neighbours),
        good.radius(65),
        good.prior(f64::NAN),
        good.power(0.0),
        good.exponent(0.0),
        good.epsilon(0.0),
        good.cap(0.5),
        good.mix(1.5),
        good.gain(-0.1),
        good.radius(0).policy(PilotPolicy::Neighbours),
    ] {
        assert!(Adaptive::with_options(Random::new(1), bad).is_err(), "{bad:?}");
    }
    assert!(Adaptive::with_options(Random::new(1), good.prior(f64::INFINITY)).is_ok());
}

/// A window's task has the terms of its own rows (128 or 4), those of the rows around, and two rows of sums, 64
/// bytes each. There are no more tasks than the image's 1024 rows need.
#[test]
fn working_memory_of_threads_is_counted_z03() {
    let frame = frame(4096, 1024);
    let planning = |radius, threads| {
        let memory = || {
            let options = options().radius(radius);
            let sampler = Adaptive::with_options(Sobol::new(1), options).unwrap();
            sampler.memory(&frame, &sampler.needs(), &Limits::samples(8 * frame.pixels() as u64))
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(memory).planning
    };
    let (wide, narrow) = (4096 * (512 + 2) * 64, 4096 * (16 + 2) * 64);
    assert_eq!(planning(64, 1) - planning(2, 1), wide - narrow);
    assert_eq!(planning(64, 4) - planning(64, 1), 3 * wide);
    assert_eq!(planning(64, 8), planning(64, 20), "there are eight tasks");
}

#[test]
fn independent_numbers_have_an_exponent_of_1_without_being_told() {
    let seen = film(penumbra);
    let counts = |points: Box<dyn PointSet>, exponent| {
        let mut sampler = Adaptive::with_options(points, options().rounds(1).exponent(exponent)).unwrap();
        planned(32, &mut sampler, &seen).unwrap()
    };
    let host = |exponent| counts(Box::new(HostNumbers), exponent);
    let net = |exponent| counts(Box::new(Sobol::new(1)), exponent);
    assert_eq!(host(1.15), net(1.0));
    assert_eq!(host(0.8), net(0.8));
    assert_ne!(host(1.15), net(1.15));
}

#[test]
fn a_whole_pilot_plans_nothing_and_a_discarded_one_has_a_bank() {
    let frame = frame(100, 50);
    let of = |sampler: &dyn Sampler, samples| sampler.memory(&frame, &sampler.needs(), &Limits::samples(samples));
    let discards = of(&preset(1, VarianceOptions::default().policy(PilotPolicy::Discard)), 20_000);
    assert_eq!(discards.discarded, 5000 * 40, "discarded samples have statistics of their own");
    let variance = |budget| of(&Adaptive::variance(Random::new(1)), budget);
    assert_eq!(variance(20_000).planning, 5000 * 4, "the pilot is all");
    assert!(variance(20_001).planning > 5000 * 100 && variance(40_000) == variance(20_001));
}

/// The side of films with costs, and the samples in each pixel.
const COSTLY: (u32, u32) = (16, 4);

/// A film of four samples per pixel with mean 1, and the deviation and rays per sample that these functions return.
fn costly(sampler: &dyn Sampler, deviation: impl Fn(usize) -> f32, cost: impl Fn(usize) -> u32) -> Film {
    support::film(COSTLY.0, sampler.needs().with_cost(), COSTLY.1, |i, k| {
        let value = 1.0 + if k % 2 == 0 { deviation(i) } else { -deviation(i) };
        Estimate::new([value; 3]).with_cost(cost(i))
    })
}

fn is_left(i: usize) -> bool {
    i % 16 < 8
}

/// Neyman's counts from each pixel's own variance, for independent samples.
fn neyman(cost: u32) -> Adaptive<Random> {
    preset(1, VarianceOptions::default().radius(0).pilot(COSTLY.1).cost(cost))
}

#[test]
fn counts_go_with_the_inverse_root_of_the_cost() {
    let mut sampler = neyman(1);
    let seen = costly(&sampler, |_| 0.5, |i| if is_left(i) { 1 } else { 4 });
    let counts = planned(24, &mut sampler, &seen).unwrap();
    assert!(counts.iter().enumerate().all(|(i, &n)| n == if is_left(i) { 32 } else { 16 }), "{counts:?}");
    // The control: without costs they are uniform.
    assert!(planned(24, &mut neyman(0), &seen).unwrap().iter().all(|&n| n == 24));
}

#[test]
fn the_error_of_as_many_rays_meets_its_closed_form() {
    let deviation = |i| if is_left(i) { 0.5f32 } else { 0.25 };
    let cost = |i| if is_left(i) { 1 } else { 4 };
    let mut sampler = neyman(1);
    let seen = costly(&sampler, deviation, cost);
    let counts = planned(20, &mut sampler, &seen).unwrap();
    let sum = |f: &dyn Fn(usize) -> f64| (0..counts.len()).map(f).sum::<f64>();
    let (s2, c) = (|i| f64::from(deviation(i)).powi(2), |i| f64::from(cost(i)));
    let error = sum(&|i| s2(i) / f64::from(counts[i]));
    let rays = sum(&|i| c(i) * f64::from(counts[i]));
    let uniform = sum(&s2) * sum(&c) / rays;
    let bound = sum(&|i| (s2(i) * c(i)).sqrt()).powi(2) / (sum(&c) * sum(&s2));
    assert!((bound - 0.64).abs() < 1e-6 && (error / uniform - bound).abs() < 1e-6, "{} {bound}", error / uniform);
}

#[test]
fn equal_costs_change_no_count() {
    let noisy = |i: usize| ((i * 7919) % 101) as f32 / 102.0;
    for policy in [PilotPolicy::Keep, PilotPolicy::Neighbours] {
        let of = |cost| {
            let options = AdaptiveOptions::default().policy(policy).pilot(COSTLY.1).cost(cost);
            Adaptive::with_options(Sobol::new(1), options).unwrap()
        };
        for rays in [0, 1, 3] {
            let seen = costly(&of(1), noisy, |_| rays);
            assert_eq!(
                planned(33, &mut of(1), &seen).unwrap(),
                planned(33, &mut of(0), &seen).unwrap(),
                "{policy:?}, {rays} rays"
            );
        }
    }
}

#[test]
fn a_pixels_own_cost_does_not_decide_its_count_where_its_values_do_not() {
    let at = 16 * 8 + 8;
    let counts = |policy, rays: u32| {
        let options = AdaptiveOptions::default().policy(policy).pilot(COSTLY.1).rounds(1).cost(1);
        let mut sampler = Adaptive::with_options(Random::new(1), options).unwrap();
        let noisy = |i: usize| if i.is_multiple_of(2) { 0.2 } else { 0.5 };
        let seen = costly(&sampler, noisy, |i| if i == at { rays } else { 2 });
        planned(64, &mut sampler, &seen).unwrap()
    };
    let of = |policy| [counts(policy, 2), counts(policy, 1000)];
    let [cheap, dear] = of(PilotPolicy::Neighbours);
    assert!(dear[at] >= cheap[at] && dear[at + 1] < cheap[at + 1], "{} {}", dear[at], cheap[at]);
    // The control: with kept samples it decides.
    let [cheap, dear] = of(PilotPolicy::Keep);
    assert!(dear[at] < cheap[at], "{} {}", dear[at], cheap[at]);
}

#[test]
fn costs_are_described_and_refused_beside_crossed_halves() {
    let described = |cost| with(AdaptiveOptions::default().cost(cost)).describe();
    assert!(described(1).ends_with(",cost=1") && described(0).ends_with(",cost=0"));
    assert!(neyman(1).describe().ends_with(",cost=1"));
    let crossed = VarianceOptions::default().policy(PilotPolicy::Cross).cost(1);
    assert!(Adaptive::variance_with_options(Random::new(1), crossed).is_err());
    assert!(AdaptiveOptions::parse("cost=2").is_err());
}
