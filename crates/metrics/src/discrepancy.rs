//! Discrepancies of points in the unit square.

/// The L2 star discrepancy of points in the unit square, by the formula of [Warnock 1972].
///
/// It is the root mean square, over all boxes `[0, x) x [0, y)`, of the fraction of points in the box minus the box's area.
/// Takes `O(n^2)` steps. Returns 1/3, the value without points, for an empty slice.
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

/// The star discrepancy of points in the unit square: the largest difference, over all boxes `[0, x) x [0, y)`, between the
/// fraction of points in the box and the box's area.
///
/// Exact, by the formula of [Niederreiter 1972] for two dimensions, in `O(n^2)` steps. Returns 1 for an empty slice.
///
/// ```
/// use dapple_metrics::star_discrepancy;
///
/// // The smallest box around the point: 1 - 0.25. The square without its right side: no point, area 1.
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
