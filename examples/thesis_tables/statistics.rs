//! Means with intervals, and curves.

/// Student's t for 95 % two-sided intervals, by degrees of freedom 1 to 15.
const STUDENT: [f64; 15] =
    [12.71, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131];

/// The mean and half-width of its 95 % interval; no half-width from one value.
pub(crate) fn mean(values: &[f64]) -> (f64, Option<f64>) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    if values.len() < 2 {
        return (mean, None);
    }
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
    (mean, Some(STUDENT[(values.len() - 2).min(STUDENT.len() - 1)] * (variance / n).sqrt()))
}

/// A geometric mean of ratios and its 95 % interval, from their logarithms.
pub(crate) struct Ratio {
    pub(crate) mean: f64,
    pub(crate) bounds: Option<[f64; 2]>,
}

pub(crate) fn ratio(logs: &[f64]) -> Ratio {
    let (mean, half) = mean(logs);
    Ratio { mean: mean.exp(), bounds: half.map(|h| [(mean - h).exp(), (mean + h).exp()]) }
}

pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    (values[(n - 1) / 2] + values[n / 2]) / 2.0
}

/// The curve through `points` (x ascending), straight between them on logarithmic axes. True if `x` lies beyond their
/// ends, where the last piece is continued.
pub(crate) fn on_curve(points: &[[f64; 2]], x: f64) -> (f64, bool) {
    let piece = points.windows(2).find(|p| x <= p[1][0]).or(points.windows(2).last());
    let Some(&[[x0, y0], [x1, y1]]) = piece else { return (f64::NAN, true) };
    let t = (x / x0).ln() / (x1 / x0).ln();
    (y0 * (y1 / y0).powf(t), x < points[0][0] || x > points[points.len() - 1][0])
}

/// Least squares of `y = floor + slope x`.
fn line(points: impl Iterator<Item = [f64; 2]> + Clone) -> [f64; 2] {
    let n = points.clone().count() as f64;
    let sum = |of: fn([f64; 2]) -> f64| points.clone().map(of).sum::<f64>();
    let (x, y, xx, xy) = (sum(|p| p[0]), sum(|p| p[1]), sum(|p| p[0] * p[0]), sum(|p| p[0] * p[1]));
    let slope = (n * xy - x * y) / (n * xx - x * x);
    [(y - slope * x) / n, slope]
}

/// `a` of the least-squares fit MSE = a + b / n: the error for infinitely many samples.
pub(crate) fn floor(curve: &[(u64, f64)]) -> f64 {
    line(curve.iter().map(|&(n, e)| [1.0 / n as f64, e]))[0]
}

/// The exponent of the least-squares fit MSE = c n^exponent.
pub(crate) fn exponent(curve: &[(u64, f64)]) -> f64 {
    line(curve.iter().map(|&(n, e)| [(n as f64).ln(), e.ln()]))[1]
}
