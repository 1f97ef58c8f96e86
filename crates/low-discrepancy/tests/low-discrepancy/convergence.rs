//! Convergence rates, error estimates from two streams, and the quality of prefixes.

#![allow(clippy::print_stderr, reason = "the README's slopes are what the table prints")]

use crate::support::{Integrand, estimate, id, integrands, pair, rms};
use dapple_core::PointSet;
use dapple_core::point_set::streams;
use dapple_low_discrepancy::{BlueNoise, Halton, Lattice, LowDiscrepancy, Pmj02, Random, Sobol, Stratified, ZSobol};
use dapple_metrics::log_log_fit;

/// Returns the root mean square error over `scrambles` pixels, which are `apart` columns and rows apart.
fn rmse(points: &dyn PointSet, g: &Integrand, n: u32, scrambles: u32, apart: u32) -> f64 {
    rms((0..scrambles).map(|p| estimate(points, g.f, [p % 64 * apart, p / 64 * apart], 0, n.into()) - g.mean))
}

/// Returns the slope of the error over the sample count on logarithmic axes.
fn slope(counts: &[u32], error: impl Fn(u32) -> f64) -> f64 {
    let errors: Vec<f64> = counts.iter().map(|n| error(*n)).collect();
    log_log_fit(&counts.iter().map(|n| f64::from(*n)).collect::<Vec<_>>(), &errors, 0.95).unwrap().slope.value
}

/// Returns the exact variance of the mean of `x y` over an Owen-scrambled (0,m,2)-net of `n = 2^m` points.
///
/// The Haar components of `x` at level `k` have variance `2^-(2k+4)`; those of `x y` are their products. A net removes a
/// component at levels `(j, k)` of both axes if `j + k + 2 <= m`. It doubles the component if `j + k = m - 1` (two points in
/// the box, in opposite quarters) and leaves it otherwise. On one axis it removes levels below `m`. These are the gain
/// coefficients of [Owen 1997] for this case.
fn owen_variance_of_product(m: i32) -> f64 {
    let both = |levels: i32| f64::from(levels + 1) * 2.0_f64.powi(-2 * levels - 8);
    let finer: f64 = (m..m + 60).map(both).sum();
    let one_axis = 2.0 * 0.25 * 2.0_f64.powi(-2 * m - 4) * 4.0 / 3.0;
    (2.0 * both(m - 1) + finer + one_axis) / 2.0_f64.powi(m)
}

/// The hash is as good as full Owen scrambling: the RMSE on `x y` is within 4.5 standard errors of the theory (1.1 % with 4000
/// scrambles).
#[test]
fn the_error_of_a_product_equals_owens_formula() {
    for m in 2..=8 {
        let found = rmse(&Sobol::new(3), &integrands()[0], 1 << m, 4000, 1);
        let ratio = found / owen_variance_of_product(m).sqrt();
        assert!((ratio - 1.0).abs() < 0.05, "2^{m}: {ratio:.3}");
    }
}

/// Slopes of the RMSE. A slope of seven counts and 600 scrambles has a standard error of 0.015.
///
/// Published: independent numbers fall as `n^-0.5`. Sobol' points fall as `n^-1.5 sqrt(log n)` on `x y`, which from 8 to
/// 512 samples is a slope of -1.40 in closed form, and as `n^-0.75` on the edge of a disk. Jittering falls as `n^-1` and
/// `n^-0.75`.
///
/// The others have no published slope. Shuffled pairs of Halton's sequence, at their own counts, must beat jittering on `x y`
/// and be no worse on an edge. pbrt-v2's points must not be worse than jittering. A shift causes a step at the border. On `x
/// y`, shifted lattices therefore converge like jittering, and shifted nets like `sqrt(log n) / n`, which has a slope of -0.87.
/// `zsobol` preserves nets, so it has the slope of Sobol' points. On an edge all have the slope of jittering. Sets that couple
/// pixels have independent errors 128 columns or rows apart.
#[test]
fn errors_converge_at_their_rates() {
    type Make = fn(u32) -> Box<dyn PointSet>;
    type Row = (Make, &'static [u32], u32, [std::ops::Range<f64>; 2]);
    const POWERS: &[u32] = &[8, 16, 32, 64, 128, 256, 512];
    let exact = |m: i32| owen_variance_of_product(m).sqrt();
    let of_owen = slope(POWERS, |n| exact(n.ilog2() as i32));
    assert!((of_owen + 1.4).abs() < 0.01, "{of_owen}");
    assert!(((exact(306) / exact(300)).log2() / 6.0 + 1.5).abs() < 0.01, "the limit");
    let squares: &'static [u32] = &[16, 64, 256, 1024];
    let near = |slope: f64| slope - 0.07..slope + 0.07;
    let below = |slope: f64| f64::NEG_INFINITY..slope;
    let rows: [Row; 9] = [
        (|_| Box::new(Random::new(0)), POWERS, 1, [-0.5, -0.5].map(near)),
        (|_| Box::new(Sobol::new(0)), POWERS, 1, [of_owen, -0.75].map(near)),
        (|n| Box::new(Stratified::new(0, n.isqrt()).unwrap()), squares, 1, [-1.0, -0.75].map(near)),
        (|n| Box::new(LowDiscrepancy::new(0, n).unwrap()), squares, 1, [-0.93, -0.68].map(below)),
        (|_| Box::new(Halton::new(0)), &[6, 12, 18, 36, 72, 108, 216], 1, [-1.07, -0.68].map(below)),
        (|_| Box::new(Lattice::new(0)), POWERS, 128, [-0.93, -0.68].map(below)),
        (|_| Box::new(Pmj02::new(0)), POWERS, 128, [-0.80, -0.68].map(below)),
        (|_| Box::new(BlueNoise::new(0, Sobol::new(0))), POWERS, 128, [-0.80, -0.68].map(below)),
        (|n| Box::new(ZSobol::new(0, n).unwrap()), POWERS, 128, [-1.33, -0.68].map(below)),
    ];
    for (make, counts, apart, wanted) in rows {
        for (g, wanted) in integrands().iter().zip(wanted) {
            let found = slope(counts, |n| rmse(&*make(n), g, n, 600, apart));
            let what = format!("{} on {}: RMSE slope {found:.3}, expected {wanted:.3?}", make(8).describe(), g.name);
            eprintln!("{what}");
            assert!(wanted.contains(&found), "{what}");
        }
    }
}

/// Returns the ratio of the RMS of the estimated error to the RMS of the true error, for the mean of two halves.
fn honesty(halves: impl Fn(u32) -> [f64; 2], mean: f64) -> f64 {
    let pairs: Vec<[f64; 2]> = (0..4000).map(halves).collect();
    let estimated = rms(pairs.iter().map(|[a, b]| 0.5 * (a - b)));
    let truth = rms(pairs.iter().map(|[a, b]| 0.5 * (a + b) - mean));
    estimated / truth
}

/// Two independently scrambled streams estimate their error correctly. The even and odd samples of one stream estimate
/// it far too high. With 4000 pixels the standard error is 1.6 %; the bound is 4.5 of them.
#[test]
fn two_streams_estimate_their_error_correctly() {
    let points = Sobol::new(4);
    let [product, disk, ..] = integrands();
    for (g, split_is_at_least) in [(&product, 10.0), (&disk, 2.0)] {
        for n in [8_u64, 32, 128] {
            let two = honesty(|p| streams::HALVES.map(|s| estimate(&points, g.f, [p % 64, p / 64], s, n)), g.mean);
            let one = honesty(
                |p| {
                    [0, 1].map(|half| {
                        let at = |i| pair(&points, id([p % 64, p / 64], 0, 2 * i + half), 1, 1);
                        (0..n).map(at).map(|[x, y]| (g.f)(x, y)).sum::<f64>() / n as f64
                    })
                },
                g.mean,
            );
            assert!((two - 1.0).abs() < 0.072, "{} with 2 x {n}: {two:.3}", g.name);
            assert!(n < 32 || one > split_is_at_least, "the control passes: {one:.2}");
        }
    }
}

/// Every n up to 300 is unbiased, over 512 scrambles. At powers of two, the variance is within Owen's bound, e times the
/// variance of independent numbers. Estimated variances of a few samples scatter by 10 %.
#[test]
fn every_prefix_is_unbiased_s06() {
    let (gs, scrambles) = (integrands(), 512);
    for points in [&Sobol::new(6) as &dyn PointSet, &Halton::new(6), &Random::new(6)] {
        // Sums over scrambles of each prefix's error and squared error.
        let mut sums = vec![[[0.0_f64; 2]; 8]; 301];
        for s in 0..scrambles {
            let mut totals = [0.0; 8];
            for (n, sums) in sums.iter_mut().enumerate().skip(1) {
                let [x, y] = pair(points, id([s % 64, s / 64], 0, n as u64 - 1), 1, 0);
                for ((total, g), [sum, square]) in totals.iter_mut().zip(&gs).zip(sums) {
                    *total += (g.f)(x, y) - g.mean;
                    let error = *total / n as f64;
                    *sum += error;
                    *square += error * error;
                }
            }
        }
        let count = f64::from(scrambles);
        for (n, sums) in sums.iter().enumerate().skip(1) {
            for ([sum, square], g) in sums.iter().zip(&gs) {
                // 2400 means of each set; 5.5 is exceeded by chance once in 10^4 runs.
                let bias = (sum / count).abs() / (square / count / count).sqrt();
                assert!(bias < 5.5, "{}: {} at n = {n} is biased: {bias:.1}", points.describe(), g.name);
                let ratio = square / count / (g.variance / n as f64);
                let bounded = !n.is_power_of_two() || ratio < std::f64::consts::E;
                assert!(bounded, "{}: {} at n = {n}: {ratio}", points.describe(), g.name);
            }
        }
    }
}
