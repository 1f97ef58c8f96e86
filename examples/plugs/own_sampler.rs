//! Dapple in a renderer with its own `Sampler` trait, and a queue of image blocks for its worker threads.
//!
//! ```sh
//! cargo run --release --example own_sampler
//! ```
//!
//! It renders the scene with the host's own sampler and with Dapple, with equal numbers of samples, and prints the errors
//! against a reference of many samples. Only the code between the two `plug` marks uses Dapple.

#![expect(clippy::print_stdout, reason = "the program prints its result")]

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::array::from_fn;
use std::f32::consts::{PI, TAU};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

const SIZE: [u32; 2] = [96, 72];
const SPP: u32 = 16;
const REFERENCE_SPP: u32 = 512;

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
use dapple::{Error, Estimate, Filtered, FirstHit, Frame, Limits, Rng, Session};

impl Sampler for Rng<'_> {
    fn get_1d(&mut self) -> f32 {
        self.next_f32()
    }
    fn get_2d(&mut self) -> [f32; 2] {
        self.next_2d()
    }
}

fn estimate((light, hit): (Rgb, Option<Hit>)) -> Estimate {
    (light, hit.map(|h| FirstHit::new(h.at, h.normal, h.t).with_albedo(h.colour))).into()
}

fn render_with_dapple(seed: u64) -> Result<Filtered, Error> {
    let session = Session::new(Frame::new(SIZE[0], SIZE[1])?, Limits::spp(SPP.into()), dapple::default_pair(seed))?;
    session.run(|round| for_each_block(|area| round.trace_tile(area, |s| estimate(radiance(s.pixel(), &mut s.rng())))))
}
// --- end of plug

/// The host's own loop: the same number of samples in each pixel of each block.
fn render(spp: u32, seed: u64) -> Vec<Rgb> {
    let image = Mutex::new(vec![[0.0; 3]; (SIZE[0] * SIZE[1]) as usize]);
    let Ok(()) = for_each_block(|[x0, y0, x1, y1]| {
        for (y, x) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (y, x))) {
            let i = y * SIZE[0] + x;
            let mut sampler = Independent(Pcg64Mcg::seed_from_u64(seed << 32 | u64::from(i)));
            let mean = (0..spp).fold([0.0; 3], |mean, _| add(mean, 1.0 / spp as f32, radiance([x, y], &mut sampler).0));
            image.lock().expect("no worker panics")[i as usize] = mean;
        }
        Ok::<_, std::convert::Infallible>(())
    });
    image.into_inner().expect("no worker panics")
}

/// Calls `work` for each block `[x0, y0, x1, y1]` of the image. Worker threads take the blocks from a queue.
fn for_each_block<E: Send>(work: impl Fn([u32; 4]) -> Result<(), E> + Sync) -> Result<(), E> {
    let [columns, rows] = SIZE.map(|n| n.div_ceil(16));
    let queue = AtomicU32::new(0);
    let worker = || loop {
        let n = queue.fetch_add(1, Ordering::Relaxed);
        if n >= columns * rows {
            return Ok(());
        }
        let [x, y] = [n % columns * 16, n / columns * 16];
        work([x, y, SIZE[0].min(x + 16), SIZE[1].min(y + 16)])?;
    };
    std::thread::scope(|threads| {
        let threads: Vec<_> = (0..4).map(|_| threads.spawn(worker)).collect();
        threads.into_iter().try_for_each(|thread| thread.join().expect("no worker panics"))
    })
}

/// The host's interface for random numbers.
trait Sampler {
    fn get_1d(&mut self) -> f32;
    fn get_2d(&mut self) -> [f32; 2];
}

/// The host's sampler: independent random numbers.
struct Independent(Pcg64Mcg);

impl Sampler for Independent {
    fn get_1d(&mut self) -> f32 {
        self.0.random()
    }

    fn get_2d(&mut self) -> [f32; 2] {
        self.0.random()
    }
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

/// Boxes, each by two corners and a colour. The first box is the room, seen from inside.
const BOXES: [([V3; 2], Rgb); 3] = [
    ([[0.0, 0.0, -2.0], [1.0; 3]], [0.7, 0.65, 0.6]),
    ([[0.15, 0.0, 0.5], [0.4, 0.6, 0.75]], [0.65, 0.15, 0.1]),
    ([[0.55, 0.0, 0.2], [0.85, 0.3, 0.5]], [0.15, 0.45, 0.2]),
];
/// A light below the ceiling, facing down: corner, sides and radiance.
const LAMP: (V3, [f32; 2], Rgb) = ([0.35, 0.999, 0.4], [0.3, 0.3], [14.0, 11.0, 8.0]);

/// The nearest wall on a ray.
fn hit(from: V3, to: V3) -> Option<Hit> {
    let walls = BOXES.iter().filter_map(|&([low, high], colour)| {
        // A ray is inside the box from its last entry on the three axes to its first exit.
        let [a, b]: [V3; 2] = [low, high].map(|side| from_fn(|i| (side[i] - from[i]) / to[i]));
        let enter = (0..3).map(|i| (a[i].min(b[i]), i)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        let leave = (0..3).map(|i| (a[i].max(b[i]), i)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let (t, axis) = if enter.0 > 1e-4 { enter } else { leave };
        let normal = from_fn(|i| if i == axis { -to[i].signum() } else { 0.0 });
        (enter.0 < leave.0 && t > 1e-4).then(|| Hit { t, at: add(from, t, to), normal, colour })
    });
    walls.min_by(|a, b| a.t.total_cmp(&b.t))
}

/// The radiance of one sample of a pixel, and its first hit.
fn radiance(pixel: [u32; 2], sampler: &mut dyn Sampler) -> (Rgb, Option<Hit>) {
    let place = sampler.get_2d();
    let [x, y]: [f32; 2] = from_fn(|i| (pixel[i] as f32 + place[i] - 0.5 * SIZE[i] as f32) / SIZE[1] as f32);
    let (mut from, mut to) = ([0.5, 0.5, -1.4], unit([x, -y, 1.4]));
    let (mut light, mut weight, mut first) = ([0.0; 3], [1.0; 3], None);
    for bounce in 0..4 {
        let Some(hit) = hit(from, to) else { break };
        let lamp = reflected(&hit, sampler.get_2d());
        weight = from_fn(|c| weight[c] * hit.colour[c]);
        light = from_fn(|c| light[c] + weight[c] * lamp * LAMP.2[c]);
        let [u, v] = sampler.get_2d();
        let (height, (sin, cos)) = (1.0 - 2.0 * u, (TAU * v).sin_cos());
        let ring = (1.0 - height * height).sqrt();
        (from, to) = (hit.at, unit(add([ring * cos, ring * sin, height], 1.0001, hit.normal)));
        if bounce == 0 {
            first = Some(hit);
        } else if sampler.get_1d() < 0.3 {
            break;
        } else {
            weight = weight.map(|w| w / 0.7);
        }
    }
    (light, first)
}

/// The fraction of the light's radiance that a surface reflects, estimated with a random point on the light.
fn reflected(at: &Hit, [u, v]: [f32; 2]) -> f32 {
    let (corner, [width, depth], _) = LAMP;
    let to = add(add(corner, 1.0, [u * width, 0.0, v * depth]), -1.0, at.at);
    let (distance, to) = (dot(to, to).sqrt(), unit(to));
    let cosines = dot(at.normal, to).max(0.0) * to[1].max(0.0);
    let free = cosines > 0.0 && hit(at.at, to).is_none_or(|other| other.t > distance - 1e-4);
    if free { cosines * width * depth / (PI * distance * distance) } else { 0.0 }
}
