//! Dapple in a progressive viewer that improves its image until the window is closed.
//!
//! ```sh
//! cargo run --release --example viewer
//! ```
//!
//! It shows the scene with the host's own loop and with Dapple, with equal numbers of samples, and prints the errors of the
//! last images against a reference of many samples. Only the code between the two `plug` marks uses Dapple.

#![expect(clippy::print_stdout, reason = "the program prints its result")]

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::array::from_fn;
use std::f32::consts::TAU;

const SIZE: [u32; 2] = [96, 72];
const PIXELS: usize = 96 * 72;
/// The number of images shown until the window is closed. The last image has 16 samples per pixel.
const UPDATES: usize = 10;
const REFERENCE_SPP: usize = 512;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let own = |spp, seed| {
        let mut window = Window::new(spp);
        view(seed, &mut window);
        window.image
    };
    let (reference, mut window) = (own(REFERENCE_SPP, 1), Window::new(UPDATES));
    let error = |image: &[Rgb]| {
        let pairs = image.as_flattened().iter().zip(reference.as_flattened());
        pairs.map(|(x, r)| (x - r).powi(2) / (r * r + 0.01)).sum::<f32>() / (3 * PIXELS) as f32
    };
    let samples = view_with_dapple(2, &mut window)? as usize;
    let (plain, dapple) = (error(&own(samples.div_ceil(PIXELS), 2)), error(&window.image));
    println!("relMSE {plain:.2e} without Dapple, {dapple:.2e} with Dapple: ratio {:.3}", dapple / plain);
    Ok(())
}

// --- plug
use dapple::{Error, FirstHit, Frame, Limits, Session};

fn view_with_dapple(seed: u64, window: &mut Window) -> Result<u64, Error> {
    let mut session = Session::new(Frame::new(SIZE[0], SIZE[1])?, Limits::open(), dapple::default_pair(seed))?;
    while let Some(round) = session.next_round()? {
        round.trace(|sample| {
            let mut rng = sample.rng();
            let (light, hit) = radiance(sample.pixel(), &mut || rng.next_f32());
            (light, hit.map(|h| FirstHit::new(h.at, h.normal, h.t).with_albedo(h.colour)))
        })?;
        if !window.show(session.image()?.radiance) {
            break;
        }
    }
    Ok(session.film().record().samples)
}
// --- end of plug

/// The host's own loop: repeatedly adds one sample to each pixel and shows the image.
fn view(seed: u64, window: &mut Window) {
    let mut sum = vec![[0.0; 3]; PIXELS];
    for spp in 1_u32.. {
        sum.par_iter_mut().enumerate().for_each(|(i, sum)| {
            let mut rng = Pcg64Mcg::seed_from_u64(seed << 56 | u64::from(spp) << 32 | i as u64);
            let pixel = [i as u32 % SIZE[0], i as u32 / SIZE[0]];
            *sum = add(*sum, 1.0, radiance(pixel, &mut || rng.random()).0);
        });
        if !window.show(sum.iter().map(|&sum| sum.map(|x| x / spp as f32)).collect()) {
            return;
        }
    }
}

/// A stand-in for the viewer's window, which is closed after a number of images.
struct Window {
    image: Vec<Rgb>,
    updates: usize,
}

impl Window {
    fn new(updates: usize) -> Self {
        Self { image: Vec::new(), updates }
    }

    /// Shows an image. Returns `false` once the window is closed.
    fn show(&mut self, image: Vec<Rgb>) -> bool {
        (self.image, self.updates) = (image, self.updates - 1);
        self.updates > 0
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

const HIGHEST: f32 = 3.0;

/// The height and the colour of the tower in a cell of the city's grid. Streets have height 0.
fn tower(x: i32, z: i32) -> (f32, Rgb) {
    let hash = (x.wrapping_mul(0x2c1b_3c6d) ^ z.wrapping_mul(0x297a_2d39)).wrapping_mul(0x1b87_3593) as u32;
    if x.rem_euclid(3) == 0 || z.rem_euclid(5) == 0 || x.abs() > 5 || z > 9 {
        return (0.0, [0.3; 3]);
    }
    let of = |shift: u32| (hash >> shift & 0xff) as f32 / 255.0;
    (0.5 + (HIGHEST - 0.5) * of(24), [0.35 + 0.5 * of(16), 0.4 + 0.3 * of(8), 0.35 + 0.3 * of(12)])
}

/// The first tower or street on a ray, found by traversing the cells of the grid.
fn hit(from: V3, to: V3) -> Option<Hit> {
    let (mut cell, mut t, mut axis) = ([from[0].floor(), from[2].floor()], 0.0, 1);
    for _ in 0..64 {
        if to[1] > 0.0 && from[1] + t * to[1] > HIGHEST {
            break;
        }
        let leaves = [0, 1].map(|i| (cell[i] + f32::from(to[2 * i] > 0.0) - from[2 * i]) / to[2 * i]);
        let next = leaves[0].min(leaves[1]);
        let (height, colour) = tower(cell[0] as i32, cell[1] as i32);
        let side = t > 0.0 && from[1] + t * to[1] < height;
        if side || from[1] + next * to[1] < height {
            let (t, axis) = if side { (t, axis) } else { ((height - from[1]) / to[1], 1) };
            let normal = from_fn(|i| if i == axis { -to[i].signum() } else { 0.0 });
            return Some(Hit { t, at: add(add(from, t, to), 1e-3, normal), normal, colour });
        }
        let i = usize::from(leaves[1] < leaves[0]);
        cell[i] += to[2 * i].signum();
        (t, axis) = (next, 2 * i);
    }
    None
}

/// The radiance of one sample of a pixel, and its first hit.
fn radiance(pixel: [u32; 2], random: &mut dyn FnMut() -> f32) -> (Rgb, Option<Hit>) {
    let [x, y]: [f32; 2] = from_fn(|i| (pixel[i] as f32 + random() - 0.5 * SIZE[i] as f32) / SIZE[1] as f32);
    let (mut from, mut to) = ([0.3, 5.5, -5.0], unit([x, -y - 0.65, 1.0]));
    let (mut light, mut weight, mut first) = ([0.0; 3], [1.0; 3], None);
    for _ in 0..3 {
        let Some(surface) = hit(from, to) else {
            return (from_fn(|c| light[c] + weight[c] * [0.25, 0.35, 0.5][c]), first);
        };
        weight = from_fn(|c| weight[c] * surface.colour[c]);
        let mut direction = || {
            let (height, (sin, cos)) = (1.0 - 2.0 * random(), (TAU * random()).sin_cos());
            let ring = (1.0 - height * height).sqrt();
            [ring * cos, height, ring * sin]
        };
        // A wide sun behind thin clouds.
        let sun = unit(add([-0.7, 0.7, -0.3], 0.3, direction()));
        let cosine = dot(sun, surface.normal);
        if cosine > 0.0 && hit(surface.at, sun).is_none() {
            light = from_fn(|c| light[c] + weight[c] * cosine * [1.6, 1.4, 1.1][c]);
        }
        (from, to) = (surface.at, unit(add(direction(), 1.0001, surface.normal)));
        first.get_or_insert(surface);
    }
    (light, first)
}
