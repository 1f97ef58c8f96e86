//! A comparison with Embree on the same triangles and rays, one thread each, in alternation.
//!
//! ```sh
//! cargo run --release -p dapple-geometry --example beside_embree -- --full
//! ```
//!
//! It needs a C++ compiler and Embree 3 (Debian's `libembree-dev`). Without them, it prints a message and only Dapple's
//! figures. Without `--full` it runs the smallest scene once, as a test. Prints Markdown.

#![expect(clippy::print_stdout, reason = "a program: its table is its result")]

#[path = "../../../benches/scenes/mod.rs"]
mod scenes;

use dapple_geometry::{Geometry, Ray, Shape};
use scenes::{Scene, Soup, rays, scenes, shapes};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The result of a ray tracer: seconds to build the tree, nanoseconds per ray, and the number of hits.
#[derive(Clone, Copy)]
struct Run {
    build: f64,
    ray: f64,
    hits: usize,
}

fn main() -> Result<()> {
    let full = std::env::args().any(|word| word == "--full");
    let (rounds, repeats) = if full { (5, 3) } else { (1, 1) };
    let folder = tempfile::tempdir()?;
    let embree = match compile(folder.path()) {
        Ok(program) => Some(program),
        Err(why) => {
            println!("Embree is not here, so only our own figures: {why}\n");
            None
        }
    };
    println!("Nanoseconds a ray, median of {rounds} (least, most); ratios of medians: above 1 we are faster.\n");
    println!(
        "| scene | rays | ours | Embree robust | Embree fast | over robust | over fast | hits: ours, robust, fast |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let mut builds = Vec::new();
    for scene in scenes().iter().take(if full { 4 } else { 1 }) {
        builds.push(measure(scene, folder.path(), embree.as_deref(), rounds, repeats)?);
    }
    println!(
        "\nBuilding, M triangles a second:\n\n| scene | triangles | ours, one thread | ours, two threads | Embree robust, one thread | bytes a triangle |"
    );
    println!("|---|---|---|---|---|---|");
    builds.iter().for_each(|line| println!("{line}"));
    Ok(())
}

/// Prints the table rows of a scene and returns the row of its build time.
fn measure(scene: &Scene, folder: &Path, embree: Option<&Path>, rounds: usize, repeats: usize) -> Result<String> {
    let soup = folder.join("soup");
    write_soup(&soup, &scene.soups)?;
    let (geometry, built) = build(&shapes(&scene.soups), rounds)?;
    let mut theirs_built = Vec::new();
    for (kind, rays) in ["primary", "bounce", "shadow"].iter().zip(rays(&geometry, scene.views)) {
        let any = *kind == "shadow";
        let file = folder.join("rays");
        write_rays(&file, &rays)?;
        let mut runs = [const { Vec::new() }; 3];
        for _ in 0..rounds {
            runs[0].push(trace(&geometry, &rays, any, repeats));
            let Some(program) = embree else { continue };
            for (way, runs) in ["robust", "fast"].iter().zip(&mut runs[1..]) {
                runs.push(trace_there(program, [&soup, &file], way, any, repeats)?);
            }
        }
        theirs_built.extend(runs[1].iter().map(|run| run.build));
        let figure = |runs: &[Run]| median(runs.iter().map(|run| run.ray).collect());
        let said = |runs: &[Run]| {
            figure(runs).map_or("–".to_owned(), |[low, middle, high]| format!("{middle:.0} ({low:.0}, {high:.0})"))
        };
        let ratio = |i: usize| match (figure(&runs[0]), figure(&runs[i])) {
            (Some([_, ours, _]), Some([_, theirs, _])) => format!("{:.2}", theirs / ours),
            _ => "–".to_owned(),
        };
        let hits = |i: usize| runs[i].first().map_or("–".to_owned(), |run: &Run| run.hits.to_string());
        let [ours, robust, fast] = runs.each_ref().map(|runs| said(runs));
        let all_hits = [0, 1, 2].map(hits).join(", ");
        println!("| {} | {kind} | {ours} | {robust} | {fast} | {} | {} | {all_hits} |", scene.name, ratio(1), ratio(2));
    }
    let count = geometry.triangle_count() as f64;
    let rate = |seconds: Vec<f64>| {
        median(seconds).map_or("–".to_owned(), |[low, middle, high]| {
            let [slow, usual, quick] = [high, middle, low].map(|s| count / s / 1e6);
            format!("{usual:.2} ({slow:.2}, {quick:.2})")
        })
    };
    let bytes = geometry.memory_bytes() as f64 / count;
    let [alone, both] = built.map(rate);
    Ok(format!("| {} | {count} | {alone} | {both} | {} | {bytes:.0} |", scene.name, rate(theirs_built)))
}

/// Builds a scene with one thread and with two, in alternation. Returns the last tree and the seconds of each build.
fn build(shapes: &[Shape], rounds: usize) -> Result<(Geometry, [Vec<f64>; 2])> {
    let pools = [1, 2].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build());
    let mut seconds = [const { Vec::new() }; 2];
    let mut last = None;
    for _ in 0..rounds {
        for (pool, seconds) in pools.iter().zip(&mut seconds) {
            let pool = pool.as_ref().map_err(ToString::to_string)?;
            let shapes = shapes.to_vec();
            let (geometry, elapsed) = pool.install(|| {
                spread_threads();
                let start = Instant::now();
                (Geometry::build(shapes), start.elapsed().as_secs_f64())
            });
            last = Some(geometry?);
            seconds.push(elapsed);
        }
    }
    Ok((last.ok_or("no rounds")?, seconds))
}

/// Keeps all threads of the pool busy until the system has given each a processor of its own. Linux often starts two on
/// the same one and moves the second after 4 ms, half of a build of 70,000 triangles.
fn spread_threads() {
    rayon::broadcast(|_| {
        let start = Instant::now();
        while start.elapsed() < Duration::from_millis(20) {}
    });
}

fn trace(scene: &Geometry, rays: &[Ray], any: bool, repeats: usize) -> Run {
    let (mut best, mut hits) = (f64::INFINITY, 0);
    for _ in 0..repeats {
        let start = Instant::now();
        hits = match any {
            true => rays.iter().filter(|ray| scene.occluded(ray)).count(),
            false => rays.iter().filter(|ray| std::hint::black_box(scene.closest(ray)).is_some()).count(),
        };
        best = best.min(start.elapsed().as_secs_f64() / rays.len() as f64 * 1e9);
    }
    Run { build: 0.0, ray: best, hits }
}

fn trace_there(program: &Path, files: [&Path; 2], way: &str, any: bool, repeats: usize) -> Result<Run> {
    let mut command = Command::new(program);
    command.args(files).args([way, if any { "any" } else { "closest" }, &repeats.to_string()]);
    let said = String::from_utf8(command.output()?.stdout)?;
    let words: Vec<&str> = said.split_whitespace().collect();
    let &[build, ray, hits, _] = &words[..] else { return Err(format!("Embree said: {said}").into()) };
    Ok(Run { build: build.parse()?, ray: ray.parse()?, hits: hits.parse()? })
}

fn compile(folder: &Path) -> Result<PathBuf> {
    let (source, program) = (Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/embree.cpp"), folder.join("embree"));
    let words = ["-O3", "-std=c++17", "-o"];
    let output = Command::new("c++").args(words).arg(&program).arg(source).arg("-lembree3").output()?;
    if output.status.success() { Ok(program) } else { Err(String::from_utf8_lossy(&output.stderr).into()) }
}

fn write_soup(path: &Path, soups: &[Soup]) -> Result<()> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let count: usize = soups.iter().map(|(_, triangles)| triangles.len()).sum();
    file.write_all(&u32::try_from(count)?.to_le_bytes())?;
    for (positions, triangles) in soups {
        for x in triangles.iter().flatten().flat_map(|&corner| positions[corner as usize]) {
            file.write_all(&x.to_le_bytes())?;
        }
    }
    Ok(file.flush()?)
}

fn write_rays(path: &Path, rays: &[Ray]) -> Result<()> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    for ray in rays {
        let (from, along) = (ray.origin.extend(ray.tmin), ray.direction.extend(ray.tmax));
        for x in from.to_array().into_iter().chain(along.to_array()) {
            file.write_all(&x.to_le_bytes())?;
        }
    }
    Ok(file.flush()?)
}

/// Returns the smallest value, the median and the largest value.
fn median(mut all: Vec<f64>) -> Option<[f64; 3]> {
    all.sort_by(f64::total_cmp);
    Some([*all.first()?, *all.get(all.len() / 2)?, *all.last()?])
}
