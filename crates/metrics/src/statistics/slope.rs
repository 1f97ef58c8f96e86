//! The slope of an error over samples or time.

use super::interval::{Interval, student_interval};
use super::{StatisticsError, check_confidence, check_count, check_lengths, logarithms, mean, scatter};

/// A straight line on logarithmic axes, `y = scale * x^slope`, from [`log_log_fit`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct LogLogFit {
    /// The exponent, with its confidence interval. MSE as a function of the number of independent samples has a slope
    /// of -1.
    pub slope: Interval,
    /// The value of y at x = 1.
    pub scale: f64,
    /// The standard deviation of ln y about the line.
    pub deviation: f64,
}

impl LogLogFit {
    /// Returns the y of the line at `x`, which must be above 0.
    pub fn predict(&self, x: f64) -> f64 {
        self.scale * libm::pow(x, self.slope.value)
    }

    /// Returns the x at which the line reaches `y`, such as the time to reach an error. `y` must be above 0. The result
    /// is infinite or 0 if the line is level at another y.
    pub fn solve(&self, y: f64) -> f64 {
        libm::exp(libm::log(y / self.scale) / self.slope.value)
    }
}

/// Fits a line to points on logarithmic axes by least squares.
///
/// The slope's interval is Student's with n - 2 degrees of freedom and assumes independent points. Errors of one seed at
/// growing budgets are dependent: fit each seed, then take [`mean_interval`](super::mean_interval) of the slopes.
///
/// ```
/// let fit = dapple_metrics::log_log_fit(&[4.0, 8.0, 16.0], &[0.25, 0.125, 0.0625], 0.95)?;
/// assert!((fit.slope.value + 1.0).abs() < 1e-12 && (fit.solve(0.01) - 100.0).abs() < 1e-9);
/// # Ok::<(), dapple_metrics::StatisticsError>(())
/// ```
///
/// # Errors
/// [`StatisticsError::TooFew`] below three points, [`StatisticsError::SameAbscissa`], [`StatisticsError::Lengths`],
/// [`StatisticsError::NotPositive`], [`StatisticsError::Confidence`].
pub fn log_log_fit(x: &[f64], y: &[f64], confidence: f64) -> Result<LogLogFit, StatisticsError> {
    check_confidence(confidence)?;
    check_lengths(x, y)?;
    check_count(x.len(), 3)?;
    let [log_x, log_y] = [logarithms(x)?, logarithms(y)?];
    // Different numbers can have equal logarithms.
    if log_x.iter().all(|&other| other == log_x[0]) {
        return Err(StatisticsError::SameAbscissa { x: x[0] });
    }
    let width = scatter(&log_x, &log_x);
    let slope = scatter(&log_x, &log_y) / width;
    let intercept = mean(&log_y) - slope * mean(&log_x);
    let residuals: Vec<f64> = log_x.iter().zip(&log_y).map(|(x, y)| y - intercept - slope * x).collect();
    let degrees = x.len() as f64 - 2.0;
    let deviation = (scatter(&residuals, &residuals) / degrees).sqrt();
    let slope = student_interval(slope, deviation / width.sqrt(), degrees, confidence);
    Ok(LogLogFit { slope, scale: libm::exp(intercept), deviation })
}
