//! Counts that spend a budget exactly and best.

use dapple_core::Error;
use dapple_core::plan::{Allocation, Ladder, allocate};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A second implementation: hands samples out one by one to the largest gain. Optimal and slow.
fn greedy(scores: &[f64], floors: &[u32], ceiling: u32, total: u64) -> Vec<u32> {
    let mut counts = floors.to_vec();
    for _ in counts.iter().map(|&n| u64::from(n)).sum::<u64>()..total {
        let gain = |p: usize| match counts[p] {
            n if n >= ceiling => -1.0,
            0 => f64::INFINITY,
            n => scores[p] / (f64::from(n) * (f64::from(n) + 1.0)),
        };
        let best = (0..scores.len()).reduce(|a, b| if gain(b) > gain(a) { b } else { a }).unwrap();
        counts[best] += 1;
    }
    counts
}

fn objective(scores: &[f64], counts: &[u32], exponent: f64) -> f64 {
    let term = |(g, &n): (&f64, &u32)| if n == 0 { f64::INFINITY } else { g * f64::from(n).powf(-exponent) };
    scores.iter().zip(counts).map(term).sum()
}

/// The number of random cases: `all`, or a thousandth under Miri, which runs a thousand times slower.
pub(crate) const fn cases(all: usize) -> usize {
    if cfg!(miri) { all.div_ceil(1000) } else { all }
}

fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}

/// The smallest objective over all possible assignments.
fn brute_force(scores: &[f64], floors: &[u32], ceiling: u32, total: u64) -> f64 {
    let Some((&floor, others)) = floors.split_first() else { return if total == 0 { 0.0 } else { f64::INFINITY } };
    let mut best = f64::INFINITY;
    for n in floor.max(1)..=ceiling.min(total as u32) {
        let rest = brute_force(&scores[1..], others, ceiling, total - u64::from(n));
        best = best.min(scores[0] / f64::from(n) + rest);
    }
    best
}

#[test]
fn no_instance_of_300_is_suboptimal() {
    let mut rng = Pcg64::seed_from_u64(1);
    for case in 0..cases(300) {
        let pixels = rng.random_range(1..=5);
        let scores: Vec<f64> = (0..pixels).map(|_| 10f64.powf(rng.random_range(-3.0..3.0))).collect();
        let floors: Vec<u32> = (0..pixels).map(|_| rng.random_range(1..4)).collect();
        let ceiling = rng.random_range(4..12);
        let total = rng.random_range(sum(&floors)..=ceiling as u64 * pixels);
        let got = allocate(&scores, &floors, ceiling, total).unwrap();
        assert_eq!(sum(&got.counts), total, "case {case}");
        let (got, best) = (objective(&scores, &got.counts, 1.0), brute_force(&scores, &floors, ceiling, total));
        assert!(got <= best * (1.0 + 1e-12), "case {case}: {got} instead of {best}");
        let greedy = objective(&scores, &greedy(&scores, &floors, ceiling, total), 1.0);
        assert!(greedy <= best * (1.0 + 1e-12), "case {case}: the greedy rule is no oracle");
    }
}

#[test]
fn larger_instances_meet_the_greedy_optimum() {
    let mut rng = Pcg64::seed_from_u64(2);
    for case in 0..40 {
        let pixels = rng.random_range(100..1500);
        let scores: Vec<f64> = (0..pixels).map(|_| 10f64.powf(rng.random_range(-6.0..6.0))).collect();
        let floors: Vec<u32> = (0..pixels).map(|_| rng.random_range(0..9)).collect();
        let total = sum(&floors).max(pixels) + rng.random_range(0..4 * pixels);
        let got = allocate(&scores, &floors, 100, total).unwrap();
        assert_eq!(sum(&got.counts) + got.unspent, total, "case {case}");
        let (got, best) = (got.counts, greedy(&scores, &floors, 100, total));
        let (got, best) = (objective(&scores, &got, 1.0), objective(&scores, &best, 1.0));
        assert!(got <= best * (1.0 + 1e-12) || best.is_infinite(), "case {case}: {got} instead of {best}");
    }
}

/// Random weights from 1e-38 to 1e38 mixed with NaN, negative and infinite ones, and the number of the latter.
fn wild(rng: &mut Pcg64, pixels: usize) -> (Vec<f64>, usize) {
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0];
    let injected = rng.random_range(0..4) == 0;
    let mut replaced = 0;
    let scores = (0..pixels)
        .map(|_| match rng.random_range(0..20) {
            0 if injected => {
                replaced += 1;
                bad[rng.random_range(0..4)]
            }
            1 => 0.0,
            _ => 10f64.powf(rng.random_range(-38.0..38.0)),
        })
        .collect();
    (scores, replaced)
}

#[test]
fn totals_are_exact_a07() {
    let mut rng = Pcg64::seed_from_u64(3);
    for case in 0..cases(10_000) {
        let pixels = if case % 100 == 99 && !cfg!(miri) { 5000 } else { rng.random_range(1..60) };
        let (scores, replaced) = wild(&mut rng, pixels);
        let floors: Vec<u32> = (0..pixels).map(|_| rng.random_range(0..5)).collect();
        let ceiling = rng.random_range(4..200);
        let total = rng.random_range(sum(&floors)..=u64::from(ceiling) * pixels as u64 + 9);
        let exponent = [None, Some(1.0), Some(1.3), Some(3.0)][case % 4];
        let got = match exponent {
            None => allocate(&scores, &floors, ceiling, total),
            Some(e) => {
                if case % 8 > 3 { Ladder::Halves } else { Ladder::Whole }.allocate(&scores, &floors, ceiling, total, e)
            }
        };
        let got = got.unwrap();
        assert_eq!(sum(&got.counts) + got.unspent, total, "case {case}");
        assert_eq!(got.unspent, total.saturating_sub(u64::from(ceiling) * pixels as u64), "case {case}");
        assert_eq!(got.replaced, replaced, "case {case}");
        let within = got.counts.iter().zip(&floors).all(|(&n, &floor)| (floor..=ceiling).contains(&n));
        assert!(within, "case {case}: floors {floors:?}, ceiling {ceiling}, counts {:?}", got.counts);
    }
}

#[test]
fn budgets_below_the_floors_are_refused_and_floors_win_over_ceilings_a07() {
    let refused = allocate(&[1.0; 3], &[2; 3], 9, 5);
    assert!(matches!(refused, Err(Error::BudgetTooSmall { budget: 5, needed: 6, pixels: 3 })));
    let got = allocate(&[1.0, 5.0], &[7, 1], 4, 20).unwrap();
    assert_eq!((got.counts, got.unspent), (vec![7, 4], 9));
    for exponent in [0.0, -1.0, f64::NAN, 3.1] {
        assert!(matches!(
            Ladder::Whole.allocate(&[1.0], &[1], 9, 5, exponent),
            Err(Error::OutOfRange { name: "exponent", .. })
        ));
    }
    let nothing = allocate(&[], &[], 4, 20).unwrap();
    assert_eq!((nothing.counts, nothing.unspent, nothing.replaced), (vec![], 20, 0));
}

#[test]
fn permuting_pixels_permutes_counts_a07() {
    let mut rng = Pcg64::seed_from_u64(4);
    for _ in 0..cases(200) {
        let pixels = rng.random_range(2..80);
        // Few values: many ties.
        let scores: Vec<f64> = (0..pixels).map(|_| f64::from(1u32 << rng.random_range(0..6))).collect();
        let total = rng.random_range(pixels as u64..20 * pixels as u64);
        let mut order: Vec<usize> = (0..pixels).collect();
        order.shuffle(&mut rng);
        let permuted: Vec<f64> = order.iter().map(|&p| scores[p]).collect();
        let run = |scores: &[f64]| -> Vec<Allocation> {
            let floors = vec![1; pixels];
            let plain = allocate(scores, &floors, 64, total).unwrap();
            vec![plain, Ladder::Whole.allocate(scores, &floors, 64, total, 1.3).unwrap()]
        };
        for (got, permuted_got) in run(&scores).into_iter().zip(run(&permuted)) {
            // Only pixels of equal scores may swap counts.
            let of = |scores: &[f64], counts: &[u32]| {
                let mut pairs: Vec<_> = scores.iter().map(|g| g.to_bits()).zip(counts.iter().copied()).collect();
                pairs.sort_unstable();
                pairs
            };
            assert_eq!(of(&scores, &got.counts), of(&permuted, &permuted_got.counts));
        }
    }
}

#[test]
fn equal_scores_give_counts_that_differ_by_one() {
    for score in [0.0, 1.0, 1e300, 1e-300, f64::NAN, f64::INFINITY, -2.0] {
        let totals = [97, 98, 500, 97 * 37 + 13, 97 * 1000 - 1];
        for &total in &totals[..if cfg!(miri) { 3 } else { 5 }] {
            let (scores, floors) = (vec![score; 97], vec![1; 97]);
            let plain = allocate(&scores, &floors, 2000, total).unwrap();
            let ladder = Ladder::Halves.allocate(&scores, &floors, 2000, total, 1.3).unwrap();
            for counts in [plain.counts, ladder.counts] {
                let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
                assert!(most - least <= 1, "score {score}, total {total}: {least} .. {most}");
                assert_eq!(sum(&counts), total);
            }
        }
    }
    // NaN beside zeros counts as zero, so all are equal.
    let mixed: Vec<f64> = (0..97).map(|i| if i % 3 == 0 { f64::NAN } else { 0.0 }).collect();
    let counts = Ladder::Whole.allocate(&mixed, &[1; 97], 2000, 97 * 10 + 5, 1.3).unwrap().counts;
    assert!(counts.iter().max().unwrap() - counts.iter().min().unwrap() <= 1, "{counts:?}");
}

/// Both halves of the image get equal numbers of the remaining samples, within 6 standard errors.
#[test]
fn odd_samples_prefer_no_part_of_the_image() {
    let counts = allocate(&vec![1.0; 10_000], &vec![1; 10_000], 100, 25_000).unwrap().counts;
    let odd = |part: &[u32]| part.iter().filter(|&&n| n == 3).count() as f64;
    let (first, second) = (odd(&counts[..5000]), odd(&counts[5000..]));
    assert!((first - second).abs() < 6.0 * 5000f64.sqrt(), "{first} and {second}");
}

#[test]
fn more_budget_never_lowers_a_count() {
    let mut rng = Pcg64::seed_from_u64(5);
    let scores: Vec<f64> = (0..50).map(|_| 10f64.powf(rng.random_range(-2.0..2.0))).collect();
    let mut before = vec![0; 50];
    for total in 50..50 + cases(1950) as u64 {
        let counts = allocate(&scores, &[1; 50], 60, total).unwrap().counts;
        assert!(counts.iter().zip(&before).all(|(n, b)| n >= b), "total {total}");
        before = counts;
    }
}

#[test]
fn all_but_one_count_are_on_the_ladder() {
    let mut rng = Pcg64::seed_from_u64(6);
    for case in 0..cases(500) {
        let pixels = rng.random_range(2..200usize);
        let ladder = if case % 2 == 0 { Ladder::Halves } else { Ladder::Whole };
        let even = ladder == Ladder::Halves;
        let mut scores: Vec<f64> = (0..pixels).map(|_| 10f64.powf(rng.random_range(-3.0..3.0))).collect();
        scores[1] = scores[0] * 2.0;
        // A ceiling off the ladder.
        let (floor, ceiling) = (if even { 2 } else { 1 }, 61);
        let total = rng.random_range(u64::from(floor) * pixels as u64..=40 * pixels as u64);
        let floors = vec![floor; pixels];
        let counts = ladder.allocate(&scores, &floors, ceiling, total, 1.3).unwrap().counts;
        assert_eq!(sum(&counts), total);
        let off = counts.iter().filter(|&&n| ladder.floor(n) != n || (even && n % 2 == 1)).count();
        assert!(off <= 1, "case {case}: {off} counts are off the ladder: {counts:?}");
    }
}

/// No exchange of one step between two pixels improves the objective by more than the one odd pixel can explain.
#[test]
fn ladder_steps_are_in_the_order_of_gains() {
    let mut rng = Pcg64::seed_from_u64(7);
    for _ in 0..cases(100) {
        let scores: Vec<f64> = (0..60).map(|_| 10f64.powf(rng.random_range(-3.0..3.0))).collect();
        let total = rng.random_range(60..1200);
        let counts = Ladder::Whole.allocate(&scores, &[1; 60], u32::MAX, total, 1.3).unwrap().counts;
        let on: Vec<usize> = (0..60).filter(|&p| Ladder::Whole.floor(counts[p]) == counts[p]).collect();
        let f = |n: u32| f64::from(n).powf(-1.3);
        let per_sample = |p: usize, n: u32, m: u32| scores[p] * (f(n) - f(m)) / f64::from(m - n);
        let below = |n: u32| Ladder::Whole.floor(n - 1);
        let taken = on.iter().filter(|&&p| counts[p] > 1).map(|&p| per_sample(p, below(counts[p]), counts[p]));
        let open = on.iter().map(|&p| per_sample(p, counts[p], Ladder::Whole.next(counts[p])));
        let (taken, open) = (taken.fold(f64::INFINITY, f64::min), open.fold(0.0, f64::max));
        assert!(open <= taken * (1.0 + 1e-9), "a step worth {open} was left out for one worth {taken}");
    }
}

#[test]
fn the_ladder_has_its_published_rungs() {
    let climb = |ladder: Ladder| std::iter::successors(Some(0), move |&n| Some(ladder.next(n)));
    assert_eq!(climb(Ladder::Whole).take(13).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64]);
    assert_eq!(climb(Ladder::Halves).take(12).collect::<Vec<_>>(), [0, 2, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96]);
    for ladder in [Ladder::Whole, Ladder::Halves] {
        let rungs: Vec<u32> = climb(ladder).take_while(|&n| n < u32::MAX).collect();
        assert!(*rungs.last().unwrap() >= 3 << 30, "the ladder ends early");
        for n in 1..2000 {
            let next = *rungs.iter().find(|&&r| r > n).unwrap();
            let floor = *rungs.iter().rev().find(|&&r| r <= n).unwrap();
            assert_eq!(ladder.next(n), next, "after {n}");
            // Below the first rung, `n` itself.
            assert_eq!(ladder.floor(n), if floor == 0 { n } else { floor }, "under {n}");
        }
        assert_eq!((ladder.floor(0), ladder.next(u32::MAX)), (0, u32::MAX));
        assert_eq!(ladder.floor(u32::MAX), *rungs.last().unwrap());
    }
}

#[test]
fn threads_change_no_count() {
    let mut rng = Pcg64::seed_from_u64(8);
    let scores: Vec<f64> = (0..50_000).map(|_| 10f64.powf(rng.random_range(-3.0..3.0))).collect();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Ladder::Whole.allocate(&scores, &vec![4; 50_000], 200, 1_600_001, 1.3).unwrap())
    };
    let one = run(1);
    assert!([2, 3, 7].into_iter().all(|threads| run(threads) == one));
}
