//! Noise: that of a reference and its subtraction, the difference of noisy images, and power spectra.

use crate::support::{Random, pixels};
use approx::assert_relative_eq;
use dapple_metrics::{
    Difference, MeasuredValue, MetricsError, NoisyReference, Pixels, SpectrumRing, compare, compare_corrected,
    difference, image_spectrum, point_spectrum,
};
use std::f64::consts::{PI, TAU};

const SIZE: [u32; 2] = [32, 32];

/// A noiseless image with a wide range.
fn truth() -> Vec<[f32; 3]> {
    (0..1024).map(|i| [0, 1, 2].map(|c| 0.2 * 1.005_f32.powi((i * 7 + c * 300) % 1024))).collect()
}

/// The image with noise of this relative standard deviation.
fn noisy(truth: &[[f32; 3]], random: &mut Random, level: f32) -> Vec<[f32; 3]> {
    truth.iter().map(|t| t.map(|v| v * (1.0 + level * (random.next() - 0.5) as f32 * 12_f32.sqrt()))).collect()
}

#[test]
fn corrected_errors_have_known_answers() {
    let [x, a, b] = [[0.5; 3], [1.0; 3], [2.0; 3]].map(|v| vec![v; 1024]);
    let halves = NoisyReference::Halves([pixels(SIZE, &a), pixels(SIZE, &b)]);
    let found = compare_corrected(pixels(SIZE, &x), halves).unwrap();
    // (x - a)(x - b) is the same, written otherwise.
    assert_eq!([found.mse.measured, found.mse.reference, found.mse.error], [1.0, 0.25, 0.75]);
    assert_relative_eq!(found.rel_mse.error, 0.75 / 2.26, max_relative = 1e-14);
    assert!(found.mse.reference_limited() && found.rel_mse.reference_limited());
    let [mean, variance] = [[1.5; 3], [0.25; 3]].map(|v| vec![v; 1024]);
    let known = NoisyReference::Variance { mean: pixels(SIZE, &mean), variance: pixels(SIZE, &variance) };
    assert_eq!(compare_corrected(pixels(SIZE, &x), known).unwrap(), found);
}

#[test]
fn an_exact_reference_changes_nothing() {
    let truth = truth();
    let mut image = noisy(&truth, &mut Random(1), 0.1);
    image[7] = [f32::NAN, f32::INFINITY, 1.0];
    let found =
        compare_corrected(pixels(SIZE, &image), NoisyReference::Halves([pixels(SIZE, &truth), pixels(SIZE, &truth)]))
            .unwrap();
    let plain = compare(pixels(SIZE, &image), pixels(SIZE, &truth)).unwrap();
    assert_eq!((found.mse.error, found.mse.reference), (plain.mse, 0.0));
    assert_relative_eq!(found.rel_mse.error, plain.rel_mse, max_relative = 1e-14);
    assert!(!found.mse.reference_limited());
    let same =
        compare_corrected(pixels(SIZE, &truth), NoisyReference::Halves([pixels(SIZE, &truth), pixels(SIZE, &truth)]))
            .unwrap();
    assert_eq!((same.mse.error, same.mse.reference_limited()), (0.0, false));
}

#[test]
fn errors_within_100_times_the_references_variance_are_marked_t02() {
    let [x, r] = [[1.5; 3], [1.0; 3]].map(|v| vec![v; 1024]);
    let marked = |variance: f32| {
        let variance = vec![[variance; 3]; 1024];
        let known = NoisyReference::Variance { mean: pixels(SIZE, &r), variance: pixels(SIZE, &variance) };
        let found = compare_corrected(pixels(SIZE, &x), known).unwrap();
        [found.mse.reference_limited(), found.rel_mse.reference_limited()]
    };
    // 0.25 - v < 100 v from v = 0.25 / 101 on.
    assert_eq!(marked(0.0), [false; 2]);
    assert_eq!(marked(0.99 * 0.25 / 101.0), [false; 2]);
    assert_eq!(marked(1.01 * 0.25 / 101.0), [true; 2]);
    assert_eq!(marked(1.0), [true; 2], "the correction is larger than the measured error");
}

/// MSE and relMSE of 200 noisy images against a noisy reference: measured, due to the reference, and against the noiseless
/// reference. The reference's variance is `known`, or estimated from two halves.
fn of_seeds(known: bool) -> Vec<[[f64; 3]; 2]> {
    let truth = truth();
    let variance: Vec<_> = truth.iter().map(|t| t.map(|v| 0.01 * v * v)).collect();
    let of_seed = |seed: u64| {
        let mut random = Random(seed << 32);
        let [x, a, b] = [0.1; 3].map(|level| noisy(&truth, &mut random, level));
        let exact = compare(pixels(SIZE, &x), pixels(SIZE, &truth)).unwrap();
        let reference = match known {
            true => NoisyReference::Variance { mean: pixels(SIZE, &a), variance: pixels(SIZE, &variance) },
            false => NoisyReference::Halves([pixels(SIZE, &a), pixels(SIZE, &b)]),
        };
        let found = compare_corrected(pixels(SIZE, &x), reference).unwrap();
        assert_eq!(found.mse.error, found.mse.measured - found.mse.reference);
        [(found.mse, exact.mse), (found.rel_mse, exact.rel_mse)].map(|(f, exact)| [f.measured, f.reference, exact])
    };
    (0..200).map(of_seed).collect()
}

#[test]
fn the_corrected_error_is_that_against_a_noiseless_reference_t02() {
    // Student's t with 199 degrees of freedom exceeds 5.05 either way in 1e-6 of all runs.
    const BOUND: f64 = 5.05;
    for known in [false, true] {
        let seeds = of_seeds(known);
        let t = |metric: usize, share: f64| {
            let of = |[measured, reference, exact]: [f64; 3]| measured - share * reference - exact;
            let differences: Vec<f64> = seeds.iter().map(|seed| of(seed[metric])).collect();
            let n = differences.len() as f64;
            let mean = differences.iter().sum::<f64>() / n;
            let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
            mean / (variance / n).sqrt()
        };
        assert!(t(0, 1.0).abs() < BOUND, "{known}: {}", t(0, 1.0));
        // Negative controls: no correction, and one of half or twice the size.
        for share in [0.0, 0.5, 2.0] {
            assert!(t(0, share).abs() > BOUND && t(1, share).abs() > BOUND, "the control passed: {share} {known}");
        }
        if known {
            continue;
        }
        // The corrected relMSE keeps a bias of second order: v = 0.01 / 2 and e = 0.01 make 3 v (1 + 2 v / e) = 0.03. Five
        // standard errors of 200 x 3072 terms are 0.01.
        let sum = |k: usize| seeds.iter().map(|seed| seed[1][k]).sum::<f64>();
        let [bias, uncorrected] = [sum(0) - sum(1), sum(0)].map(|of| of / sum(2) - 1.0);
        assert!(bias > -0.01 && bias < 0.03 + 0.01, "{bias}");
        assert!(uncorrected > 0.4, "the control: {uncorrected}");
    }
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
    let x = pixels(SIZE, &good);
    let nan = bad(f32::NAN);
    for pair in [[pixels(SIZE, &nan), x], [x, pixels(SIZE, &nan)]] {
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
        let known = NoisyReference::Variance { mean: x, variance: pixels(SIZE, &variance) };
        let error = compare_corrected(x, known).unwrap_err();
        assert!(matches!(error, MetricsError::Variance { pixel: [1, 1], .. }), "{error}");
        assert!(error.to_string().contains("column 1, row 1"));
    }
}

/// `n` renders of an image whose true value is `value` in every pixel, with noise of variance `0.2^2 / 12`.
fn renders(value: f64, n: u64, seed: u64) -> Vec<Vec<[f32; 3]>> {
    (0..n).map(|render| Random((seed * 100 + render) << 32).image(256, |u| value + 0.2 * (u - 0.5))).collect()
}

fn of(a: &[Vec<[f32; 3]>], b: &[Vec<[f32; 3]>]) -> Difference {
    let [a, b]: [Vec<Pixels<'_>>; 2] = [a, b].map(|r| r.iter().map(|v| pixels([16, 16], v)).collect());
    difference(&a, &b).unwrap()
}

#[test]
fn noise_cancels() {
    let truth = 0.1 * 0.1 / (0.5 * 0.5 + 0.01);
    let (mut inside, mut mean, runs) = (0, 0.0, 40);
    for seed in 0..runs {
        let found = of(&renders(0.5, 4, 2 * seed), &renders(0.4, 4, 2 * seed + 1)).rel_mse;
        mean += found.value / runs as f64;
        // Student's t for 95 % and 3 degrees of freedom.
        inside += u32::from((found.value - truth).abs() < 3.182 * found.standard_error);
    }
    // The denominator's noise has variance 1/12 0.2^2 / 2, which makes it 1.8 % too much.
    assert!((mean / truth - 1.018).abs() < 0.01, "{mean} {truth}");
    // 95 % of 40, and by chance never below 32 (p < 1e-3).
    assert!(inside >= 32, "{inside}");
    // The control: the plain relMSE contains the noise of both.
    let (a, b) = (&renders(0.5, 1, 0)[0], &renders(0.4, 1, 1)[0]);
    let plain = compare(pixels([16, 16], b), pixels([16, 16], a)).unwrap();
    assert!(plain.rel_mse > 1.3 * truth, "{}", plain.rel_mse);
}

#[test]
fn equal_images_have_no_difference() {
    let (mut signs, mut inside) = (0, 0);
    for seed in 0..40 {
        let found = of(&renders(0.5, 4, 2 * seed), &renders(0.5, 4, 2 * seed + 1));
        signs += i32::from(found.rel_mse.value > 0.0);
        inside += u32::from(found.mean_lost.value.abs() < 3.182 * found.mean_lost.standard_error);
    }
    assert!((8..=32).contains(&signs) && inside >= 32, "{signs} {inside}");
    let same = renders(0.5, 4, 0);
    let Difference { rel_mse, mean_lost, .. } = of(&same, &same);
    assert_eq!([rel_mse, mean_lost], [MeasuredValue { value: 0.0, standard_error: 0.0 }; 2]);
}

#[test]
fn mean_lost_is_a_share_of_the_mean() {
    let a = vec![vec![[2.0, 1.0, 1.0]; 256]; 4];
    let b = vec![vec![[2.0, 0.0, 1.0]; 256]; 4];
    let found = of(&a, &b);
    assert!((found.mean_lost.value - 0.25).abs() < 1e-12 && found.mean_lost.standard_error == 0.0);
    assert!((found.rel_mse.value - 1.0 / 1.01 / 3.0).abs() < 1e-12, "{found:?}");
    // A brighter image lost less than 0; a black one has nothing to lose.
    assert!((of(&b, &a).mean_lost.value + 1.0 / 3.0).abs() < 1e-12);
    let black = vec![vec![[0.0; 3]; 256]; 4];
    assert_eq!(of(&black, &black).mean_lost.value, 0.0);
    let broken = vec![vec![[f32::NAN, 1.0, f32::INFINITY]; 256]; 4];
    assert!((of(&a, &broken).mean_lost.value - 0.75).abs() < 1e-12);
}

#[test]
fn too_few_renders_and_different_sizes_are_refused() {
    let values = vec![[0.0; 3]; 4];
    let square = pixels([2, 2], &values);
    let line = pixels([4, 1], &values);
    let few = |a: usize, b: usize| difference(&vec![square; a], &vec![square; b]).err();
    assert_eq!(few(3, 3), Some(MetricsError::FewRenders([3, 3])));
    assert_eq!(few(4, 3), Some(MetricsError::FewRenders([4, 3])));
    assert_eq!(few(4, 4), None);
    let unlike = difference(&[square; 4], &[square, square, line, square]).err();
    assert_eq!(unlike, Some(MetricsError::Sizes { image: [4, 1], reference: [2, 2] }));
}

fn white(n: u64, seed: u64) -> Vec<f64> {
    let mut random = Random(seed << 32);
    (0..n).map(|_| random.next()).collect()
}

/// The largest deviation of a ring from 1, in standard errors. Powers are exponentially distributed, so a ring's mean
/// has a relative standard error of `1 / sqrt(count)`.
fn deviation(rings: &[SpectrumRing]) -> f64 {
    rings.iter().map(|ring| (ring.power - 1.0).abs() * (ring.count as f64).sqrt()).fold(0.0, f64::max)
}

/// About 30 rings. Rings of few frequencies have long tails, hence 6; a gradient, the negative control, is far beyond.
#[test]
fn white_noise_is_flat_and_a_gradient_is_not() {
    for (size, seed) in [([64, 64], 1), ([48, 80], 2), ([33, 57], 3)] {
        let values = white(u64::from(size[0] * size[1]), seed);
        let rings = image_spectrum(size, &values).unwrap();
        assert!(rings.len() >= 28 && deviation(&rings) < 6.0, "{size:?}: {:.1}", deviation(&rings));
        let gradient: Vec<f64> =
            values.iter().enumerate().map(|(p, v)| v + (p % size[0] as usize) as f64 * 0.05).collect();
        let rings = image_spectrum(size, &gradient).unwrap();
        assert!(deviation(&rings) > 30.0, "the control is flat");
    }
}

/// Each pixel less the mean of its four neighbours: a known filter, `(1 - (cos 2 pi fx + cos 2 pi fy) / 2)^2`, which
/// empties low frequencies. Over `1 + 4/16`, the variance of the sum.
#[test]
fn a_high_pass_filter_empties_low_frequencies() {
    let side = 96_usize;
    let values = white((side * side) as u64, 5);
    let at = |x: usize, y: usize| values[y % side * side + x % side];
    let sharp = |x: usize, y: usize| {
        at(x, y) - 0.25 * (at(x + 1, y) + at(x + side - 1, y) + at(x, y + 1) + at(x, y + side - 1))
    };
    let filtered: Vec<f64> = (0..side * side).map(|p| sharp(p % side, p / side)).collect();
    let rings = image_spectrum([side as u32; 2], &filtered).unwrap();
    for ring in rings.iter().filter(|ring| ring.count > 50) {
        // The filter's mean over angles, by 64 directions.
        let response = |k: u32| {
            let angle = TAU * f64::from(k) / 64.0;
            let [x, y] = [angle.cos(), angle.sin()].map(|c| (TAU * ring.frequency * c).cos());
            (1.0 - 0.5 * (x + y)).powi(2)
        };
        let wanted = (0..64).map(response).sum::<f64>() / 64.0 / 1.25;
        let error = (ring.power / wanted - 1.0) * (ring.count as f64).sqrt();
        assert!(error.abs() < 6.0, "{}: {} {wanted}", ring.frequency, ring.power);
    }
    assert!(rings.iter().take(5).all(|ring| ring.power < 0.01));
}

/// The sum over all frequencies is the number of pixels, by Parseval; in a strip of 1 pixel all are in rings.
#[test]
fn the_power_of_a_strip_sums_to_its_pixels() {
    let rings = image_spectrum([1, 64], &white(64, 9)).unwrap();
    // Frequencies from 1/64 to 1/2; all but the last have a mirror image.
    let sum: f64 = rings.iter().map(|ring| ring.power * if ring.frequency < 0.5 { 2.0 } else { 1.0 }).sum();
    assert!(rings.len() == 32 && (sum - 64.0).abs() < 1e-9, "{} {sum}", rings.len());
}

/// Independent points are flat; jittered points of an m x m grid have `1 - sinc^2(fx/m) sinc^2(fy/m)` expected.
#[test]
fn spectra_of_random_and_of_jittered_points_are_the_known_ones() {
    let side = 24_usize;
    let mut jittered = vec![0.0; 20];
    let mut wanted = [0.0; 20];
    let random: Vec<[f64; 2]> = white(1152, 3).chunks_exact(2).map(|c| [c[0], c[1]]).collect();
    let rings = point_spectrum(&random, 20);
    // A spectrum stays when all points are moved.
    let moved: Vec<[f64; 2]> = random.iter().map(|[x, y]| [x + 0.3, y + 0.17]).collect();
    for (ring, moved) in rings.iter().zip(point_spectrum(&moved, 20)) {
        assert!((ring.power - moved.power).abs() < 1e-9 * ring.power, "{} {}", ring.power, moved.power);
    }
    assert!(deviation(&rings) < 6.0, "{:.1}", deviation(&rings));
    for seed in 0..8 {
        let values = white(1152, 20 + seed);
        let place = |p: usize, k: usize| ([p % side, p / side][k] as f64 + values[2 * p + k]) / side as f64;
        let points: Vec<[f64; 2]> = (0..side * side).map(|p| [place(p, 0), place(p, 1)]).collect();
        for (ring, sum) in point_spectrum(&points, 20).iter().zip(&mut jittered) {
            *sum += ring.power / 8.0;
        }
    }
    for (k, wanted) in wanted.iter_mut().enumerate() {
        let sinc = |c: f64| {
            let x = PI * c / side as f64;
            if x == 0.0 { 1.0 } else { x.sin() / x }
        };
        let direction = |d: u32| {
            let angle = TAU * f64::from(d) / 64.0;
            1.0 - (sinc((k + 1) as f64 * angle.cos()) * sinc((k + 1) as f64 * angle.sin())).powi(2)
        };
        *wanted = (0..64).map(direction).sum::<f64>() / 64.0;
    }
    for k in 2..20 {
        assert!((jittered[k] / wanted[k] - 1.0).abs() < 0.25, "{k}: {} {}", jittered[k], wanted[k]);
    }
    assert!(jittered[1] < 0.06 && wanted[19] > 0.5);
}
