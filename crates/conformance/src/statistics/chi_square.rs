//! The chi-square test of sample counts against a density. For independent samples only: low-discrepancy points are too
//! even.

use super::levels::gamma_q;

/// The chi-square test's p-value of observed counts per cell against expected ones.
///
/// Cells that expect fewer than 5 samples are pooled in ascending order. A sample in a cell that expects less than 1e-9
/// is impossible, and the p-value is 0.
pub fn chi_square(observed: &[u64], expected: &[f64]) -> f64 {
    assert_eq!(observed.len(), expected.len());
    let mut order: Vec<usize> = (0..expected.len()).collect();
    order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));
    let (mut statistic, mut cells) = (0.0, 0usize);
    let (mut pool_seen, mut pool_due) = (0.0, 0.0);
    for i in order {
        let (seen, due) = (observed[i] as f64, expected[i]);
        if due < 1e-9 {
            if seen > 0.0 {
                return 0.0;
            }
        } else if due < 5.0 || (pool_due > 0.0 && pool_due < 5.0) {
            pool_seen += seen;
            pool_due += due;
        } else {
            statistic += (seen - due).powi(2) / due;
            cells += 1;
        }
    }
    if pool_due > 0.0 {
        statistic += (pool_seen - pool_due).powi(2) / pool_due;
        cells += 1;
    }
    if cells < 2 { 1.0 } else { gamma_q(0.5 * (cells - 1) as f64, 0.5 * statistic) }
}

/// The integral of `f` over the rectangle `x` by `y`, to about the absolute error `tolerance`. Uses a 3x3 Simpson rule,
/// and halves both sides adaptively at most `depth` times.
pub fn integrate(f: &dyn Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], tolerance: f64, depth: u32) -> f64 {
    let (xm, ym) = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]));
    let whole = simpson(f, x, y);
    let quarters =
        [([x[0], xm], [y[0], ym]), ([xm, x[1]], [y[0], ym]), ([x[0], xm], [ym, y[1]]), ([xm, x[1]], [ym, y[1]])];
    let parts: f64 = quarters.iter().map(|&(x, y)| simpson(f, x, y)).sum();
    if depth == 0 || (parts - whole).abs() <= 15.0 * tolerance {
        return parts + (parts - whole) / 15.0;
    }
    quarters.iter().map(|&(x, y)| integrate(f, x, y, 0.25 * tolerance, depth - 1)).sum()
}

fn simpson(f: &dyn Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2]) -> f64 {
    const WEIGHTS: [f64; 3] = [1.0, 4.0, 1.0];
    let mut sum = 0.0;
    for (i, a) in WEIGHTS.iter().enumerate() {
        for (j, b) in WEIGHTS.iter().enumerate() {
            sum += a * b * f(x[0] + 0.5 * i as f64 * (x[1] - x[0]), y[0] + 0.5 * j as f64 * (y[1] - y[0]));
        }
    }
    sum * (x[1] - x[0]) * (y[1] - y[0]) / 36.0
}
