//! Adaptive against uniform sampling, at equal time and at equal samples, with intervals.
//!
//! ```sh
//! cargo run --release --example equal_time -- --full > docs/results/equal-time.md
//! ```
//!
//! For each scene and seed it renders the uniform picture, then the adaptive one with as many samples as
//! take the same time, in turns and on one thread; errors are taken against a reference of another point
//! set and seed, whose own variance is printed beside them. Unfiltered: `thesis_tables` has the whole
//! factorial with filters. Ratios are geometric means over seeds with 95 % intervals (paired log
//! ratios, Student's t). Without `--full` a small form runs in seconds, to show that it works.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a program: its table is its result")]

use dapple::core::{Frame, Limits, Needs, NoWatch, render};
use dapple::metrics::{Comparison, Pixels, compare};
use dapple::renderer::{Stage, World, bundled, integrator, pbrt, registry, scene};
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// What the run spends.
struct Size {
    side: u32,
    spp: u64,
    seeds: u64,
    reference_spp: u64,
}

/// Student's t for 95 % two-sided intervals, by degrees of freedom 1 to 15.
const STUDENT: [f64; 15] =
    [12.71, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131];

fn main() -> Result<()> {
    let full = std::env::args().any(|a| a == "--full");
    let size = match full {
        true => Size { side: 128, spp: 32, seeds: 8, reference_spp: 2048 },
        false => Size { side: 24, spp: 8, seeds: 3, reference_spp: 128 },
    };
    println!(
        "{}x{} pixels, {} spp uniform, {} seeds, one thread for what is timed; reference {} spp, random points.\n",
        size.side, size.side, size.spp, size.seeds, size.reference_spp
    );
    println!("`variance` over `uniform`, both on `sobol`, filter `none`: below 1 adaptive wins.\n");
    println!(
        "| scene | relMSE, equal time | trimmed relMSE, equal time | sRGB MSE, equal time | relMSE, equal spp | spp at equal time | relMSE of uniform | of the reference |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (name, scene) in scenes()? {
        let row = race(&scene, &size)?;
        println!("| {name} | {row} |");
    }
    Ok(())
}

/// The bundled scenes and, where it is at hand, Bitterli's Cornell box.
fn scenes() -> Result<Vec<(String, scene::Scene)>> {
    let mut scenes = Vec::new();
    for name in ["teapot", "terrain", "cornell"] {
        let bundle = bundled::files(name).ok_or("a bundled scene is missing")?;
        scenes.push((name.to_owned(), bundle.read()?));
    }
    let folder = std::env::var("DAPPLE_SCENES").unwrap_or_else(|_| "../shared/scenes".into());
    let shared = std::path::Path::new(&folder).join("pbrt-v4/cornell-box/scene-v4.pbrt");
    if shared.is_file() {
        scenes.push(("cornell-box (shared)".into(), pbrt::read_scene(&shared, &pbrt::ReadOptions::default())?));
    } else {
        eprintln!("skipped: cornell-box, no scenes in {folder}");
    }
    for (_, scene) in &mut scenes {
        scene.film.pixel_filter = scene::PixelFilter::default();
    }
    Ok(scenes)
}

struct Picture {
    pixels: Vec<[f32; 3]>,
    seconds: f64,
}

fn picture(world: &World, sampler: &str, points: &str, seed: u64, side: u32, samples: u64) -> Result<Picture> {
    let mut integrator = integrator(world);
    let spp = samples / u64::from(side * side);
    let points = registry::points(points, registry::Setting { seed, spp: Some(spp) })?;
    let mut sampler = registry::sampler(sampler, points, &Stage::empty())?;
    let frame = Frame::new(side, side)?;
    let start = Instant::now();
    let film = render(&mut *integrator, &mut *sampler, Needs::none(), frame, &Limits::samples(samples), &mut NoWatch)?;
    Ok(Picture { pixels: film.picture(), seconds: start.elapsed().as_secs_f64() })
}

/// Renders on one thread: that thread's wall time is what is compared.
fn timed(world: &World, sampler: &str, seed: u64, side: u32, samples: u64) -> Result<Picture> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let send = pool.install(|| picture(world, sampler, "sobol", seed, side, samples).map_err(|e| e.to_string()));
    Ok(send?)
}

fn race(scene: &scene::Scene, size: &Size) -> Result<String> {
    let world = World::with_resolution(scene, [size.side; 2])?;
    let pixels = u64::from(size.side * size.side);
    let samples = size.spp * pixels;
    // Two halves of the reference by different seeds: their difference tells its own error.
    let half = |seed| picture(&world, "uniform", "random", seed, size.side, size.reference_spp / 2 * pixels);
    let (a, b) = (half(1001)?.pixels, half(1002)?.pixels);
    let mean = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (a[c] + b[c]) * 0.5);
    let reference: Vec<[f32; 3]> = a.iter().zip(&b).map(mean).collect();
    let score = |p: &[[f32; 3]], r: &[[f32; 3]]| -> Result<Comparison> {
        Ok(compare(Pixels::new([size.side; 2], p)?, Pixels::new([size.side; 2], r)?)?)
    };
    let own = score(&a, &b)?.rel_mse / 4.0;

    let mut adaptive_samples = samples;
    let mut logs: [Vec<f64>; 4] = Default::default();
    let mut uniform_error = 0.0;
    for seed in 1..=size.seeds {
        let uniform = timed(&world, "uniform", seed, size.side, samples)?;
        let equal_spp = timed(&world, "variance", seed, size.side, samples)?;
        let rate = uniform.seconds / equal_spp.seconds;
        adaptive_samples = (samples as f64 * rate).max(pixels as f64) as u64;
        let equal_time = timed(&world, "variance", seed, size.side, adaptive_samples)?;
        let (u, t, s) = (
            score(&uniform.pixels, &reference)?,
            score(&equal_time.pixels, &reference)?,
            score(&equal_spp.pixels, &reference)?,
        );
        uniform_error += u.rel_mse / size.seeds as f64;
        // The reference's own error is in both and is taken out.
        let relative = |x: f64, y: f64, own: f64| ((x - own).max(1e-12) / (y - own).max(1e-12)).ln();
        logs[0].push(relative(t.rel_mse, u.rel_mse, own));
        logs[1].push((t.rel_mse_trimmed / u.rel_mse_trimmed).ln());
        logs[2].push((t.srgb8_mse / u.srgb8_mse).ln());
        logs[3].push(relative(s.rel_mse, u.rel_mse, own));
    }
    let [time, trimmed, display, spp] = logs.map(|l| interval(&l));
    let mean_spp = adaptive_samples as f64 / pixels as f64;
    Ok(format!("{time} | {trimmed} | {display} | {spp} | {mean_spp:.1} | {uniform_error:.3e} | {own:.1e}"))
}

/// The geometric mean of ratios with its 95 % interval.
fn interval(logs: &[f64]) -> String {
    let n = logs.len() as f64;
    let mean = logs.iter().sum::<f64>() / n;
    let variance = logs.iter().map(|l| (l - mean) * (l - mean)).sum::<f64>() / (n - 1.0);
    let half = STUDENT[(logs.len() - 2).min(STUDENT.len() - 1)] * (variance / n).sqrt();
    format!("{:.2} [{:.2}, {:.2}]", mean.exp(), (mean - half).exp(), (mean + half).exp())
}
