//! Efficiencies, confidence intervals and slopes from a few seeds.

mod student;

pub use student::{student_t_quantile, student_t_tail};

use crate::blocks::percentile;
use crate::sum::Sum;
use student::{normal_cdf, normal_quantile};

/// The reason why a statistic cannot be computed. Each message names the remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StatisticsError {
    /// Too few values for an interval.
    #[error("{found} values are too few for a confidence interval; use at least {needed} seeds or budgets")]
    TooFew {
        /// The number of values passed.
        found: usize,
        /// The fewest values needed.
        needed: usize,
    },
    /// Paired series of these different lengths.
    #[error("series of {} and {} values cannot be paired; use the same seeds or budgets for both", .0[0], .0[1])]
    Lengths([usize; 2]),
    /// A value that is NaN or infinite.
    #[error("value {index} is {value}, which is not finite; find its cause, or exclude it and report the exclusion")]
    NotFinite {
        /// The index of the value in its series, from 0.
        index: usize,
        /// The value that is NaN or infinite.
        value: f64,
    },
    /// A value that is not a finite number above 0, so that it has no logarithm.
    #[error("value {index} is {value}; ratios, efficiencies and slopes need finite values above 0")]
    NotPositive {
        /// The index of the value in its series, from 0.
        index: usize,
        /// The value that is not a finite number above 0.
        value: f64,
    },
    /// A confidence level outside 0 to 1.
    #[error("a confidence of {0} is out of range; use one between 0 and 1, such as 0.95")]
    Confidence(f64),
    /// Points that all have the same abscissa x, so that a fitted line has no slope.
    #[error("all points of the fit have x = {0}; use at least two different budgets")]
    SameAbscissa(f64),
}

fn check_confidence(value: f64) -> Result<(), StatisticsError> {
    if value > 0.0 && value < 1.0 { Ok(()) } else { Err(StatisticsError::Confidence(value)) }
}

fn check_count(found: usize, needed: usize) -> Result<(), StatisticsError> {
    if found >= needed { Ok(()) } else { Err(StatisticsError::TooFew { found, needed }) }
}

fn check_lengths(a: &[f64], b: &[f64]) -> Result<(), StatisticsError> {
    if a.len() == b.len() { Ok(()) } else { Err(StatisticsError::Lengths([a.len(), b.len()])) }
}

/// The natural logarithms of `values`; an error for the first value that is not finite and above 0.
fn logarithms(values: &[f64]) -> Result<Vec<f64>, StatisticsError> {
    let logarithm = |(index, &value): (usize, &f64)| {
        let good = value > 0.0 && value.is_finite();
        if good { Ok(libm::log(value)) } else { Err(StatisticsError::NotPositive { index, value }) }
    };
    values.iter().enumerate().map(logarithm).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().copied().collect::<Sum>().value() / values.len() as f64
}

/// The sum of the products of two series' deviations from their means.
fn scatter(a: &[f64], b: &[f64]) -> f64 {
    let means = [mean(a), mean(b)];
    a.iter().zip(b).map(|(x, y)| (x - means[0]) * (y - means[1])).collect::<Sum>().value()
}

/// The fewest values for which intervals are computed by the bootstrap. Fewer values represent their distribution too poorly.
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
    /// Returns `true` if x lies in the interval, ends included.
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
/// The interval is computed by the bootstrap from 32 values ([`BOOTSTRAP_MIN_COUNT`]) on. For fewer values, it is the
/// interval of Student's t with n - 1 degrees of freedom.
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
fn student_interval(value: f64, deviation: f64, degrees_of_freedom: f64, confidence: f64) -> Interval {
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

/// A straight line on logarithmic axes, `y = scale * x^slope`, from [`log_log_fit`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct LogLogFit {
    /// The exponent, with its confidence interval. MSE as a function of the number of independent samples has a slope
    /// of -1.
    pub slope: Interval,
    /// The value of y at x = 1.
    pub scale: f64,
    /// The standard deviation of ln y about the line, with n - 2 degrees of freedom for n points.
    pub deviation: f64,
}

impl LogLogFit {
    /// Returns the y of the line at `x`, which must be above 0.
    pub fn predict(&self, x: f64) -> f64 {
        self.scale * libm::pow(x, self.slope.value)
    }

    /// Returns the x at which the line reaches `y`, such as the time to reach an error. `y` must be above 0. For
    /// a horizontal line, the result is NaN if `y` lies on the line, else infinite or 0.
    pub fn solve(&self, y: f64) -> f64 {
        libm::exp(libm::log(y / self.scale) / self.slope.value)
    }
}

/// Fits a line to points on logarithmic axes by least squares.
///
/// The slope's interval is Student's with n - 2 degrees of freedom and assumes independent points. Errors of one seed at
/// growing budgets are dependent: fit each seed, then take [`mean_interval`] of the slopes.
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
        return Err(StatisticsError::SameAbscissa(x[0]));
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

/// The number of bootstrap resamples. The ends of a 95 % interval then vary by less than 3 % of its half width.
pub const BOOTSTRAP_RESAMPLES: usize = 9999;

/// The confidence interval of the mean by the bias-corrected and accelerated bootstrap [after Efron 1987].
///
/// `values` must have at least two elements, all finite. The seed is fixed, so equal values give equal intervals.
fn bootstrap(values: &[f64], confidence: f64) -> Interval {
    let value = mean(values);
    let mut random = SplitMix(0x6461_7070_6c65);
    let mut means: Vec<f64> = (0..BOOTSTRAP_RESAMPLES).map(|_| resampled_mean(values, value, &mut random)).collect();
    means.sort_unstable_by(f64::total_cmp);
    let [below, up_to] = [means.partition_point(|&m| m < value), means.partition_point(|&m| m <= value)];
    // Half of the ties count; the fraction is never 0 or 1.
    let share = (0.5 * (below + up_to) as f64 + 0.5) / (BOOTSTRAP_RESAMPLES as f64 + 1.0);
    let bias = normal_quantile(share);
    let acceleration = acceleration(values, value);
    let end = |p: f64| {
        let z = bias + normal_quantile(p);
        let rest = 1.0 - acceleration * z;
        // Past the pole the percentile is an end of the range.
        let at = if rest > 0.0 { normal_cdf(bias + z / rest) } else { f64::from(u8::from(z > 0.0)) };
        percentile(&means, 100.0 * at)
    };
    let tail = 0.5 - 0.5 * confidence;
    Interval { value, low: end(tail), high: end(1.0 - tail), method: IntervalMethod::Bootstrap }
}

/// The mean of a resample: as many values as `values` has, drawn with replacement. It sums deviations from `mean`, so
/// that equal values give exactly their mean.
fn resampled_mean(values: &[f64], mean: f64, random: &mut SplitMix) -> f64 {
    let sum: f64 = (0..values.len()).map(|_| values[random.below(values.len())] - mean).sum();
    mean + sum / values.len() as f64
}

/// The acceleration: a sixth of the skewness of the mean's jackknife values [after Efron 1987].
fn acceleration(values: &[f64], mean: f64) -> f64 {
    let distances = values.iter().map(|v| v - mean);
    let square = distances.clone().map(|d| d * d).collect::<Sum>().value();
    let cube = distances.map(|d| d * d * d).collect::<Sum>().value();
    if square > 0.0 { cube / (6.0 * square * square.sqrt()) } else { 0.0 }
}

/// The random number generator SplitMix64 [after Steele 2014].
struct SplitMix(u64);

impl SplitMix {
    /// A uniform random number in `0..count`; probabilities differ by at most 2^-64 `count`.
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((u128::from(z ^ z >> 31) * count as u128) >> 64) as usize
    }
}
