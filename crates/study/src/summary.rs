//! The statistics of a study, computed from its runs; `summary.csv` and the report contain them.

mod comparison;
mod factorial;
mod per_budget;
mod run_table;
mod seed_statistic;
mod slopes;
mod time_to_error;

pub use comparison::RatioVerdict;
pub(crate) use comparison::{HOLDS, UNFAIR};
pub use factorial::FactorialEffect;

use crate::record::{Method, RunBudget};
use crate::recorded_study::RecordedStudy;
pub(crate) use per_budget::PHASES;
use run_table::RunTable;
use seed_statistic::SeedStatistic;
use std::collections::BTreeMap;

/// The confidence level of all intervals.
pub const CONFIDENCE: f64 = 0.95;

/// The largest relative difference of two render times that count as equal in a comparison.
pub const TIME_TOLERANCE: f64 = 0.1;

/// The error metrics for which methods are compared with the baseline.
pub const COMPARED: [&str; 4] = ["relmse", "relmse_trimmed", "srgb8_mse", "flip"];

/// One value of the summary: a line of `summary.csv`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Row {
    /// The scene's name in the study.
    pub scene: String,
    /// The method: sampler, point set and filter.
    pub method: Method,
    /// The budget, such as `16 spp` or `time of 16 spp`; empty for values over all budgets.
    pub budget: String,
    /// The name of the metric; [`Summary::write_csv`] lists all names.
    pub metric: String,
    /// The value of the metric; `None` if it is unknown, for the reason in `note`.
    pub value: Option<f64>,
    /// The lower end of the 95 % confidence interval over seeds; `None` without an interval.
    pub low: Option<f64>,
    /// The upper end of the 95 % confidence interval over seeds; `None` without an interval.
    pub high: Option<f64>,
    /// The number of seeds from whose runs the value is computed.
    pub n: usize,
    /// Remarks on the value, separated by `; `.
    pub note: String,
}

impl Row {
    /// The row's unique key: scene, method, budget and metric, joined by `|`.
    pub fn key(&self) -> String {
        key(&self.scene, &self.method, &self.budget, &self.metric)
    }

    /// The ends of the 95 % confidence interval, `[low, high]`; `None` without an interval.
    pub fn interval(&self) -> Option<[f64; 2]> {
        Some([self.low?, self.high?])
    }
}

/// All values computed from the runs of a study.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    rows: Vec<Row>,
    places: BTreeMap<String, usize>,
}

fn key(scene: &str, method: &Method, budget: &str, metric: &str) -> String {
    [scene, &method.sampler, &method.points, &method.filter, budget, metric].join("|")
}

impl Summary {
    /// Computes all values for which a study has runs.
    pub fn of(recorded: &RecordedStudy) -> Self {
        let grid = RunTable::new(recorded);
        let mut summary = Self::default();
        per_budget::add(&mut summary, &grid);
        slopes::add(&mut summary, &grid);
        time_to_error::add(&mut summary, &grid);
        comparison::add(&mut summary, &grid);
        factorial::add(&mut summary, &grid);
        summary
    }

    /// All rows, in this order: values of each budget, slopes, times to error levels, comparisons with the baseline,
    /// factorial effects.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Finds the row of a scene, method, budget and metric; `None` if there is no such row.
    pub fn find(&self, scene: &str, method: &Method, budget: &str, metric: &str) -> Option<&Row> {
        self.places.get(&key(scene, method, budget, metric)).map(|&i| &self.rows[i])
    }

    fn add(
        &mut self,
        grid: &RunTable<'_>,
        at: [usize; 2],
        budget: Option<RunBudget>,
        metric: &str,
        figure: SeedStatistic,
    ) {
        let row = Row {
            scene: grid.manifest.scenes[at[0]].name.clone(),
            method: grid.manifest.methods[at[1]].clone(),
            budget: budget.map_or_else(String::new, |budget| budget.to_string()),
            metric: metric.to_owned(),
            value: figure.value,
            low: figure.ends.map(|e| e[0]),
            high: figure.ends.map(|e| e[1]),
            n: figure.n,
            note: figure.note,
        };
        let _ = self.places.insert(row.key(), self.rows.len());
        self.rows.push(row);
    }

    /// Writes `summary.csv`: a header, then one line per row.
    ///
    /// Columns: `scene`, `sampler`, `points`, `filter`, `budget` (empty for values over all budgets), `metric`,
    /// `value`, `low`, `high` (95 % interval over seeds), `n` (seeds), `note`. An unknown value is empty, and its note
    /// gives the reason. Numbers are the shortest that give the same f64.
    ///
    /// Metrics at one budget:
    /// * geometric means: `mse`, `relmse`, `relmse_trimmed`, `smape`, `srgb8_mse`, `flip`, and
    ///   `predicted over true relmse`;
    /// * means: `psnr`, `mean_ratio`, `spp`, and `seconds PHASE` for `load`, `bvh`, `cluster`, `probe`, `plan`,
    ///   `trace`, `filter`;
    /// * the median of [`Run::render_s`](crate::Run::render_s): `seconds`;
    /// * against the baseline, paired by seed: `METRIC ratio`, `seconds ratio`, `relmse x seconds ratio`;
    /// * ratios of the factorial design (see [`FactorialEffect`]): `relmse part of counts`, `relmse part of filter`,
    ///   `relmse part of both`, `relmse part of their interplay`.
    ///
    /// Metrics over all budgets: `relmse slope over spp`, `relmse slope over seconds`, `seconds to relmse E`,
    /// `seconds ratio to relmse E`.
    ///
    /// # Errors
    /// [`csv::Error`] if the writer fails.
    pub fn write_csv(&self, to: impl std::io::Write) -> Result<(), csv::Error> {
        let mut writer = csv::Writer::from_writer(to);
        writer.write_record([
            "scene", "sampler", "points", "filter", "budget", "metric", "value", "low", "high", "n", "note",
        ])?;
        for row in &self.rows {
            let [value, low, high] = [row.value, row.low, row.high].map(|v| v.map_or_else(String::new, number));
            let method = &row.method;
            writer.write_record([
                &row.scene,
                &method.sampler,
                &method.points,
                &method.filter,
                &row.budget,
                &row.metric,
                &value,
                &low,
                &high,
                &row.n.to_string(),
                &row.note,
            ])?;
        }
        writer.flush()?;
        Ok(())
    }
}

/// Formats a value as the shortest decimal that parses to the same f64.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-4..1e7).contains(&size) { format!("{value:e}") } else { value.to_string() }
}
