//! The HTML report: fills the page template with rows of the summary.

use super::comparison_table::{
    ComparisonLine, FactorialLine, MethodVerdicts, factorial_lines, headline, lines, method_verdicts, tally,
};
use super::gallery::{Gallery, gallery};
use super::log_log_chart::{Axis, PlottedCurve, log_log, swatch};
use super::method_style::{MethodStyle, names, styles};
use super::provenance::{busy, commit, made, reference, remarks};
use super::scene_images::SceneImages;
use super::table_cell::TableCell;
use crate::file_names::safe_file_name;
use crate::record::{RunBudget, SceneRecord};
use crate::recorded_study::RecordedStudy;
use crate::summary::{PHASES, Row, Summary};
use askama::Template;

#[derive(Template)]
#[template(path = "report.html")]
struct ReportPage {
    style: &'static str,
    script: &'static str,
    scene_count: usize,
    method_count: usize,
    seed_count: usize,
    budgets: String,
    done: usize,
    expected: usize,
    remarks: Vec<String>,
    baseline: String,
    headline: Option<Headline>,
    equal_spp: Vec<ComparisonLine>,
    scenes: Vec<SceneSection>,
    legend: Vec<LegendEntry>,
    made: Vec<(&'static str, String)>,
    references: Vec<[String; 5]>,
    version: String,
    commit: String,
    /// A warning that the machine was busy.
    busy: Option<String>,
    /// The files beside the report: link and description.
    files: Vec<(String, String)>,
}

/// The comparison with the baseline at the top of the report.
struct Headline {
    timed: bool,
    budget: String,
    spp: u64,
    tally: [usize; 3],
    /// The wins, losses and undecided comparisons in FLIP.
    flip: [usize; 3],
    method_verdicts: Vec<MethodVerdicts>,
    lines: Vec<ComparisonLine>,
    factorial_lines: Vec<FactorialLine>,
}

struct LegendEntry {
    name: String,
    swatch: String,
}

struct SceneSection {
    id: String,
    name: String,
    source: String,
    resolution: [u32; 2],
    over_seconds: Option<String>,
    over_spp: Option<String>,
    levels: Vec<String>,
    costs: Vec<Cost>,
    times: Vec<Times>,
    times_budget: String,
    points: Vec<PointLine>,
    view: SceneImages,
}

/// A method's slopes of error over samples and time, and its times to reach error levels.
struct Cost {
    method: String,
    swatch: String,
    slopes: [TableCell; 2],
    /// The seconds to reach each error level, and their ratio to the baseline's.
    times: Vec<[TableCell; 2]>,
}

/// A method's render time by phase.
struct Times {
    method: String,
    /// The name of each phase, and its time in percent of the slowest method's total.
    shares: Vec<(&'static str, f64)>,
    cells: Vec<TableCell>,
}

struct PointLine {
    method: String,
    budget: String,
    cells: Vec<TableCell>,
    note: String,
}

/// A picture beside the page: its path relative to the study's folder, and its contents.
type PictureFile = (String, Vec<u8>);

/// Makes the page, and the pictures that it shows: paths relative to the study's folder, and contents.
pub(super) fn render(recorded: &RecordedStudy, summary: &Summary) -> Result<(String, Vec<PictureFile>), askama::Error> {
    let manifest = &recorded.manifest;
    let names = names(&manifest.methods);
    let styles = styles(&manifest.methods);
    let budget = headline(recorded, summary);
    let base = manifest.methods.iter().position(|m| *m == manifest.baseline).unwrap_or(0);
    let spp: Vec<RunBudget> = manifest.spp.iter().map(|&spp| RunBudget::Spp(spp)).collect();
    let view = Builder { recorded, summary, names: &names, styles: &styles, budget };
    let mut pictures = Vec::new();
    let mut scenes = Vec::new();
    for (i, scene) in manifest.scenes.iter().enumerate() {
        let mut gallery = gallery(recorded, scene);
        pictures.append(&mut gallery.files);
        scenes.push(view.scene(i, scene, gallery));
    }
    let page = ReportPage {
        style: concat!(include_str!("../../templates/palette.css"), include_str!("../../templates/report.css")),
        script: include_str!("../../templates/report.js"),
        scene_count: manifest.scenes.len(),
        method_count: manifest.methods.len(),
        seed_count: manifest.seeds.len(),
        budgets: manifest.spp.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
        done: recorded.runs.len(),
        expected: recorded.expected(),
        remarks: remarks(recorded),
        baseline: names[base].clone(),
        headline: budget.map(|budget| Headline {
            timed: matches!(budget, RunBudget::TimeOf(_)),
            budget: phrase(budget),
            spp: match budget {
                RunBudget::Spp(spp) | RunBudget::TimeOf(spp) => spp,
            },
            tally: tally(summary, budget, "relmse ratio"),
            flip: tally(summary, budget, "flip ratio"),
            method_verdicts: method_verdicts(recorded, summary, &names, budget),
            lines: lines(recorded, summary, &names, &[budget]),
            factorial_lines: factorial_lines(recorded, summary, budget),
        }),
        equal_spp: lines(recorded, summary, &names, &spp),
        scenes,
        legend: names.iter().zip(&styles).map(|(n, s)| LegendEntry { name: n.clone(), swatch: swatch(*s) }).collect(),
        made: made(recorded),
        references: manifest.scenes.iter().map(reference).collect(),
        version: manifest.version.clone(),
        commit: commit(recorded),
        busy: busy(recorded),
        files: files(recorded),
    };
    Ok((page.render()?, pictures))
}

/// The files beside the report, with descriptions.
fn files(recorded: &RecordedStudy) -> Vec<(String, String)> {
    let about = |file: &str, what: &str| (link(file), what.to_owned());
    let mut files = vec![
        about("runs.csv", "every run of every seed as a line, with CPU seconds"),
        about("runs.jsonl", "the same as JSON"),
        about("summary.csv", "all figures of this page, exact"),
        about("study.json", "settings and machine"),
        about("notebook.ipynb", "a notebook that plots error against time from runs.jsonl"),
        about("latex/tables.tex", "tables for LaTeX (booktabs)"),
        about("latex/study.tex", "a LaTeX document with tables and curves (pgfplots)"),
        about("viewer/index.html", "images for JERI, and for tev"),
    ];
    let plot = |scene: &SceneRecord| format!("plots/{}.svg", safe_file_name(&scene.name));
    files.extend(recorded.manifest.scenes.iter().map(plot).map(|file| about(&file, "error against time")));
    files
}

/// The path of a file beside the report as a link: characters with a meaning in URLs are escaped.
pub(super) fn link(file: &str) -> String {
    let escaped = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'/' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    file.bytes().map(escaped).collect()
}

/// Formats a budget for use in a sentence after "at", such as `16 spp`.
pub(super) fn phrase(budget: RunBudget) -> String {
    match budget {
        RunBudget::Spp(spp) => format!("{spp} spp"),
        RunBudget::TimeOf(spp) => format!("equal time (that of {spp} spp)"),
    }
}

pub(super) struct Builder<'a> {
    pub(super) recorded: &'a RecordedStudy,
    pub(super) summary: &'a Summary,
    pub(super) names: &'a [String],
    pub(super) styles: &'a [MethodStyle],
    pub(super) budget: Option<RunBudget>,
}

impl Builder<'_> {
    fn scene(&self, index: usize, scene: &SceneRecord, gallery: Gallery) -> SceneSection {
        let manifest = &self.recorded.manifest;
        let levels = self.levels(scene);
        let ticks = manifest.spp.iter().map(|&spp| spp as f64).collect();
        let spp = Axis { title: "samples per pixel", ticks: Some(ticks) };
        let over_spp = log_log(&self.curves(scene, "spp"), &spp, &Axis { title: "relMSE", ticks: None });
        // The bars of phases show the same budget as the comparison table.
        let times_budget = self.budget.unwrap_or(RunBudget::Spp(manifest.spp.last().copied().unwrap_or(0)));
        SceneSection {
            id: format!("scene-{index}"),
            name: scene.name.clone(),
            source: scene.source.clone(),
            resolution: scene.resolution,
            over_seconds: self.over_seconds(scene),
            over_spp,
            costs: self.costs(scene, &levels),
            levels,
            times: self.times(scene, times_budget),
            times_budget: phrase(times_budget),
            points: self.points(scene),
            view: self.view(scene, gallery),
        }
    }

    /// The chart of relMSE against seconds, as SVG; `None` without runs.
    pub(super) fn over_seconds(&self, scene: &SceneRecord) -> Option<String> {
        let seconds = Axis { title: "seconds for an image", ticks: None };
        log_log(&self.curves(scene, "seconds"), &seconds, &Axis { title: "relMSE", ticks: None })
    }

    /// The relMSE levels for which the summary has times to reach them, as text.
    pub(super) fn levels(&self, scene: &SceneRecord) -> Vec<String> {
        let mut levels: Vec<String> = Vec::new();
        for row in self.summary.rows().iter().filter(|row| row.scene == scene.name) {
            if let Some(level) = row.metric.strip_prefix("seconds to relmse ")
                && !levels.iter().any(|l| l == level)
            {
                levels.push(level.to_owned());
            }
        }
        levels
    }

    fn curves(&self, scene: &SceneRecord, x: &str) -> Vec<PlottedCurve> {
        self.named_curves(scene, x).into_iter().map(|(_, curve)| curve).collect()
    }

    /// The curves of error over `x`, with the names of their methods.
    pub(super) fn named_curves(&self, scene: &SceneRecord, x: &str) -> Vec<(&str, PlottedCurve)> {
        let manifest = &self.recorded.manifest;
        let of = |(i, method): (usize, &crate::record::Method)| {
            let point = |&spp: &u64| {
                let find =
                    |metric: &str| self.summary.find(&scene.name, method, &RunBudget::Spp(spp).to_string(), metric);
                let error = find("relmse")?;
                let [x, y] = [find(x)?.value?, error.value?];
                let drawn = x > 0.0 && y > 0.0;
                drawn.then(|| (x, y, error.interval().filter(|ends| ends[0] > 0.0)))
            };
            let points = manifest.spp.iter().filter_map(point).collect();
            (self.names[i].as_str(), PlottedCurve { style: self.styles[i], points })
        };
        manifest.methods.iter().enumerate().map(of).filter(|(_, curve)| !curve.points.is_empty()).collect()
    }

    fn costs(&self, scene: &SceneRecord, levels: &[String]) -> Vec<Cost> {
        let of = |(i, method): (usize, &crate::record::Method)| {
            let find = |metric: &str| self.summary.find(&scene.name, method, "", metric);
            let slopes = ["relmse slope over spp", "relmse slope over seconds"].map(find);
            slopes[0]?;
            let time = |level: &String| {
                let seconds = TableCell::of(find(&format!("seconds to relmse {level}")));
                [seconds, TableCell::ratio(find(&format!("seconds ratio to relmse {level}")))]
            };
            Some(Cost {
                method: self.names[i].clone(),
                swatch: swatch(self.styles[i]),
                slopes: slopes.map(TableCell::ratio),
                times: levels.iter().map(time).collect(),
            })
        };
        self.recorded.manifest.methods.iter().enumerate().filter_map(of).collect()
    }

    fn times(&self, scene: &SceneRecord, budget: RunBudget) -> Vec<Times> {
        let words = budget.to_string();
        let mut found: Vec<(usize, Vec<Option<&Row>>)> = Vec::new();
        for (i, method) in self.recorded.manifest.methods.iter().enumerate() {
            let find = |name: &str| self.summary.find(&scene.name, method, &words, &format!("seconds {name}"));
            let rows: Vec<Option<&Row>> = PHASES.iter().map(|(name, _)| find(name)).collect();
            if rows[0].is_some() {
                found.push((i, rows));
            }
        }
        let value = |row: &Option<&Row>| row.and_then(|row| row.value).unwrap_or(0.0).max(0.0);
        let longest = found.iter().map(|(_, rows)| rows.iter().map(value).sum()).fold(0.0, f64::max);
        let share = |row: &Option<&Row>| if longest > 0.0 { 100.0 * value(row) / longest } else { 0.0 };
        let line = |(i, rows): (usize, Vec<Option<&Row>>)| Times {
            method: self.names[i].clone(),
            shares: PHASES.iter().zip(&rows).map(|((name, _), row)| (*name, share(row))).collect(),
            cells: rows.into_iter().map(TableCell::of).collect(),
        };
        found.into_iter().map(line).collect()
    }

    fn points(&self, scene: &SceneRecord) -> Vec<PointLine> {
        let manifest = &self.recorded.manifest;
        let spp = manifest.spp.iter().map(|&spp| RunBudget::Spp(spp));
        let budgets: Vec<RunBudget> = spp.chain(manifest.time_of.map(RunBudget::TimeOf)).collect();
        let mut lines = Vec::new();
        for (method, name) in manifest.methods.iter().zip(self.names) {
            for &budget in &budgets {
                let words = budget.to_string();
                let find = |metric: &str| self.summary.find(&scene.name, method, &words, metric);
                let Some(row) = find("relmse") else { continue };
                let metrics =
                    ["spp", "seconds", "relmse", "relmse_trimmed", "mse", "flip", "psnr", "predicted over true relmse"];
                lines.push(PointLine {
                    method: name.clone(),
                    budget: words.clone(),
                    cells: metrics.iter().map(|metric| TableCell::of(find(metric))).collect(),
                    note: row.note.clone(),
                });
            }
        }
        lines
    }
}
