//! The calibration of a render's error estimate, and of `--error`.
//!
//! ```sh
//! docs/results/make predicted-error
//! ```
//!
//! Errors are estimated from two independently scrambled halves. Each pixel and channel gives one degree of freedom; estimates
//! are pooled over square blocks of pixels. The 95 % interval uses Student's t with one degree of freedom per pixel of the
//! block. It should contain the reference in 95 % of pixels and channels, and be narrow. Prints Markdown
//! (`docs/results/to_csv.py` converts it to CSV). Without `--full`, a small version runs in seconds.

#![expect(clippy::print_stdout, reason = "a program whose table is its result")]

use dapple_core::{Film, Frame, Limits, Needs, Render};
use dapple_job::registry::{self, MethodInputs, PointSettings};
use dapple_metrics::{RELATIVE_EPSILON, geometric_mean_interval, student_t_quantile};
use dapple_renderer::{World, integrator};
use dapple_scene::bundled;
use std::sync::Arc;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SCENES: [&str; 5] = ["cornell", "teapot", "terrain", "lens", "glass"];
const SAMPLERS: [&str; 2] = ["uniform", "variance"];
/// The sides of the pooled blocks in pixels.
const BLOCKS: [u32; 5] = [1, 2, 4, 8, 16];

struct Size {
    side: u32,
    spp: &'static [u64],
    seeds: u64,
    reference_spp: u64,
    errors: &'static [f64],
}

struct Course {
    world: Arc<World>,
    frame: Frame,
    reference: Vec<[f64; 3]>,
    /// The variance of each pixel of the reference.
    noise: Vec<[f64; 3]>,
}

fn main() -> Result<()> {
    let size = match std::env::args().any(|word| word == "--full") {
        true => {
            Size { side: 64, spp: &[8, 32, 128], seeds: 16, reference_spp: 8192, errors: &[0.03, 0.01, 0.003, 0.001] }
        }
        false => Size { side: 16, spp: &[8], seeds: 2, reference_spp: 64, errors: &[0.1] },
    };
    let courses: Vec<(&str, Course)> =
        SCENES.iter().map(|&name| Ok((name, Course::new(name, &size)?))).collect::<Result<_>>()?;
    println!(
        "{0}x{0} pixels, {1} seeds, Sobol' points; references of {2} spp of random points, with their own variance subtracted.\n",
        size.side, size.seeds, size.reference_spp
    );
    println!(
        "Predicted over true relMSE (geometric mean, 95 % interval over seeds), and the fraction of pixels and channels"
    );
    println!(
        "whose 95 % interval contains the reference (x: the interval's mean width over that of the true scatter), by"
    );
    println!("side of the pooled blocks:\n");
    let heads: Vec<String> = BLOCKS.iter().map(|side| format!("{side}x{side}")).collect();
    println!("| scene | sampler | spp | predicted / true | {} |", heads.join(" | "));
    println!("|---|---|---|---|{}", "---|".repeat(BLOCKS.len()));
    for (name, course) in &courses {
        for sampler in SAMPLERS {
            for &spp in size.spp {
                println!("| {name} | {sampler} | {spp} | {} |", course.forecasts(sampler, spp, size.seeds)?);
            }
        }
    }
    println!(
        "\nRenders with `--error`: true relMSE over the requested relMSE (geometric mean, 95 % interval), and spp.\n"
    );
    println!("| scene | sampler | asked | true / asked | predicted / asked | spp |");
    println!("|---|---|---|---|---|---|");
    for (name, course) in &courses {
        for sampler in SAMPLERS {
            for &asked in size.errors {
                println!("| {name} | {sampler} | {asked} | {} |", course.stops(sampler, asked, size.seeds)?);
            }
        }
    }
    Ok(())
}

impl Course {
    fn new(name: &str, size: &Size) -> Result<Self> {
        let scene = bundled::files(name).ok_or("a bundled scene is missing")?.read()?;
        let world = Arc::new(World::with_resolution(&scene, [size.side; 2])?);
        let frame = Frame::new(size.side, size.side)?;
        let mut course = Self { world, frame, reference: Vec::new(), noise: Vec::new() };
        let limits = Limits::samples(size.reference_spp * frame.pixels() as u64);
        let film = course.film("uniform", "random", 1 << 32, limits, Needs::none().with_variance())?;
        course.reference = (0..frame.pixels()).map(|i| film.mean(i)).collect();
        let noise = |i: usize| film.moments(i).variance().map(|v| v.map(|v| v / film.count(i) as f64));
        course.noise = (0..frame.pixels()).map(noise).collect::<Option<_>>().ok_or("a reference of one sample")?;
        Ok(course)
    }

    fn film(&self, sampler: &str, points: &str, seed: u64, limits: Limits, needs: Needs) -> Result<Film> {
        let points = registry::points(points, PointSettings { seed, spp: None })?;
        let mut sampler = registry::sampler(sampler, points, &MethodInputs::of(self.world.clone()))?.sampler;
        Ok(Render::new(self.frame, &limits).needs(needs).run(&mut *integrator(&self.world), &mut *sampler)?)
    }

    /// The relMSE of a film, with the error due to the reference's own variance subtracted.
    fn error(&self, film: &Film) -> f64 {
        let channels = self.frame.pixels() * 3;
        let sum: f64 = (0..channels).map(|k| self.squared(film, k) / (self.at(k).powi(2) + RELATIVE_EPSILON)).sum();
        sum / channels as f64
    }

    /// The reference in channel `k % 3` of pixel `k / 3`.
    fn at(&self, k: usize) -> f64 {
        self.reference[k / 3][k % 3]
    }

    /// The squared error of channel `k % 3` of pixel `k / 3`, minus the variance of the reference there.
    fn squared(&self, film: &Film, k: usize) -> f64 {
        (film.mean(k / 3)[k % 3] - self.at(k)).powi(2) - self.noise[k / 3][k % 3]
    }

    fn forecasts(&self, sampler: &str, spp: u64, seeds: u64) -> Result<String> {
        let mut ratios = Vec::new();
        let mut pooled = [[0.0; 3]; BLOCKS.len()];
        for seed in 1..=seeds {
            let limits = Limits::samples(spp * self.frame.pixels() as u64);
            let film = self.film(sampler, "sobol", seed, limits, Needs::none().with_halves())?;
            ratios.push(film.predicted_relmse().ok_or("no forecast")? / self.error(&film));
            for (sums, side) in pooled.iter_mut().zip(BLOCKS) {
                let found = self.covered(&film, side)?;
                (0..3).for_each(|i| sums[i] += found[i]);
            }
        }
        let ratio = geometric_mean_interval(&ratios, 0.95)?;
        let cells = pooled.map(|[held, all, width]| format!("{:.1} % x{:.2}", 100.0 * held / all, width / all));
        Ok(format!("{:.2} [{:.2}, {:.2}] | {}", ratio.value, ratio.low, ratio.high, cells.join(" | ")))
    }

    /// Three sums over pixels and channels: the intervals that contain the reference, all intervals, and the ratios of an
    /// interval's half width to 1.96 times the block's root mean squared error.
    fn covered(&self, film: &Film, side: u32) -> Result<[f64; 3]> {
        let [width, height] = self.frame.size();
        let mut found = [0.0; 3];
        for top in (0..height).step_by(side as usize) {
            for left in (0..width).step_by(side as usize) {
                let rows = top..(top + side).min(height);
                let block: Vec<usize> = rows
                    .flat_map(|y| (left..(left + side).min(width)).map(move |x| (y * width + x) as usize))
                    .collect();
                for channel in 0..3 {
                    let mut forecast = 0.0;
                    for &i in &block {
                        forecast += film.squared_error(i).ok_or("no forecast")?[channel] / block.len() as f64;
                    }
                    let truth: f64 = block.iter().map(|&i| self.squared(film, 3 * i + channel)).sum();
                    let truth = (truth / block.len() as f64).max(0.0).sqrt();
                    let half = student_t_quantile(0.975, block.len() as f64) * forecast.sqrt();
                    for &i in &block {
                        let k = 3 * i + channel;
                        let off = (film.mean(i)[channel] - self.at(k)).abs();
                        // The reference has an error too.
                        let reach = half.hypot(1.96 * self.noise[i][channel].sqrt());
                        found[0] += f64::from(u8::from(off <= reach));
                        found[1] += 1.0;
                        found[2] += if truth > 0.0 { (half / (1.96 * truth)).min(100.0) } else { 1.0 };
                    }
                }
            }
        }
        Ok(found)
    }

    fn stops(&self, sampler: &str, asked: f64, seeds: u64) -> Result<String> {
        let (mut truths, mut forecasts, mut samples) = (Vec::new(), Vec::new(), 0.0);
        for seed in 1..=seeds {
            let at_most = (1 << 14) * self.frame.pixels() as u64;
            let film = self.film(sampler, "sobol", seed, Limits::error(asked, at_most), Needs::none())?;
            truths.push(self.error(&film) / asked);
            forecasts.push(film.predicted_relmse().ok_or("no forecast")? / asked);
            samples += film.record().samples as f64 / (self.frame.pixels() as f64 * seeds as f64);
        }
        let [truth, forecast] = [truths, forecasts].map(|ratios| geometric_mean_interval(&ratios, 0.95));
        let (truth, forecast) = (truth?, forecast?);
        Ok(format!("{:.2} [{:.2}, {:.2}] | {:.2} | {samples:.1}", truth.value, truth.low, truth.high, forecast.value))
    }
}
