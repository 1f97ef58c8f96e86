//! The number of samples spent, their places, and the time of the decision.

use crate::support::*;
use dapple_conformance::toys::raised;
use dapple_core::plan::{BudgetLeft, Feedback, Plan, Progress};
use dapple_core::{Error, Film, Limits, Needs, Render, Sampler};
use dapple_mitchell::{MitchellOptions, MitchellPbrtOptions, PilotPolicy, Rates, Stopping};
use proptest::prelude::*;

/// A light that 1 sample in 1000 sees.
const RARE: Bernoulli = Bernoulli(1e-3);

/// As published, light that the pilot misses is never searched for: these samplers fail this case by design. The
/// numbers are binomial, within 5 standard deviations.
#[test]
fn a_dark_pilot_is_never_refined_a03() {
    let size = frame(128, 128);
    let pixels = size.pixels() as f64;
    let limits = Limits::samples(1000 * size.pixels() as u64);
    let of = |radius| mitchell(alone(4, 60, Stopping::Threshold, PilotPolicy::Keep).radius(radius), 1);
    let cases: [(Box<dyn Sampler>, i32); 3] = [
        (Box::new(of(0)), 4),
        (Box::new(of(1)), 36),
        (Box::new(pbrt(pbrt_options(4, 64, Stopping::Threshold, PilotPolicy::Refined), 1)), 4),
    ];
    for (k, (mut sampler, samples)) in cases.into_iter().enumerate() {
        let film = run(&mut { RARE }, &mut *sampler, size, &limits);
        let (stopped, share) = (film.counts().iter().filter(|&&n| n == 4).count() as f64, 0.999f64.powi(samples));
        // Windows overlap: at most 9 times the variance of independent pixels. Windows at the border are smaller, and
        // stay black a little more often.
        let allowed = 5.0 * (f64::from(samples / 4) * share * (1.0 - share) * pixels).sqrt();
        let apart = (stopped - share * pixels).abs();
        assert!(apart < allowed, "{}: {stopped} of {}", sampler.describe(), share * pixels);
        if k == 0 {
            // With a pilot of 4 and 64 samples in total, 93 % of the light is missing, with 1000 spp allowed.
            let got = (0..size.pixels()).map(|i| film.mean(i)[0]).sum::<f64>() / pixels;
            let (p, mixed) = (1e-3f64, 1.0 - 1e-3f64.powi(4) - 0.999f64.powi(4));
            let closed = (4.0 * p + 60.0 * p * mixed) / 64.0;
            assert!((0.06..0.07).contains(&(closed / p)), "{closed}");
            // The spread is that of about 65 refined pixels with 1/64 or a little more each.
            assert!((got - closed).abs() < 5.0 * (mixed / pixels).sqrt() / 64.0 * 1.1, "{got} for {closed}");
        }
    }
    // A budget reaches the dark pixels after the others are done, and takes nothing from the others.
    for policy in POLICIES {
        let limits = Limits::samples(10 * size.pixels() as u64);
        let film = run(&mut { RARE }, &mut mitchell(alone(4, 60, Stopping::Budget, policy), 2), size, &limits);
        assert!(film.counts().iter().all(|&n| n >= 4), "{policy:?}");
        let film = run(&mut { RARE }, &mut pbrt(MitchellPbrtOptions::default().policy(policy), 2), size, &limits);
        assert!(film.counts().iter().all(|&n| n >= 4), "{policy:?}");
    }
}

/// Every sampler under test, by mode and policy.
fn samplers(mode: Stopping) -> Vec<Box<dyn Sampler>> {
    let each = |policy| -> Vec<Box<dyn Sampler>> {
        let plain = MitchellOptions::default().mode(mode).policy(policy);
        vec![
            Box::new(mitchell(plain, 1)),
            Box::new(mitchell(plain.radius(0), 1)),
            Box::new(mitchell(plain.initial(3).additional(5), 1)),
            Box::new(pbrt(MitchellPbrtOptions::default().mode(mode).policy(policy), 1)),
        ]
    };
    POLICIES.into_iter().flat_map(each).collect()
}

#[test]
fn constant_images_are_sampled_uniformly_a04() {
    let size = frame(13, 11);
    for value in [0.0, 0.5, 1e30] {
        let mut field = Field(|_, _| [value; 3]);
        for total in [143, 4 * 143, 10 * 143 + 7, 33 * 143 + 1] {
            for mut sampler in samplers(Stopping::Budget) {
                let film = run(&mut field, &mut *sampler, size, &Limits::samples(total));
                let counts = film.counts();
                let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
                assert!(most - least <= 1, "{}, {value}, {total}: {least} .. {most}", sampler.describe());
                assert_eq!(film.record().samples, total, "{}", sampler.describe());
                assert!(film.image().iter().flatten().all(|x| *x == value));
            }
            // With the threshold no pixel is refined.
            for mut sampler in samplers(Stopping::Threshold) {
                let film = run(&mut field, &mut *sampler, size, &Limits::samples(total));
                let counts = film.counts();
                assert!(counts.iter().all(|&n| n == counts[0] && n > 0), "{}, {total}", sampler.describe());
            }
        }
    }
}

#[test]
fn tiny_budgets_are_met_or_refused_a06() {
    let size = frame(5, 4);
    for mode in [Stopping::Budget, Stopping::Threshold] {
        for k in 0..samplers(mode).len() {
            let outcome = |total, min_spp| {
                let mut limits = Limits::samples(total);
                limits.min_spp = min_spp;
                let draw = || {
                    let sampler = &mut *samplers(mode).swap_remove(k);
                    Render::new(size, &limits).run(&mut Bernoulli(0.5), sampler)
                };
                let counts = [draw(), draw()].map(|film| match film {
                    Ok(film) => Some((film.record().samples, film.counts())),
                    Err(Error::BudgetTooSmall { .. }) => None,
                    Err(e) => panic!("{e}"),
                });
                assert_eq!(counts[0], counts[1], "another choice in another run");
                counts[0].clone()
            };
            for (total, min_spp) in [(0, 0), (0, 1), (1, 1), (19, 1), (4 * 20 - 1, 4)] {
                assert_eq!(outcome(total, min_spp), None, "{total} samples, floor {min_spp}");
            }
            for total in [1, 19, 20, 21, 39] {
                let (spent, counts) = outcome(total, 0).unwrap();
                assert!(if mode == Stopping::Budget { spent == total } else { spent <= total });
                // Unsampled pixels have a count of 0.
                assert!(total >= 20 || counts.iter().filter(|&&n| n == 0).count() as u64 >= 20 - total);
            }
        }
    }
}

/// Refinement is decided once, after exactly `initial` samples (or all there are), and never exceeds the budget.
#[test]
fn refinement_is_decided_once_after_the_pilot_a10() {
    let size = frame(2, 1);
    for start in (2..=300u32).step_by(9) {
        for n in 1..=300u32 {
            for mode in [Stopping::Budget, Stopping::Threshold] {
                let mut sampler = mitchell(alone(start, 7, mode, PilotPolicy::Keep), 1);
                let mut film = Film::with_recorders(size, sampler.needs(), sampler.recorders());
                let mut pilots = vec![];
                for round in 0.. {
                    let (spent, total) = (film.record().samples, 2 * u64::from(n));
                    let budget = BudgetLeft::new(total).with_spent(spent);
                    let mut plan = Plan::empty(2);
                    match sampler.next_round(&Feedback::new(round, &film, budget), &mut plan).unwrap() {
                        Progress::Done => break,
                        Progress::Trace => assert!(plan.total() <= budget.left() && round < 2),
                    }
                    pilots.push(film.count(0));
                    for (i, &count) in plan.counts.iter().enumerate() {
                        (0..count).for_each(|k| film.push(i, 0, [if i == 0 { (k % 2) as f32 } else { 0.5 }; 3]));
                    }
                }
                let pilot = u64::from(start.min(n));
                assert_eq!(pilots, if n > start { vec![0, pilot] } else { vec![0] }, "{start}, {n}");
                let spent = film.record().samples;
                match mode {
                    Stopping::Budget => assert_eq!(spent, 2 * u64::from(n), "{start}, {n}"),
                    Stopping::Threshold => assert_eq!(spent, 2 * pilot + (2 * (u64::from(n) - pilot)).min(7)),
                }
                assert!(film.count(0) >= film.count(1) && film.count(1) >= pilot, "{start}, {n}");
            }
        }
    }
}

/// Under a time limit the first budget is 1 spp, and later ones are estimates. Decisions stay.
#[test]
fn budgets_that_grow_are_spent_and_change_no_decision() {
    let size = frame(16, 16);
    // The left half is flat.
    let field = || Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 8 { 0.5 } else { u[0] }; 3]);
    let pixels = size.pixels() as u64;
    for policy in POLICIES {
        let options = alone(4, 12, Stopping::Threshold, policy);
        let steps = [1, 8, 8, 30, 30, 60].map(|n: u64| n * pixels);
        let film = raised(&mut field(), &mut mitchell(options, 1), Needs::none(), size, &steps);
        let at_once = run(&mut field(), &mut mitchell(options, 1), size, &Limits::samples(60 * pixels));
        assert_eq!(film.counts(), at_once.counts(), "{policy:?}");
        assert!(film.counts().iter().enumerate().all(|(i, &n)| n == 4 || n == 16 && i % 16 >= 8), "{policy:?}");
        assert!(film.counts().contains(&16));
        for mut sampler in samplers(Stopping::Budget) {
            let film = raised(&mut field(), &mut *sampler, Needs::none(), size, &steps.map(|n| n + 7));
            assert_eq!(film.record().samples, 60 * pixels + 7, "{}", sampler.describe());
        }
    }
}

/// An error limit adds halves: samples enter and leave the image in both.
#[test]
fn error_limits_with_halves_are_spent() {
    let size = frame(16, 16);
    let pixels = size.pixels();
    for mut sampler in [samplers(Stopping::Budget), samplers(Stopping::Threshold)].into_iter().flatten() {
        let mut field = Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 8 { 0.5 } else { u[0] }; 3]);
        let at_most = 50 * pixels as u64;
        let film = run(&mut field, &mut *sampler, size, &Limits::error(1e-9, at_most));
        let taken: u64 = (0..pixels).map(|i| film.count(i) + film.discarded(i).count).sum();
        assert_eq!(taken, film.record().samples);
        let described = sampler.describe();
        match described.contains("mode=budget") {
            true => assert_eq!(taken, at_most, "{described}"),
            false => assert!(taken <= at_most, "{described}"),
        }
        for i in 0..pixels {
            let [a, b] = [0, 1].map(|half| film.half(half, i).unwrap().count);
            assert!(a.abs_diff(b) <= 1, "{described}: {a} and {b} samples in the halves");
        }
    }
}

/// Rates that follow the budget stay until it has doubled. The last tenth of a time limit goes to further steps, not to
/// one more sample everywhere.
#[test]
fn rates_by_the_budget_stay_while_it_grows_a_little() {
    let size = frame(16, 16);
    let pixels = size.pixels() as u64;
    let field = || Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 12 { 0.5 } else { u[0] }; 3]);
    let counts = |steps: [u64; 3]| {
        let steps = steps.map(|n| n * pixels);
        raised(&mut field(), &mut mitchell(MitchellOptions::default(), 1), Needs::none(), size, &steps).counts()
    };
    assert_eq!(Rates::for_mean(24), Rates { initial: 8, additional: 20 });
    let off_rates = |counts: &[u64]| counts.iter().filter(|&&n| n < 8 || !(n - 8).is_multiple_of(20)).count();
    let (short, long) = (counts([1, 24, 24]), counts([1, 24, 30]));
    // At most one pixel off the rates for each budget that ended within a step.
    assert!(off_rates(&short) <= 1 && off_rates(&long) <= 2, "{long:?}");
    assert!(long.iter().zip(&short).all(|(long, short)| long >= short));
    // After the budget has doubled, the rates follow: 14 + 39 at 48.
    assert!(counts([1, 24, 48]).iter().all(|&n| n >= 14));
}

#[derive(Clone, Debug)]
struct Case {
    size: [u32; 2],
    rates: [u32; 2],
    radius: u32,
    policy: PilotPolicy,
    spp: u64,
    odd: u64,
    bounds: [u32; 2],
    seed: u64,
}

fn cases() -> impl Strategy<Value = Case> {
    let policies = prop::sample::select(POLICIES.to_vec());
    let place = ([1..9u32, 1..9u32], [2..9u32, 1..20u32], 0..3u32, policies);
    (place, 1..60u64, 0..64u64, [0..9u32, 0..80u32], any::<u64>()).prop_map(
        |((size, rates, radius, policy), spp, odd, [low, room], seed)| {
            let low = low.min(spp as u32);
            Case { size, rates, radius, policy, spp, odd, bounds: [low, (spp as u32 + 2).max(low) + room], seed }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, rng_algorithm: prop::test_runner::RngAlgorithm::ChaCha, failure_persistence: None, ..ProptestConfig::default() })]

    /// The budget is met to the sample within all bounds, and at most one pixel leaves the two rates.
    #[test]
    fn budgets_are_exact_and_one_pixel_at_most_gets_part_of_a_step(case in cases()) {
        let size = frame(case.size[0], case.size[1]);
        let pixels = size.pixels() as u64;
        let [initial, additional] = case.rates;
        let total = case.spp * pixels + case.odd.min(pixels);
        let mut limits = Limits::samples(total);
        [limits.min_spp, limits.max_spp] = case.bounds;
        let options = alone(initial, additional, Stopping::Budget, case.policy).radius(case.radius);
        // Every pixel has a different spread, and some have none.
        let mut field = Field(|[x, y]: [u32; 2], u: [f32; 4]| {
            let spread = (mix(case.seed ^ u64::from(x * 16 + y)) % 8) as f32 / 8.0;
            [1.0 + spread * (u[0] - 0.5), 1.0, 0.0]
        });
        let film = run(&mut field, &mut mitchell(options, case.seed), size, &limits);
        let counts = film.counts();
        prop_assert_eq!(film.record().samples, total);
        prop_assert!(counts.iter().all(|&n| (u64::from(limits.min_spp)..=u64::from(limits.max_spp)).contains(&n)));
        let kept = counts.iter().sum::<u64>();
        let floor = u64::from(initial).min(kept / pixels);
        if case.policy == PilotPolicy::Keep {
            prop_assert!(counts.iter().all(|&n| n >= floor), "{:?} below {}", counts, floor);
            prop_assert_eq!(kept, total);
        }
        // If no pixel could be ranked, counts differ by at most one.
        let on_rate = |n: u64| {
            n <= floor.max(u64::from(limits.min_spp)) || n == u64::from(limits.max_spp)
                || n >= u64::from(initial) && (n - u64::from(initial)).is_multiple_of(u64::from(additional))
        };
        let off = counts.iter().filter(|&&n| !on_rate(n)).count();
        let level = counts.iter().max().unwrap() - counts.iter().min().unwrap() <= 1;
        prop_assert!(off <= 1 || level, "{} pixels off the rates: {:?}", off, counts);
    }
}
