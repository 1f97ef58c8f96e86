//! The rows of effects and measurements, as a table and as JSON.

use dapple_job::found_by_chance;
use dapple_metrics::{Difference, MeasuredValue, student_t_quantile};
use dapple_scene::{CalledEffect, Effect, Effects, Scene, Source};
use serde::Serialize;
use std::path::Path;

/// The effects of a scene and their measurements. The keys of its JSON line have the order of the fields; a missing
/// measurement is null.
#[derive(Default, Serialize)]
pub(super) struct Report<'a> {
    scene: &'a str,
    max_depth: Option<u32>,
    pub(super) resolution: Option<[u32; 2]>,
    pub(super) spp: Option<u32>,
    pub(super) seeds: Option<u32>,
    /// The mean time in seconds of tracing an image with every effect: processor time of all threads if the system reports
    /// it, else wall-clock time.
    pub(super) seconds: Option<f64>,
    pub(super) interrupted: bool,
    pub(super) effects: Vec<Row<'a>>,
    found_by_chance: Option<Reason<'a>>,
    /// The cost and the light of paths longer than the scene's depth limit, measured against unlimited depth. `None` if the
    /// scene sets no limit, or no path is long enough to be cut.
    pub(super) beyond_depth: Option<Figures>,
    #[serde(skip)]
    by_chance: Option<&'a CalledEffect>,
}

/// An effect of the scene, its first object, and its measurement if there is one.
#[derive(Serialize)]
pub(super) struct Row<'a> {
    #[serde(skip)]
    pub(super) called: &'a CalledEffect,
    effect: &'static str,
    #[serde(flatten)]
    reason: Reason<'a>,
    #[serde(flatten)]
    pub(super) figures: Figures,
    /// The reason why the effect cannot be left out; null if it can.
    pub(super) kept: Option<String>,
}

#[derive(Serialize)]
struct Reason<'a> {
    because: &'a str,
    file: &'a Path,
    line: u32,
    objects: usize,
}

/// The measurement of one effect; its fields are empty if the effect was not measured.
#[derive(Clone, Copy, Default, Serialize)]
pub(super) struct Figures {
    /// The effect's fraction of the tracing time, at most 1. It is below 0 if the image takes longer without the effect.
    time_share: Option<Figure>,
    /// The ratio of the tracing time with the effect to the time without it.
    time_ratio: Option<Figure>,
    relmse: Option<Figure>,
    radiance_lost: Option<Figure>,
}

/// A measured value with the half width of its 95 % interval, `noise`.
#[derive(Clone, Copy, Serialize)]
struct Figure {
    value: f64,
    noise: f64,
}

impl Figures {
    /// Computes the figures of an effect from two estimates over `seeds` seeds: `log_time`, the logarithm of the ratio of
    /// tracing times, and `image`, the difference of the images.
    pub(super) fn new(log_time: MeasuredValue, image: Difference, seeds: u32) -> Self {
        let student = student(seeds - 1);
        let figure = |m: MeasuredValue| Figure { value: m.value, noise: student * m.standard_error };
        let log = figure(log_time);
        let ratio = log.value.exp();
        // The noise is propagated with the derivatives of exp(x) and 1 - exp(-x).
        Self {
            time_share: Some(Figure { value: 1.0 - 1.0 / ratio, noise: log.noise / ratio }),
            time_ratio: Some(Figure { value: ratio, noise: ratio * log.noise }),
            relmse: Some(figure(image.rel_mse)),
            radiance_lost: Some(figure(image.mean_lost)),
        }
    }
}

/// The quantile of Student's t distribution for a two-sided 95 % interval and `freedom` degrees of freedom.
fn student(freedom: u32) -> f64 {
    student_t_quantile(0.975, f64::from(freedom))
}

impl<'a> Report<'a> {
    /// Makes a report without measurements.
    pub(super) fn new(scene: &'a Scene, effects: &'a Effects, by_chance: Option<&'a CalledEffect>) -> Self {
        let row = |called: &'a CalledEffect| Row {
            called,
            effect: called.effect.name(),
            reason: reason(called),
            figures: Figures::default(),
            kept: None,
        };
        Self {
            scene: &scene.name,
            max_depth: effects.max_depth(),
            effects: effects.called().iter().map(row).collect(),
            found_by_chance: by_chance.map(reason),
            by_chance,
            ..Self::default()
        }
    }

    /// Formats the report as one line of JSON.
    pub(super) fn json(&self) -> String {
        // Serialising text and numbers cannot fail; NaN and infinity become null.
        serde_json::to_string(self).unwrap_or_default()
    }

    /// Formats the report as a table.
    pub(super) fn table(&self) -> String {
        let depth = self.max_depth.map_or("unlimited".into(), |d| d.to_string());
        let count = match self.effects.len() {
            0 => "no effects".to_owned(),
            1 => "1 effect".to_owned(),
            n => format!("{n} effects"),
        };
        let mut lines = vec![format!("{}: {count}, depth {depth}", self.scene)];
        let measured = self.effects.iter().any(|row| row.kept.is_some() || row.figures.time_ratio.is_some());
        if let (true, Some([w, h]), Some(spp), Some(seeds)) = (measured, self.resolution, self.spp, self.seeds) {
            let seconds = self.seconds.map_or(String::new(), |s| format!(", {s:.3} s to trace an image"));
            lines.push(format!("{w}x{h}, {spp} spp, {seeds} seeds{seconds}; ± is half the width of a 95 % interval"));
        }
        if !self.effects.is_empty() {
            lines.push(String::new());
            lines.extend(self.rows());
        }
        if let Some(Figures { time_ratio: Some(ratio), relmse, radiance_lost, .. }) = &self.beyond_depth {
            lines.push(format!(
                "\nbeyond depth {depth}: {} of the radiance is cut off, relMSE {}; unlimited depth takes {:.2} times as long ±{:.2}",
                cell(*radiance_lost, percent), cell(*relmse, scientific), ratio.value, ratio.noise
            ));
        }
        if let Some(called) = self.by_chance {
            lines.push(format!("\n{}: {}; the default integrator is photons", called.source, found_by_chance(called)));
        }
        lines.join("\n")
    }

    /// The table's head and rows, with aligned columns.
    fn rows(&self) -> Vec<String> {
        let heads = ["effect", "of the time", "without it", "relMSE without it", "radiance lost", "caused by"];
        let all: Vec<[String; 6]> =
            [heads.map(str::to_owned)].into_iter().chain(self.effects.iter().map(Row::cells)).collect();
        let columns = if self.resolution.is_some() { &[0, 1, 2, 3, 4, 5][..] } else { &[0, 5] };
        let width = |column: usize| all.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = columns.iter().map(|&column| width(column)).collect();
        let line = |row: &[String; 6]| {
            let cells = columns.iter().zip(&widths).map(|(&column, &width)| format!("{:<width$}", row[column]));
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
        };
        all.iter().map(line).collect()
    }
}

impl Row<'_> {
    fn cells(&self) -> [String; 6] {
        let CalledEffect { effect, because, source, objects, .. } = self.called;
        // For several lights, the cause is all lights together, so that no other objects are counted.
        let others = match objects {
            n if *n > 1 && *effect != Effect::SeveralLights => format!(", and {} more", n - 1),
            _ => String::new(),
        };
        let kept = self.kept.as_ref().map_or(String::new(), |why| format!(" (cannot be left out: {why})"));
        let Figures { time_share, time_ratio, relmse, radiance_lost } = self.figures;
        [
            effect.name().to_owned(),
            cell(time_share, percent),
            cell(time_ratio, times),
            cell(relmse, scientific),
            cell(radiance_lost, percent),
            format!("{}: {because}{others}{kept}", place(source)),
        ]
    }
}

fn reason(called: &CalledEffect) -> Reason<'_> {
    let Source { file, line } = &called.source;
    Reason { because: &called.because, file, line: *line, objects: called.objects }
}

/// The location of an object: file name and line. Folders are left out, since the table has no room for them; JSON has the
/// full path.
fn place(source: &Source) -> String {
    let file = source.file.file_name().map_or_else(|| source.to_string(), |n| n.to_string_lossy().into_owned());
    if source.line == 0 { file } else { format!("{file}:{}", source.line) }
}

fn cell(figure: Option<Figure>, text: fn(Figure) -> String) -> String {
    figure.map_or_else(|| "-".to_owned(), text)
}

fn percent(Figure { value, noise }: Figure) -> String {
    format!("{:.1} % ±{:.1}", 100.0 * value, 100.0 * noise)
}

fn scientific(Figure { value, noise }: Figure) -> String {
    format!("{value:.2e} ±{noise:.0e}")
}

fn times(Figure { value, noise }: Figure) -> String {
    match value >= 1.0 {
        true => format!("{value:.2}x faster ±{noise:.2}"),
        false => format!("{:.2}x slower ±{:.2}", 1.0 / value, noise / value / value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_by_students_t() {
        for (freedom, table) in [(1, 12.706), (3, 3.182), (30, 2.042), (31, 2.040), (60, 2.000)] {
            assert!((student(freedom) - table).abs() < 0.0006, "{freedom}: {}", student(freedom));
        }
    }

    #[test]
    fn ratios_say_which_way() {
        assert_eq!(times(Figure { value: 1.25, noise: 0.1 }), "1.25x faster ±0.10");
        assert_eq!(times(Figure { value: 0.5, noise: 0.05 }), "2.00x slower ±0.20");
    }
}
