//! The slopes of error over samples and over time on logarithmic axes.

use super::run_table::{RunTable, error};
use super::seed_statistic::SeedStatistic;
use super::{CONFIDENCE, Summary};
use crate::record::Run;
use dapple_metrics::log_log_fit;
use std::collections::BTreeMap;

/// A function that returns a run's cost, in samples per pixel or in seconds.
type OfRun = fn(&Run) -> f64;

pub(super) fn add(summary: &mut Summary, grid: &RunTable<'_>) {
    let over: [(&str, OfRun); 2] =
        [("relmse slope over spp", |run| run.spp), ("relmse slope over seconds", |run| run.render_s)];
    for at in grid.all() {
        let curves = curves(grid, at);
        if curves.is_empty() {
            continue;
        }
        for (metric, x) in over {
            summary.add(grid, at, None, metric, slope(&curves, x));
        }
    }
}

/// The runs of one seed in the order of ascending budgets.
pub(super) type Curve<'a> = Vec<&'a Run>;

/// The runs of a scene and method as one curve per seed, over the budgets in samples per pixel.
pub(super) fn curves<'a>(grid: &RunTable<'a>, at: [usize; 2]) -> BTreeMap<u64, Curve<'a>> {
    let mut curves: BTreeMap<u64, Curve<'a>> = BTreeMap::new();
    for budget in grid.spp_budgets() {
        for (&seed, &run) in grid.at(at, budget) {
            curves.entry(seed).or_default().push(run);
        }
    }
    curves
}

/// The mean over seeds of each curve's slope. Errors of one seed at growing budgets are not independent, but slopes of
/// different seeds are.
fn slope(curves: &BTreeMap<u64, Curve<'_>>, x: OfRun) -> SeedStatistic {
    let longest = curves.values().map(Vec::len).max().unwrap_or(0);
    if longest < 2 {
        return SeedStatistic::missing(curves.len(), "one budget: no slope");
    }
    // Seeds that lack budgets, as in an unfinished study, are left out: their slopes cover another range.
    let whole: Vec<_> = curves.values().filter(|curve| curve.len() == longest).collect();
    let series: Vec<[Vec<f64>; 2]> = whole
        .iter()
        .map(|curve| [curve.iter().map(|run| x(run)).collect(), curve.iter().map(|run| error(run, "relmse")).collect()])
        .collect();
    if series.iter().flatten().flatten().any(|v| *v <= 0.0) {
        return SeedStatistic::missing(series.len(), "a value is not above 0: no slope");
    }
    if let [[x, y]] = &series[..]
        && longest > 2
    {
        let fit = log_log_fit(x, y, CONFIDENCE).map(|fit| fit.slope);
        return SeedStatistic::from_interval(fit, 1)
            .noted("one seed: interval of the fit, whose points are not independent");
    }
    let slopes: Result<Vec<f64>, _> = series.iter().map(|[x, y]| slope_of(x, y)).collect();
    match slopes {
        Ok(slopes) => SeedStatistic::arithmetic(&slopes),
        Err(error) => SeedStatistic::missing(series.len(), &error.to_string()),
    }
}

/// The slope of the line fitted to points on logarithmic axes. Two points give the slope of the line through them.
fn slope_of(x: &[f64], y: &[f64]) -> Result<f64, dapple_metrics::StatisticsError> {
    if let ([x0, x1], [y0, y1]) = (x, y) {
        if x0 == x1 {
            return Err(dapple_metrics::StatisticsError::SameAbscissa { x: *x0 });
        }
        return Ok(libm::log(y1 / y0) / libm::log(x1 / x0));
    }
    log_log_fit(x, y, CONFIDENCE).map(|fit| fit.slope.value)
}
