//! The data of the HTML report's template.

use super::about::{busy, commit, lights, load, quoted, remarks};
use super::chart::{MethodStyle, PlottedCurve, log_log, names, styles};
use super::gallery::{SceneImages, error_ticks};
use super::tables::{Line, TableCell, headline, lines, short, tally};
use crate::RecordedStudy;
use crate::record::{Manifest, PHASES, RunBudget, SceneRecord};
use crate::summary::{Summary, compared};
use askama::Template;
use dapple_metrics::METRICS;

/// The page. Its template shows the study, and tables that are computed here.
#[derive(Template)]
#[template(path = "report.html")]
pub(super) struct ReportPage<'a> {
    pub(super) recorded: &'a RecordedStudy,
    pub(super) summary: &'a Summary,
    manifest: &'a Manifest,
    style: &'static str,
    script: &'static str,
    pub(super) names: Vec<String>,
    pub(super) styles: Vec<MethodStyle>,
    baseline: String,
    /// The budget of the first comparison; `None` without runs to compare.
    headline: Option<RunBudget>,
    comparison: Vec<Line>,
    equal_spp: Vec<Line>,
    scenes: Vec<SceneSection>,
}

/// The tables, charts and images of a scene.
struct SceneSection {
    record: SceneRecord,
    over_seconds: Option<String>,
    over_spp: Option<String>,
    points: Vec<Line>,
    /// The seconds of each phase at one budget, and the slowest method's total.
    phases: Vec<Line>,
    longest: f64,
    view: SceneImages,
}

/// The groups of verdicts on a method: metric, verdict, and the start of a sentence.
const VERDICTS: [(&str, &str, &str); 4] = [
    ("relmse", "win", "wins on"),
    ("relmse", "loss", "loses on"),
    ("relmse", "undecided", "is undecided on"),
    ("flip", "loss", "loses in FLIP on"),
];

/// An image file beside the page: the path relative to the study's folder, and the contents.
type PictureFile = (String, Vec<u8>);

/// Renders the page. Also returns the image files that the page links to.
pub(super) fn render(recorded: &RecordedStudy, summary: &Summary) -> Result<(String, Vec<PictureFile>), askama::Error> {
    let manifest = &recorded.manifest;
    let names = names(&manifest.methods);
    let headline = headline(recorded, summary);
    let base = manifest.methods.iter().position(|m| *m == manifest.baseline).unwrap_or(0);
    let spp: Vec<RunBudget> = manifest.spp.iter().map(|&spp| RunBudget::Spp(spp)).collect();
    let ratios = compared().map(|metric| format!("{} ratio", metric.name));
    let ratios: Vec<String> = ratios.chain(["seconds ratio", "relmse x seconds ratio"].map(str::to_owned)).collect();
    let methods: Vec<_> = manifest.methods.iter().zip(&names).collect();
    let compare = |budgets: &[RunBudget]| {
        let of = |scene| lines(summary, scene, &methods, budgets, ("relmse ratio", &ratios));
        manifest.scenes.iter().flat_map(of).collect::<Vec<Line>>()
    };
    let mut page = ReportPage {
        recorded,
        summary,
        manifest,
        style: concat!(include_str!("../../templates/palette.css"), include_str!("../../templates/report.css")),
        script: include_str!("../../templates/report.js"),
        styles: styles(&manifest.methods),
        baseline: names[base].clone(),
        headline,
        comparison: compare(headline.as_slice()),
        equal_spp: compare(&spp),
        scenes: Vec::new(),
        names,
    };
    let mut scenes: Vec<SceneSection> = manifest.scenes.iter().map(|scene| page.scene(scene)).collect();
    let pictures = scenes.iter_mut().flat_map(|scene| std::mem::take(&mut scene.view.files)).collect();
    page.scenes = scenes;
    Ok((page.render()?, pictures))
}

/// The path of a file beside the report as a link; special characters of URLs are escaped.
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

impl ReportPage<'_> {
    fn scene(&self, scene: &SceneRecord) -> SceneSection {
        let manifest = self.manifest;
        let methods: Vec<_> = manifest.methods.iter().zip(&self.names).collect();
        let table = |budgets: &[RunBudget], key: &str, metrics: &[String]| {
            lines(self.summary, scene, &methods, budgets, (key, metrics))
        };
        let budgets: Vec<RunBudget> = manifest.budgets().collect();
        let errors = METRICS.iter().map(|metric| metric.name);
        let metrics = ["spp", "seconds"].into_iter().chain(errors).chain(["predicted over true relmse"]);
        let phases = table(&[self.phases_budget()], "seconds load", &PHASES.map(|name| format!("seconds {name}")));
        let total = |line: &Line| line.cells.iter().map(|cell| cell.number).sum();
        let ticks: Vec<f64> = manifest.spp.iter().map(|&spp| spp as f64).collect();
        SceneSection {
            record: scene.clone(),
            over_seconds: log_log(&self.curves(scene, "seconds"), "seconds for an image", None),
            over_spp: log_log(&self.curves(scene, "spp"), "samples per pixel", Some(&ticks)),
            points: table(&budgets, "relmse", &metrics.map(str::to_owned).collect::<Vec<_>>()),
            longest: phases.iter().map(total).fold(f64::MIN_POSITIVE, f64::max),
            phases,
            view: self.images(scene),
        }
    }

    /// The budget of the table of phases: the budget of the first comparison, else the largest spp.
    fn phases_budget(&self) -> RunBudget {
        self.headline.unwrap_or(RunBudget::Spp(self.manifest.spp.last().copied().unwrap_or(0)))
    }

    /// The curves of relMSE over the metric `x`, such as `seconds`.
    fn curves(&self, scene: &SceneRecord, x: &str) -> Vec<PlottedCurve> {
        let curve = |(method, style): (_, &MethodStyle)| {
            let point = |&spp: &u64| {
                let budget = RunBudget::Spp(spp).to_string();
                let find = |metric: &str| self.summary.find(&scene.name, method, &budget, metric);
                let error = find("relmse")?;
                let [x, y] = [find(x)?.value?, error.value?];
                let interval = error.interval().filter(|ends| ends[0] > 0.0);
                (x > 0.0 && y > 0.0).then_some((x, y, interval))
            };
            PlottedCurve { style: *style, points: self.manifest.spp.iter().filter_map(point).collect() }
        };
        let curves = self.manifest.methods.iter().zip(&self.styles).map(curve);
        curves.filter(|curve| !curve.points.is_empty()).collect()
    }

    /// The scenes on which a method's comparison by `metric` has the verdict `class`, and the ratio on each.
    fn verdicts(&self, method: &str, metric: &str, class: &str) -> Vec<(&str, &TableCell)> {
        let at = compared().position(|one| one.name == metric).unwrap_or(0);
        let of_method = self.comparison.iter().filter(|line| line.method == method);
        let cells = of_method.map(|line| (line.scene.as_str(), &line.cells[at]));
        cells.filter(|(_, cell)| cell.class == class).collect()
    }
}
