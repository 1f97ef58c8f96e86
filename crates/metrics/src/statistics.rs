//! Efficiencies, confidence intervals and slopes from a few seeds.

mod bootstrap;
mod interval;
mod slope;
mod student;

pub use bootstrap::BOOTSTRAP_RESAMPLES;
pub use interval::{
    BOOTSTRAP_MIN_COUNT, Interval, IntervalMethod, efficiency, geometric_mean_interval, mean_interval, ratio_interval,
};
pub use slope::{LogLogFit, log_log_fit};
pub use student::student_t_quantile;

use crate::sum::Sum;

/// An error of a statistic. Each message names the remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StatisticsError {
    /// Too few values for an interval.
    #[error("{found} values are too few for an interval; use at least {needed} seeds or budgets")]
    TooFew {
        /// The number of values passed.
        found: usize,
        /// The fewest values needed.
        needed: usize,
    },
    /// Paired series of different lengths.
    #[error("series of {} and {} values cannot be paired; use the same seeds or budgets for both", lengths[0], lengths[1])]
    Lengths {
        /// The lengths of the first and of the second series.
        lengths: [usize; 2],
    },
    /// A value that is NaN or infinite.
    #[error("value {index} is {value}; correct its source, or leave it out and report that")]
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
    #[error("a confidence of {value} is out of range; use one between 0 and 1, such as 0.95")]
    Confidence {
        /// The confidence level passed.
        value: f64,
    },
    /// Points that all have the same abscissa x, so that a fitted line has no slope.
    #[error("all points are at x = {x}; use at least two budgets for a slope")]
    SameAbscissa {
        /// The common abscissa.
        x: f64,
    },
}

fn check_confidence(value: f64) -> Result<(), StatisticsError> {
    if value > 0.0 && value < 1.0 { Ok(()) } else { Err(StatisticsError::Confidence { value }) }
}

fn check_count(found: usize, needed: usize) -> Result<(), StatisticsError> {
    if found >= needed { Ok(()) } else { Err(StatisticsError::TooFew { found, needed }) }
}

fn check_lengths(a: &[f64], b: &[f64]) -> Result<(), StatisticsError> {
    if a.len() == b.len() { Ok(()) } else { Err(StatisticsError::Lengths { lengths: [a.len(), b.len()] }) }
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
