//! Errors, times and error predictions of each method at each budget.

use super::Summary;
use super::run_table::{RunTable, Seeds, error};
use super::seed_statistic::SeedStatistic;
use crate::record::{Phases, Run};

/// A function that returns the seconds of one phase of a run.
pub(crate) type OfPhases = fn(&Phases) -> f64;

/// The name of each phase of a run and the function that returns its seconds, in the order of the phases.
pub(crate) const PHASES: [(&str, OfPhases); 7] = [
    ("load", |p| p.load),
    ("bvh", |p| p.bvh),
    ("cluster", |p| p.cluster),
    ("probe", |p| p.probe),
    ("plan", |p| p.plan),
    ("trace", |p| p.trace),
    ("filter", |p| p.filter),
];

pub(super) fn add(summary: &mut Summary, grid: &RunTable<'_>) {
    for at in grid.all() {
        for budget in grid.budgets() {
            let runs = grid.at(at, budget);
            if runs.is_empty() {
                continue;
            }
            let values = |of: &dyn Fn(&Run) -> f64| -> Vec<f64> { runs.values().map(|run| of(run)).collect() };
            let mut put = |metric: &str, figure| summary.add(grid, at, Some(budget), metric, figure);
            for metric in ["mse", "relmse", "relmse_trimmed", "smape", "srgb8_mse", "flip"] {
                let figure = SeedStatistic::geometric(&values(&|run| error(run, metric)));
                put(metric, if metric.ends_with("mse") { figure.noted(&marks(runs, metric)) } else { figure });
            }
            for metric in ["psnr", "mean_ratio"] {
                put(metric, SeedStatistic::arithmetic(&values(&|run| error(run, metric))));
            }
            put("spp", SeedStatistic::arithmetic(&values(&|run| run.spp)));
            put("seconds", SeedStatistic::bare(median(values(&|run| run.render_s)), runs.len()).noted("median"));
            for (name, phase) in PHASES {
                let figure = SeedStatistic::arithmetic(&values(&|run| phase(&run.seconds)));
                put(&format!("seconds {name}"), figure);
            }
            let predicted: Vec<f64> = predictions(runs);
            if !predicted.is_empty() {
                put("predicted over true relmse", SeedStatistic::geometric(&predicted));
            }
        }
    }
}

/// The ratio of predicted to measured relMSE of each run that has a prediction.
fn predictions(runs: &Seeds<'_>) -> Vec<f64> {
    let ratio = |run: &&Run| {
        let found = run.predicted_relmse? / run.errors.relmse;
        found.is_finite().then_some(found)
    };
    runs.values().filter_map(ratio).collect()
}

/// A note on the reference's own noise: the number of runs whose error it limits, or from whose error it was
/// subtracted. Empty if it does not matter.
fn marks(runs: &Seeds<'_>, metric: &str) -> String {
    let count = |of: fn(&Run) -> bool| runs.values().filter(|run| of(run)).count();
    let [limited, corrected] = [count(|run| run.reference_limited), count(|run| run.corrected)];
    let mut notes = Vec::new();
    if limited > 0 {
        notes.push(format!("reference-limited in {limited} of {}", runs.len()));
    }
    if corrected > 0 && ["mse", "relmse"].contains(&metric) {
        notes.push(format!("corrected for the reference in {corrected} of {}", runs.len()));
    }
    notes.join("; ")
}

/// The median of at least one value; for an even number, the mean of the middle two.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}
