//! The header of an OpenEXR file: settings and results of the render.

use crate::{BudgetSpec, Job, RenderedImage, pixel_filter};
use dapple_core::{Combine, Film};

/// All settings and results of the render, as pairs of attribute name and text. `cpu` is the processor time in seconds;
/// `None` if unknown.
pub(super) fn attributes(job: &Job, image: &RenderedImage, cpu: Option<f64>) -> Vec<(String, String)> {
    let (spec, scene, film) = (job.spec(), job.scene(), &image.film);
    let (record, frame, limits) = (film.record(), job.frame(), job.limits());
    let [[w, h], [x, y], [cw, ch]] = [frame.resolution(), frame.origin(), frame.size()];
    let budgets: Vec<String> = record.budgets.iter().map(u64::to_string).collect();
    let notices: Vec<String> = scene.notices.iter().map(|n| format!("{}: {}", n.source, n.message)).collect();
    let effects: Vec<&str> = job.world().effects().called().iter().map(|c| c.effect.name()).collect();
    let without: Vec<&str> = job.prepared().without().iter().map(|e| e.name()).collect();
    let list = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("scene", scene.name.clone()),
        ("scene-file", scene.camera.source.file.display().to_string()),
        ("sampler", job.sampler_described().to_owned()),
        ("points", job.points_described().to_owned()),
        ("filter", image.filter.clone()),
        ("integrator", job.integrator().to_owned()),
        ("pixel-filter", pixel_filter(&scene.film.pixel_filter)),
        ("seed", spec.seed.to_string()),
        ("budget", budget(job)),
        ("budgets", budgets.join(",")),
        ("min-spp", limits.min_spp.to_string()),
        ("max-spp", limits.max_spp.to_string()),
        ("resolution", format!("{w}x{h}")),
        ("crop", format!("{x},{y},{},{}", x + cw, y + ch)),
        ("max-depth", scene.max_depth.map_or("unlimited".into(), |d| d.to_string())),
        ("light-selection", spec.selection().name().to_owned()),
        ("effects", effects.join(",")),
        ("without", without.join(",")),
        ("notices", notices.join("\n")),
        ("samples", record.samples.to_string()),
        ("spp", image.spp().to_string()),
        ("rays", image.rays().to_string()),
        ("probe-rays", image.probe_rays.to_string()),
        ("rejected", record.rejected.to_string()),
        ("predicted-relmse", film.predicted_relmse().map_or("unknown".into(), |e| e.to_string())),
        ("predicted-relmse-filtered", record.filtered_relmse.map_or("unknown".into(), |e| e.to_string())),
        ("bias", bias(job, image)),
        // A checked description can be written.
        ("spec", spec.to_json().unwrap_or_default()),
        ("interrupted", record.interrupted.to_string()),
        ("threads", rayon::current_num_threads().to_string()),
        // Serialising plain numbers cannot fail.
        ("seconds", serde_json::to_string(&image.seconds).unwrap_or_default()),
        ("cpu-seconds", cpu.map_or("unknown".into(), |s| s.to_string())),
    ];
    // A text attribute is never empty, so that every reader shows it.
    let filled = |text: String| if text.is_empty() { "none".to_owned() } else { text };
    list.into_iter().map(|(key, text)| (format!("dapple:{key}"), filled(text))).collect()
}

/// Formats the budget in the unit in which the user set it.
fn budget(job: &Job) -> String {
    match job.spec().budget {
        BudgetSpec::Seconds(seconds) => format!("{seconds} seconds"),
        BudgetSpec::Error(relmse) => {
            let most = job.spec().max_spp.unwrap_or(crate::ERROR_SPP);
            format!("relMSE {relmse} of the {} image, at most {most} spp", job.error_concerns())
        }
        BudgetSpec::Samples(samples) => format!("{samples} samples"),
        BudgetSpec::Scene => "of the scene".into(),
        BudgetSpec::Spp(spp) => match job.limits().budget {
            dapple_core::Budget::Samples(samples) => format!("{spp} spp, {samples} samples"),
            _ => format!("{spp} spp"),
        },
    }
}

/// A phrase about the bias of the image, from its samples and its filter.
fn bias(job: &Job, image: &RenderedImage) -> String {
    let samples = bias_of_samples(job, &image.film);
    match image.filter.as_str() {
        "none" => samples.to_owned(),
        _ => format!("biased: by the filter, less so with more samples; the samples by themselves {samples}"),
    }
}

/// A phrase about the bias of the unfiltered image: samples that decide sample counts bias an image that contains them
/// [Kirk and Arvo 1991].
fn bias_of_samples(job: &Job, film: &Film) -> &'static str {
    let rounds = &film.record().rounds;
    let decided = rounds.split_last().is_some_and(|(_, deciding)| deciding.iter().any(|round| round.kept));
    match film.combine() {
        _ if matches!(job.spec().budget, BudgetSpec::Error(_)) => {
            "biased: the predicted error of the samples in the image decided when to stop"
        }
        _ if job.is_a_priori() || !decided => "none: no sample of the image decided on its counts",
        Combine::Equally => "none: each half's counts were decided by the other half's samples",
        _ => "biased: samples that are or were in the image decided on its counts",
    }
}
