//! Statistics over seeds, and comparisons of methods with the baseline.

use super::{CONFIDENCE, Row, RunTable, Summary, TIME_TOLERANCE, compared};
use crate::record::{Run, RunBudget};
use dapple_core::options::OptionValue;
use dapple_metrics::{Interval, StatisticsError, geometric_mean_interval, mean_interval, ratio_interval};

/// The verdict on a method, from the confidence interval of the ratio `error of the method / error of the baseline`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum RatioVerdict {
    /// The whole interval lies below 1: the method has less error.
    Win,
    /// The interval contains 1 or is missing, or the method has less error but is slower than the baseline by more than
    /// [`TIME_TOLERANCE`] at equal time.
    Undecided,
    /// The whole interval lies above 1: the method has more error.
    Loss,
}

dapple_core::choices!(RatioVerdict { Win = "win", Undecided = "undecided", Loss = "loss" });

impl RatioVerdict {
    /// The verdict in a row's note; `None` for rows without a verdict.
    pub fn of(row: &Row) -> Option<Self> {
        // The note begins with the verdict's name.
        Self::from_text(row.note.split(';').next()?)
    }
}

/// The text in a row's note for a verdict that also holds with wider intervals, which give all comparisons a joint confidence
/// of 95 %.
pub(crate) const HOLDS: &str = "holds for all together";

/// The text in a row's note for a comparison that is undecided although the interval excludes 1, because the times differ too
/// much.
pub(crate) const UNFAIR: &str = "times the time";

pub(super) fn add(summary: &mut Summary, grid: &RunTable<'_>) {
    for budget in grid.manifest.budgets() {
        let others = grid.all().filter(|[_, method]| *method != grid.baseline);
        let is_paired = |at: &[usize; 2]| !grid.pairs(at[0], [at[1], grid.baseline], budget).is_empty();
        let pairs: Vec<[usize; 2]> = others.filter(is_paired).collect();
        // The confidence level of each interval that gives all of them a joint confidence of 95 % [after Šidák 1967].
        let together = libm::pow(CONFIDENCE, 1.0 / pairs.len().max(1) as f64);
        for at in pairs {
            compare(summary, grid, at, budget, together);
        }
    }
}

fn compare(summary: &mut Summary, grid: &RunTable<'_>, at: [usize; 2], budget: RunBudget, together: f64) {
    let pairs = grid.pairs(at[0], [at[1], grid.baseline], budget);
    let of = |value: &dyn Fn(&Run) -> f64| pairs.iter().map(|[a, b]| (value(a), value(b))).collect::<Vec<_>>();
    let seconds = SeedStatistic::ratio(&of(&|run| run.render_s));
    let timed = matches!(budget, RunBudget::TimeOf(_)).then_some(seconds.value).flatten();
    for metric in compared() {
        let values = of(&|run| run.errors.get(metric.name));
        let limited = metric.name == "relmse" && pairs.iter().any(|pair| pair.iter().any(|run| run.reference_limited));
        let wide = SeedStatistic::ratio_at(&values, together);
        let note = if limited { "reference-limited" } else { "" };
        let figure = judge(SeedStatistic::ratio(&values), wide.ends, timed).noted(note);
        summary.add(grid, at, budget, &format!("{} ratio", metric.name), figure);
    }
    summary.add(grid, at, budget, "seconds ratio", seconds);
    let cost = judge(SeedStatistic::ratio(&of(&|run| run.errors.get("relmse") * run.render_s)), None, None);
    summary.add(grid, at, budget, "relmse x seconds ratio", cost);
}

/// Puts the verdict at the front of the statistic's note. `wide` is the wider interval, for joint confidence in all
/// comparisons. `seconds` is the ratio of render times in an equal-time comparison.
fn judge(figure: SeedStatistic, wide: Option<[f64; 2]>, seconds: Option<f64>) -> SeedStatistic {
    let side = |ends: [f64; 2]| match ends {
        [_, high] if high < 1.0 => RatioVerdict::Win,
        [low, _] if low > 1.0 => RatioVerdict::Loss,
        _ => RatioVerdict::Undecided,
    };
    let Some(ends) = figure.ends else { return with_first(figure, RatioVerdict::Undecided.name()) };
    let verdict = side(ends);
    let unfair = seconds.is_some_and(|ratio| match verdict {
        RatioVerdict::Win => ratio > 1.0 + TIME_TOLERANCE,
        RatioVerdict::Loss => ratio < 1.0 / (1.0 + TIME_TOLERANCE),
        RatioVerdict::Undecided => false,
    });
    if unfair {
        let note = format!("{}; it took {:.2} {UNFAIR}", RatioVerdict::Undecided.name(), seconds.unwrap_or(1.0));
        with_first(figure, &note)
    } else if verdict != RatioVerdict::Undecided && wide.is_some_and(|wide| side(wide) == verdict) {
        with_first(figure, &format!("{}; {HOLDS}", verdict.name()))
    } else {
        with_first(figure, verdict.name())
    }
}

fn with_first(figure: SeedStatistic, first: &str) -> SeedStatistic {
    SeedStatistic { note: first.to_owned(), ..figure.clone() }.noted(&figure.note)
}

/// A statistic over the runs of several seeds: value, confidence interval and note.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct SeedStatistic {
    pub(super) value: Option<f64>,
    pub(super) ends: Option<[f64; 2]>,
    pub(super) n: usize,
    pub(super) note: String,
}

impl SeedStatistic {
    /// The geometric mean with its 95 % interval. If a value is 0 or negative, the arithmetic mean, with a note.
    pub(super) fn geometric(values: &[f64]) -> Self {
        let without = values.iter().filter(|v| **v <= 0.0).count();
        if without > 0 {
            let note = format!("arithmetic mean: {without} of {} values are not above 0", values.len());
            return Self::arithmetic(values).noted(&note);
        }
        Self::of(values, || geometric_mean_interval(values, CONFIDENCE))
    }

    /// The arithmetic mean with its 95 % interval.
    pub(super) fn arithmetic(values: &[f64]) -> Self {
        Self::of(values, || mean_interval(values, CONFIDENCE))
    }

    /// A single value without an interval, or the interval of several values.
    fn of(values: &[f64], interval: impl FnOnce() -> Result<Interval, StatisticsError>) -> Self {
        match values {
            [] => Self::missing(0, "no runs"),
            _ if values.iter().any(|value| value.is_nan()) => Self::missing(values.len(), "not measured"),
            &[value] => Self::bare(value, 1).noted("one seed: no interval"),
            _ => Self::from_interval(interval(), values.len()),
        }
    }

    /// The geometric mean of the ratios of paired values, with its 95 % interval.
    fn ratio(pairs: &[(f64, f64)]) -> Self {
        Self::ratio_at(pairs, CONFIDENCE)
    }

    fn ratio_at(pairs: &[(f64, f64)], confidence: f64) -> Self {
        if pairs.iter().any(|(a, b)| *a <= 0.0 || *b <= 0.0) {
            return Self::missing(pairs.len(), "no ratio: a value is not above 0");
        }
        let (a, b): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
        let ratios: Vec<f64> = pairs.iter().map(|(a, b)| a / b).collect();
        Self::of(&ratios, || ratio_interval(&a, &b, confidence))
    }

    fn missing(n: usize, note: &str) -> Self {
        Self { n, note: note.into(), ..Self::default() }
    }

    /// A value without an interval, computed from `n` seeds.
    pub(super) fn bare(value: f64, n: usize) -> Self {
        Self { value: Some(value), n, ..Self::default() }
    }

    fn from_interval(found: Result<Interval, StatisticsError>, n: usize) -> Self {
        match found {
            Ok(i) if i.value.is_finite() && i.low.is_finite() && i.high.is_finite() => {
                Self { ends: Some([i.low, i.high]), ..Self::bare(i.value, n) }
            }
            Ok(i) if i.value.is_finite() => Self::bare(i.value, n).noted("the interval is unbounded"),
            Ok(_) => Self::missing(n, "the value overflows"),
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
