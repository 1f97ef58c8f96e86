//! Rounded values for tables.

use crate::summary::{RatioVerdict, Row, number};

/// A value in a table of the report: rounded for display, and exact as in `summary.csv`.
#[derive(Clone, Debug, Default)]
pub(super) struct TableCell {
    /// The key of the value's row in `summary.csv`; see [`Row::key`].
    pub(super) key: String,
    /// The exact value, as text in `summary.csv`.
    pub(super) value: String,
    pub(super) low: String,
    pub(super) high: String,
    /// The rounded value, as the table displays it.
    pub(super) text: String,
    /// The rounded 95 % interval; empty without an interval.
    pub(super) interval: String,
    pub(super) note: String,
    /// The name of the value's verdict, if it is compared with the baseline; empty otherwise.
    pub(super) class: &'static str,
    /// The sign of a footnote about the value; empty without a footnote.
    pub(super) mark: &'static str,
}

impl TableCell {
    /// Makes a cell from a row's value with three significant digits; a dash without a value.
    pub(super) fn of(row: Option<&Row>) -> Self {
        Self::with(row, short)
    }

    /// Makes a cell from a row's value as a ratio with two or three decimals; a dash without a value.
    pub(super) fn ratio(row: Option<&Row>) -> Self {
        Self::with(row, ratio)
    }

    fn with(row: Option<&Row>, write: fn(f64) -> String) -> Self {
        let Some(row) = row else { return Self { text: "–".into(), note: "no runs".into(), ..Self::default() } };
        let write = |value: f64| write(value).replace('-', "−");
        let exact = |v: Option<f64>| v.map_or_else(String::new, number);
        Self {
            key: row.key(),
            value: exact(row.value),
            low: exact(row.low),
            high: exact(row.high),
            text: row.value.map_or_else(|| "–".into(), write),
            interval: row
                .interval()
                .map_or_else(String::new, |ends| format!("[{}, {}]", write(ends[0]), write(ends[1]))),
            note: row.note.clone(),
            class: RatioVerdict::of(row).map_or("", RatioVerdict::words),
            mark: mark(&row.note),
        }
    }
}

/// The footnote sign for a row's note; empty for notes without a footnote in the report.
fn mark(note: &str) -> &'static str {
    if note.contains("extrapolated") {
        "†"
    } else if note.contains("mean curve") {
        "‡"
    } else if note.contains("reference-limited") {
        "§"
    } else if note.contains("arithmetic mean") {
        "¶"
    } else {
        ""
    }
}

/// Formats a value with three significant digits.
pub(super) fn short(value: f64) -> String {
    let size = value.abs();
    match size {
        0.0 => "0".into(),
        s if !(1e-3..99_999.5).contains(&s) => format!("{value:.2e}"),
        s if s >= 99.95 => format!("{value:.0}"),
        s if s >= 9.995 => format!("{value:.1}"),
        s if s >= 0.9995 => format!("{value:.2}"),
        s if s >= 0.099_95 => format!("{value:.3}"),
        s if s >= 0.009_995 => format!("{value:.4}"),
        _ => format!("{value:.5}"),
    }
}

/// Formats a ratio with two decimals; below 0.095 with more, and from 9.995 with fewer.
pub(super) fn ratio(value: f64) -> String {
    match value.abs() {
        s if !(0.01..999.5).contains(&s) => short(value),
        s if s >= 99.95 => format!("{value:.0}"),
        s if s >= 9.995 => format!("{value:.1}"),
        s if s >= 0.095 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}
