//! Formatting of a render's result as a line of JSON and as a summary.

use dapple_job::memory::{MemoryEstimate, resident, size};
use dapple_job::{Job, PhaseSeconds, RenderedImage};
use serde::Serialize;

/// A finished image with its job, from which the result is formatted.
pub(super) struct Report<'a> {
    pub(super) job: &'a Job,
    pub(super) image: &'a RenderedImage,
    pub(super) cpu: Option<f64>,
    /// The estimated memory of the render; `None` for merged shards, which other machines rendered.
    pub(super) expected: Option<&'a MemoryEstimate>,
}

/// The JSON line that is printed; its keys have the order of the fields. An unknown value is null.
#[derive(Serialize)]
struct Line<'a> {
    scene: &'a str,
    sampler: &'a str,
    points: &'a str,
    filter: &'a str,
    seed: u64,
    threads: usize,
    resolution: [u32; 2],
    samples: u64,
    spp: f64,
    rays: u64,
    seconds: PhaseSeconds,
    render_s: f64,
    cpu: Option<f64>,
    predicted_relmse: Option<f64>,
    predicted_relmse_filtered: Option<f64>,
    rejected: u64,
    effects: Vec<&'static str>,
    without: Vec<&'static str>,
}

impl Report<'_> {
    /// Formats the result of the render as one line of JSON.
    pub(super) fn json(&self) -> String {
        let (job, image, record) = (self.job, self.image, self.image.film.record());
        let line = Line {
            scene: &job.scene().name,
            sampler: job.sampler_described(),
            points: job.points_described(),
            filter: &image.filter,
            seed: job.spec().seed,
            threads: rayon::current_num_threads(),
            resolution: job.frame().resolution(),
            samples: record.samples,
            spp: image.spp(),
            rays: image.rays(),
            seconds: image.seconds,
            render_s: image.seconds.render(),
            cpu: self.cpu,
            predicted_relmse: image.film.predicted_relmse(),
            predicted_relmse_filtered: record.filtered_relmse,
            rejected: record.rejected,
            effects: job.world().effects().called().iter().map(|c| c.effect.name()).collect(),
            without: job.prepared().without().iter().map(|e| e.name()).collect(),
        };
        // Serialising plain numbers and text cannot fail.
        serde_json::to_string(&line).unwrap_or_default()
    }

    /// Formats the result of the render as at most five lines of text. The settings are in the header of EXR files, and in
    /// the line of JSON.
    pub(super) fn summary(&self) -> String {
        let (job, image, film) = (self.job, self.image, &self.image.film);
        let [w, h] = film.frame().size();
        let seconds = image.seconds.render();
        let counts = film.counts();
        let (least, most) = (counts.iter().min().copied().unwrap_or(0), counts.iter().max().copied().unwrap_or(0));
        let rate = film.record().rays as f64 / image.seconds.trace.max(1e-9) * 1e-6;
        let mut lines = vec![
            format!("{}, {w}x{h}: {:.2} spp ({least} to {most}) in {seconds:.2} s", job.scene().name, image.spp()),
            format!("{} samples, {} rays, {rate:.2} million rays per second", film.record().samples, image.rays()),
        ];
        let record = film.record();
        if record.passes > 0 {
            let (passes, rays, seconds) = (record.passes, record.prepare_rays, record.prepare_seconds);
            let name = job.integrator();
            lines.push(format!("{name}: {passes} passes from the lights, {rays} rays in {seconds:.2} s of these"));
        }
        if let Some(relmse) = film.predicted_relmse() {
            let filtered = film.record().filtered_relmse;
            let filtered = filtered.map_or_else(String::new, |filtered| format!(", filtered {filtered:.3e}"));
            lines.push(format!("predicted relMSE {relmse:.3e}{filtered}"));
        }
        if let Some(expected) = self.expected {
            let taken = resident().map_or_else(String::new, |[_, most]| format!("{} taken, ", size(most)));
            lines.push(format!("memory: {taken}{expected} expected"));
        }
        lines.join("\n")
    }
}
