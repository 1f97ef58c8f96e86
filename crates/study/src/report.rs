//! The report of a study: `report.html`, `summary.csv` and `runs.csv`.

mod about;
mod chart;
mod gallery;
mod page;
mod tables;

use crate::record::{Method, PHASES, Run};
use crate::summary::{Summary, number};
use crate::{RecordedStudy, StudyError};
use dapple_metrics::METRICS;
use dapple_scene::image::write_file;
use std::path::Path;

/// Reads a study, finished or not, and writes its report into the same folder.
///
/// | file | contents |
/// |---|---|
/// | `report.html` | the report: one file that needs neither network nor folder |
/// | `summary.csv` | every value of the report |
/// | `runs.csv` | every run as a line, with CPU seconds |
/// | `viewer/` | images at full resolution for the report's viewer, if they are too large for the page |
///
/// Each file is written completely or not at all. Equal records give equal bytes.
///
/// # Errors
/// [`StudyError`] if the study cannot be read or a file cannot be written. Missing or broken images are no error; the
/// report lists them.
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

/// Makes the text of `runs.csv`. Unknown values are empty; `seconds` is wall time, `cpu_seconds` user and system time.
fn runs_csv(recorded: &RecordedStudy) -> Result<Vec<u8>, csv::Error> {
    let manifest = &recorded.manifest;
    let names = chart::names(&manifest.methods);
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(columns(&Run::default(), "", "").map(|(name, _)| name))?;
    for run in &recorded.runs {
        let method = manifest.methods.iter().position(|m| *m == run.method).map_or("", |i| &names[i]);
        let scene = manifest.scenes.iter().find(|scene| scene.name == run.scene);
        let lights = scene.map_or("", |scene| scene.lights.name());
        writer.write_record(columns(run, lights, &method.replace('\u{a0}', " ")).map(|(_, value)| value))?;
    }
    writer.into_inner().map_err(|e| e.into_error().into())
}

/// The name and the value of each column.
fn columns(run: &Run, lights: &str, method: &str) -> impl Iterator<Item = (String, String)> {
    let known = |value: Option<f64>| value.filter(|v| !v.is_nan()).map_or_else(String::new, number);
    let Run { scene, method: Method { sampler, points, filter }, budget, .. } = run;
    let named = |name: &str, value: &dyn ToString| (name.to_owned(), value.to_string());
    let first = [
        named("scene", scene),
        named("lights", &lights),
        named("method", &method),
        named("sampler", sampler),
        named("points", points),
        named("filter", filter),
        named("budget", &if budget.is_timed() { "time" } else { "spp" }),
        named("budget_spp", &budget.spp()),
        named("seed", &run.seed),
        named("asked", &run.asked),
        named("samples", &run.samples),
        named("spp", &number(run.spp)),
        named("rays", &run.rays),
        named("seconds", &number(run.render_s)),
        named("cpu_seconds", &known(run.cpu_s)),
    ];
    let last = [
        named("predicted_relmse", &known(run.predicted_relmse)),
        named("corrected", &run.corrected),
        named("reference_limited", &run.reference_limited),
        named("rejected", &run.rejected),
        named("load", &known(run.load)),
        named("fresh", &run.fresh),
        named("image", &run.image.as_deref().unwrap_or_default()),
    ];
    let phases = PHASES.iter().map(|(name, of)| (format!("seconds_{name}"), number(of(&run.seconds))));
    let errors = METRICS.iter().map(move |metric| named(metric.name, &known(Some(run.errors.get(metric.name)))));
    first.into_iter().chain(phases).chain(errors).chain(last)
}
