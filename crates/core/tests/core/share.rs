//! Counts in proportion to weights.

use crate::allocate::cases;
use dapple_core::Error;
use dapple_core::plan::share;
use rand::{RngExt, SeedableRng, seq::SliceRandom};

fn rng(seed: u64) -> rand_pcg::Pcg64 {
    rand_pcg::Pcg64::seed_from_u64(seed)
}

fn counts(weights: &[f64], base: u32, ceiling: u32, total: u64) -> Vec<u32> {
    share(weights, base, &vec![0; weights.len()], ceiling, total).unwrap().counts
}

#[test]
fn shares_go_with_weights() {
    assert_eq!(counts(&[1.0, 2.0, 3.0], 0, 100, 60), [10, 20, 30]);
    assert_eq!(counts(&[1.0, 2.0, 3.0], 4, 100, 72), [14, 24, 34]);
    assert_eq!(counts(&[1.0, 2.0, 5.0], 0, 10, 25), [5, 10, 10], "the rest above the ceiling is shared in proportion");
    assert_eq!(counts(&[1.0, 1.0, 8.0], 1, 4, 10), [3, 3, 4]);
    assert_eq!(counts(&[0.0, 1.0, 1.0], 2, 8, 18), [2, 8, 8], "zeros wait");
    assert_eq!(counts(&[0.0, 0.0, 1.0], 2, 8, 18), [5, 5, 8], "and then share alike");
}

#[test]
fn largest_remainders_come_first() {
    // Shares of 2.1, 3.3 and 4.6.
    assert_eq!(counts(&[2.1, 3.3, 4.6], 0, 100, 10), [2, 3, 5]);
}

#[test]
fn equal_remainders_go_by_weight() {
    // Shares of 0.5 and 1.5, either way round.
    assert_eq!(counts(&[1.0, 3.0], 0, 100, 2), [0, 2]);
    assert_eq!(counts(&[3.0, 1.0], 0, 100, 2), [2, 0]);
}

#[test]
fn below_the_base_counts_are_level() {
    let got = counts(&[1.0, 1e6, 3.0, 0.0], 4, 9, 10);
    assert!(got.iter().all(|n| (2..=3).contains(n)), "{got:?}");
}

#[test]
fn floors_hold_and_bases_rise() {
    let got = share(&[1.0, 1.0, 2.0], 3, &[9, 0, 0], 20, 24).unwrap().counts;
    assert_eq!(got, [9, 6, 9], "3 + 3 w, and 9 already there");
    assert!(matches!(share(&[1.0; 3], 0, &[2; 3], 9, 5), Err(Error::BudgetTooSmall { needed: 6, .. })));
    assert_eq!(share(&[1.0; 3], 0, &[2; 3], 9, 30).unwrap().unspent, 3);
    assert_eq!(share(&[], 0, &[], 9, 30).unwrap().unspent, 30);
}

/// A random weight from 1e-38 to 1e38; one in ten is 0.
fn weight(rng: &mut rand_pcg::Pcg64) -> f64 {
    match rng.random_range(0..40) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => f64::NEG_INFINITY,
        3 => -1.0,
        _ => 10f64.powf(rng.random_range(-38.0..38.0)),
    }
}

fn is_none(w: f64) -> bool {
    w.is_nan() || w < 0.0 || w == f64::INFINITY
}

#[test]
fn totals_are_exact_a07() {
    let mut rng = rng(0xa07);
    for case in 0..cases(10_000) {
        // Few large cases: 10 of 2^20, the others small.
        let n = match case {
            9_990.. => 1 << 20,
            9_900.. => rng.random_range(1000..5000),
            _ => rng.random_range(1..60),
        };
        let mild = rng.random_bool(0.3);
        let weights: Vec<f64> =
            (0..n).map(|_| if mild { rng.random_range(0.5..4.0) } else { weight(&mut rng) }).collect();
        let floors: Vec<u32> = (0..n).map(|_| rng.random_range(0..5)).collect();
        let base = rng.random_range(0..6);
        let ceiling = rng.random_range(5..200);
        let least: u64 = floors.iter().map(|&f| u64::from(f)).sum();
        let total = rng.random_range(least..=n as u64 * u64::from(ceiling));
        let got = share(&weights, base, &floors, ceiling, total).unwrap();
        assert_eq!(got.unspent, 0, "case {case}");
        assert_eq!(got.counts.iter().map(|&c| u64::from(c)).sum::<u64>(), total, "case {case}");
        assert!(got.counts.iter().zip(&floors).all(|(&c, &f)| (f..=ceiling).contains(&c)), "case {case}");
        assert_eq!(got.replaced, weights.iter().filter(|w| is_none(**w)).count(), "case {case}");
    }
}

/// With equal floors, a pixel of larger weight never gets fewer samples.
#[test]
fn larger_weights_get_no_fewer() {
    let mut rng = rng(7);
    for _ in 0..cases(500) {
        let n = rng.random_range(2..80);
        let mut weights: Vec<f64> = (0..n).map(|_| 10f64.powf(rng.random_range(-38.0..38.0))).collect();
        weights.sort_by(f64::total_cmp);
        let got = counts(&weights, 3, 50, rng.random_range(0..50 * n as u64));
        assert!(got.windows(2).all(|c| c[0] <= c[1] + 1), "largest remainder allows one: {got:?}");
    }
}

#[test]
fn permuting_weights_permutes_counts_a07() {
    let mut rng = rng(0x9e37);
    for case in 0..cases(500) {
        let n = rng.random_range(2..300);
        let weights: Vec<f64> = (0..n).map(|_| weight(&mut rng)).collect();
        // Below the base, weights do not matter.
        let total = rng.random_range(3 * n as u64..40 * n as u64);
        let sorted = |order: &[usize]| {
            let permuted: Vec<f64> = order.iter().map(|&i| weights[i]).collect();
            let counts = counts(&permuted, 3, 40, total);
            // Among equal weights a hash decides: compare weights with their counts, sorted.
            let mut pairs: Vec<(u64, u32)> = permuted.iter().map(|w| w.to_bits()).zip(counts).collect();
            pairs.sort_unstable();
            pairs
        };
        let mut order: Vec<usize> = (0..n).collect();
        let reference = sorted(&order);
        order.shuffle(&mut rng);
        // Weights that count as the largest, or as zero, may swap among equals.
        let largest = weights.iter().copied().filter(|w| w.is_finite()).fold(0.0, f64::max);
        let distinct = |pairs: Vec<(u64, u32)>| -> Vec<(u64, u32)> {
            let between = largest * 1e-59..largest;
            pairs.into_iter().filter(|(w, _)| between.contains(&f64::from_bits(*w))).collect()
        };
        let reference = distinct(reference);
        assert_eq!(distinct(sorted(&order)), reference, "case {case}");
    }
}

/// One weight, or one floor, that takes most of the budget leaves the factor of all others far from its first guess.
#[test]
fn one_weight_of_another_size_leaves_the_others_their_shares() {
    for large in [1e3, 1e20, 1e50] {
        assert_eq!(counts(&[large, 1.0, 2.0, 3.0], 0, 1000, 1060), [1000, 10, 20, 30], "{large}");
        assert_eq!(share(&[large, 1.0, 2.0, 3.0], 0, &[900, 0, 0, 0], 900, 960).unwrap().counts, [900, 10, 20, 30]);
        assert_eq!(counts(&[1.0 / large, 1.0, 2.0, 3.0], 0, 1000, 60), [0, 10, 20, 30], "{large}");
    }
}

/// Rounding adds at most one sample to a pixel's share.
#[test]
fn counts_stay_within_one_of_their_share() {
    let mut rng = rng(11);
    let weights: Vec<f64> = (0..10_000).map(|_| rng.random_range(0.1..3.0)).collect();
    let got = counts(&weights, 6, 1000, 80_000);
    let factor = 20_000.0 / weights.iter().sum::<f64>();
    let off = weights.iter().zip(&got).map(|(w, &n)| (6.0 + factor * w - f64::from(n)).abs()).fold(0.0, f64::max);
    assert!(off < 1.001, "{off}");
}
