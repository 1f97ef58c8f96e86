//! What each safeguard of rays costs, and what breaks without it.
//!
//! ```sh
//! cargo run --release -p dapple-geometry --example price_of_rays -- --full
//! ```
//!
//! Builds itself once with each safeguard left out (in `target/price`; a minute each from nothing) and runs the programs in
//! turns. Without `--full` only itself is run, to show that it works. Prints Markdown.
#![expect(clippy::print_stdout, reason = "a program: its table is its result")]

#[path = "../benches/scenes/mod.rs"]
mod scenes;

use dapple_geometry::{Geometry, Mesh, Preset, PrimitiveId, Ray, Shape, spawn_ray};
use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use scenes::{Soup, rays, scenes, shapes};
use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const WITHOUT: [(&str, &str); 4] = [
    ("exact", "triangles finished in f64 where f32 cannot tell"),
    ("padding", "boxes grown by what rounding asks for"),
    ("ties", "the smallest number wins at the same distance"),
    ("offsets", "rays leave by a bound on the error, not by 1e-4"),
];
/// What [`broken`] counts.
const FAULTS: [&str; 4] = ["escapes", "other winners", "met again", "passed over"];
const ROUNDS: usize = 7;

fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if words.iter().any(|word| word == "--one") {
        one()
    } else if words.iter().any(|word| word == "--full") {
        all()
    } else {
        println!("{FAULTS:?}: {:?} with all safeguards", broken()?);
        Ok(())
    }
}

/// The numbers of this program: nanoseconds a ray, then faults.
fn one() -> Result<()> {
    for scene in scenes() {
        let geometry = Geometry::build(shapes(&scene.soups), Preset::default())?;
        let [primary, bounce, shadow] = rays(&geometry, scene.views);
        for (rays, any) in [(primary, false), (bounce, false), (shadow, true)] {
            let count = |_: usize| match any {
                true => rays.iter().filter(|ray| geometry.occluded(ray)).count(),
                false => rays.iter().filter(|ray| std::hint::black_box(geometry.closest(ray)).is_some()).count(),
            };
            let nanoseconds = (0..3).map(|run| {
                let start = Instant::now();
                std::hint::black_box(count(run));
                start.elapsed().as_secs_f64() / rays.len() as f64 * 1e9
            });
            println!("{}", nanoseconds.fold(f64::INFINITY, f64::min));
        }
    }
    broken()?.iter().for_each(|count| println!("{count}"));
    Ok(())
}

fn all() -> Result<()> {
    let me = std::env::current_exe()?;
    let others: Vec<PathBuf> = WITHOUT.iter().map(|(word, _)| build_without(word)).collect::<Result<_>>()?;
    let mut runs = vec![Vec::new(); 1 + others.len()];
    for _ in 0..ROUNDS {
        for (program, runs) in std::iter::once(&me).chain(&others).zip(&mut runs) {
            runs.push(figures(program)?);
        }
    }
    let kinds = runs[0][0].len() - FAULTS.len();
    println!(
        "Time with the safeguard over time without it, geometric mean over nine sets of rays (cornell 36, sphere 70k, terrain"
    );
    println!(
        "1M; primary, bounce and shadow): median of {ROUNDS} pairs (least, most). Faults of all rays tried, without it and with it.\n"
    );
    println!("| safeguard | price | least set, most | {} |", FAULTS.join(" | "));
    println!("|---|---|---|---|---|---|---|");
    for ((_, what), without) in WITHOUT.iter().zip(&runs[1..]) {
        let pairs: Vec<Vec<f64>> = runs[0]
            .iter()
            .zip(without)
            .map(|(with, without)| with.iter().zip(without).take(kinds).map(|(a, b)| a / b).collect())
            .collect();
        let mean = |ratios: &[f64]| (ratios.iter().map(|r| r.ln()).sum::<f64>() / ratios.len() as f64).exp();
        let [low, middle, high] = spread(pairs.iter().map(|pair| mean(pair)).collect());
        let by_set = (0..kinds).map(|kind| spread(pairs.iter().map(|pair| pair[kind]).collect())[1]);
        let [least, _, most] = spread(by_set.collect());
        let faults: Vec<String> =
            (kinds..kinds + FAULTS.len()).map(|i| format!("{} / {}", without[0][i], runs[0][0][i])).collect();
        println!("| {what} | {middle:.3} ({low:.3}, {high:.3}) | {least:.2}, {most:.2} | {} |", faults.join(" | "));
    }
    Ok(())
}

fn build_without(word: &str) -> Result<PathBuf> {
    let target = PathBuf::from(format!("target/price/{word}"));
    let flags = format!("--cfg dapple_without=\"{word}\"");
    let words = ["build", "--quiet", "--release", "--offline", "-p", "dapple-geometry", "--example", "price_of_rays"];
    let done =
        Command::new(env!("CARGO")).args(words).env("RUSTFLAGS", flags).env("CARGO_TARGET_DIR", &target).status()?;
    if !done.success() {
        return Err(format!("could not be built without {word}").into());
    }
    Ok(target.join("release/examples/price_of_rays"))
}

fn figures(program: &PathBuf) -> Result<Vec<f64>> {
    let output = Command::new(program).arg("--one").output()?;
    let said = String::from_utf8(output.stdout)?;
    Ok(said.lines().map(str::parse).collect::<std::result::Result<_, _>>()?)
}

/// Least, middle and most.
fn spread(mut all: Vec<f64>) -> [f64; 3] {
    all.sort_by(f64::total_cmp);
    [all[0], all[all.len() / 2], all[all.len() - 1]]
}

/// How often things go wrong in inputs made to break them; what [`FAULTS`] names.
fn broken() -> Result<[usize; 4]> {
    Ok([escapes()?, other_winners()?, met_again()?, passed_over()?])
}

fn build(soups: Vec<Soup>, preset: Preset) -> Result<Geometry> {
    let meshes = soups.into_iter().map(|(positions, triangles)| Ok(Shape::from(Mesh::new(positions, triangles)?)));
    Ok(Geometry::build(meshes.collect::<Result<_>>()?, preset)?)
}

/// Rays from inside a closed sphere, far from the origin and near, at its vertices and the middles of its edges; along
/// the axes through the corners of a grid.
fn escapes() -> Result<usize> {
    let mut count = 0;
    for centre in [DVec3::ZERO, DVec3::new(0.3, -0.7, 0.11), DVec3::new(148_376.0, 1_234.0, -223_423.0)] {
        let soup = scenes::sphere(50, 2.0, centre);
        let scene = build(vec![soup.clone()], Preset::default())?;
        for offset in [DVec3::ZERO, DVec3::new(0.5, -0.25, 0.125), DVec3::new(-0.7, 0.9, 0.3)] {
            let eye = (centre + offset).as_vec3();
            for triangle in &soup.1 {
                let [a, b, c] = triangle.map(|v| Vec3::from_array(soup.0[v as usize]));
                for aim in [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5] {
                    count += usize::from(scene.closest(&Ray::new(eye, (aim - eye).normalize())).is_none());
                }
            }
        }
    }
    Ok(count)
}

/// Rays onto two layers in one plane: those for which another preset has another winner.
fn other_winners() -> Result<usize> {
    let layer = |n: u32| scenes::grid(n, n, |u, v| DVec3::new(u * 8.0 - 4.0, v * 8.0 - 4.0, 0.0));
    let scene = |preset| build(vec![layer(8), layer(5)], preset);
    let [one, other] = [scene(Preset::Fastest)?, scene(Preset::Medium)?];
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let differ = |_: &usize| {
        let [x, y] = [(); 2].map(|()| rng.random_range(-4.0..4.0));
        let ray = Ray::new(Vec3::new(x, y, 5.0), Vec3::NEG_Z);
        one.closest(&ray).map(|hit| (hit.shape, hit.primitive))
            != other.closest(&ray).map(|hit| (hit.shape, hit.primitive))
    };
    Ok((0..10_000).filter(differ).count())
}

/// Rays that leave triangles of many sizes and meet them again; the walk is not told where they start.
fn met_again() -> Result<usize> {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let mut count = 0;
    for _ in 0..1000 {
        let size = 10.0_f32.powf(rng.random_range(-4.0..4.0));
        let corners: Vec<[f32; 3]> = (0..3).map(|_| std::array::from_fn(|_| rng.random_range(-size..size))).collect();
        let middle = corners.iter().fold(Vec3::ZERO, |sum, p| sum + Vec3::from_array(*p) / 3.0);
        let scene = build(vec![(corners, vec![[0, 1, 2]])], Preset::Fastest)?;
        let eye = middle + random_direction(&mut rng) * size;
        let ray = Ray::new(eye, middle - eye);
        let Some(hit) = scene.closest(&ray) else { continue };
        let point = scene.surface(&ray, &hit);
        for _ in 0..100 {
            let next = Ray { ends: [PrimitiveId::NONE; 2], ..spawn_ray(&point, random_direction(&mut rng)) };
            count += usize::from(scene.occluded(&next));
        }
    }
    Ok(count)
}

/// Rays from a sheet straight to another one, just above: those that do not meet it.
fn passed_over() -> Result<usize> {
    let sheet = |z: f64| scenes::grid(4, 4, |u, v| DVec3::new(u, v, z));
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    let mut count = 0;
    for gap in [1e-2, 1e-3, 2e-4, 9e-5, 1e-5] {
        let scene = build(vec![sheet(0.0), sheet(gap)], Preset::default())?;
        for _ in 0..1000 {
            let [x, y] = [(); 2].map(|()| rng.random_range(0.1..0.9));
            let ray = Ray::new(Vec3::new(x, y, -1.0), Vec3::Z);
            let Some(hit) = scene.closest(&ray) else { continue };
            let next = spawn_ray(&scene.surface(&ray, &hit), Vec3::Z);
            count += usize::from(scene.closest(&next).is_none_or(|hit| hit.shape != 1));
        }
    }
    Ok(count)
}

fn random_direction(rng: &mut Pcg64Mcg) -> Vec3 {
    loop {
        let v = Vec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}
