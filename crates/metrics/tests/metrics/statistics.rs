//! Intervals and slopes against scipy, closed forms and simulation.

#![allow(clippy::excessive_precision)]

use approx::assert_relative_eq;
use dapple_metrics::{
    BOOTSTRAP_MIN_COUNT, Interval, IntervalMethod, StatisticsError, efficiency, geometric_mean_interval, log_log_fit,
    mean_interval, ratio_interval, student_t_quantile,
};

const A: [f64; 8] = [3.1e-3, 2.7e-3, 4.4e-3, 3.9e-3, 2.2e-3, 3.3e-3, 2.9e-3, 5.1e-3];
const B: [f64; 8] = [4.0e-3, 2.9e-3, 5.9e-3, 4.1e-3, 3.5e-3, 3.6e-3, 3.0e-3, 6.6e-3];
const N: [f64; 8] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0];

/// Nearly normal numbers: sums of twelve uniform ones by SplitMix64 [after Steele 2014].
struct Normal(u64);

impl Normal {
    fn next(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn assert_interval(found: Interval, expected: [f64; 3]) {
    assert_relative_eq!([found.value, found.low, found.high][..], expected[..], max_relative = 1e-12);
    assert_eq!(found.method, IntervalMethod::Student);
}

/// Expected values are of scipy 1.17.1, printed by `oracle.py` in the folder above.
#[test]
fn student_intervals_match_scipy() {
    let mean = [3.450000000000000e-03, 2.650611101172849e-03, 4.249388898827151e-03];
    assert_interval(mean_interval(&A, 0.95).unwrap(), mean);
    let geometric = [-5.702309518467060_f64, -5.931128639682400, -5.473490397251720].map(f64::exp);
    assert_interval(geometric_mean_interval(&A, 0.95).unwrap(), geometric);
    let ratio = [-1.890946362839455e-01_f64, -3.168062436466466e-01, -6.138302892124434e-02].map(f64::exp);
    assert_interval(ratio_interval(&A, &B, 0.95).unwrap(), ratio);
}

#[test]
fn the_fit_matches_scipy() {
    let fit = log_log_fit(&N, &A, 0.95).unwrap();
    assert_interval(fit.slope, [4.133318556965924e-02, -1.143171129733980e-01, 1.969834841127164e-01]);
    assert_relative_eq!(fit.scale.ln(), -5.802584452111156, max_relative = 1e-12);
}

#[test]
fn the_bootstrap_matches_scipy() {
    let values: Vec<f64> = (1..=40).map(|k| f64::from(k * 37 % 41) / 41.0).map(|u| u.powi(3)).collect();
    let found = mean_interval(&values, 0.95).unwrap();
    // scipy with 2,000,000 resamples: 0.16853 and 0.33980, each +- 0.0001. An end here has a standard deviation of
    // 0.0435 (that of the mean) * 0.027; four of them are 0.0047.
    assert_eq!(found.method, IntervalMethod::Bootstrap);
    assert_relative_eq!(found.value, 0.2439024390243903, max_relative = 1e-14);
    let close = |ends: [f64; 2]| (found.low - ends[0]).abs().max((found.high - ends[1]).abs()) < 0.0047;
    assert!(close([0.16853, 0.33980]), "{found:?}");
    // Negative control: the plain percentile interval, which ignores the skewness.
    assert!(!close([0.16281, 0.33186]), "{found:?}");
    assert_eq!(mean_interval(&values, 0.95).unwrap(), found, "the seed is fixed");
}

#[test]
fn a_method_does_not_win_against_itself() {
    for count in [2, 8, BOOTSTRAP_MIN_COUNT, 100] {
        let errors: Vec<f64> = (0..count).map(|i| 1e-3 * (1.0 + (i as f64).sin() / 2.0)).collect();
        let found = ratio_interval(&errors, &errors, 0.95).unwrap();
        assert_eq!([found.value, found.low, found.high], [1.0; 3]);
        assert!(found.contains(1.0) && !found.contains(1.001));
    }
}

#[test]
fn swapping_the_methods_inverts_the_ratio() {
    let [ab, ba] = [ratio_interval(&A, &B, 0.9).unwrap(), ratio_interval(&B, &A, 0.9).unwrap()];
    let turned = [1.0 / ba.value, 1.0 / ba.high, 1.0 / ba.low];
    assert_relative_eq!([ab.value, ab.low, ab.high][..], turned[..], max_relative = 1e-12);
    // Pairing removes the seeds' common variation: unpaired, the interval would contain 1.
    assert!(!ab.contains(1.0));
    let [a, b] = [A, B].map(|errors| geometric_mean_interval(&errors, 0.9).unwrap());
    assert!(a.high > b.low);
}

/// The number of intervals of `count` values that contain `truth`; the values are 1 plus noise.
fn covered(count: usize, truth: f64, skewed: bool, trials: u64) -> u64 {
    let holds = |trial: &u64| {
        let mut random = Normal(trial * 7919 + count as u64);
        let mut value = || if skewed { -(1.0 - random.uniform()).ln() } else { 1.0 + random.next() };
        let values: Vec<f64> = (0..count).map(|_| value()).collect();
        mean_interval(&values, 0.95).unwrap().contains(truth)
    };
    (0..trials).filter(holds).count() as u64
}

#[test]
fn student_intervals_contain_the_truth_in_95_of_100_cases() {
    // Binomial of 4000 and 0.95: mean 3800, standard deviation 13.8; 4.9 of them (1e-6 both ways) are 67.
    for count in [2, 3, 8, 31] {
        let found = covered(count, 1.0, false, 4000);
        assert!(found.abs_diff(3800) < 67, "{count}: {found}");
    }
    // Negative controls: a truth beside it, and intervals with the normal quantile in place of t's.
    assert!(covered(31, 1.2, false, 4000) < 3733);
    let normal = student_t_quantile(0.975, f64::INFINITY) / student_t_quantile(0.975, 2.0);
    let narrow = (0..4000_u64).filter(|trial| {
        let mut random = Normal(*trial);
        let found = mean_interval(&[random.next(), random.next(), random.next()], 0.95).unwrap();
        found.value.abs() < (found.high - found.value) * normal
    });
    assert!(narrow.count() < 3733);
}

#[test]
fn bootstrap_intervals_contain_the_truth_in_95_of_100_cases() {
    // The bootstrap is exact for many values only. For 32 normal ones it contains the truth in 0.937: the share for a z
    // of 1.96 sqrt(31/32) under Student's t. For 100 exponential ones BCa is taken to be within 0.02 of 0.95, as its
    // error falls like 1/n. Beyond that, 4.9 standard deviations (1e-6 both ways) of a binomial of 400, 0.0109 each.
    let [normal, exponential] =
        [(32, false), (100, true)].map(|(n, skewed)| covered(n, 1.0, skewed, 400) as f64 / 400.0);
    assert!((normal - 0.937).abs() < 0.0534 + 0.005, "{normal}");
    assert!((exponential - 0.95).abs() < 0.0534 + 0.02, "{exponential}");
    // Negative control: a truth one and a half standard deviations off.
    let control = covered(32, 1.0 + 1.5 / 32_f64.sqrt(), false, 400) as f64 / 400.0;
    assert!(control < 0.937 - 0.0534 - 0.005, "{control}");
}

#[test]
fn a_power_law_is_found_exactly() {
    let errors = N.map(|n| 0.25 * n.powf(-1.5));
    let fit = log_log_fit(&N, &errors, 0.95).unwrap();
    assert_relative_eq!(fit.slope.value, -1.5, max_relative = 1e-14);
    assert_relative_eq!(fit.scale, 0.25, max_relative = 1e-14);
    assert!(fit.deviation < 1e-14 && fit.slope.high - fit.slope.low < 1e-13);
    assert_relative_eq!(fit.predict(9.0), 0.25 / 27.0, max_relative = 1e-13);
    assert_relative_eq!(fit.solve(0.25 / 27.0), 9.0, max_relative = 1e-13);
}

#[test]
fn slopes_of_noisy_points_lie_in_their_intervals() {
    // 95 % of 4000 fits, as above; the control looks for another slope.
    let found = [-1.0, -1.1].map(|truth| {
        let fits = (0..4000_u64).filter(|seed| {
            let mut random = Normal(seed << 20);
            let errors = N.map(|n| 0.1 / n * (0.1 * random.next()).exp());
            log_log_fit(&N, &errors, 0.95).unwrap().slope.contains(truth)
        });
        fits.count() as u64
    });
    assert!(found[0].abs_diff(3800) < 67 && found[1] < 3733, "{found:?}");
}

#[test]
fn twice_the_time_for_the_same_error_is_half_as_efficient() {
    assert_eq!(efficiency(0.25, 8.0), Ok(0.5));
    assert_eq!(efficiency(0.25, 16.0), Ok(0.25));
    assert!(matches!(efficiency(0.0, 1.0), Err(StatisticsError::NotPositive { index: 0, .. })));
    assert!(matches!(efficiency(1.0, f64::NAN), Err(StatisticsError::NotPositive { index: 1, .. })));
    assert!(efficiency(1e-200, 1e-200).is_err() && efficiency(1e200, 1e200).is_err());
}

#[test]
fn input_without_a_statistic_is_refused() {
    use StatisticsError as E;
    assert_eq!(mean_interval(&[1.0], 0.95), Err(E::TooFew { found: 1, needed: 2 }));
    assert!(mean_interval(&[], 0.95).unwrap_err().to_string().contains("at least 2"));
    assert!(matches!(mean_interval(&[1.0, f64::NAN], 0.95), Err(E::NotFinite { index: 1, .. })));
    for value in [0.0, 1.0, -0.5, 95.0, f64::NAN] {
        assert!(matches!(mean_interval(&A, value), Err(E::Confidence { .. })), "{value}");
        assert!(matches!(log_log_fit(&N, &A, value), Err(E::Confidence { .. })), "{value}");
    }
    assert_eq!(ratio_interval(&A, &B[1..], 0.95), Err(E::Lengths { lengths: [8, 7] }));
    for value in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        let bad = [1.0, 2.0, value];
        assert!(matches!(ratio_interval(&bad, &A[..3], 0.95), Err(E::NotPositive { index: 2, .. })));
        assert!(matches!(geometric_mean_interval(&bad, 0.95), Err(E::NotPositive { index: 2, .. })));
        assert!(matches!(log_log_fit(&A[..3], &bad, 0.95), Err(E::NotPositive { index: 2, .. })));
        assert!(matches!(log_log_fit(&[value; 3], &A[..3], 0.95), Err(E::NotPositive { index: 0, .. })));
    }
    assert_eq!(log_log_fit(&N[..2], &A[..2], 0.95), Err(E::TooFew { found: 2, needed: 3 }));
    assert_eq!(log_log_fit(&[4.0; 3], &A[..3], 0.95), Err(E::SameAbscissa { x: 4.0 }));
    assert_eq!(log_log_fit(&N, &A[1..], 0.95), Err(E::Lengths { lengths: [8, 7] }));
}
