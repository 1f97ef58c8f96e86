//! Tests of equal spread, and of error estimates.

use super::mean::Mean;

/// The p-value of the claim that two groups have equal spread, for any distributions. A t-test of the distances from
/// each group's median [after Brown and Forsythe 1974].
pub fn brown_forsythe(a: &[f64], b: &[f64]) -> f64 {
    let distances = |values: &[f64]| -> Mean {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        let median = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
        values.iter().map(|v| (v - median).abs()).collect()
    };
    distances(a).against_estimate(&distances(b)).p()
}

/// Sums that compare error estimates with true errors, over many pixels and seeds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Calibration {
    held: u64,
    all: u64,
    forecast: f64,
    real: f64,
}

impl Calibration {
    /// Adds an estimate with its predicted variance `forecast`, and the true value, which is itself known with variance
    /// `noise`.
    ///
    /// `quantile` scales the interval: 1.96 for 95 %, or Student's t if the forecast has few degrees of freedom.
    pub fn add(&mut self, estimate: f64, forecast: f64, truth: f64, noise: f64, quantile: f64) {
        let off = estimate - truth;
        let reach = (quantile * forecast.sqrt()).hypot(1.96 * noise.sqrt());
        self.held += u64::from(off.abs() <= reach);
        self.all += 1;
        self.forecast += forecast;
        self.real += off * off - noise;
    }

    /// The fraction of intervals that contain the true value.
    pub fn coverage(&self) -> f64 {
        self.held as f64 / self.all as f64
    }

    /// The ratio of the predicted to the true root mean squared error.
    pub fn ratio(&self) -> f64 {
        (self.forecast / self.real).sqrt()
    }

    /// Returns `true` if the 95 % intervals contain 93 to 97 % of true values, and
    /// [`ratio`](Self::ratio) is from 0.9 to 1.1.
    pub fn is_honest(&self) -> bool {
        (0.93..=0.97).contains(&self.coverage()) && (0.9..=1.1).contains(&self.ratio())
    }
}
