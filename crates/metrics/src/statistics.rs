//! What may be said of a method after a few seeds: efficiencies, intervals, slopes.

mod bootstrap;
mod interval;
mod slope;
mod student;

pub use bootstrap::BOOTSTRAP_RESAMPLES;
pub use interval::{
    BOOTSTRAP_MIN_COUNT, Interval, Method, efficiency, geometric_mean_interval, mean_interval, ratio_interval,
};
pub use slope::{LogLogFit, log_log_fit};
pub use student::student_t_quantile;

use crate::sum::Sum;

/// Why numbers give no statistic. Each message says what to do.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StatisticsError {
    /// Too few values for an interval.
    #[error("{found} values give no interval: take at least {needed}, by more seeds or budgets")]
    TooFew {
        /// Values given.
        found: usize,
        /// The fewest that do.
        needed: usize,
    },
    /// Series that should go together pair by pair.
    #[error("series of {} and {} values cannot be paired: give both the same seeds or budgets", lengths[0], lengths[1])]
    Lengths {
        /// Their lengths.
        lengths: [usize; 2],
    },
    /// A value that is no number.
    #[error("value {index} is {value}: leave it out, and say so, or mend what made it")]
    NotFinite {
        /// Its place in its series, from 0.
        index: usize,
        /// The value.
        value: f64,
    },
    /// A value without a logarithm.
    #[error("value {index} is {value}, but ratios, efficiencies and slopes need finite values above 0")]
    NotPositive {
        /// Its place in its series, from 0.
        index: usize,
        /// The value.
        value: f64,
    },
    /// A confidence that is none.
    #[error("a confidence of {value}: use one between 0 and 1, both excluded; .95 is usual")]
    Confidence {
        /// The value.
        value: f64,
    },
    /// Points above one another have no slope.
    #[error("all points are at x = {x}: a slope needs at least two budgets")]
    SameAbscissa {
        /// Where all points are.
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

/// Natural logarithms.
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

/// Sum of products of two series' distances from their means.
fn scatter(a: &[f64], b: &[f64]) -> f64 {
    let means = [mean(a), mean(b)];
    a.iter().zip(b).map(|(x, y)| (x - means[0]) * (y - means[1])).collect::<Sum>().value()
}
