//! Counts by error and cost.

use crate::common::*;
use dapple_adaptive::{Adaptive, AdaptiveOptions, PilotPolicy, VarianceOptions};
use dapple_conformance::sampler;
use dapple_core::{BudgetLeft, Estimate, Feedback, Film, Options as _, Plan, PointSet, Sampler};
use dapple_low_discrepancy::{Random, Sobol};

const SIDE: u32 = 16;
const PILOT: u64 = 4;

/// A film of four samples per pixel with mean 1, and the deviation and rays per sample that these functions return.
fn film(sampler: &dyn Sampler, deviation: impl Fn(usize) -> f32, cost: impl Fn(usize) -> u32) -> Film {
    let mut film = Film::new(frame(SIDE, SIDE), sampler.needs().with_cost());
    for i in 0..(SIDE * SIDE) as usize {
        for k in 0..PILOT {
            let value = 1.0 + if k % 2 == 0 { deviation(i) } else { -deviation(i) };
            film.push_estimate(i, k as usize, &Estimate::new([value; 3]).with_cost(cost(i)));
        }
    }
    film
}

/// The counts after the round that follows the film, for `spp` samples per pixel.
fn planned(sampler: &mut dyn Sampler, film: &Film, spp: u64) -> Vec<u32> {
    let pixels = u64::from(SIDE * SIDE);
    let budget = BudgetLeft::new(spp * pixels).with_spent(PILOT * pixels).with_max_spp(100_000);
    let mut plan = Plan::empty(pixels as usize);
    sampler.next_round(&Feedback::new(1, film, budget), &mut plan).unwrap();
    plan.counts.iter().map(|n| n + PILOT as u32).collect()
}

fn is_left(i: usize) -> bool {
    i % (SIDE as usize) < SIDE as usize / 2
}

/// Neyman's counts from each pixel's own variance, for independent samples.
fn neyman(cost: u32) -> Adaptive<Random> {
    let options = VarianceOptions::default().radius(0).pilot(PILOT as u32).cost(cost);
    Adaptive::variance_with_options(Random::new(1), options).unwrap()
}

#[test]
fn counts_go_with_the_inverse_root_of_the_cost() {
    let mut sampler = neyman(1);
    let seen = film(&sampler, |_| 0.5, |i| if is_left(i) { 1 } else { 4 });
    let counts = planned(&mut sampler, &seen, 24);
    assert!(counts.iter().enumerate().all(|(i, &n)| n == if is_left(i) { 32 } else { 16 }), "{counts:?}");
    // The control: without costs they are uniform.
    assert!(planned(&mut neyman(0), &seen, 24).iter().all(|&n| n == 24));
}

#[test]
fn the_error_of_as_many_rays_meets_its_closed_form() {
    let deviation = |i| if is_left(i) { 0.5f32 } else { 0.25 };
    let cost = |i| if is_left(i) { 1 } else { 4 };
    let mut sampler = neyman(1);
    let seen = film(&sampler, deviation, cost);
    let counts = planned(&mut sampler, &seen, 20);
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
            let options = AdaptiveOptions::default().policy(policy).pilot(PILOT as u32).cost(cost);
            Adaptive::with_options(Sobol::new(1), options).unwrap()
        };
        for rays in [0, 1, 3] {
            let seen = film(&of(1), noisy, |_| rays);
            assert_eq!(planned(&mut of(1), &seen, 33), planned(&mut of(0), &seen, 33), "{policy:?}, {rays} rays");
        }
    }
}

#[test]
fn a_pixels_own_cost_does_not_decide_its_count_where_its_values_do_not() {
    let at = (SIDE * 8 + 8) as usize;
    let counts = |policy, rays: u32| {
        let options = AdaptiveOptions::default().policy(policy).pilot(PILOT as u32).rounds(1).cost(1);
        let mut sampler = Adaptive::with_options(Random::new(1), options).unwrap();
        let noisy = |i: usize| if i.is_multiple_of(2) { 0.2 } else { 0.5 };
        let seen = film(&sampler, noisy, |i| if i == at { rays } else { 2 });
        planned(&mut sampler, &seen, 64)
    };
    let of = |policy| [counts(policy, 2), counts(policy, 1000)];
    let [cheap, dear] = of(PilotPolicy::Neighbours);
    assert!(dear[at] >= cheap[at] && dear[at + 1] < cheap[at + 1], "{} {}", dear[at], cheap[at]);
    // The control: with kept samples it decides.
    let [cheap, dear] = of(PilotPolicy::Keep);
    assert!(dear[at] < cheap[at], "{} {}", dear[at], cheap[at]);
}

#[test]
fn samplers_with_costs_conform() {
    fn conforms<P: PointSet + 'static>(points: impl Fn() -> P) {
        for policy in [PilotPolicy::Keep, PilotPolicy::Neighbours, PilotPolicy::Discard] {
            let options = AdaptiveOptions::default().policy(policy).cost(1);
            sampler(|| Box::new(Adaptive::with_options(points(), options).unwrap()));
            let options = VarianceOptions::default().policy(policy).cost(1);
            sampler(|| Box::new(Adaptive::variance_with_options(points(), options).unwrap()));
        }
    }
    conforms(|| Sobol::new(6));
}

#[test]
fn costs_are_described_and_refused_beside_crossed_halves() {
    let described =
        |cost| Adaptive::with_options(Random::new(1), AdaptiveOptions::default().cost(cost)).unwrap().describe();
    assert!(described(1).ends_with(",cost=1") && described(0).ends_with(",cost=0"));
    assert!(neyman(1).describe().ends_with(",cost=1"));
    let crossed = VarianceOptions::default().policy(PilotPolicy::Cross).cost(1);
    assert!(Adaptive::variance_with_options(Random::new(1), crossed).is_err());
    assert!(AdaptiveOptions::parse("cost=2").is_err());
}
