//! The tables of the report: rounded values, and comparisons with the baseline.

use crate::RecordedStudy;
use crate::record::{Method, RunBudget, SceneRecord};
use crate::summary::{HOLDS, RatioVerdict, Row, Summary, TIME_TOLERANCE, UNFAIR, number};

/// A value in a table of the report: rounded for display, and exact as in `summary.csv`.
#[derive(Clone, Debug, Default)]
pub(super) struct TableCell {
    /// The key of the value's row in `summary.csv`; see [`Row::key`].
    pub(super) key: String,
    pub(super) metric: String,
    /// The value; 0 if unknown.
    pub(super) number: f64,
    /// The exact value and the ends of its interval, as text in `summary.csv`.
    pub(super) value: String,
    pub(super) low: String,
    pub(super) high: String,
    /// The rounded value, as the table displays it.
    pub(super) text: String,
    /// The rounded 95 % interval; empty without an interval.
    pub(super) interval: String,
    pub(super) note: String,
    /// The name of the verdict, for values that are compared with the baseline; empty otherwise.
    pub(super) class: &'static str,
    /// The symbol of a footnote about the value; empty without a footnote.
    pub(super) mark: &'static str,
}

impl TableCell {
    /// Creates a cell from a row's value: ratios with two or three decimals, other values with three significant digits, a dash
    /// without a value.
    pub(super) fn of(row: Option<&Row>) -> Self {
        let Some(row) = row else { return Self { text: "–".into(), note: "no runs".into(), ..Self::default() } };
        let round = if row.metric.ends_with("ratio") { ratio } else { short };
        let write = |value: f64| round(value).replace('-', "−");
        let exact = |v: Option<f64>| v.map_or_else(String::new, number);
        let interval = |[low, high]: [f64; 2]| format!("[{}, {}]", write(low), write(high));
        let marks = [("reference-limited", "§"), ("arithmetic mean", "¶")];
        Self {
            key: row.key(),
            metric: row.metric.clone(),
            number: row.value.unwrap_or(0.0),
            value: exact(row.value),
            low: exact(row.low),
            high: exact(row.high),
            text: row.value.map_or_else(|| "–".into(), write),
            interval: row.interval().map_or_else(String::new, interval),
            note: row.note.clone(),
            class: RatioVerdict::of(row).map_or("", RatioVerdict::name),
            mark: marks.iter().find(|(words, _)| row.note.contains(words)).map_or("", |(_, mark)| mark),
        }
    }
}

/// Formats a value with three significant digits.
pub(super) fn short(value: f64) -> String {
    let size = value.abs();
    match size {
        0.0 => "0".into(),
        s if !(1e-3..99_999.5).contains(&s) => format!("{value:.2e}"),
        s => {
            let digits = [99.95, 9.995, 0.9995, 0.099_95, 0.009_995].iter().take_while(|limit| s < **limit).count();
            format!("{value:.digits$}")
        }
    }
}

/// Formats a ratio with two decimals; below 0.095 with more, and from 9.995 with fewer.
fn ratio(value: f64) -> String {
    match value.abs() {
        s if !(0.01..999.5).contains(&s) || s >= 9.995 => short(value),
        s if s >= 0.095 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

/// A row of a table: one method on one scene at one budget.
pub(super) struct Line {
    pub(super) scene: String,
    pub(super) method: String,
    pub(super) budget: String,
    pub(super) cells: Vec<TableCell>,
    /// The note of the row's first metric. `class` is the name of its verdict; empty without a verdict.
    pub(super) note: String,
    pub(super) class: &'static str,
}

impl Line {
    /// True if the verdict also holds with the wider intervals that give all comparisons a joint confidence of 95 %.
    pub(super) fn together(&self) -> bool {
        self.note.contains(HOLDS)
    }

    /// The reason why a comparison is undecided: unequal times, a missing interval, or an interval that contains 1.
    /// Empty for a win or a loss.
    pub(super) fn why(&self) -> String {
        let mut notes = self.note.split("; ").skip(1);
        if self.class != RatioVerdict::Undecided.name() {
            String::new()
        } else if let Some(note) = notes.clone().find(|note| note.contains(UNFAIR)) {
            format!("{note}; equal is within {:.0} %", 100.0 * TIME_TOLERANCE)
        } else if self.cells.first().is_some_and(|cell| cell.interval.is_empty()) {
            notes.next().unwrap_or("no interval").to_owned()
        } else {
            "the interval contains 1".into()
        }
    }
}

/// The rows of a table about a scene, with one cell for each of `metrics`. A method and budget has a row if the summary
/// contains the metric `key` for it.
pub(super) fn lines(
    summary: &Summary,
    scene: &SceneRecord,
    methods: &[(&Method, &String)],
    budgets: &[RunBudget],
    (key, metrics): (&str, &[String]),
) -> Vec<Line> {
    let mut lines = Vec::new();
    for &(method, name) in methods {
        for budget in budgets.iter().map(RunBudget::to_string) {
            let find = |metric: &str| summary.find(&scene.name, method, &budget, metric);
            let Some(row) = find(key) else { continue };
            lines.push(Line {
                scene: scene.name.clone(),
                method: name.clone(),
                cells: metrics.iter().map(|metric| TableCell::of(find(metric))).collect(),
                note: row.note.clone(),
                class: RatioVerdict::of(row).map_or("", RatioVerdict::name),
                budget,
            });
        }
    }
    lines
}

/// The budget of the report's first comparison: equal time if there are equal-time runs, else the largest spp. `None` without
/// runs to compare.
pub(super) fn headline(recorded: &RecordedStudy, summary: &Summary) -> Option<RunBudget> {
    recorded.manifest.budgets().rev().find(|budget| tally(summary, *budget, "relmse ratio") != [0; 3])
}

/// Counts the wins, losses and undecided comparisons of a metric at one budget.
pub(super) fn tally(summary: &Summary, budget: RunBudget, metric: &str) -> [usize; 3] {
    let words = budget.to_string();
    let rows = || summary.rows().iter().filter(|row| row.budget == words && row.metric == metric);
    [RatioVerdict::Win, RatioVerdict::Loss, RatioVerdict::Undecided]
        .map(|verdict| rows().filter(|row| RatioVerdict::of(row) == Some(verdict)).count())
}
