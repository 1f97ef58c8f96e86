//! Decisions of the error-driven sampler on made-up films.

use crate::common::*;
use dapple_adaptive::{
    Adaptive, AdaptiveOptions, ErrorMap, PilotPolicy, PoolShape, Pooling, Sources, relative_variance,
};
use dapple_core::{
    BudgetLeft, Error, Feedback, Film, Frame, HostNumbers, Limits, Needs, Plan, PointSet, Progress, SampleId, Sampler,
};
use dapple_low_discrepancy::{Random, Sobol};

const SIDE: usize = 48;
const PILOT: u32 = 8;

/// A film of `PILOT` samples per pixel; `value` takes the pixel and four numbers.
fn film(needs: Needs, value: impl Fn([usize; 2], [f32; 4]) -> f32) -> Film {
    let points = Random::new(9);
    let mut film = Film::new(frame(SIDE as u32, SIDE as u32), needs);
    for i in 0..SIDE * SIDE {
        for index in 0..PILOT {
            let id = SampleId::new([(i % SIDE) as u32, (i / SIDE) as u32], 0, u64::from(index));
            film.push(i, index as usize, [value([i % SIDE, i / SIDE], points.block(id, 0)); 3]);
        }
    }
    film
}

/// The final counts, planned from this film for 32 samples per pixel.
fn planned(sampler: &mut dyn Sampler, film: &Film) -> Result<Vec<u32>, Error> {
    planned_for(32, sampler, film)
}

/// The final counts, planned from this film for `spp` samples per pixel.
fn planned_for(spp: u64, sampler: &mut dyn Sampler, film: &Film) -> Result<Vec<u32>, Error> {
    let pixels = (SIDE * SIDE) as u64;
    let spent = u64::from(PILOT) * pixels;
    let budget = BudgetLeft::new(spp * pixels).with_spent(spent).with_max_spp(100_000);
    let mut plan = Plan::empty(SIDE * SIDE);
    let progress = sampler.next_round(&Feedback::new(1, film, budget), &mut plan)?;
    assert_eq!(progress, Progress::Trace);
    assert_eq!(plan.total(), budget.left());
    Ok(plan.counts.iter().map(|n| n + PILOT).collect())
}

fn with(options: AdaptiveOptions) -> Adaptive<Random> {
    Adaptive::with_options(Random::new(1), options).unwrap()
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
    let seen = film(Needs::none().with_variance(), penumbra);
    let exponent = options().exponent;
    let counts = planned(&mut one_round(), &seen).unwrap();
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
    let seen = film(Needs::none().with_variance(), |[x, _], u| if x < 4 { u[0] * 100.0 } else { 1.0 });
    let counts = planned(&mut with(options().rounds(1).cap(6.0)), &seen).unwrap();
    assert!(counts.iter().all(|&n| n >= PILOT), "every pixel gets the pilot, a quarter of the mean");
    assert!(counts.iter().all(|&n| n <= 6 * 32 + 1), "and no pixel gets more than the cap");
    let beyond = (0..SIDE).map(|y| counts[y * SIDE + 40]).filter(|&n| n > PILOT).count();
    assert!(beyond > 0, "some samples go where no variance was seen");
}

/// A score of 1 % of the mean is 0.005 of a noisy pixel's.
#[test]
fn pixels_without_variance_get_samples_by_the_least_score() {
    let seen = film(Needs::none().with_variance(), |[x, _], u| if x < 24 { u[0] } else { 0.5 });
    let steady = options().pool(PoolShape::Window).power(2.0);
    let counts = planned_for(1024, &mut with(steady.rounds(1).pilot(PILOT)), &seen).unwrap();
    let exponent = options().exponent;
    let [noisy, quiet] = [6, 40].map(|x| column_mean(&counts, x));
    let expected = 0.005f64.powf(1.0 / (1.0 + exponent));
    assert!((quiet / noisy / expected - 1.0).abs() < 0.2, "{quiet} of {noisy}, not {expected} of it");
}

/// Count, mean 1 and sample variance, as moments.
fn moments_of(count: u64, variance: f64) -> dapple_core::RgbMoments {
    let mut moments = dapple_core::RgbMoments::default();
    (moments.count, moments.mean, moments.m2) = (count, [1.0; 3], [variance * (count - 1) as f64; 3]);
    moments
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
        let sources = Sources::All;
        let pooling = Pooling { pool: PoolShape::Window, radius: 1, prior, power: 1.0, epsilon: 0.5, sources };
        let found = relative_variance(&moments, [2, 1], &pooling).unwrap();
        for (found, expected) in found.iter().zip(expected) {
            // Three channels, over the squared mean and epsilon.
            assert!((found / (3.0 * expected / 1.5) - 1.0).abs() < 1e-12, "prior {prior}: {found}, not {expected}");
        }
    }
}

#[test]
fn counts_without_a_gain_are_uniform() {
    let alike = film(Needs::none().with_variance(), |_, u| u[0]);
    let counts = planned(&mut one_round(), &alike).unwrap();
    assert!(counts.iter().all(|&n| n == 32), "{:?}", &counts[..50]);
    // Negative control: a sampler that always adapts follows the pilot's noise.
    let always = options().gain(1.0).rounds(1);
    assert!(planned(&mut with(always), &alike).unwrap().iter().any(|&n| n != 32));
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
    let seen = film(Needs::none().with_variance(), |_, u| u[0]);
    let top =
        |film: &Film| Ok((0..film.frame().pixels()).map(|i| if i < SIDE * SIDE / 2 { 9.0 } else { 1.0 }).collect());
    let ratio = |mix: f64| {
        let counts = planned(&mut driven(mix, top), &seen).unwrap();
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
    let seen = film(Needs::none().with_variance(), penumbra);
    for bad in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
        let counts = planned(&mut driven(0.5, move |film| Ok(vec![bad; film.frame().pixels()])), &seen).unwrap();
        assert_eq!(counts, planned(&mut one_round(), &seen).unwrap(), "{bad}");
    }
    let short = planned(&mut driven(0.5, |_| Ok(vec![1.0; 3])), &seen).unwrap_err().to_string();
    assert!(short.contains("made-up") && short.contains("3 values"), "{short}");
    let refused = |_: &Film| Err(Error::Mismatch { who: "filter".into(), what: "no".into() });
    assert!(planned(&mut driven(0.5, refused), &seen).is_err(), "its errors are returned");
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
    let before = film(Needs::none().with_variance(), |_, u| noise(u, 1.0));
    for at in [[0, 5], [20, 23]] {
        let after = film(Needs::none().with_variance(), |pixel, u| noise(u, if pixel == at { 9.0 } else { 1.0 }));
        for (sources, odd) in [(Sources::Odd, 1), (Sources::Even, 0)] {
            let pooling =
                Pooling { pool: PoolShape::Window, radius: 2, prior: 6.0, power: 1.0, epsilon: 0.01, sources };
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
    let mut field = Field(|[x, _]: [u32; 2], u: [f32; 4]| x as f32 * u[0]);
    let at = frame(24, 24);
    let film = run(&mut field, &mut sampler, at, &Limits::samples(32 * 576)).unwrap();
    let rounds: Vec<u64> = film.record().rounds.iter().map(|r| r.samples).collect();
    assert_eq!(rounds, [8 * 576, 8 * 576, 8 * 576, 8 * 576]);
}

#[test]
fn tiny_budgets_and_frames_are_met() {
    for (w, h, total) in [(1, 1, 1), (1, 1, 5), (3, 1, 4), (7, 5, 35), (7, 5, 36), (8, 8, 64 * 3 + 1)] {
        for policy in [PilotPolicy::Keep, PilotPolicy::Neighbours, PilotPolicy::Discard, PilotPolicy::Cross] {
            let mut sampler = with(options().policy(policy));
            let film =
                run(&mut Field(|_, u: [f32; 4]| u[0]), &mut sampler, frame(w, h), &Limits::samples(total)).unwrap();
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
    let frame = Frame::new(4096, 1024).unwrap();
    let planning = |radius, threads| {
        let memory = || {
            let options = options().radius(radius);
            let sampler = Adaptive::with_options(Sobol::new(1), options).unwrap();
            sampler.memory(&frame, &sampler.needs(), &Limits::samples(8 * frame.pixels() as u64))
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(memory).planning
    };
    let (wide, narrow) = (4096 * (256 + 2) * 64, 4096 * (8 + 2) * 64);
    assert_eq!(planning(64, 1) - planning(2, 1), wide - narrow);
    assert_eq!(planning(64, 4) - planning(64, 1), 3 * wide);
    assert_eq!(planning(64, 8), planning(64, 20), "there are eight tasks");
}

#[test]
fn independent_numbers_have_an_exponent_of_1_without_being_told() {
    let seen = film(Needs::none().with_variance(), penumbra);
    let counts = |points: Box<dyn PointSet>, exponent| {
        let mut sampler = Adaptive::with_options(points, options().rounds(1).exponent(exponent)).unwrap();
        planned(&mut sampler, &seen).unwrap()
    };
    let host = |exponent| counts(Box::new(HostNumbers), exponent);
    let net = |exponent| counts(Box::new(Sobol::new(1)), exponent);
    assert_eq!(host(1.15), net(1.0));
    assert_eq!(host(0.8), net(0.8));
    assert_ne!(host(1.15), net(1.15));
}
