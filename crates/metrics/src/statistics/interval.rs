//! Intervals over seeds.

use super::bootstrap::bootstrap;
use super::{
    StatisticsError, check_confidence, check_count, check_lengths, logarithms, mean, scatter, student_t_quantile,
};

/// From this many values on, intervals are bootstrapped: fewer show too little of their distribution.
pub const BOOTSTRAP_MIN_COUNT: usize = 32;

/// How an interval was made.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Student's t: the values are taken as normal.
    Student,
    /// Bias-corrected and accelerated bootstrap.
    Bootstrap,
}

/// An estimate, and where the true value is to be expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The estimate.
    pub value: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
    /// How the ends were found.
    pub method: Method,
}

impl Interval {
    /// Whether x lies in it, ends included: of a ratio that contains 1 nothing is won or lost.
    pub fn contains(&self, x: f64) -> bool {
        (self.low..=self.high).contains(&x)
    }

    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self { value: f(self.value), low: f(self.low), high: f(self.high), method: self.method }
    }
}

/// `1 / (error * seconds)`, which for independent samples does not depend on how many there are; the error is a
/// squared one, MSE or relMSE.
///
/// # Errors
/// [`StatisticsError::NotPositive`] where the error (index 0) or the time (index 1) is not above 0, and for a
/// product beyond the range of an f64.
pub fn efficiency(error: f64, seconds: f64) -> Result<f64, StatisticsError> {
    logarithms(&[error, seconds])?;
    let found = 1.0 / (error * seconds);
    if found > 0.0 && found.is_finite() {
        Ok(found)
    } else {
        Err(StatisticsError::NotPositive { index: 0, value: error })
    }
}

/// The mean of independent values (one a seed) with its interval of `confidence`, .95 say: Student's t with n - 1
/// degrees of freedom, from 32 values ([`BOOTSTRAP_MIN_COUNT`]) on the bootstrap.
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

/// Around an estimate whose standard deviation was estimated with so many degrees of freedom.
pub(super) fn student_interval(value: f64, deviation: f64, degrees_of_freedom: f64, confidence: f64) -> Interval {
    let half = deviation * student_t_quantile(0.5 + 0.5 * confidence, degrees_of_freedom);
    Interval { value, low: value - half, high: value + half, method: Method::Student }
}

/// The geometric mean of independent values above 0, and its interval: [`mean_interval`] of their logarithms, whose
/// lower end is above 0. What bands on logarithmic axes are made of.
///
/// # Errors
/// [`StatisticsError::NotPositive`], and those of [`mean_interval`].
pub fn geometric_mean_interval(values: &[f64], confidence: f64) -> Result<Interval, StatisticsError> {
    Ok(mean_interval(&logarithms(values)?, confidence)?.map(libm::exp))
}

/// How many times as large as `b` is `a`: the geometric mean of `a[i] / b[i]`, with its interval. Both at an index
/// share what makes them vary together (the seed, the scene), which the pairing takes out.
///
/// Of two methods' errors at equal time, a ratio whose interval lies below 1 says that the first one wins.
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
