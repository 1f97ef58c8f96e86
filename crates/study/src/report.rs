//! The report of a study: `report.html`, `summary.csv` and `runs.csv`.

mod about;
mod chart;
mod gallery;
mod page;
mod tables;

use crate::record::{Method, PHASES, Run};
use crate::summary::{Summary, number};
use crate::{RecordedStudy, StudyError};
use dapple_metrics::{METRICS, Metric};
use dapple_scene::image::write_file;
use std::path::Path;

/// Reads a study, finished or not, and writes its report into the same folder.
///
/// | file | contents |
/// |---|---|
/// | `report.html` | the report: one self-contained file |
/// | `summary.csv` | every value of the report |
/// | `runs.csv` | every run as a line, with CPU seconds |
/// | `viewer/` | images at full resolution for the report's viewer, if they are too large for the page |
///
/// Each file is written completely or not at all. Equal records produce identical files.
///
/// # Errors
/// [`StudyError`] if the study cannot be read or a file cannot be written. Missing or damaged images are no error; the report
/// lists them.
pub fn write_report(folder: &Path) -> Result<Summary, StudyError> {
    let recorded = RecordedStudy::read(folder)?;
    let summary = Summary::of(&recorded);
    let mut table = Vec::new();
    summary.write_csv(&mut table)?;
    let (page, images) = page::render(&recorded, &summary)?;
    write_file(&folder.join("summary.csv"), &table)?;
    write_file(&folder.join("report.html"), page.as_bytes())?;
    write_file(&folder.join("runs.csv"), &runs_csv(&recorded)?)?;
    for (name, contents) in images {
        let file = folder.join(name);
        // If this fails, writing the file fails too, with a clear error.
        let _ = file.parent().map(std::fs::create_dir_all);
        write_file(&file, &contents)?;
    }
    Ok(summary)
}

/// Returns the text of `runs.csv`. Unknown values are empty; `seconds` is wall time, `cpu_seconds` user and system time.
fn runs_csv(recorded: &RecordedStudy) -> Result<Vec<u8>, csv::Error> {
    let manifest = &recorded.manifest;
    let names = chart::names(&manifest.methods);
    let mut writer = csv::Writer::from_writer(Vec::new());
    let head = columns(&Run::default(), "", "");
    writer.write_record(head.iter().map(|(name, _)| name))?;
    for run in &recorded.runs {
        let method = manifest.methods.iter().position(|m| *m == run.method).map_or("", |i| &names[i]);
        let scene = manifest.scenes.iter().find(|scene| scene.name == run.scene);
        let lights = scene.map_or("", |scene| scene.lights.name());
        let line = columns(run, lights, &method.replace('\u{a0}', " "));
        writer.write_record(line.iter().map(|(_, value)| value))?;
    }
    writer.into_inner().map_err(|e| e.into_error().into())
}

/// The columns of `runs.csv` for a run: name and value.
fn columns(run: &Run, lights: &str, method: &str) -> Vec<(String, String)> {
    let known = |value: Option<f64>| value.map_or_else(String::new, number);
    let measured = |metric: &Metric| Some(run.errors.get(metric.name)).filter(|v| !v.is_nan());
    let Method { sampler, points, filter } = &run.method;
    let budget = if run.budget.is_timed() { "time" } else { "spp" };
    let texts = [("scene", &*run.scene), ("lights", lights), ("method", method), ("sampler", sampler)];
    let texts = texts.into_iter().chain([("points", &**points), ("filter", filter), ("budget", budget)]);
    let counts = [("budget_spp", run.budget.spp()), ("seed", run.seed), ("asked", run.asked), ("samples", run.samples)];
    let mut all: Vec<(String, String)> = texts.map(|(name, text)| (name.to_owned(), text.to_owned())).collect();
    let mut add = |name: &str, value: String| all.push((name.to_owned(), value));
    counts.into_iter().for_each(|(name, count)| add(name, count.to_string()));
    add("spp", number(run.spp));
    add("rays", run.rays.to_string());
    add("seconds", number(run.render_s));
    add("cpu_seconds", known(run.cpu_s));
    let phases = PHASES.into_iter().zip(run.seconds.each());
    phases.for_each(|(name, seconds)| add(&format!("seconds_{name}"), number(seconds)));
    METRICS.iter().for_each(|metric| add(metric.name, known(measured(metric))));
    add("predicted_relmse", known(run.predicted_relmse));
    add("corrected", run.corrected.to_string());
    add("reference_limited", run.reference_limited.to_string());
    add("rejected", run.rejected.to_string());
    add("load", known(run.load));
    add("fresh", run.fresh.to_string());
    add("image", run.image.clone().unwrap_or_default());
    all
}
