//! Formatting of measured effects as a table and as JSON.

use super::ledger::{Ledger, Row, Shares};
use dapple_job::found_by_chance;
use dapple_metrics::{Measured, student_t_quantile};
use dapple_scene::{Called, Effect, Effects, Scene, Source};
use serde::Serialize;
use std::path::Path;

/// The effects and measurements that the table and the JSON line show.
pub(super) struct Told<'a> {
    pub(super) scene: &'a Scene,
    pub(super) effects: &'a Effects,
    pub(super) by_chance: Option<&'a Called>,
    pub(super) ledger: Option<&'a Ledger>,
}

/// The JSON line that is printed; its keys have the order of the fields. A missing measurement is null.
#[derive(Serialize)]
struct Line<'a> {
    scene: &'a str,
    max_depth: Option<u32>,
    resolution: Option<[u32; 2]>,
    spp: Option<u32>,
    seeds: Option<u32>,
    seconds: Option<f64>,
    interrupted: bool,
    effects: Vec<Entry<'a>>,
    found_by_chance: Option<Reason<'a>>,
    /// The time and light of paths beyond the scene's depth limit; null if no path is cut.
    beyond_depth: Option<Beyond>,
}

#[derive(Serialize)]
struct Beyond {
    radiance_lost: Figure,
    relmse: Figure,
    /// The ratio of the tracing time with unlimited depth to the time with the scene's depth limit.
    time_ratio: Figure,
}

#[derive(Serialize)]
struct Reason<'a> {
    because: &'a str,
    file: &'a Path,
    line: u32,
    objects: usize,
}

#[derive(Serialize)]
struct Entry<'a> {
    effect: &'static str,
    #[serde(flatten)]
    reason: Reason<'a>,
    /// The effect's share of the tracing time, at most 1, with the half width of its 95 % interval. It is below 0 if
    /// the image takes longer without the effect.
    time_share: Option<Figure>,
    /// The ratio of the tracing time with the effect to the time without it.
    time_ratio: Option<Figure>,
    relmse: Option<Figure>,
    radiance_lost: Option<Figure>,
    /// The reason why the effect cannot be left out; null if it can.
    kept: Option<&'a str>,
}

/// A measured value with the half width of its 95 % interval, `noise`.
#[derive(Clone, Copy, Serialize)]
struct Figure {
    value: f64,
    noise: f64,
}

/// The values that are shown for one effect.
struct Figures {
    time_share: Figure,
    time_ratio: Figure,
    rel_mse: Figure,
    lost: Figure,
}

impl Figures {
    fn of(shares: &Shares, seeds: u32) -> Self {
        let student = student(seeds - 1);
        let figure = |m: Measured| Figure { value: m.value, noise: student * m.standard_error };
        let log = figure(shares.log_time);
        let ratio = log.value.exp();
        // The noise is propagated with the derivatives of exp(x) and 1 - exp(-x).
        let time_ratio = Figure { value: ratio, noise: ratio * log.noise };
        let time_share = Figure { value: 1.0 - 1.0 / ratio, noise: log.noise / ratio };
        let (rel_mse, lost) = (figure(shares.image.rel_mse), figure(shares.image.mean_lost));
        Self { time_share, time_ratio, rel_mse, lost }
    }
}

/// The quantile of Student's t distribution for a two-sided 95 % interval.
fn student(freedom: u32) -> f64 {
    student_t_quantile(0.975, f64::from(freedom))
}

impl<'a> Told<'a> {
    fn row(&self, called: &Called) -> Option<&'a Row> {
        self.ledger.and_then(|l| l.rows.iter().find(|row| row.effect == called.effect))
    }

    fn figures(&self, called: &Called) -> Option<Figures> {
        let shares = self.row(called)?.measured.as_ref().ok()?;
        self.ledger.map(|l| Figures::of(shares, l.seeds))
    }

    fn beyond_depth(&self) -> Option<Beyond> {
        let ledger = self.ledger?;
        let Figures { lost, rel_mse, time_ratio, .. } = Figures::of(ledger.beyond_depth.as_ref()?, ledger.seeds);
        Some(Beyond { radiance_lost: lost, relmse: rel_mse, time_ratio })
    }

    /// Formats the effects and measurements as one line of JSON.
    pub(super) fn json(&self) -> String {
        let entry = |called: &'a Called| {
            let figures = self.figures(called);
            let figure = |of: fn(&Figures) -> Figure| figures.as_ref().map(of);
            Entry {
                effect: called.effect.name(),
                reason: reason(called),
                time_share: figure(|f| f.time_share),
                time_ratio: figure(|f| f.time_ratio),
                relmse: figure(|f| f.rel_mse),
                radiance_lost: figure(|f| f.lost),
                kept: self.row(called).and_then(|row| row.measured.as_ref().err()).map(String::as_str),
            }
        };
        let line = Line {
            scene: &self.scene.name,
            max_depth: self.effects.max_depth(),
            resolution: self.ledger.map(|l| l.resolution),
            spp: self.ledger.map(|l| l.spp),
            seeds: self.ledger.map(|l| l.seeds),
            seconds: self.ledger.and_then(|l| l.seconds),
            interrupted: self.ledger.is_some_and(|l| l.interrupted),
            effects: self.effects.called().iter().map(entry).collect(),
            found_by_chance: self.by_chance.map(reason),
            beyond_depth: self.beyond_depth(),
        };
        // Serialising text and numbers cannot fail; NaN and infinity become null.
        serde_json::to_string(&line).unwrap_or_default()
    }

    /// Formats the effects and measurements as a table.
    pub(super) fn table(&self) -> String {
        let depth = self.effects.max_depth().map_or("unlimited".into(), |d| d.to_string());
        let called = self.effects.called();
        let mut lines = vec![match called.len() {
            0 => format!("{}: no effects, depth {depth}", self.scene.name),
            1 => format!("{}: 1 effect, depth {depth}", self.scene.name),
            n => format!("{}: {n} effects, depth {depth}", self.scene.name),
        }];
        if let Some(ledger) = self.ledger.filter(|l| !l.rows.is_empty()) {
            let [w, h] = ledger.resolution;
            let seconds = ledger.seconds.map_or(String::new(), |s| format!(", {s:.3} s of tracing an image"));
            lines.push(format!(
                "{w}x{h}, {} spp, {} seeds{seconds}; ± is half a 95 % interval",
                ledger.spp, ledger.seeds
            ));
        }
        lines.push(String::new());
        let rows: Vec<[String; 6]> = called.iter().map(|c| self.cells(c)).collect();
        let wide = if self.ledger.is_some() { 6 } else { 2 };
        // The column "called for by" is long, and comes last.
        let order: &[usize] = if wide == 6 { &[0, 2, 3, 4, 5, 1] } else { &[0, 1] };
        let heads = ["effect", "called for by", "of the time", "without it", "relMSE without it", "radiance lost"];
        let all: Vec<[String; 6]> = [heads.map(str::to_owned)].into_iter().chain(rows).collect();
        let width = |column: usize| all.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = order.iter().map(|&column| width(column)).collect();
        for row in &all {
            let cells = order.iter().zip(&widths).map(|(&column, &width)| format!("{:<width$}", row[column]));
            lines.push(cells.collect::<Vec<_>>().join("  ").trim_end().to_owned());
        }
        if called.is_empty() {
            lines.truncate(1);
        }
        if let Some(Beyond { radiance_lost, relmse, time_ratio }) = self.beyond_depth() {
            lines.push(String::new());
            lines.push(format!(
                "beyond depth {depth}: {} of the radiance is cut off, relMSE {:.2e} ±{:.0e}; unlimited depth takes {:.2} times as long ±{:.2}",
                percent(radiance_lost), relmse.value, relmse.noise, time_ratio.value, time_ratio.noise
            ));
        }
        if let Some(called) = self.by_chance {
            lines.push(String::new());
            lines.push(format!("{}: {}; by default, photons carry it", called.source, found_by_chance(called)));
        }
        lines.join("\n")
    }

    fn cells(&self, called: &Called) -> [String; 6] {
        // For several lights, all of them together are the cause, and no others are counted.
        let others = match called.objects {
            n if n > 1 && called.effect != Effect::SeveralLights => format!(", and {} more", n - 1),
            _ => String::new(),
        };
        let by = format!("{}: {}{others}", place(&called.source), called.because);
        let [mut time, mut ratio, mut image, mut lost] = ["-", "-", "-", "-"].map(str::to_owned);
        if let Some(f) = self.figures(called) {
            time = percent(f.time_share);
            ratio = times(f.time_ratio);
            image = format!("{:.2e} ±{:.0e}", f.rel_mse.value, f.rel_mse.noise);
            lost = percent(f.lost);
        }
        let why = self.row(called).and_then(|row| row.measured.as_ref().err());
        let by = why.map_or(by.clone(), |why| format!("{by} (cannot be left out: {why})"));
        [called.effect.name().to_owned(), by, time, ratio, image, lost]
    }
}

fn reason(called: &Called) -> Reason<'_> {
    let Source { file, line } = &called.source;
    Reason { because: &called.because, file, line: *line, objects: called.objects }
}

/// The place of an object in the scene: file name and line. Folders are left out for lack of room in the table; JSON
/// has the full path.
fn place(source: &Source) -> String {
    let file = source.file.file_name().map_or_else(|| source.to_string(), |n| n.to_string_lossy().into_owned());
    if source.line == 0 { file } else { format!("{file}:{}", source.line) }
}

fn percent(figure: Figure) -> String {
    format!("{:.1} % ±{:.1}", 100.0 * figure.value, 100.0 * figure.noise)
}

fn times(figure: Figure) -> String {
    let (value, noise) = (figure.value, figure.noise);
    if value >= 1.0 {
        format!("{value:.2}x faster ±{noise:.2}")
    } else {
        format!("{:.2}x slower ±{:.2}", 1.0 / value, noise / value / value)
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
