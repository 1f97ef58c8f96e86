//! How it went: the JSON line, the summary, and what goes into the header of an EXR file.

use super::memory::Expected;
use super::settings::{Methods, Settings};
use crate::info;
use dapple_core::{Combine, Film, Filtered};
use dapple_job::WorldClusters;
use dapple_scene::Effects;
use dapple_scene::Scene;
use serde::Serialize;

/// Wall seconds of each phase. Phases that do not exist for a sampler take none.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct Seconds {
    pub(super) load: f64,
    pub(super) bvh: f64,
    pub(super) cluster: f64,
    pub(super) probe: f64,
    pub(super) plan: f64,
    pub(super) trace: f64,
    pub(super) filter: f64,
    pub(super) write: f64,
}

impl Seconds {
    fn render(&self) -> f64 {
        self.cluster + self.probe + self.plan + self.trace + self.filter
    }
}

/// An image with how it was made.
pub(super) struct Report<'a> {
    pub(super) settings: &'a Settings,
    pub(super) methods: &'a Methods,
    pub(super) scene: &'a Scene,
    pub(super) film: &'a Film,
    pub(super) filtered: &'a Filtered,
    /// The clusters that were made, if any.
    pub(super) clusters: Option<&'a WorldClusters>,
    pub(super) probe_rays: u64,
    pub(super) seconds: Seconds,
    pub(super) cpu: Option<f64>,
    pub(super) light_choice: &'static str,
    /// The memory that was expected, where it was rendered here.
    pub(super) expected: Option<&'a Expected>,
}

/// The keys of the JSON line, in their order. What is not known is null.
#[derive(Serialize)]
struct Line<'a> {
    scene: &'a str,
    sampler: &'a str,
    points: &'a str,
    filter: String,
    seed: u64,
    threads: usize,
    resolution: [u32; 2],
    samples: u64,
    spp: f64,
    rays: u64,
    seconds: Seconds,
    render_s: f64,
    cpu: Option<f64>,
    predicted_relmse: Option<f64>,
    rejected: u64,
    effects: Vec<&'static str>,
    without: Vec<&'static str>,
}

impl Report<'_> {
    fn spp(&self) -> f64 {
        self.film.record().samples as f64 / self.film.frame().pixels() as f64
    }

    fn effects(&self) -> Vec<&'static str> {
        Effects::of(self.scene).called().iter().map(|c| c.effect.name()).collect()
    }

    fn without(&self) -> Vec<&'static str> {
        self.settings.without.iter().map(|e| e.name()).collect()
    }

    /// One line, with the keys of the design.
    pub(super) fn json(&self) -> String {
        let (settings, record) = (self.settings, self.film.record());
        let line = Line {
            scene: &self.scene.name,
            sampler: &self.methods.sampler_described,
            points: &settings.points_described,
            filter: self.methods.filter.describe(),
            seed: settings.seed,
            threads: rayon::current_num_threads(),
            resolution: settings.frame.resolution(),
            samples: record.samples,
            spp: self.spp(),
            rays: record.rays + self.probe_rays,
            seconds: self.seconds,
            render_s: self.seconds.render(),
            cpu: self.cpu,
            predicted_relmse: self.film.predicted_relmse(),
            rejected: record.rejected,
            effects: self.effects(),
            without: self.without(),
        };
        to_string(&line)
    }

    /// A few lines for people.
    pub(super) fn summary(&self) -> String {
        let (settings, record) = (self.settings, self.film.record());
        let [w, h] = self.film.frame().size();
        let seconds = self.seconds.render();
        let counts = self.film.counts();
        let (least, most) = (counts.iter().min().copied().unwrap_or(0), counts.iter().max().copied().unwrap_or(0));
        let rays = record.rays + self.probe_rays;
        let rate = record.rays as f64 / self.seconds.trace.max(1e-9) * 1e-6;
        let mut lines = vec![
            format!("{}, {w}x{h}: {:.2} spp ({least} to {most}) in {seconds:.2} s", self.scene.name, self.spp()),
            format!(
                "{}, {}, filter {}",
                self.methods.sampler_described,
                settings.points_described,
                self.methods.filter.describe()
            ),
            format!("{} samples, {rays} rays, {rate:.2} million rays a second", record.samples),
        ];
        if let Some(relmse) = self.film.predicted_relmse() {
            lines.push(format!("predicted relMSE {relmse:.3e}"));
        }
        lines.extend(self.expected.map(Expected::line));
        lines.join("\n")
    }

    /// Every setting and how it went, as text attributes.
    pub(super) fn attributes(&self) -> Vec<(String, String)> {
        let (settings, scene, record) = (self.settings, self.scene, self.film.record());
        let (frame, limits) = (&settings.frame, &settings.limits);
        let [[w, h], [x, y], [cw, ch]] = [frame.resolution(), frame.origin(), frame.size()];
        let budgets: Vec<String> = record.budgets.iter().map(u64::to_string).collect();
        let notices: Vec<String> = scene.notices.iter().map(|n| format!("{}: {}", n.source, n.message)).collect();
        let list = [
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("scene", scene.name.clone()),
            ("scene-file", scene.camera.source.file.display().to_string()),
            ("sampler", self.methods.sampler_described.clone()),
            ("points", settings.points_described.clone()),
            ("filter", self.methods.filter.describe()),
            ("pixel-filter", info::pixel_filter(&scene.film.pixel_filter)),
            ("seed", settings.seed.to_string()),
            ("budget", settings.asked.clone()),
            ("budgets", budgets.join(",")),
            ("min-spp", limits.min_spp.to_string()),
            ("max-spp", limits.max_spp.to_string()),
            ("resolution", format!("{w}x{h}")),
            ("crop", format!("{x},{y},{},{}", x + cw, y + ch)),
            ("max-depth", scene.max_depth.map_or("unlimited".into(), |d| d.to_string())),
            ("light-choice", self.light_choice.to_owned()),
            ("effects", self.effects().join(",")),
            ("without", self.without().join(",")),
            ("notices", notices.join("\n")),
            ("samples", record.samples.to_string()),
            ("spp", self.spp().to_string()),
            ("rays", (record.rays + self.probe_rays).to_string()),
            ("probe-rays", self.probe_rays.to_string()),
            ("rejected", record.rejected.to_string()),
            ("predicted-relmse", self.film.predicted_relmse().map_or("unknown".into(), |e| e.to_string())),
            ("bias", self.bias(settings)),
            ("interrupted", record.interrupted.to_string()),
            ("threads", rayon::current_num_threads().to_string()),
            ("seconds", to_string(&self.seconds)),
            ("cpu-seconds", self.cpu.map_or("unknown".into(), |s| s.to_string())),
        ];
        // A text attribute is never empty, so that every reader shows it.
        let filled = |text: String| if text.is_empty() { "none".to_owned() } else { text };
        list.into_iter().map(|(key, text)| (format!("dapple:{key}"), filled(text))).collect()
    }

    /// Of the image: of its samples, and of what made it of them.
    fn bias(&self, settings: &Settings) -> String {
        let samples = bias(self.film, settings, self.methods.sampler.a_priori());
        match self.methods.filter.name() {
            "none" => samples.to_owned(),
            _ => format!("biased: by the filter, less so with more samples; the samples by themselves {samples}"),
        }
    }
}

/// Whether samples that are in the image decided on its counts [Kirk and Arvo 1991].
fn bias(film: &Film, settings: &Settings, a_priori: bool) -> &'static str {
    let rounds = &film.record().rounds;
    let decided = rounds.split_last().is_some_and(|(_, deciding)| deciding.iter().any(|round| round.kept));
    match film.combine() {
        _ if matches!(settings.limits.budget, dapple_core::Budget::Error { .. }) => {
            "biased: the predicted error of the samples in the image decided when to stop"
        }
        _ if a_priori || !decided => "none: no sample of the image decided on its counts",
        Combine::Equally => "none: each half's counts were decided by the other half's samples",
        _ => "biased: samples that are or were in the image decided on its counts",
    }
}

/// JSON on one line, keys in the order of the fields. Plain numbers and text cannot fail.
fn to_string(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}
