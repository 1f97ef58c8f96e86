//! How fast an error falls.

use super::interval::{Interval, student_interval};
use super::{StatisticsError, check_confidence, check_count, check_lengths, logarithms, mean, scatter};

/// A straight line on logarithmic axes: `y = scale * x^slope`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogLogFit {
    /// The exponent. Of MSE over samples it is -1 for independent samples.
    pub slope: Interval,
    /// y at x = 1.
    pub scale: f64,
    /// Standard deviation of ln y about the line.
    pub deviation: f64,
}

impl LogLogFit {
    /// The line's y at x, which is above 0.
    pub fn predict(&self, x: f64) -> f64 {
        self.scale * libm::pow(x, self.slope.value)
    }

    /// Where the line has y, which is above 0: the time to reach an error, say. Infinite or 0 where the line is
    /// level and passes elsewhere.
    pub fn solve(&self, y: f64) -> f64 {
        libm::exp(libm::log(y / self.scale) / self.slope.value)
    }
}

/// Fits a line to points on logarithmic axes by least squares; its slope's interval is Student's, with n - 2 degrees
/// of freedom.
///
/// The interval takes the points as independent. Errors of one seed at growing budgets are not: fit each seed, and
/// take [`mean_interval`](super::mean_interval) of the slopes.
///
/// # Errors
/// [`StatisticsError::TooFew`] below three points, [`StatisticsError::SameAbscissa`], [`StatisticsError::Lengths`],
/// [`StatisticsError::NotPositive`], [`StatisticsError::Confidence`].
pub fn log_log_fit(x: &[f64], y: &[f64], confidence: f64) -> Result<LogLogFit, StatisticsError> {
    check_confidence(confidence)?;
    check_lengths(x, y)?;
    check_count(x.len(), 3)?;
    let [log_x, log_y] = [logarithms(x)?, logarithms(y)?];
    // Neighbouring numbers can have equal logarithms.
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
