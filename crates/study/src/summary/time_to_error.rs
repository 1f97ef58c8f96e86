//! The render times in which methods reach given relMSE levels.
//!
//! Each seed has a curve of relMSE over render time, with one point per budget. Between two neighbouring points the
//! time is interpolated on logarithmic axes. The first crossing of the level counts.
//!
//! 1. If every seed's curve crosses the level, the value is the geometric mean over seeds, with its interval.
//! 2. If only some curves cross it, the curve of mean errors is interpolated, without an interval. Dropping the other
//!    seeds would flatter the method.
//! 3. If the mean curve does not cross the level, the note gives a bound on the time. If there are at least three
//!    budgets, the time at which a fitted line reaches the level is the value, marked as extrapolated. It must be
//!    within a factor of [`REACH`] of the measured times.

use super::run_table::{RunTable, error};
use super::seed_statistic::SeedStatistic;
use super::slopes::{Curve, curves};
use super::{CONFIDENCE, Summary, number};
use dapple_metrics::log_log_fit;
use std::collections::BTreeMap;

/// The largest factor by which a fitted line is extrapolated beyond the measured times.
const REACH: f64 = 4.0;

/// The largest number of error levels per scene.
const LEVELS: usize = 3;

pub(super) fn add(summary: &mut Summary, grid: &RunTable<'_>) {
    for scene in 0..grid.manifest.scenes.len() {
        let base = curves(grid, [scene, grid.baseline]);
        let levels = levels(&mean_curve(&base));
        for method in 0..grid.manifest.methods.len() {
            let own = curves(grid, [scene, method]);
            if own.is_empty() {
                continue;
            }
            for &level in &levels {
                let at = [scene, method];
                let name = number(level);
                let [mine, theirs] = [times(&own, level), times(&base, level)];
                let ratio = ratio(&mine, &theirs);
                summary.add(grid, at, None, &format!("seconds to relmse {name}"), mine.figure);
                summary.add(grid, at, None, &format!("seconds ratio to relmse {name}"), ratio);
            }
        }
    }
}

/// A point of a curve: render time in seconds, and relMSE.
type Point = [f64; 2];

/// Chooses error levels: 1, 2 or 5 times powers of ten within the baseline's measured errors, evenly spread.
fn levels(baseline: &[Point]) -> Vec<f64> {
    let errors = || baseline.iter().map(|p| p[1]);
    let [low, high] = [errors().fold(f64::INFINITY, f64::min), errors().fold(0.0, f64::max)];
    if baseline.len() < 2 || low <= 0.0 {
        return Vec::new();
    }
    let decades = libm::floor(libm::log10(low)) as i32..=libm::ceil(libm::log10(high)) as i32;
    let steps = |decade: i32| [1, 2, 5].map(|step| format!("{step}e{decade}").parse().unwrap_or(f64::NAN));
    let mut inside: Vec<f64> = decades.flat_map(steps).filter(|level| (low..=high).contains(level)).collect();
    inside.reverse();
    if inside.len() <= LEVELS {
        return inside;
    }
    (0..LEVELS).map(|i| inside[i * (inside.len() - 1) / (LEVELS - 1)]).collect()
}

/// The curve of geometric means of time and error at each budget, over the seeds that have runs at the most budgets.
fn mean_curve(curves: &BTreeMap<u64, Curve<'_>>) -> Vec<Point> {
    let longest = curves.values().map(Vec::len).max().unwrap_or(0);
    let whole: Vec<Vec<Point>> = curves.values().filter(|c| c.len() == longest).map(points).collect();
    let mean = |budget: usize, axis: usize| {
        let sum: f64 = whole.iter().map(|curve| libm::log(curve[budget][axis])).sum();
        libm::exp(sum / whole.len() as f64)
    };
    (0..longest).map(|i| [mean(i, 0), mean(i, 1)]).filter(|p| p.iter().all(|v| *v > 0.0 && v.is_finite())).collect()
}

fn points(curve: &Curve<'_>) -> Vec<Point> {
    curve.iter().map(|run| [run.render_s, error(run, "relmse")]).collect()
}

/// The interpolated time in seconds at which a curve first crosses the error level from above; `None` if it never does.
fn crossing(curve: &[Point], level: f64) -> Option<f64> {
    let positive = curve.iter().flatten().all(|v| *v > 0.0);
    if !positive || curve.first()?[1] < level {
        return None;
    }
    if curve[0][1] == level {
        return Some(curve[0][0]);
    }
    let pair = curve.windows(2).find(|pair| pair[1][1] <= level)?;
    let [[t0, e0], [t1, e1]] = [pair[0], pair[1]].map(|p| p.map(libm::log));
    let share = (e0 - libm::log(level)) / (e0 - e1);
    Some(libm::exp(t0 + share * (t1 - t0)))
}

struct Times {
    /// The time in seconds of each seed to reach the level; empty unless all seeds reach it.
    seeds: BTreeMap<u64, f64>,
    measured: bool,
    figure: SeedStatistic,
}

fn times(curves: &BTreeMap<u64, Curve<'_>>, level: f64) -> Times {
    let n = curves.len();
    let found: BTreeMap<u64, f64> =
        curves.iter().filter_map(|(&seed, curve)| Some((seed, crossing(&points(curve), level)?))).collect();
    if n > 0 && found.len() == n {
        let values: Vec<f64> = found.values().copied().collect();
        return Times {
            seeds: found,
            measured: true,
            figure: SeedStatistic::geometric(&values).noted("interpolated by seed"),
        };
    }
    let mean = mean_curve(curves);
    let without = |figure: SeedStatistic, measured| Times { seeds: BTreeMap::new(), measured, figure };
    if let Some(time) = crossing(&mean, level) {
        let note = format!("interpolated on the mean curve: {} of {n} seeds cross the level", found.len());
        return without(SeedStatistic::bare(time, n).noted(&note), true);
    }
    without(beyond(&mean, level, n), false)
}

/// The statistic for an error level that the mean curve does not cross: an extrapolated time, or only a bound in the
/// note.
fn beyond(mean: &[Point], level: f64, n: usize) -> SeedStatistic {
    let (Some(first), Some(last)) = (mean.first(), mean.last()) else {
        return SeedStatistic::missing(n, "no errors above 0");
    };
    let below = first[1] < level;
    let bound = if below {
        format!("reached before {}", seconds(first[0]))
    } else {
        format!("not reached by {}", seconds(last[0]))
    };
    let (x, y): (Vec<f64>, Vec<f64>) = mean.iter().map(|p| (p[0], p[1])).unzip();
    match log_log_fit(&x, &y, CONFIDENCE) {
        Ok(fit) if fit.slope.value < 0.0 => {
            let time = fit.solve(level);
            let near = if below {
                (first[0] / REACH..first[0]).contains(&time)
            } else {
                (last[0]..last[0] * REACH).contains(&time)
            };
            if near {
                return SeedStatistic::bare(time, n).noted(&format!("extrapolated by a fit: {bound}"));
            }
            SeedStatistic::missing(n, &bound)
        }
        _ => SeedStatistic::missing(n, &bound),
    }
}

/// Formats a time in seconds with its unit, for a note.
fn seconds(time: f64) -> String {
    if time < 0.1 { format!("{:.3} ms", 1000.0 * time) } else { format!("{time:.3} s") }
}

fn ratio(mine: &Times, theirs: &Times) -> SeedStatistic {
    let pairs: Vec<(f64, f64)> =
        mine.seeds.iter().filter_map(|(seed, time)| Some((*time, *theirs.seeds.get(seed)?))).collect();
    if !pairs.is_empty() {
        return SeedStatistic::ratio(&pairs).noted("paired by seed");
    }
    match (mine.figure.value, theirs.figure.value) {
        (Some(a), Some(b)) if mine.measured && theirs.measured => {
            SeedStatistic::bare(a / b, mine.figure.n).noted("of the mean curves")
        }
        (Some(a), Some(b)) => SeedStatistic::bare(a / b, mine.figure.n).noted("extrapolated by a fit"),
        _ => SeedStatistic::missing(
            mine.figure.n,
            if mine.figure.value.is_none() { &mine.figure.note } else { &theirs.figure.note },
        ),
    }
}
