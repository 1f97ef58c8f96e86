//! Statistics over the runs of several seeds.

use super::CONFIDENCE;
use dapple_metrics::{geometric_mean_interval, mean_interval, ratio_interval};

/// A statistic over the runs of several seeds: value, confidence interval and note.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct SeedStatistic {
    pub(super) value: Option<f64>,
    pub(super) ends: Option<[f64; 2]>,
    pub(super) n: usize,
    pub(super) note: String,
}

const ONE_SEED: &str = "one seed: no interval";

impl SeedStatistic {
    /// The geometric mean with its 95 % interval. If a value is not above 0, the arithmetic mean, with a note.
    pub(super) fn geometric(values: &[f64]) -> Self {
        let without = values.iter().filter(|v| **v <= 0.0).count();
        if without > 0 {
            let note = format!("arithmetic mean: {without} of {} values are not above 0", values.len());
            return Self::arithmetic(values).noted(&note);
        }
        match values {
            [] => Self::missing(0, "no runs"),
            &[value] => Self { value: Some(value), ends: None, n: 1, note: ONE_SEED.into() },
            _ => Self::from_interval(geometric_mean_interval(values, CONFIDENCE), values.len()),
        }
    }

    /// The arithmetic mean with its 95 % interval.
    pub(super) fn arithmetic(values: &[f64]) -> Self {
        match values {
            [] => Self::missing(0, "no runs"),
            &[value] => Self { value: Some(value), ends: None, n: 1, note: ONE_SEED.into() },
            _ => Self::from_interval(mean_interval(values, CONFIDENCE), values.len()),
        }
    }

    /// The geometric mean of the ratios of paired values, with its 95 % interval.
    pub(super) fn ratio(pairs: &[(f64, f64)]) -> Self {
        Self::ratio_at(pairs, CONFIDENCE)
    }

    pub(super) fn ratio_at(pairs: &[(f64, f64)], confidence: f64) -> Self {
        if pairs.iter().any(|(a, b)| *a <= 0.0 || *b <= 0.0) {
            return Self::missing(pairs.len(), "a value is not above 0: no ratio");
        }
        match pairs {
            [] => Self::missing(0, "no seed has both"),
            &[(a, b)] => Self { value: Some(a / b), ends: None, n: 1, note: ONE_SEED.into() },
            _ => {
                let (a, b): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
                Self::from_interval(ratio_interval(&a, &b, confidence), pairs.len())
            }
        }
    }

    pub(super) fn missing(n: usize, note: &str) -> Self {
        Self { value: None, ends: None, n, note: note.into() }
    }

    /// A value without an interval, computed from `n` seeds.
    pub(super) fn bare(value: f64, n: usize) -> Self {
        Self { value: Some(value), ends: None, n, note: String::new() }
    }

    pub(super) fn from_interval(
        found: Result<dapple_metrics::Interval, dapple_metrics::StatisticsError>,
        n: usize,
    ) -> Self {
        match found {
            Ok(i) if i.value.is_finite() && i.low.is_finite() && i.high.is_finite() => {
                Self { value: Some(i.value), ends: Some([i.low, i.high]), n, note: String::new() }
            }
            Ok(i) if i.value.is_finite() => Self::bare(i.value, n).noted("the interval has no end"),
            Ok(_) => Self::missing(n, "beyond the range of numbers"),
            Err(error) => Self::missing(n, &error.to_string()),
        }
    }

    /// Adds a remark to the statistic's note.
    pub(super) fn noted(mut self, note: &str) -> Self {
        if !note.is_empty() {
            self.note = if self.note.is_empty() { note.into() } else { format!("{}; {note}", self.note) };
        }
        self
    }
}
