//! S6: spread, and whether what was forecast of it is so.

use super::mean::Mean;

/// p-value of equal spread of two samples, whatever their distributions: a t-test of the distances from each one's median
/// [after Brown and Forsythe 1974], for two groups.
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

/// Forecasts of error beside errors, over many pixels and seeds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Calibration {
    held: u64,
    all: u64,
    told: f64,
    real: f64,
}

impl Calibration {
    /// Takes in an estimate, the variance that was forecast for it, the truth, known but for `noise` (a variance), and the
    /// quantile that makes the interval: 1.96 for 95 %, or Student's where the forecast has few degrees of freedom.
    pub fn add(&mut self, estimate: f64, forecast: f64, truth: f64, noise: f64, quantile: f64) {
        let off = estimate - truth;
        let reach = (quantile * forecast.sqrt()).hypot(1.96 * noise.sqrt());
        self.held += u64::from(off.abs() <= reach);
        self.all += 1;
        self.told += forecast;
        self.real += off * off - noise;
    }

    /// Share of intervals that held the truth.
    pub fn coverage(&self) -> f64 {
        self.held as f64 / self.all as f64
    }

    /// Root of the mean variance forecast over that of the mean squared error.
    pub fn ratio(&self) -> f64 {
        (self.told / self.real).sqrt()
    }

    /// Whether 95 % intervals hold 93 to 97 %, and forecasts are within a tenth of what is so.
    pub fn is_honest(&self) -> bool {
        (0.93..=0.97).contains(&self.coverage()) && (0.9..=1.1).contains(&self.ratio())
    }
}
