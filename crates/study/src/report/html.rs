//! The HTML report: fills the page template with rows of the summary.

use super::comparison_table::{
    ComparisonLine, FactorialLine, MethodVerdicts, factorial_lines, headline, lines, method_verdicts, tally,
};
use super::gallery::{ERROR_DECADES, Embedded, Gallery, gallery};
use super::log_log_chart::{Axis, PlottedCurve, log_log, swatch, tick_words};
use super::method_style::{MethodStyle, names, styles};
use super::table_cell::{TableCell, short};
use crate::record::{RunBudget, SceneRecord};
use crate::recorded_study::RecordedStudy;
use crate::summary::{PHASES, Row, Summary, number};
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
    /// The smallest and the largest error of the error maps' colour scale, as text.
    error_scale: [String; 2],
}

/// The comparison with the baseline at the top of the report.
struct Headline {
    timed: bool,
    budget: String,
    spp: u64,
    tally: [usize; 3],
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

/// The images of one scene, with captions, as the template needs them.
struct SceneImages {
    budget: String,
    exposure: String,
    overview: Option<Embedded>,
    marks: Vec<CropMark>,
    reference_crops: Vec<Embedded>,
    tiles: Vec<MethodTile>,
    problems: Vec<String>,
}

/// The rectangle of a crop in the overview image, as CSS percentages.
struct CropMark {
    label: &'static str,
    place: String,
}

struct MethodTile {
    method: String,
    swatch: String,
    ratio: Option<TableCell>,
    baseline: bool,
    crops: Vec<(Embedded, &'static str)>,
    error_map: Option<Embedded>,
    sample_map: Option<Embedded>,
    white: Option<String>,
}

const CROP_LABELS: [&str; 2] = ["A: where methods differ most", "B: a typical part"];

pub(super) fn render(recorded: &RecordedStudy, summary: &Summary) -> Result<String, askama::Error> {
    let manifest = &recorded.manifest;
    let names = names(&manifest.methods);
    let styles = styles(&manifest.methods);
    let budget = headline(recorded, summary);
    let base = manifest.methods.iter().position(|m| *m == manifest.baseline).unwrap_or(0);
    let spp: Vec<RunBudget> = manifest.spp.iter().map(|&spp| RunBudget::Spp(spp)).collect();
    let view = Builder { recorded, summary, names: &names, styles: &styles, budget };
    ReportPage {
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
            tally: tally(summary, budget),
            method_verdicts: method_verdicts(recorded, summary, &names, budget),
            lines: lines(recorded, summary, &names, &[budget]),
            factorial_lines: factorial_lines(recorded, summary, budget),
        }),
        equal_spp: lines(recorded, summary, &names, &spp),
        scenes: manifest.scenes.iter().enumerate().map(|(i, scene)| view.scene(i, scene)).collect(),
        legend: names.iter().zip(&styles).map(|(n, s)| LegendEntry { name: n.clone(), swatch: swatch(*s) }).collect(),
        made: made(recorded),
        references: manifest.scenes.iter().map(reference).collect(),
        error_scale: ERROR_DECADES.map(|decade| tick_words(libm::pow(10.0, decade))),
    }
    .render()
}

/// Sentences about unusual records: foreign, repeated or incomplete lines of `runs.jsonl`, and rejected samples.
fn remarks(recorded: &RecordedStudy) -> Vec<String> {
    let mut remarks = Vec::new();
    let mut remark = |count: usize, words: &str| {
        if count > 0 {
            remarks.push(format!("{count} {words}"));
        }
    };
    remark(
        recorded.foreign,
        "lines of runs.jsonl belong to no scene, method, budget or seed of this study and were left out.",
    );
    remark(recorded.repeated, "runs were made twice; the last one counts.");
    remark(usize::from(recorded.torn), "line of runs.jsonl was cut off at its end and was left out.");
    let rejected = recorded.runs.iter().filter(|run| run.rejected > 0).count();
    remark(rejected, "runs had samples that were NaN, infinite or negative.");
    remarks
}

fn made(recorded: &RecordedStudy) -> Vec<(&'static str, String)> {
    let m = &recorded.manifest;
    let unknown = || "unknown".to_owned();
    let loads: Vec<f64> = recorded.runs.iter().filter_map(|run| run.load).collect();
    let load = if loads.is_empty() {
        unknown()
    } else {
        let [low, high] =
            [loads.iter().copied().fold(f64::INFINITY, f64::min), loads.iter().copied().fold(0.0, f64::max)];
        format!("{low:.2} to {high:.2} (one-minute average before each run)")
    };
    let fresh = recorded.runs.iter().filter(|run| run.fresh).count();
    let quote = |word: &String| {
        let plain = !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c));
        if plain { word.clone() } else { format!("'{}'", word.replace('\'', "'\\''")) }
    };
    vec![
        ("Command", m.command.iter().map(quote).collect::<Vec<_>>().join(" ")),
        ("Version", m.version.clone()),
        ("Commit", m.commit.clone().unwrap_or_else(unknown)),
        ("Began", m.began.clone()),
        ("Processor", m.machine.processor.clone().unwrap_or_else(unknown)),
        ("Threads", m.machine.threads.to_string()),
        ("System", m.machine.system.clone()),
        ("Load", load),
        ("Depth", m.max_depth.map_or_else(|| "each scene's".into(), |depth| format!("at most {depth}"))),
        ("Processes", format!("{fresh} of {} runs in a process of their own", recorded.runs.len())),
        ("Seeds", m.seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
        ("Runs", format!("{} of {}", recorded.runs.len(), recorded.expected())),
    ]
}

fn reference(scene: &SceneRecord) -> [String; 5] {
    let r = &scene.reference;
    let unknown = || "unknown".to_owned();
    let seeds = r.seeds.map(|s| format!(", seeds {} and {}", s[0], s[1])).unwrap_or_default();
    let points = r.points.as_ref().map(|p| format!("{p}{seeds}"));
    let spp = r.spp.map(|spp| spp.to_string());
    let short_hash: String = r.hash.chars().take(16).collect();
    [
        r.file.clone(),
        spp.unwrap_or_else(unknown),
        points.unwrap_or_else(unknown),
        r.relmse.map_or_else(unknown, short),
        short_hash,
    ]
}

/// Formats a budget for use in a sentence after "at", such as `16 spp`.
fn phrase(budget: RunBudget) -> String {
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
    fn scene(&self, index: usize, scene: &SceneRecord) -> SceneSection {
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
            view: self.view(scene, gallery(self.recorded, scene)),
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
            PlottedCurve { style: self.styles[i], points: manifest.spp.iter().filter_map(point).collect() }
        };
        manifest.methods.iter().enumerate().map(of).filter(|curve| !curve.points.is_empty()).collect()
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

    fn view(&self, scene: &SceneRecord, gallery: Gallery) -> SceneImages {
        let manifest = &self.recorded.manifest;
        let words = gallery.budget.map(|budget| budget.to_string()).unwrap_or_default();
        let percent = |part: u32, whole: u32| 100.0 * f64::from(part) / f64::from(whole.max(1));
        let mark = |(crop, label): (&[u32; 4], &&'static str)| {
            let [w, h] = scene.resolution;
            let [x, y, cw, ch] = [percent(crop[0], w), percent(crop[1], h), percent(crop[2], w), percent(crop[3], h)];
            CropMark { label: &label[..1], place: format!("left:{x:.2}%;top:{y:.2}%;width:{cw:.2}%;height:{ch:.2}%") }
        };
        let tile = |tile: super::gallery::MethodImages| {
            let method = &manifest.methods[tile.method];
            let row = self.summary.find(&scene.name, method, &words, "relmse ratio");
            MethodTile {
                method: self.names[tile.method].clone(),
                swatch: swatch(self.styles[tile.method]),
                ratio: row.map(|row| TableCell::ratio(Some(row))),
                baseline: *method == manifest.baseline,
                crops: tile.crops.into_iter().zip(CROP_LABELS).collect(),
                error_map: tile.error_map,
                sample_map: tile.sample_map,
                white: tile.white.map(|white| if white.fract() == 0.0 { number(white) } else { short(white) }),
            }
        };
        SceneImages {
            budget: gallery.budget.map(phrase).unwrap_or_default(),
            exposure: match gallery.exposure_stops {
                0.0 => "as rendered".into(),
                stops => format!("{stops:+} stops").replace('-', "−"),
            },
            marks: gallery.crops.iter().zip(&CROP_LABELS).map(mark).collect(),
            overview: gallery.overview,
            reference_crops: gallery.reference_crops,
            tiles: gallery.tiles.into_iter().map(tile).collect(),
            problems: gallery.problems,
        }
    }
}
