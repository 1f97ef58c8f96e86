//! Discrepancies of points in the unit square.

/// The L2 star discrepancy of points in the unit square, by the formula of [Warnock 1972].
///
/// It is the root mean square, over all boxes `[0, x) x [0, y)`, of the share of points in the box less its area. Takes
/// `O(n^2)` steps. Returns 1/3, the value without points, for an empty slice.
///
/// Independent points have an expected square of `5 / (36 n)`.
///
/// ```
/// use dapple_metrics::l2_star_discrepancy;
///
/// // One point in the middle: 1/9 - 9/32 + 1/4.
/// let found = l2_star_discrepancy(&[[0.5, 0.5]]);
/// assert!((found * found - 23.0 / 288.0).abs() < 1e-15);
/// ```
pub fn l2_star_discrepancy(points: &[[f64; 2]]) -> f64 {
    let n = points.len().max(1) as f64;
    let single: f64 = points.iter().map(|[x, y]| (1.0 - x * x) * (1.0 - y * y)).sum();
    let mut pairs = 0.0;
    for (i, [x, y]) in points.iter().enumerate() {
        let with = |[u, v]: &[f64; 2]| (1.0 - x.max(*u)) * (1.0 - y.max(*v));
        pairs += 2.0 * points[..i].iter().map(with).sum::<f64>() + (1.0 - x) * (1.0 - y);
    }
    (1.0 / 9.0 - single / (2.0 * n) + pairs / (n * n)).max(0.0).sqrt()
}

/// The star discrepancy of points in the unit square: the largest difference, over all boxes `[0, x) x [0, y)`, between
/// the share of points in the box and its area.
///
/// Exact, by the formula of [Niederreiter 1972] for two dimensions, in `O(n^2)` steps. Returns 1 for an empty slice.
///
/// ```
/// use dapple_metrics::star_discrepancy;
///
/// // The box that just holds the point has too much, the square's lower half has too little.
/// assert_eq!(star_discrepancy(&[[0.5, 0.5]]), 0.75);
/// assert_eq!(star_discrepancy(&[[1.0, 0.5]]), 1.0);
/// ```
pub fn star_discrepancy(points: &[[f64; 2]]) -> f64 {
    let n = points.len().max(1) as f64;
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    // The second coordinates of the points so far, between 0 and 1.
    let mut heights = vec![0.0, 1.0];
    let mut worst = 0.0_f64;
    for l in 0..=sorted.len() {
        let here = if l == 0 { 0.0 } else { sorted[l - 1][0] };
        let next = sorted.get(l).map_or(1.0, |point| point[0]);
        if let Some(point) = l.checked_sub(1).map(|last| sorted[last]) {
            let place = heights.partition_point(|y| *y <= point[1]).clamp(1, heights.len() - 1);
            heights.insert(place, point[1]);
        }
        for (k, ends) in heights.windows(2).enumerate() {
            let share = k as f64 / n;
            worst = worst.max((share - here * ends[0]).abs()).max((share - next * ends[1]).abs());
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
