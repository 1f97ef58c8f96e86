//! The statistics of a study, computed from its runs. They are the contents of `summary.csv` and of the report.

mod comparison;

pub use comparison::RatioVerdict;
pub(crate) use comparison::{HOLDS, UNFAIR};

use crate::RecordedStudy;
use crate::record::{Manifest, Method, PHASES, Run, RunBudget};
use comparison::SeedStatistic;
use dapple_metrics::{Better, METRICS, Metric};
use std::collections::BTreeMap;

/// The confidence level of all intervals.
pub const CONFIDENCE: f64 = 0.95;

/// The largest relative difference at which a comparison regards two render times as equal.
pub const TIME_TOLERANCE: f64 = 0.1;

/// Iterates over the metrics by which methods are compared with the baseline: those of [`METRICS`] where lower is better.
pub fn compared() -> impl Iterator<Item = &'static Metric> {
    METRICS.iter().filter(|metric| metric.better == Better::Lower)
}

/// One value of the summary: a line of `summary.csv`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Row {
    /// The scene's name in the study.
    pub scene: String,
    /// The method: sampler, point set and filter.
    pub method: Method,
    /// The budget, such as `16 spp` or `time of 16 spp`.
    pub budget: String,
    /// The name of the metric; [`Summary::write_csv`] lists all names.
    pub metric: String,
    /// The value of the metric; `None` if unknown, and `note` then gives the reason.
    pub value: Option<f64>,
    /// The lower end of the 95 % confidence interval over seeds; `None` without an interval.
    pub low: Option<f64>,
    /// The upper end of the 95 % confidence interval over seeds; `None` without an interval.
    pub high: Option<f64>,
    /// The number of seeds over which the value is computed.
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
        add_budgets(&mut summary, &grid);
        comparison::add(&mut summary, &grid);
        summary
    }

    /// All rows: values at each budget, then comparisons with the baseline.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Finds the row of a scene, method, budget and metric; `None` if the study lacks it.
    pub fn find(&self, scene: &str, method: &Method, budget: &str, metric: &str) -> Option<&Row> {
        self.places.get(&key(scene, method, budget, metric)).map(|&i| &self.rows[i])
    }

    fn add(&mut self, grid: &RunTable<'_>, at: [usize; 2], budget: RunBudget, metric: &str, figure: SeedStatistic) {
        let row = Row {
            scene: grid.manifest.scenes[at[0]].name.clone(),
            method: grid.manifest.methods[at[1]].clone(),
            budget: budget.to_string(),
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
    /// Columns: `scene`, `sampler`, `points`, `filter`, `budget`, `metric`, `value`, `low`, `high` (95 % interval over seeds),
    /// `n` (seeds), `note`. An unknown value is empty, and its note gives the reason. Numbers are written as the shortest
    /// decimals that parse to the same f64.
    ///
    /// Metrics at one budget:
    /// * geometric means: the [`METRICS`] where lower is better, and `predicted over true relmse`;
    /// * means: the other [`METRICS`], `spp`, and `seconds PHASE` for `load`, `bvh`, `cluster`, `first_hits`, `plan`, `trace`,
    ///   `filter`;
    /// * medians: `seconds`, which is [`Run::render_s`];
    /// * against the baseline, paired by seed: `METRIC ratio`, `seconds ratio`, `relmse x seconds ratio`.
    ///
    /// # Errors
    /// [`csv::Error`] if the writer fails.
    pub fn write_csv(&self, to: impl std::io::Write) -> Result<(), csv::Error> {
        let mut writer = csv::Writer::from_writer(to);
        writer.write_record([
            "scene", "sampler", "points", "filter", "budget", "metric", "value", "low", "high", "n", "note",
        ])?;
        for row in &self.rows {
            let Row { scene, method: Method { sampler, points, filter }, budget, metric, note, .. } = row;
            let [value, low, high] = [row.value, row.low, row.high].map(|v| v.map_or_else(String::new, number));
            let n = row.n.to_string();
            writer.write_record([scene, sampler, points, filter, budget, metric, &value, &low, &high, &n, note])?;
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

/// The runs of one scene, method and budget, by seed.
type Seeds<'a> = BTreeMap<u64, &'a Run>;

/// All runs of a study, by the indices of their scenes and methods in the manifest.
struct RunTable<'a> {
    manifest: &'a Manifest,
    baseline: usize,
    cells: BTreeMap<([usize; 2], RunBudget), Seeds<'a>>,
}

impl<'a> RunTable<'a> {
    fn new(recorded: &'a RecordedStudy) -> Self {
        let manifest = &recorded.manifest;
        let mut cells: BTreeMap<_, Seeds<'a>> = BTreeMap::new();
        for run in &recorded.runs {
            let scene = manifest.scenes.iter().position(|s| s.name == run.scene);
            let method = manifest.methods.iter().position(|m| *m == run.method);
            if let (Some(scene), Some(method)) = (scene, method) {
                let _ = cells.entry(([scene, method], run.budget)).or_default().insert(run.seed, run);
            }
        }
        let baseline = manifest.methods.iter().position(|m| *m == manifest.baseline).unwrap_or(0);
        Self { manifest, baseline, cells }
    }

    /// The indices of every pair of scene and method, scene by scene.
    fn all(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let [scenes, methods] = [self.manifest.scenes.len(), self.manifest.methods.len()];
        (0..scenes).flat_map(move |scene| (0..methods).map(move |method| [scene, method]))
    }

    /// The runs of two methods on one scene at one budget, paired by seed.
    fn pairs(&self, scene: usize, methods: [usize; 2], budget: RunBudget) -> Vec<[&'a Run; 2]> {
        let [a, b] = methods.map(|method| self.cells.get(&([scene, method], budget)));
        a.into_iter().flatten().filter_map(|(seed, run)| Some([*run, *b?.get(seed)?])).collect()
    }
}

/// Adds errors, times and error predictions of each method at each budget.
fn add_budgets(summary: &mut Summary, grid: &RunTable<'_>) {
    for at in grid.all() {
        for budget in grid.manifest.budgets() {
            let Some(runs) = grid.cells.get(&(at, budget)) else { continue };
            let values = |of: &dyn Fn(&Run) -> f64| -> Vec<f64> { runs.values().map(|run| of(run)).collect() };
            let mut put = |metric: &str, figure| summary.add(grid, at, budget, metric, figure);
            for metric in METRICS {
                let values = values(&|run| run.errors.get(metric.name));
                let figure = match metric.better {
                    Better::Lower => SeedStatistic::geometric(&values),
                    Better::Higher | Better::NearOne => SeedStatistic::arithmetic(&values),
                };
                let squared = metric.name.ends_with("mse");
                put(metric.name, if squared { figure.noted(&marks(runs)) } else { figure });
            }
            put("spp", SeedStatistic::arithmetic(&values(&|run| run.spp)));
            put("seconds", SeedStatistic::bare(median(values(&|run| run.render_s)), runs.len()).noted("median"));
            for (at, name) in PHASES.into_iter().enumerate() {
                put(&format!("seconds {name}"), SeedStatistic::arithmetic(&values(&|run| run.seconds.each()[at])));
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
    let ratio = |run: &&Run| Some(run.predicted_relmse? / run.errors.get("relmse"));
    runs.values().filter_map(ratio).filter(|ratio| ratio.is_finite()).collect()
}

/// A note on the reference's noise: the number of runs whose precision it limits, and the number of runs corrected for it.
/// Empty if both are 0.
fn marks(runs: &Seeds<'_>) -> String {
    let count = |of: fn(&Run) -> bool| runs.values().filter(|run| of(run)).count();
    let limited = ("reference-limited", count(|run| run.reference_limited));
    let corrected = ("corrected for the reference", count(|run| run.corrected));
    let noted = [limited, corrected].into_iter().filter(|(_, count)| *count > 0);
    noted.map(|(words, count)| format!("{words} in {count} of {}", runs.len())).collect::<Vec<_>>().join("; ")
}

/// The median; for an even number of values, the mean of the middle two; NaN without values.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { f64::NAN } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}
