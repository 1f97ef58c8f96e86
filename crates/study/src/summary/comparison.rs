//! Comparisons of methods with the baseline.

use super::run_table::{RunTable, error};
use super::seed_statistic::SeedStatistic;
use super::{COMPARED, CONFIDENCE, Row, Summary, TIME_TOLERANCE};
use crate::record::{Run, RunBudget};

/// The verdict on a method, from the confidence interval of the ratio of its error to the baseline's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum RatioVerdict {
    /// The whole interval lies below 1: the method has less error.
    Win,
    /// The interval contains 1 or is missing, or a better error took too much time. At equal time, the method with less
    /// error may take at most [`TIME_TOLERANCE`] more time.
    Undecided,
    /// The whole interval lies above 1: the method has more error.
    Loss,
}

impl RatioVerdict {
    /// The verdict's name, with which the note of a row begins.
    pub fn words(self) -> &'static str {
        match self {
            Self::Win => "win",
            Self::Undecided => "undecided",
            Self::Loss => "loss",
        }
    }

    /// The verdict in a row's note; `None` for rows without a verdict.
    pub fn of(row: &Row) -> Option<Self> {
        let first = row.note.split(';').next()?;
        [Self::Win, Self::Undecided, Self::Loss].into_iter().find(|v| v.words() == first)
    }
}

/// The words in a row's note that mark a verdict that also holds with wider intervals, which all comparisons together
/// satisfy with 95 % confidence.
pub(crate) const HOLDS: &str = "holds for all together";

/// The words in a row's note that mark an undecided comparison: the interval excludes 1, but the times differ too much.
pub(crate) const UNFAIR: &str = "times the time";

pub(super) fn add(summary: &mut Summary, grid: &RunTable<'_>) {
    for budget in grid.budgets() {
        let compared: Vec<[usize; 2]> = grid
            .all()
            .filter(|&[scene, method]| {
                method != grid.baseline && !grid.pairs(scene, [method, grid.baseline], budget).is_empty()
            })
            .collect();
        // The confidence level that each interval needs so that all of them hold together with 95 % confidence [after
        // Šidák 1967].
        let together = libm::pow(CONFIDENCE, 1.0 / compared.len().max(1) as f64);
        for at in compared {
            compare(summary, grid, at, budget, together);
        }
    }
}

fn compare(summary: &mut Summary, grid: &RunTable<'_>, at: [usize; 2], budget: RunBudget, together: f64) {
    let pairs = grid.pairs(at[0], [at[1], grid.baseline], budget);
    let of =
        |value: &dyn Fn(&Run) -> f64| -> Vec<(f64, f64)> { pairs.iter().map(|[a, b]| (value(a), value(b))).collect() };
    let seconds = SeedStatistic::ratio(&of(&|run| run.render_s));
    let timed = matches!(budget, RunBudget::TimeOf(_)).then_some(seconds.value).flatten();
    for metric in COMPARED {
        let values = of(&|run| error(run, metric));
        let limited = metric == "relmse" && pairs.iter().any(|pair| pair.iter().any(|run| run.reference_limited));
        let wide = SeedStatistic::ratio_at(&values, together);
        let figure = judge(SeedStatistic::ratio(&values), wide.ends, timed).noted(if limited {
            "reference-limited"
        } else {
            ""
        });
        summary.add(grid, at, Some(budget), &format!("{metric} ratio"), figure);
    }
    summary.add(grid, at, Some(budget), "seconds ratio", seconds);
    let cost = judge(SeedStatistic::ratio(&of(&|run| run.errors.relmse * run.render_s)), None, None);
    summary.add(grid, at, Some(budget), "relmse x seconds ratio", cost);
}

/// Adds the verdict to the front of the statistic's note. `wide` is the interval at which all comparisons hold
/// together; `seconds` is the ratio of render times in an equal-time comparison.
pub(super) fn judge(figure: SeedStatistic, wide: Option<[f64; 2]>, seconds: Option<f64>) -> SeedStatistic {
    let side = |ends: [f64; 2]| match ends {
        [_, high] if high < 1.0 => RatioVerdict::Win,
        [low, _] if low > 1.0 => RatioVerdict::Loss,
        _ => RatioVerdict::Undecided,
    };
    let Some(ends) = figure.ends else {
        return with_first(figure, RatioVerdict::Undecided.words().to_owned());
    };
    let verdict = side(ends);
    let unfair = seconds.is_some_and(|ratio| match verdict {
        RatioVerdict::Win => ratio > 1.0 + TIME_TOLERANCE,
        RatioVerdict::Loss => ratio < 1.0 / (1.0 + TIME_TOLERANCE),
        RatioVerdict::Undecided => false,
    });
    let mut notes = vec![if unfair { RatioVerdict::Undecided } else { verdict }.words().to_owned()];
    if unfair {
        notes.push(format!("it took {:.2} {UNFAIR}", seconds.unwrap_or(1.0)));
    } else if verdict != RatioVerdict::Undecided && wide.is_some_and(|wide| side(wide) == verdict) {
        notes.push(HOLDS.to_owned());
    }
    with_first(figure, notes.join("; "))
}

fn with_first(figure: SeedStatistic, first: String) -> SeedStatistic {
    let rest = figure.note;
    SeedStatistic { note: first, ..figure }.noted(&rest)
}
