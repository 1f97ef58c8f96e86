//! The variance of a noisy reference, and its subtraction.

use approx::assert_relative_eq;
use dapple_metrics::{Corrected, MetricsError, NoisyReference, Pixels, compare, compare_corrected};

/// Uniform numbers of mean 0 and variance 1, by SplitMix64 [after Steele 2014].
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (((z ^ z >> 31) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) as f32 * 12_f32.sqrt()
    }
}

const SIZE: [u32; 2] = [32, 32];

fn pixels(values: &[[f32; 3]]) -> Pixels<'_> {
    Pixels::new(SIZE, values).unwrap()
}

/// A noiseless image with a wide range.
fn truth() -> Vec<[f32; 3]> {
    (0..1024).map(|i| [0, 1, 2].map(|c| 0.2 * 1.005_f32.powi((i * 7 + c * 300) % 1024))).collect()
}

fn noisy(truth: &[[f32; 3]], random: &mut Random, level: f32) -> Vec<[f32; 3]> {
    truth.iter().map(|t| t.map(|v| v * (1.0 + level * random.next()))).collect()
}

#[test]
fn corrected_errors_have_known_answers() {
    let [x, a, b] = [[0.5; 3], [1.0; 3], [2.0; 3]].map(|v| vec![v; 1024]);
    let halves = NoisyReference::Halves([pixels(&a), pixels(&b)]);
    let found = compare_corrected(pixels(&x), halves).unwrap();
    // (x - a)(x - b) is the same, written otherwise.
    assert_eq!([found.mse.measured, found.mse.reference, found.mse.error], [1.0, 0.25, 0.75]);
    assert_relative_eq!(found.rel_mse.error, 0.75 / 2.26, max_relative = 1e-14);
    assert!(found.mse.reference_limited() && found.rel_mse.reference_limited());
    let [mean, variance] = [[1.5; 3], [0.25; 3]].map(|v| vec![v; 1024]);
    let known = NoisyReference::Variance { mean: pixels(&mean), variance: pixels(&variance) };
    assert_eq!(compare_corrected(pixels(&x), known).unwrap(), found);
}

#[test]
fn an_exact_reference_changes_nothing() {
    let truth = truth();
    let mut image = noisy(&truth, &mut Random(1), 0.1);
    image[7] = [f32::NAN, f32::INFINITY, 1.0];
    let found = compare_corrected(pixels(&image), NoisyReference::Halves([pixels(&truth), pixels(&truth)])).unwrap();
    let plain = compare(pixels(&image), pixels(&truth)).unwrap();
    assert_eq!((found.mse.error, found.mse.reference), (plain.mse, 0.0));
    assert_relative_eq!(found.rel_mse.error, plain.rel_mse, max_relative = 1e-14);
    assert!(!found.mse.reference_limited());
    let same = compare_corrected(pixels(&truth), NoisyReference::Halves([pixels(&truth), pixels(&truth)])).unwrap();
    assert_eq!((same.mse.error, same.mse.reference_limited()), (0.0, false));
}

#[test]
fn errors_within_100_times_the_references_variance_are_marked_t02() {
    let [x, r] = [[1.5; 3], [1.0; 3]].map(|v| vec![v; 1024]);
    let marked = |variance: f32| {
        let variance = vec![[variance; 3]; 1024];
        let known = NoisyReference::Variance { mean: pixels(&r), variance: pixels(&variance) };
        let found = compare_corrected(pixels(&x), known).unwrap();
        [found.mse.reference_limited(), found.rel_mse.reference_limited()]
    };
    // 0.25 - v < 100 v from v = 0.25 / 101 on.
    assert_eq!(marked(0.0), [false; 2]);
    assert_eq!(marked(0.99 * 0.25 / 101.0), [false; 2]);
    assert_eq!(marked(1.01 * 0.25 / 101.0), [true; 2]);
    assert_eq!(marked(1.0), [true; 2], "the correction is larger than the measured error");
}

/// Student's t over 200 seeds of the difference between a corrected error and the error against the noiseless image,
/// for MSE and relMSE.
fn t_of_seeds(figure: impl Fn(&Corrected) -> [f64; 2], known: bool) -> [f64; 2] {
    let truth = truth();
    let differences: Vec<[f64; 2]> = (0..200)
        .map(|seed| {
            let mut random = Random(seed << 32);
            let [x, a, b] = [0.1, 0.1, 0.1].map(|level| noisy(&truth, &mut random, level));
            let exact = compare(pixels(&x), pixels(&truth)).unwrap();
            let variance: Vec<_> = truth.iter().map(|t| t.map(|v| 0.01 * v * v)).collect();
            let reference = if known {
                NoisyReference::Variance { mean: pixels(&a), variance: pixels(&variance) }
            } else {
                NoisyReference::Halves([pixels(&a), pixels(&b)])
            };
            let found = figure(&compare_corrected(pixels(&x), reference).unwrap());
            [found[0] - exact.mse, found[1] - exact.rel_mse]
        })
        .collect();
    [0, 1].map(|i| {
        let n = differences.len() as f64;
        let mean = differences.iter().map(|d| d[i]).sum::<f64>() / n;
        let variance = differences.iter().map(|d| (d[i] - mean).powi(2)).sum::<f64>() / (n - 1.0);
        mean / (variance / n).sqrt()
    })
}

#[test]
fn the_corrected_error_is_that_against_a_noiseless_reference_t02() {
    // Student's t with 199 degrees of freedom exceeds 5.05 either way in 1e-6 of all runs. MSE only: the next test
    // is relMSE's, whose denominator keeps a bias of second order.
    const BOUND: f64 = 5.05;
    for known in [false, true] {
        let t = t_of_seeds(|c| [c.mse.error, c.rel_mse.error], known);
        assert!(t[0].abs() < BOUND, "{known}: {t:?}");
        // Negative controls: no correction, and one of half or twice the size.
        for share in [0.0, 0.5, 2.0] {
            let wrong = |e: &dapple_metrics::CorrectedError| e.measured - share * e.reference;
            let t = t_of_seeds(|c| [wrong(&c.mse), wrong(&c.rel_mse)], known);
            assert!(t.iter().all(|t| t.abs() > BOUND), "the control passed: {share} {known} {t:?}");
        }
    }
}

#[test]
fn the_bias_of_the_corrected_relmse_is_that_of_its_denominator() {
    let truth = truth();
    let mut sums = [0.0; 3];
    for seed in 0..200 {
        let mut random = Random(seed << 24);
        let [x, a, b] = [0.1, 0.1, 0.1].map(|level| noisy(&truth, &mut random, level));
        sums[0] += compare(pixels(&x), pixels(&truth)).unwrap().rel_mse;
        let found = compare_corrected(pixels(&x), NoisyReference::Halves([pixels(&a), pixels(&b)])).unwrap().rel_mse;
        sums[1] += found.error;
        sums[2] += found.measured;
    }
    // v = 0.01 / 2 and e = 0.01 make 3 v (1 + 2 v / e) = 0.03; five standard errors of 200 x 3072 terms are 0.01.
    let [bias, uncorrected] = [1, 2].map(|i| sums[i] / sums[0] - 1.0);
    assert!(bias > -0.01 && bias < 0.03 + 0.01, "{bias}");
    assert!(uncorrected > 0.4, "the control: {uncorrected}");
}

#[test]
fn references_that_differ_in_size_or_are_not_finite_are_refused() {
    let good = vec![[1.0; 3]; 1024];
    let small = Pixels::new([16, 16], &good[..256]).unwrap();
    let bad = |value: f32| {
        let mut image = good.clone();
        image[33][2] = value;
        image
    };
    let x = pixels(&good);
    let nan = bad(f32::NAN);
    for pair in [[pixels(&nan), x], [x, pixels(&nan)]] {
        let error = compare_corrected(x, NoisyReference::Halves(pair)).unwrap_err();
        assert!(matches!(error, MetricsError::NonFiniteReference { pixel: [1, 1], .. }), "{error}");
    }
    for pair in [[small, x], [x, small]] {
        assert!(matches!(compare_corrected(x, NoisyReference::Halves(pair)), Err(MetricsError::Sizes { .. })));
        let known = NoisyReference::Variance { mean: pair[0], variance: pair[1] };
        assert!(matches!(compare_corrected(x, known), Err(MetricsError::Sizes { .. })));
    }
    for value in [-1e-9, f32::NAN, f32::INFINITY] {
        let variance = bad(value);
        let known = NoisyReference::Variance { mean: x, variance: pixels(&variance) };
        let error = compare_corrected(x, known).unwrap_err();
        assert!(matches!(error, MetricsError::Variance { pixel: [1, 1], .. }), "{error}");
        assert!(error.to_string().contains("column 1, row 1"));
    }
}
