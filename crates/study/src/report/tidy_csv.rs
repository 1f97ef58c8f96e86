//! The file `runs.csv`: one line per run, one column per value.

use super::method_style::names;
use crate::record::{ImageErrors, Run, RunBudget};
use crate::recorded_study::RecordedStudy;
use crate::summary::{PHASES, number};

/// A function that returns one of a run's errors.
type OfErrors = fn(&ImageErrors) -> f64;

/// The name of each error and the function that returns it.
const ERRORS: [(&str, OfErrors); 8] = [
    ("mse", |e| e.mse),
    ("relmse", |e| e.relmse),
    ("relmse_trimmed", |e| e.relmse_trimmed),
    ("smape", |e| e.smape),
    ("psnr", |e| e.psnr),
    ("srgb8_mse", |e| e.srgb8_mse),
    ("flip", |e| e.flip),
    ("mean_ratio", |e| e.mean_ratio),
];

/// Makes the text of `runs.csv`. Unknown values are empty; `seconds` is wall time, `cpu_seconds` user and system time.
pub(super) fn render(recorded: &RecordedStudy) -> Result<Vec<u8>, csv::Error> {
    let manifest = &recorded.manifest;
    let names = names(&manifest.methods);
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut head: Vec<String> =
        ["scene", "lights", "method", "sampler", "points", "filter", "budget", "budget_spp", "seed"]
            .map(str::to_owned)
            .to_vec();
    head.extend(["asked", "samples", "spp", "rays", "seconds", "cpu_seconds"].map(str::to_owned));
    head.extend(PHASES.iter().map(|(name, _)| format!("seconds_{name}")));
    head.extend(ERRORS.iter().map(|(name, _)| (*name).to_owned()));
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
    let (budget, budget_spp) = match run.budget {
        RunBudget::Spp(spp) => ("spp", spp),
        RunBudget::TimeOf(spp) => ("time", spp),
    };
    let mut line = [&run.scene, lights, method, &run.method.sampler, &run.method.points, &run.method.filter, budget]
        .map(str::to_owned)
        .to_vec();
    line.extend([budget_spp, run.seed, run.asked, run.samples].map(|n| n.to_string()));
    line.extend([number(run.spp), run.rays.to_string(), number(run.render_s), known(run.cpu_s)]);
    line.extend(PHASES.iter().map(|(_, of)| number(of(&run.seconds))));
    line.extend(ERRORS.iter().map(|(_, of)| number(of(&run.errors))));
    line.extend([known(run.predicted_relmse), run.corrected.to_string(), run.reference_limited.to_string()]);
    line.extend([run.rejected.to_string(), known(run.load), run.fresh.to_string()]);
    line.push(run.image.clone().unwrap_or_default());
    line
}
