//! Discrepancies in closed form.

use dapple_metrics::{l2_star_discrepancy, star_discrepancy};

fn grid(m: u32) -> Vec<[f64; 2]> {
    let centre = |k: u32| (f64::from(k) + 0.5) / f64::from(m);
    (0..m * m).map(|p| [centre(p % m), centre(p / m)]).collect()
}

/// For centres of `m x m` cells the sums factor: `sum (1 - x^2) = m (2/3 + 1/(12 m^2))` along an axis, and
/// `sum (1 - max(x, x')) = m^2/3 + 1/6`.
#[test]
fn l2_of_a_grid_has_its_closed_form() {
    for m in [1, 2, 5, 16] {
        let n = f64::from(m * m);
        let wanted = 1.0 / 9.0 - 0.5 * (2.0 / 3.0 + 1.0 / (12.0 * n)).powi(2) + ((n / 3.0 + 1.0 / 6.0) / n).powi(2);
        let found = l2_star_discrepancy(&grid(m)).powi(2);
        assert!((found - wanted).abs() < 1e-14, "{m}: {found} {wanted}");
    }
}

/// One point `(a, b)`: the largest of `a`, `b` and `1 - a b`. A grid's centres: the whole of the first column and row
/// is empty up to `1/(2m)`, and the box that just holds all has too much, `1 - (1 - 1/(2m))^2`.
#[test]
fn star_discrepancies_have_their_closed_forms() {
    for [a, b] in [[0.1, 0.2], [0.9, 0.3], [0.7, 0.95], [0.0, 0.0]] {
        let found = star_discrepancy(&[[a, b]]);
        assert!((found - a.max(b).max(1.0 - a * b)).abs() < 1e-15, "{a} {b}: {found}");
    }
    for m in [2, 5, 16] {
        let wanted = 1.0 - (1.0 - 0.5 / f64::from(m)).powi(2);
        assert!((star_discrepancy(&grid(m)) - wanted).abs() < 1e-14, "{m}: {}", star_discrepancy(&grid(m)));
    }
    assert_eq!(star_discrepancy(&[]), 1.0);
}
