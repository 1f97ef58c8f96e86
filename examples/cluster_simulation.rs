//! The efficiency of a render on many machines, simulated from measured costs of rows.
//!
//! ```sh
//! cargo run --release --example cluster_simulation -- measure > docs/results/cluster-rows.csv
//! cargo run --release --example cluster_simulation -- docs/results/cluster-rows.csv > table.md
//! ```
//!
//! `measure` renders bundled scenes and prints the rays of each row of pixels, in the pilot and in the rounds after it.
//! Rays are counted, not timed, so that a busy machine does not matter. The second command simulates the barriers of the
//! default render: passes of 1, 1, 2, 4, … samples per pixel, each dealt in bands of 16 rows. The assumptions are the
//! constants below; `docs/results/cluster.md` discusses them.

#![expect(clippy::print_stdout, reason = "a program whose table is its result")]

use dapple::core::{Frame, Limits, Needs, Render};
use dapple::job::registry::{self, MethodInputs, Setting};
use dapple::renderer::{World, integrator};
use dapple_scene::bundled;
use std::sync::Arc;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Scenes with their rays per second and thread, from docs/results/speed.md: a box, and scenes of models.
const SCENES: [(&str, f64); 3] = [("cornell", 5.5e6), ("teapot", 3.0e6), ("cabin", 2.0e6)];
/// Width and height of the measured images.
const MEASURED: [u32; 2] = [320, 180];
/// Width and height in CI.
const SMALL: [u32; 2] = [32, 18];
/// Samples per pixel of the pilot and of the whole measured render.
const PILOT: u64 = 8;
const SPP: u64 = 32;

/// Rows of pixels in a band.
const BAND: usize = 16;
/// Samples per pixel between two barriers; the first five are the pilot, a quarter of all, and four of these train.
const PASSES: [f64; 7] = [1.0, 1.0, 2.0, 4.0, 248.0, 256.0, 512.0];
const PILOT_PASSES: usize = 5;
const TRAINING_PASSES: usize = 4;
/// The part of the expected time after which machines deal bands anew; the least expected seconds, and per second of moving.
const MEETING: f64 = 0.75;
const LEAST: f64 = 0.1;
const PER_SECOND: f64 = 20.0;
/// The most bands of a machine that gets one within a round, relative to equal shares.
const MORE: f64 = 1.25;
/// Bytes per pixel of a band that moves.
const MOVED_BYTES: f64 = 350.0;
/// Threads of a machine; each pass divides its bands among them without loss.
const THREADS: f64 = 64.0;
/// The network: bytes per second that a machine receives, and seconds of a message through all machines.
const BANDWIDTH: f64 = 100e9 / 8.0;
const LATENCY: f64 = 1e-3;
/// Rows around a band that a machine reads to plan it, bytes per pixel of them, and bytes of training data per pass.
const HALO_ROWS: f64 = 4.0;
const HALO_BYTES: f64 = 56.0;
const TRAINING_BYTES: f64 = 8e6;
/// Seconds per pixel and thread of planning a round and of the filter; every machine plans and filters its own rows.
const PLAN_SECONDS: f64 = 0.1e-6;
const FILTER_SECONDS: f64 = 18e-6;
/// Rows that the filter reads above and below its own at the finest scale, grids included, and bytes per pixel that it reads.
const FILTER_ROWS: f64 = 70.0;
const FILTER_BYTES: f64 = 350.0;
/// Bytes per pixel that the first machine gets at the end: the image with its errors, and the statistics that an EXR file shows.
const DELIVERED_BYTES: f64 = 16.0 + 276.0;
/// The standard deviation of a machine's speed, and of a pass on it.
const SPEED: f64 = 0.03;
const JITTER: f64 = 0.01;
/// The share of stragglers, and their speed.
const STRAGGLERS: f64 = 0.01;
const STRAGGLER_SPEED: f64 = 0.5;
/// Mean hours between failures of a machine, and seconds until a failed job runs again.
const HOURS_TO_FAILURE: f64 = 2000.0;
const RESTART_SECONDS: f64 = 60.0;
/// Simulated renders of each case.
const TRIALS: u64 = 5;

fn main() -> Result<()> {
    let argument = std::env::args().nth(1).ok_or("give `measure`, or the file that it printed")?;
    if argument == "measure" {
        print!("{}", measured(MEASURED)?);
        return Ok(());
    }
    // CI gives a folder: both commands with a small image.
    let (text, measured) = match std::path::Path::new(&argument).is_dir() {
        true => (measured(SMALL)?, SMALL),
        false => (std::fs::read_to_string(&argument).map_err(|e| format!("{argument}: {e}"))?, MEASURED),
    };
    println!(
        "| scene | image | machines | interleaved | by cost | and within rounds | and stragglers | and failures | minutes |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (name, rays_per_second) in SCENES {
        let rows = Rows::read(&text, name, measured[0])?;
        for [width, height] in [[3840, 2160], [15360, 8640]] {
            for machines in [64, 256, 1024] {
                println!("{}", row(name, &rows, rays_per_second, [width, height], machines));
            }
        }
    }
    Ok(())
}

/// The rays of each row of each scene, as lines of text below their heads.
fn measured(size: [u32; 2]) -> Result<String> {
    let lines: Vec<String> = SCENES.iter().map(|(name, _)| measured_scene(name, size)).collect::<Result<_>>()?;
    Ok(format!("scene,row,pilot,later\n{}", lines.concat()))
}

fn measured_scene(name: &str, [width, height]: [u32; 2]) -> Result<String> {
    let scene = bundled::files(name).ok_or("unknown scene")?.read()?;
    let world = Arc::new(World::new(&scene)?);
    let frame = Frame::new(width, height)?;
    let rays = |sampler: &str, spp: u64| -> Result<Vec<u64>> {
        let points = registry::points("sobol", Setting { seed: 1, spp: None })?;
        let mut sampler = registry::sampler(sampler, points, &MethodInputs::of(world.clone()))?.sampler;
        let limits = Limits::samples(spp * frame.pixels() as u64);
        let render = Render::new(frame, &limits).needs(Needs::none().with_cost());
        let film = render.run(&mut *integrator(&world), &mut *sampler)?;
        let row = |y: usize| (0..width as usize).filter_map(|x| film.cost(y * width as usize + x)).sum();
        Ok((0..height as usize).map(row).collect())
    };
    let (pilot, all) = (rays("uniform", PILOT)?, rays("adaptive", SPP)?);
    let line =
        |(row, (pilot, all)): (usize, (&u64, &u64))| format!("{name},{row},{pilot},{}\n", all.saturating_sub(*pilot));
    Ok(pilot.iter().zip(&all).enumerate().map(line).collect())
}

/// Rays per sample of the mean pixel of each measured row, in the pilot and later: the share that the sampler gives the row
/// is part of the latter.
struct Rows {
    pilot: Vec<f64>,
    later: Vec<f64>,
}

impl Rows {
    fn read(text: &str, scene: &str, width: u32) -> Result<Self> {
        let mut rows = Self { pilot: Vec::new(), later: Vec::new() };
        for line in text.lines().filter(|line| line.split(',').next() == Some(scene)) {
            let values: Vec<f64> = line.split(',').skip(2).map(str::parse).collect::<std::result::Result<_, _>>()?;
            let [pilot, later] = values[..] else { return Err(format!("\"{line}\" has no two numbers").into()) };
            let pixels = f64::from(width);
            rows.pilot.push(pilot / (pixels * PILOT as f64));
            rows.later.push(later / (pixels * (SPP - PILOT) as f64));
        }
        if rows.pilot.is_empty() { Err(format!("the file has no rows of {scene}").into()) } else { Ok(rows) }
    }

    /// The rays of each band of an image of this size, per sample of a pixel on average.
    fn bands(&self, pass: usize, [width, height]: [usize; 2]) -> Vec<f64> {
        let rows = if pass < PILOT_PASSES { &self.pilot } else { &self.later };
        let of_row = |y: usize| width as f64 * interpolated(rows, (y as f64 + 0.5) / height as f64);
        (0..height).step_by(BAND).map(|top| (top..(top + BAND).min(height)).map(of_row).sum()).collect()
    }
}

/// The value at a place from 0 to 1 among values at the centres of equal intervals.
fn interpolated(values: &[f64], place: f64) -> f64 {
    let at = (place * values.len() as f64 - 0.5).clamp(0.0, (values.len() - 1) as f64);
    let (first, share) = (at as usize, at.fract());
    values[first] + share * (values[(first + 1).min(values.len() - 1)] - values[first])
}

/// Random numbers by SplitMix64, so that the table is the same everywhere.
struct Numbers(u64);

impl Numbers {
    /// The next number in 0 .. 1.
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A normal number, as the sum of twelve uniform ones.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// The effects that a simulation includes.
#[derive(Clone, Copy)]
struct With {
    /// Bands are dealt by their measured seconds for a sample and the samples of the next pass, not in turns.
    by_cost: bool,
    /// Bands are dealt anew within rounds, by what each has left.
    meets: bool,
    stragglers: bool,
    failures: bool,
}

fn row(name: &str, rows: &Rows, rays_per_second: f64, size: [usize; 2], machines: usize) -> String {
    let none = With { by_cost: false, meets: false, stragglers: false, failures: false };
    let cases = [
        none,
        With { by_cost: true, ..none },
        With { by_cost: true, meets: true, ..none },
        With { by_cost: true, meets: true, stragglers: true, failures: false },
        With { by_cost: true, meets: true, stragglers: true, failures: true },
    ];
    let alone = work(rows, rays_per_second, size);
    let mean = |with: With| {
        let seconds = |trial| render(rows, rays_per_second, size, machines, with, &mut Numbers(trial));
        (1..=TRIALS).map(seconds).sum::<f64>() / TRIALS as f64
    };
    let seconds = cases.map(mean);
    let [a, b, c, d, e] = seconds.map(|seconds| format!("{:.2}", alone / (machines as f64 * seconds)));
    let [width, height] = size;
    format!("| {name} | {width}x{height} | {machines} | {a} | {b} | {c} | {d} | {e} | {:.2} |", seconds[4] / 60.0)
}

/// The seconds of one machine without any loss: tracing, planning and the filter.
fn work(rows: &Rows, rays_per_second: f64, size: [usize; 2]) -> f64 {
    let pixels = (size[0] * size[1]) as f64;
    let rays: f64 = (0..PASSES.len()).map(|pass| PASSES[pass] * rows.bands(pass, size).iter().sum::<f64>()).sum();
    (rays / rays_per_second + pixels * (FILTER_SECONDS + PLAN_SECONDS * rounds())) / THREADS
}

/// Rounds of the default sampler: the pilot, and two after it.
fn rounds() -> f64 {
    3.0
}

/// The seconds of a render on several machines.
fn render(
    rows: &Rows,
    rays_per_second: f64,
    size: [usize; 2],
    machines: usize,
    with: With,
    numbers: &mut Numbers,
) -> f64 {
    let speeds: Vec<f64> = (0..machines)
        .map(|_| {
            let speed = (1.0 + SPEED * numbers.normal()).max(0.5);
            if with.stragglers && numbers.uniform() < STRAGGLERS { speed * STRAGGLER_SPEED } else { speed }
        })
        .collect();
    let pixels = (size[0] * size[1]) as f64;
    let mut total = 0.0;
    // Bands by machine, at first in turns.
    let count = size[1].div_ceil(BAND);
    let mut owner: Vec<usize> = (0..count).map(|band| band % machines).collect();
    for (pass, spp) in PASSES.into_iter().enumerate() {
        let costs = rows.bands(pass, size);
        // Seconds of each band on the machine that has it, whose speed differs a little from pass to pass.
        let speeds: Vec<f64> = speeds.iter().map(|speed| speed / (1.0 + JITTER * numbers.normal().abs())).collect();
        let work: Vec<f64> = costs.iter().map(|cost| spp * cost / (rays_per_second * THREADS)).collect();
        let trains = pass < TRAINING_PASSES;
        let mut took = LATENCY + if trains { TRAINING_BYTES / BANDWIDTH } else { 0.0 };
        took += if with.meets && !trains {
            traced_with_meetings(work, &mut owner.clone(), &speeds, size[0])
        } else {
            loads(&work, &owner, &speeds).into_iter().fold(0.0, f64::max)
        };
        if !trains {
            let most = (count.div_ceil(machines) * BAND * size[0]) as f64;
            took += most * (HALO_BYTES * HALO_ROWS / BAND as f64 / BANDWIDTH + PLAN_SECONDS / THREADS);
        }
        if with.failures && numbers.uniform() < machines as f64 * took / (HOURS_TO_FAILURE * 3600.0) {
            took += numbers.uniform() * took + RESTART_SECONDS;
        }
        total += took;
        if with.by_cost {
            let next = rows.bands((pass + 1).min(PASSES.len() - 1), size);
            owner = dealt(&next, &speeds);
        }
    }
    let own = size[1] as f64 / machines as f64;
    let read = (own + 2.0 * FILTER_ROWS).min(size[1] as f64);
    let slowest = speeds.iter().copied().fold(f64::INFINITY, f64::min);
    let filter = read * size[0] as f64 * (FILTER_SECONDS / (THREADS * slowest) + FILTER_BYTES / BANDWIDTH);
    total + filter + pixels * DELIVERED_BYTES / BANDWIDTH
}

/// The seconds that each machine takes for its bands.
fn loads(work: &[f64], owner: &[usize], speeds: &[f64]) -> Vec<f64> {
    let mut seconds = vec![0.0; speeds.len()];
    work.iter().zip(owner).for_each(|(work, owner)| seconds[*owner] += work / speeds[*owner]);
    seconds
}

/// The seconds until all bands are traced, if machines meet, and move bands from the one that would end last to the one that
/// would end first. All bands of a machine progress together.
fn traced_with_meetings(mut work: Vec<f64>, owner: &mut [usize], speeds: &[f64], width: usize) -> f64 {
    let (mut took, mut moving) = (0.0, 0.0_f64);
    loop {
        let mut loads = loads(&work, owner, speeds);
        let expected = loads.iter().sum::<f64>() / loads.len() as f64;
        if expected < LEAST.max(PER_SECOND * moving) {
            return took + loads.into_iter().fold(0.0, f64::max);
        }
        let wait = MEETING * expected;
        for (work, owner) in work.iter_mut().zip(&*owner) {
            *work *= 1.0 - (wait / loads[*owner].max(f64::MIN_POSITIVE)).min(1.0);
        }
        loads.iter_mut().for_each(|load| *load = (*load - wait).max(0.0));
        let mut moved = vec![0; loads.len()];
        let most = (MORE * work.len() as f64 / loads.len() as f64).ceil() as usize;
        loop {
            let by_load = |a: &usize, b: &usize| loads[*a].total_cmp(&loads[*b]);
            let (Some(last), Some(first)) = ((0..loads.len()).max_by(by_load), (0..loads.len()).min_by(by_load)) else {
                break;
            };
            // The later of both ends after a move. A machine knows what a band takes on its owner.
            let after = |band: &usize| {
                let seconds = work[*band] / speeds[last];
                (loads[last] - seconds).max(loads[first] + seconds)
            };
            let own = (0..work.len()).filter(|band| owner[*band] == last);
            let Some(band) = own.min_by(|a, b| after(a).total_cmp(&after(b))) else { break };
            let is_full = owner.iter().filter(|owner| **owner == first).count() >= most;
            if is_full || after(&band) * 200.0 > loads[last] * 199.0 {
                break;
            }
            loads[last] -= work[band] / speeds[last];
            loads[first] += work[band] / speeds[last];
            owner[band] = first;
            moved[first] += 1;
        }
        let most = moved.into_iter().max().unwrap_or(0);
        let seconds = LATENCY + (most * BAND * width) as f64 * MOVED_BYTES / BANDWIDTH;
        moving = moving.max(seconds);
        took += wait + seconds;
    }
}

/// The owner of each band such that machines end at about the same time: the most expensive bands first, each to the
/// machine that would end first.
fn dealt(costs: &[f64], speeds: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..costs.len()).collect();
    order.sort_by(|a, b| costs[*b].total_cmp(&costs[*a]));
    let mut load = vec![0.0; speeds.len()];
    let mut owner = vec![0; costs.len()];
    for band in order {
        let ends = |machine: &usize| (load[*machine] + costs[band]) / speeds[*machine];
        let best = (0..speeds.len()).min_by(|a, b| ends(a).total_cmp(&ends(b))).unwrap_or(0);
        load[best] += costs[band];
        owner[band] = best;
    }
    owner
}
