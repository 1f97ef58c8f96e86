//! Dapple in a renderer that traces waves of rays, stage by stage, as renderers on graphics cards do.
//!
//! ```sh
//! cargo run --release --example wavefront
//! ```
//!
//! It renders the scene with the host's own waves and with Dapple's, with equal numbers of samples, and prints the errors
//! against a reference of many samples. Only the code between the two `plug` marks uses Dapple.

#![expect(clippy::print_stdout, reason = "the program prints its result")]

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::array::from_fn;
use std::f32::consts::{PI, TAU};

const SIZE: [u32; 2] = [96, 72];
const SPP: u32 = 16;
const REFERENCE_SPP: u32 = 512;
/// The number of paths in a wave.
const WAVE: usize = 1 << 14;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let reference = render(REFERENCE_SPP, 1);
    let error = |image: &[Rgb]| {
        let pairs = image.as_flattened().iter().zip(reference.as_flattened());
        pairs.map(|(x, r)| (x - r).powi(2) / (r * r + 0.01)).sum::<f32>() / (3 * SIZE[0] * SIZE[1]) as f32
    };
    let (plain, dapple) = (error(&render(SPP, 2)), error(&render_with_dapple(2)?.radiance));
    println!("relMSE {plain:.2e} without Dapple, {dapple:.2e} with Dapple: ratio {:.3}", dapple / plain);
    Ok(())
}

// --- plug
use dapple::{Error, Filtered, FirstHit, Frame, Limits, Session};

fn render_with_dapple(seed: u64) -> Result<Filtered, Error> {
    let session = Session::new(Frame::new(SIZE[0], SIZE[1])?, Limits::spp(SPP.into()), dapple::default_pair(seed))?;
    let first = |h: Hit| FirstHit::new(h.at, h.normal, h.t).with_albedo(h.colour);
    session.run(|round| {
        round.trace_batches(WAVE, |batch| {
            let ids: Vec<_> = batch.iter().map(|sample| sample.id()).collect();
            let paths = trace(ids.iter().map(|id| id.pixel), |path, stage| round.points().block(ids[path], stage));
            paths.into_iter().map(move |path| (path.radiance, path.first.map(first)))
        })
    })
}
// --- end of plug

/// The host's own loop: one wave over the whole image per sample.
fn render(spp: u32, seed: u64) -> Vec<Rgb> {
    let pixels = || (0..SIZE[0] * SIZE[1]).map(|i| [i % SIZE[0], i / SIZE[0]]);
    let mut image = vec![[0.0; 3]; pixels().count()];
    for sample in 0..spp {
        let random = |path: usize, stage: u32| {
            let number = u64::from(4 * sample + stage) << 32 | path as u64;
            Pcg64Mcg::seed_from_u64(seed << 48 | number).random()
        };
        for (sum, path) in image.iter_mut().zip(trace(pixels(), random)) {
            *sum = add(*sum, 1.0 / spp as f32, path.radiance);
        }
    }
    image
}

type V3 = [f32; 3];
type Rgb = [f32; 3];

fn add(a: V3, s: f32, b: V3) -> V3 {
    from_fn(|i| a[i] + s * b[i])
}

fn dot(a: V3, b: V3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: V3) -> V3 {
    a.map(|x| x / dot(a, a).sqrt())
}

struct Hit {
    t: f32,
    at: V3,
    normal: V3,
    colour: Rgb,
}

/// The state of a path between stages.
struct Path {
    pixel: [u32; 2],
    from: V3,
    to: V3,
    hit: Option<Hit>,
    weight: Rgb,
    radiance: Rgb,
    first: Option<Hit>,
}

/// Traces a path for each of the pixels, stage by stage. `random` returns four numbers for the stage of a path.
fn trace(pixels: impl Iterator<Item = [u32; 2]>, random: impl Fn(usize, u32) -> [f32; 4] + Sync) -> Vec<Path> {
    let start =
        |pixel| Path { pixel, from: EYE, to: EYE, hit: None, weight: [1.0; 3], radiance: [0.0; 3], first: None };
    let mut paths: Vec<_> = pixels.map(start).collect();
    paths.par_iter_mut().enumerate().for_each(|(i, path)| camera(path, random(i, 0)));
    for bounce in 0..3 {
        paths.par_iter_mut().for_each(intersect);
        paths.par_iter_mut().enumerate().for_each(|(i, path)| shade(path, random(i, 1 + bounce)));
    }
    paths
}

const EYE: V3 = [0.0, 1.5, -6.0];
/// A light facing down: corner, sides and radiance.
const LAMP: (V3, [f32; 2], Rgb) = ([1.0, 4.0, -1.5], [1.2, 1.2], [28.0, 26.0, 22.0]);
/// Centres, radii and colours.
const BALLS: [(V3, f32, Rgb); 4] = [
    ([-1.4, 1.0, 0.4], 1.0, [0.8, 0.35, 0.2]),
    ([0.9, 0.7, -0.4], 0.7, [0.25, 0.5, 0.8]),
    ([0.0, 0.35, -1.7], 0.35, [0.9, 0.8, 0.3]),
    ([2.3, 1.2, 2.0], 1.2, [0.7, 0.7, 0.7]),
];

fn camera(path: &mut Path, [u, v, ..]: [f32; 4]) {
    let [x, y] = [(0, u), (1, v)].map(|(i, u)| (path.pixel[i] as f32 + u - 0.5 * SIZE[i] as f32) / SIZE[0] as f32);
    path.to = unit([x, -y - 0.12, 1.0]);
}

/// Finds the nearest ball or the floor, unless the path has ended.
fn intersect(path: &mut Path) {
    path.hit = if path.weight == [0.0; 3] { None } else { meet(path.from, path.to) };
}

fn meet(from: V3, to: V3) -> Option<Hit> {
    let balls = BALLS.iter().filter_map(|&(centre, radius, colour)| {
        let out = add(from, -1.0, centre);
        let (b, across) = (dot(out, to), add(out, -dot(out, to), to));
        let t = -b - (radius * radius - dot(across, across)).sqrt(); // NaN beside the ball
        (t > 1e-3).then(|| Hit { t, at: add(from, t, to), normal: unit(add(out, t, to)), colour })
    });
    let t = -from[1] / to[1];
    let at = add(from, t, to);
    let colour = [0.25 + 0.5 * (at[0].floor() + at[2].floor()).rem_euclid(2.0); 3];
    let floor = (t > 1e-3 && t < 40.0).then_some(Hit { t, at, normal: [0.0, 1.0, 0.0], colour });
    balls.chain(floor).min_by(|a, b| a.t.total_cmp(&b.t))
}

/// Adds direct lighting at the hit, and scatters the path there.
fn shade(path: &mut Path, [lamp_u, lamp_v, u, v]: [f32; 4]) {
    let Some(hit) = path.hit.take() else {
        path.radiance = from_fn(|c| path.radiance[c] + path.weight[c] * [0.15, 0.2, 0.3][c]);
        path.weight = [0.0; 3];
        return;
    };
    path.weight = from_fn(|c| path.weight[c] * hit.colour[c]);
    let (corner, [width, depth], shine) = LAMP;
    let to = add(add(corner, 1.0, [lamp_u * width, 0.0, lamp_v * depth]), -1.0, hit.at);
    let (distance, to) = (dot(to, to).sqrt(), unit(to));
    let cosines = dot(hit.normal, to).max(0.0) * to[1].max(0.0);
    if cosines > 0.0 && meet(hit.at, to).is_none_or(|other| other.t > distance) {
        let part = cosines * width * depth / (PI * distance * distance);
        path.radiance = from_fn(|c| path.radiance[c] + path.weight[c] * part * shine[c]);
    }
    let (height, (sin, cos)) = (1.0 - 2.0 * u, (TAU * v).sin_cos());
    let ring = (1.0 - height * height).sqrt();
    (path.from, path.to) = (hit.at, unit(add([ring * cos, ring * sin, height], 1.0001, hit.normal)));
    path.first.get_or_insert(hit);
}
