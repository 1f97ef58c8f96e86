//! The cost of each numerical safeguard, and the inputs that break without it.
//!
//! `cargo bench -p dapple-benches --bench price` takes two or three minutes, on a machine that does nothing else. Arguments after `--`:
//!
//! * `--quick` or `--test`: takes seconds; counts of failures are exact, prices are rough;
//! * `--overflow-checks WITH WITHOUT`: two builds of `dapple`, with and without overflow checks; adds the price of these
//!   checks.
//!
//! A price is the time with the safeguard divided by the time without it, measured in alternating pairs in one process on one
//! thread. It is given as a median with an interval of at least 95 % confidence for any distribution of noise (order
//! statistics). Film, loading and checkpoints are timed separately and compared with a whole render. Failures are counts, which
//! are equal on every machine.

#![allow(clippy::print_stdout, clippy::print_stderr, missing_docs, unreachable_pub, reason = "a program")]

mod safeguards;

use dapple_core::limits::Schedule;
use dapple_core::render::{Monitor, NoMonitor};
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, Needs, Render};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{World, integrator};
use dapple_scene::{Scene, bundled};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use safeguards::{checkpoints, halves, invalid_samples, precise_sums, recentring};
use std::hint::black_box;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let has = |name: &str| arguments.iter().any(|argument| argument == name);
    // `cargo test -p dapple-benches --benches` runs each bench once, without `--bench`; so does `cargo bench -- --test`.
    let quick = has("--quick") || has("--test") || !has("--bench");
    let programs = arguments.iter().position(|argument| argument == "--overflow-checks");
    // The other programs run first, since they may fail.
    let checked = match programs.and_then(|at| arguments.get(at + 1..at + 3)) {
        Some([with, without]) => Some(overflow_checks(Path::new(without), Path::new(with), quick)?),
        _ => None,
    };
    let mut rows = prices(quick)?;
    rows.extend(checked);
    println!("{}", table(&rows));
    Ok(())
}

/// One safeguard: its price, and the failures that it prevents.
#[derive(Debug)]
pub struct Row {
    pub safeguard: &'static str,
    does: &'static str,
    pub price: Ratio,
    /// The work that was timed.
    price_of: String,
    /// The smallest tested inputs that fail without the safeguard; empty if none is known.
    pub breaks: Vec<Break>,
}

/// An input, its visible defect, and the failures among `of` trials (rays, pixels, samples or images), without and with the
/// safeguard.
#[derive(Debug)]
pub struct Break {
    input: String,
    seen: &'static str,
    pub of: u64,
    pub without: u64,
    pub with: u64,
}

/// Measures every safeguard that this program can run without, on one thread, in order from scene to file.
pub fn prices(quick: bool) -> Result<Vec<Row>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        let count = |few: usize, many| if quick { few } else { many };
        let image = Image::new(quick)?;
        Ok(vec![
            recentring(count(6, 11))?,
            precise_sums(count(6, 15), count(4, 64), &image)?,
            invalid_samples(count(6, 15), count(4, 64), &image)?,
            halves(count(6, 15), &image)?,
            checkpoints(count(6, 11), &image)?,
        ])
    })
}

/// The table as Markdown.
fn table(rows: &[Row]) -> String {
    let mut lines = vec![
        "Time with each safeguard over time without it: median of pairs in turns (an interval that holds it with 95 %). \
         Failures without it and with it, of all trials.\n\n\
         | safeguard | price | breaks | without | with | of | visible defect |\n|---|---|---|---|---|---|---|"
            .to_owned(),
    ];
    for row in rows {
        // A price close to 1 needs more digits.
        let digits = if (row.price.median - 1.0).abs() < 1e-3 { 5 } else { 3 };
        let [middle, low, high] = [row.price.median, row.price.low, row.price.high].map(|x| format!("{x:.digits$}"));
        let mut head = format!("{} | {middle} ({low}, {high})", row.safeguard);
        if row.breaks.is_empty() {
            lines.push(format!("| {head} | no input is known to | | | | |"));
        }
        for Break { input, seen, of, without, with } in &row.breaks {
            lines.push(format!("| {head} | {input} | {without} | {with} | {of} | {seen} |"));
            head = " |".to_owned();
        }
    }
    lines.push(String::new());
    let note = |row: &Row| {
        format!("* **{}**: {}. Price of {} ({} pairs).", row.safeguard, row.does, row.price_of, row.price.pairs)
    };
    lines.extend(rows.iter().map(note));
    lines.join("\n")
}

/// The median of ratios, and an interval around it.
#[derive(Clone, Copy, Debug)]
pub struct Ratio {
    pub median: f64,
    pub low: f64,
    pub high: f64,
    pub pairs: usize,
}

impl Ratio {
    /// The median of at least one ratio, with an interval between order statistics. The interval is valid for any distribution,
    /// since the number of ratios below the median is binomial [after David and Nagaraja 2003, section 7.1]. It is the
    /// narrowest one with at least 95 % confidence. With fewer than six ratios, it is the range of all ratios.
    pub fn of(mut ratios: Vec<f64>) -> Self {
        ratios.sort_by(f64::total_cmp);
        let n = ratios.len();
        let median = 0.5 * (ratios[(n - 1) / 2] + ratios[n / 2]);
        // P(fewer than k + 1 of n below the median), term by term.
        let mut term = 0.5_f64.powi(n as i32);
        let (mut tail, mut outside) = (term, 0);
        loop {
            term *= (n - outside) as f64 / (outside + 1) as f64;
            tail += term;
            if 2.0 * tail > 0.05 || 2 * (outside + 1) >= n {
                return Self { median, low: ratios[outside], high: ratios[n - 1 - outside], pairs: n };
            }
            outside += 1;
        }
    }
}

/// The median of `count` ratios, each from one call of `pair` with the number of the pair.
fn pairs(count: usize, pair: impl FnMut(usize) -> Result<f64>) -> Result<Ratio> {
    Ok(Ratio::of((0..count).map(pair).collect::<Result<_>>()?))
}

/// Runs both functions, `with` first if `number` is even, so that drift of the machine affects both equally.
pub fn in_turn<T>(
    number: usize,
    with: impl FnOnce() -> Result<T>,
    without: impl FnOnce() -> Result<T>,
) -> Result<[T; 2]> {
    if number.is_multiple_of(2) {
        let with = with()?;
        return Ok([with, without()?]);
    }
    let without = without()?;
    Ok([with()?, without])
}

/// The seconds that `work` takes.
fn seconds<T>(work: impl FnOnce() -> T) -> f64 {
    let start = Instant::now();
    black_box(work());
    start.elapsed().as_secs_f64()
}

/// The ratio of the time `whole` to the time without the safeguard, which takes `part` longer than its replacement.
pub fn of_whole(whole: f64, part: f64) -> f64 {
    // If the machine stalls between two clock readings, the part may seem as long as the whole.
    whole / (whole - part).max(0.01 * whole)
}

fn scene(name: &str) -> Result<Scene> {
    Ok(bundled::files(name).ok_or("there is no such bundled scene")?.read()?)
}

/// A step of the work on samples.
type Part<'a> = &'a dyn Fn(&[[f32; 3]]);

/// The number of samples per pixel that are summed.
const SPP: usize = 16;

/// The Cornell box. Its samples are the cheapest of all bundled scenes, so that the relative cost of safeguards is largest.
struct Image {
    world: World,
    frame: Frame,
    spp: u64,
}

impl Image {
    const NAME: &str = "cornell";

    fn new(quick: bool) -> Result<Self> {
        let (side, spp) = if quick { (48, 4) } else { (192, 8) };
        let world = World::with_resolution(&scene(Self::NAME)?, [side; 2])?;
        Ok(Self { world, frame: Frame::new(side, side)?, spp })
    }

    fn sampler() -> Uniform<Sobol> {
        Uniform::new(Sobol::new(7))
    }

    fn samples(&self) -> u64 {
        self.spp * self.frame.pixels() as u64
    }

    /// Limits with two slices, so that a render can be stopped halfway.
    fn limits(&self) -> Limits {
        Limits::samples(self.samples()).with_schedule(Schedule::default().with_progress_spp((self.spp / 2) as u32))
    }

    fn render(&self, needs: Needs, monitor: &mut dyn Monitor) -> Result<Film> {
        let limits = self.limits();
        let render = Render::new(self.frame, &limits).needs(needs).monitor(monitor);
        Ok(render.run(&mut *integrator(&self.world), &mut Self::sampler())?)
    }

    /// The seconds of a whole render.
    fn seconds(&self, needs: Needs) -> Result<f64> {
        let start = Instant::now();
        black_box(self.render(needs, &mut NoMonitor)?);
        Ok(start.elapsed().as_secs_f64())
    }

    /// The image's description for the table.
    fn describe(&self) -> String {
        let [width, height] = self.frame.size();
        format!("rendering {} ({width}x{height}, {} spp, one thread)", Self::NAME, self.spp)
    }

    /// The price of the first step over the second, relative to a whole render, and the difference in nanoseconds per sample.
    fn of_render(&self, count: usize, runs: usize, part: [Part<'_>; 2]) -> Result<(Ratio, f64)> {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let samples: Vec<[f32; 3]> =
            (0..4096 * SPP).map(|_| std::array::from_fn(|_| rng.random_range(0.0..2.0))).collect();
        let per_sample = 1.0 / (samples.len() * runs) as f64;
        let mut parts = Vec::new();
        let ratio = pairs(count, |number| {
            let time = |part: Part<'_>| Ok(seconds(|| (0..runs).for_each(|_| part(black_box(&samples)))));
            let [with, without] = in_turn(number, || time(part[0]), || time(part[1]))?;
            parts.push((with - without) * per_sample);
            Ok(of_whole(self.seconds(Needs::none())? / self.samples() as f64, (with - without) * per_sample))
        })?;
        Ok((ratio, 1e9 * Ratio::of(parts).median))
    }
}

/// The row of overflow checks. `without` and `with` are builds of the program that differ only in these checks.
pub fn overflow_checks(without: &Path, with: &Path, quick: bool) -> Result<Row> {
    // A scene with one light, one with an environment map, and one with hundreds of thousands of triangles.
    const SCENES: [&str; 3] = ["cornell", "teapot", "terrain"];
    let (count, size) = if quick { (3, "--resolution 32x32 --spp 2") } else { (90, "--resolution 192x192 --spp 16") };
    let price = pairs(count, |number| {
        let words = format!("{} {size}", SCENES[number % SCENES.len()]);
        // The order within a pair alternates after each round of scenes.
        let turn = number / SCENES.len();
        let [with, without] = in_turn(turn, || trace(with, &words), || trace(without, &words))?;
        Ok(with / without)
    })?;
    Ok(Row {
        safeguard: "overflow-checks",
        does: "whole numbers that overflow end the program (against a build of its own, without them; the BVH has none)",
        price,
        price_of: format!("`dapple render SCENE {size}`, tracing, one thread; {} in turn", SCENES.join(", ")),
        breaks: Vec::new(),
    })
}

/// The seconds of tracing that `program` reports for a render.
fn trace(program: &Path, words: &str) -> Result<f64> {
    let wrong =
        |why: &str| format!("{}: {why}; it must be a build of dapple, see docs/results/price.md", program.display());
    let folder = tempfile::tempdir()?;
    let mut command = Command::new(program);
    command.arg("render").args(words.split(' ')).args(["--threads", "1", "--json", "-o"]);
    let output = command.arg(folder.path().join("image.pfm")).output();
    let output = output.map_err(|e| wrong(&format!("it does not start ({e})")))?;
    if !output.status.success() {
        return Err(wrong(String::from_utf8_lossy(&output.stderr).trim()).into());
    }
    let said: Option<serde_json::Value> = serde_json::from_slice(&output.stdout).ok();
    let seconds = said.and_then(|said| said["seconds"]["trace"].as_f64());
    Ok(seconds.filter(|s| *s > 0.0).ok_or_else(|| wrong("its output has no time of tracing"))?)
}
