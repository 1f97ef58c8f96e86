//! The report of a study: `report.html`, `summary.csv` and `runs.csv`.

mod about;
mod chart;
mod gallery;
mod page;
mod tables;

use crate::record::{PHASES, Run};
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
    let mut head: Vec<String> =
        ["scene", "lights", "method", "sampler", "points", "filter", "budget", "budget_spp", "seed"]
            .map(str::to_owned)
            .to_vec();
    head.extend(["asked", "samples", "spp", "rays", "seconds", "cpu_seconds"].map(str::to_owned));
    head.extend(PHASES.iter().map(|(name, _)| format!("seconds_{name}")));
    head.extend(METRICS.iter().map(|metric| metric.name.to_owned()));
    head.extend(
        ["predicted_relmse", "corrected", "reference_limited", "rejected", "load", "fresh", "image"].map(str::to_owned),
    );
    writer.write_record(&head)?;
    for run in &recorded.runs {
        let method = manifest.methods.iter().position(|m| *m == run.method).map_or("", |i| &names[i]);
        let lights =
            manifest.scenes.iter().find(|scene| scene.name == run.scene).map_or("", |scene| scene.lights.name());
        writer.write_record(line(run, lights, &method.replace('\u{a0}', " ")))?;
    }
    writer.into_inner().map_err(|e| e.into_error().into())
}

fn line(run: &Run, lights: &str, method: &str) -> Vec<String> {
    let known = |value: Option<f64>| value.map_or_else(String::new, number);
    let budget = if run.budget.is_timed() { "time" } else { "spp" };
    let mut line = [&run.scene, lights, method, &run.method.sampler, &run.method.points, &run.method.filter, budget]
        .map(str::to_owned)
        .to_vec();
    line.extend([run.budget.spp(), run.seed, run.asked, run.samples].map(|n| n.to_string()));
    line.extend([number(run.spp), run.rays.to_string(), number(run.render_s), known(run.cpu_s)]);
    line.extend(PHASES.iter().map(|(_, of)| number(of(&run.seconds))));
    line.extend(METRICS.iter().map(|metric| known(Some(run.errors.get(metric.name)).filter(|v| !v.is_nan()))));
    line.extend([known(run.predicted_relmse), run.corrected.to_string(), run.reference_limited.to_string()]);
    line.extend([run.rejected.to_string(), known(run.load), run.fresh.to_string()]);
    line.push(run.image.clone().unwrap_or_default());
    line
}
