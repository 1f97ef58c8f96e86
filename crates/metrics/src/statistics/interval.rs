//! Confidence intervals over seeds.

use super::bootstrap::bootstrap;
use super::{
    StatisticsError, check_confidence, check_count, check_lengths, logarithms, mean, scatter, student_t_quantile,
};

/// The fewest values for which intervals are computed by the bootstrap. Fewer values show too little of their
/// distribution.
pub const BOOTSTRAP_MIN_COUNT: usize = 32;

/// The method by which an interval was computed.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IntervalMethod {
    /// The interval of Student's t, which assumes normally distributed values.
    Student,
    /// The bias-corrected and accelerated bootstrap [after Efron 1987].
    Bootstrap,
}

/// An estimate with its confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Interval {
    /// The estimated value: a mean, a geometric mean, a ratio or a slope.
    pub value: f64,
    /// The lower end of the confidence interval.
    pub low: f64,
    /// The upper end of the confidence interval.
    pub high: f64,
    /// The method by which `low` and `high` were computed.
    pub method: IntervalMethod,
}

impl Interval {
    /// Returns `true` if x lies in the interval, ends included. If a ratio's interval contains 1, neither method is
    /// better.
    pub fn contains(&self, x: f64) -> bool {
        (self.low..=self.high).contains(&x)
    }

    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self { value: f(self.value), low: f(self.low), high: f(self.high), method: self.method }
    }
}

/// The efficiency `1 / (error * seconds)` of a render, for a squared error such as MSE or relMSE. With independent
/// samples, the efficiency does not depend on the number of samples.
///
/// ```
/// assert_eq!(dapple_metrics::efficiency(0.25, 8.0), Ok(0.5));
/// ```
///
/// # Errors
/// [`StatisticsError::NotPositive`] if the error (index 0) or the time (index 1) is not above 0, or their product is out
/// of the range of an f64.
pub fn efficiency(error: f64, seconds: f64) -> Result<f64, StatisticsError> {
    logarithms(&[error, seconds])?;
    let found = 1.0 / (error * seconds);
    if found > 0.0 && found.is_finite() {
        Ok(found)
    } else {
        Err(StatisticsError::NotPositive { index: 0, value: error })
    }
}

/// The mean of independent values, one per seed, with an interval of the confidence level `confidence`, such as 0.95.
///
/// The interval is Student's t with n - 1 degrees of freedom, or the bootstrap from 32 values ([`BOOTSTRAP_MIN_COUNT`])
/// on.
///
/// ```
/// # use dapple_metrics::mean_interval;
/// let found = mean_interval(&[2.1, 1.9, 2.4, 2.0, 2.2, 1.8, 2.3, 2.1], 0.95)?;
/// assert!((found.value - 2.1).abs() < 1e-12 && found.contains(2.0) && !found.contains(1.9));
/// # Ok::<(), dapple_metrics::StatisticsError>(())
/// ```
///
/// # Errors
/// [`StatisticsError::TooFew`] below two values, [`StatisticsError::NotFinite`], [`StatisticsError::Confidence`].
pub fn mean_interval(values: &[f64], confidence: f64) -> Result<Interval, StatisticsError> {
    check_confidence(confidence)?;
    check_count(values.len(), 2)?;
    if let Some((index, &value)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
        return Err(StatisticsError::NotFinite { index, value });
    }
    if values.len() >= BOOTSTRAP_MIN_COUNT {
        return Ok(bootstrap(values, confidence));
    }
    let value = mean(values);
    let n = values.len() as f64;
    let deviation = (scatter(values, values) / (n - 1.0) / n).sqrt();
    Ok(student_interval(value, deviation, n - 1.0, confidence))
}

/// The confidence interval of a value whose estimated standard error is `deviation`, by Student's t.
pub(super) fn student_interval(value: f64, deviation: f64, degrees_of_freedom: f64, confidence: f64) -> Interval {
    let half = deviation * student_t_quantile(0.5 + 0.5 * confidence, degrees_of_freedom);
    Interval { value, low: value - half, high: value + half, method: IntervalMethod::Student }
}

/// The geometric mean of independent values above 0, with its interval: [`mean_interval`] of their logarithms.
///
/// The lower end is above 0, so the interval fits a logarithmic axis.
///
/// ```
/// let found = dapple_metrics::geometric_mean_interval(&[1.0, 4.0, 2.0], 0.95)?;
/// assert!((found.value - 2.0).abs() < 1e-12 && found.low > 0.0);
/// # Ok::<(), dapple_metrics::StatisticsError>(())
/// ```
///
/// # Errors
/// [`StatisticsError::NotPositive`], and the errors of [`mean_interval`].
pub fn geometric_mean_interval(values: &[f64], confidence: f64) -> Result<Interval, StatisticsError> {
    Ok(mean_interval(&logarithms(values)?, confidence)?.map(libm::exp))
}

/// The geometric mean of `a[i] / b[i]` with its interval.
///
/// `a[i]` and `b[i]` share a seed or a scene. Pairing removes the variation that they have in common. For errors of two
/// methods at equal time, an interval below 1 means that the first method wins.
///
/// ```
/// # use dapple_metrics::ratio_interval;
/// let ratio = ratio_interval(&[2.1e-3, 1.9e-3, 2.4e-3], &[4.0e-3, 3.9e-3, 4.9e-3], 0.95)?;
/// assert!(ratio.high < 1.0, "the first method wins");
/// # Ok::<(), dapple_metrics::StatisticsError>(())
/// ```
///
/// # Errors
/// [`StatisticsError::Lengths`], [`StatisticsError::NotPositive`], [`StatisticsError::TooFew`] below two pairs,
/// [`StatisticsError::Confidence`].
pub fn ratio_interval(a: &[f64], b: &[f64], confidence: f64) -> Result<Interval, StatisticsError> {
    check_lengths(a, b)?;
    let [a, b] = [logarithms(a)?, logarithms(b)?];
    let differences: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
    Ok(mean_interval(&differences, confidence)?.map(libm::exp))
}
