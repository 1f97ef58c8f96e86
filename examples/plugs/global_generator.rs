//! Dapple in a renderer whose functions draw random numbers from a thread-local generator, without passing it as an argument.
//!
//! ```sh
//! cargo run --release --example global_generator
//! ```
//!
//! It renders the scene with the host's own generator and with Dapple, with equal numbers of samples, and prints the errors
//! against a reference of many samples. Only the code between the two `plug` marks uses Dapple.

#![expect(clippy::print_stdout, reason = "the program prints its result")]

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::array::from_fn;
use std::cell::RefCell;
use std::f32::consts::TAU;

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
use dapple::{Draws, Error, Filtered, FirstHit, Frame, Limits, PointSet, Session};

fn render_with_dapple(seed: u64) -> Result<Filtered, Error> {
    let points: std::sync::Arc<dyn PointSet> = dapple::points("sobol", seed)?.into();
    let methods = dapple::default_pair_with(points.clone());
    let session = Session::new(Frame::new(SIZE[0], SIZE[1])?, Limits::spp(SPP.into()), methods)?;
    let trace = |sample: &Draws<'_>| {
        GENERATOR.set(Box::new(Draws::shared(points.clone(), sample.id()).into_rng()));
        let (light, hit) = radiance(sample.pixel());
        (light, hit.map(|h| FirstHit::new(h.at, h.normal, h.t).with_albedo(h.colour)))
    };
    session.run(|round| round.trace(trace))
}
// --- end of plug

/// The host's own loop: the same number of samples in each pixel.
fn render(spp: u32, seed: u64) -> Vec<Rgb> {
    let pixel = |i: u32| {
        GENERATOR.set(Box::new(Pcg64Mcg::seed_from_u64(seed << 32 | u64::from(i))));
        (0..spp).fold([0.0; 3], |mean, _| add(mean, 1.0 / spp as f32, radiance([i % SIZE[0], i / SIZE[0]]).0))
    };
    (0..SIZE[0] * SIZE[1]).into_par_iter().map(pixel).collect()
}

thread_local! {
    static GENERATOR: RefCell<Box<dyn Rng>> = RefCell::new(Box::new(Pcg64Mcg::seed_from_u64(0)));
}

/// A random number in `[0, 1)`, from the thread's generator.
fn random() -> f32 {
    GENERATOR.with_borrow_mut(|rng| rng.random())
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

/// A random direction.
fn direction() -> V3 {
    let (height, (sin, cos)) = (1.0 - 2.0 * random(), (TAU * random()).sin_cos());
    let ring = (1.0 - height * height).sqrt();
    [ring * cos, height, ring * sin]
}

struct Hit {
    t: f32,
    at: V3,
    normal: V3,
    colour: Rgb,
}

/// The distance between neighbouring pillars, and the radius of a pillar.
const PILLARS: (f32, f32) = (1.8, 0.3);
/// A spherical light: centre, radius and radiance. It is invisible to camera rays.
const LAMP: (V3, f32, Rgb) = ([0.9, 2.2, 2.7], 0.25, [60.0, 45.0, 28.0]);
const SKY: Rgb = [0.08, 0.11, 0.18];

/// The nearest pillar on a ray, or the floor.
fn hit(from: V3, to: V3) -> Option<Hit> {
    let across = (to[0] * to[0] + to[2] * to[2]).sqrt();
    let pillars = (0..20).filter_map(|i| {
        let centre = [((i % 5) as f32 - 2.0) * PILLARS.0, 0.0, (i / 5) as f32 * PILLARS.0];
        let [x, _, z] = add(from, -1.0, centre);
        let (b, side) = ((x * to[0] + z * to[2]) / across, (x * to[2] - z * to[0]) / across);
        let t = (-b - (PILLARS.1 * PILLARS.1 - side * side).sqrt()) / across; // NaN beside the pillar
        let at = add(from, t, to);
        let normal = [(at[0] - centre[0]) / PILLARS.1, 0.0, (at[2] - centre[2]) / PILLARS.1];
        let band = (at[1] * 3.0).floor().rem_euclid(2.0);
        (t > 1e-3).then_some(Hit { t, at, normal, colour: [0.7, 0.5 + 0.1 * band, 0.3 + 0.3 * band] })
    });
    let t = -from[1] / to[1];
    let at = add(from, t, to);
    let colour = [0.3 + 0.4 * (at[0].floor() + at[2].floor()).rem_euclid(2.0); 3];
    let floor = (t > 1e-3 && t < 30.0).then_some(Hit { t, at, normal: [0.0, 1.0, 0.0], colour });
    pillars.chain(floor).min_by(|a, b| a.t.total_cmp(&b.t))
}

/// The radiance of one sample of a pixel, and its first hit.
fn radiance(pixel: [u32; 2]) -> (Rgb, Option<Hit>) {
    let [x, y]: [f32; 2] = from_fn(|i| (pixel[i] as f32 + random() - 0.5 * SIZE[i] as f32) / SIZE[1] as f32);
    let (mut from, mut to) = ([0.9, 1.1, -2.6], unit([x, -y - 0.12, 1.0]));
    let (mut light, mut weight, mut first) = ([0.0; 3], [1.0; 3], None);
    for _ in 0..4 {
        let Some(hit) = hit(from, to) else {
            return (from_fn(|c| light[c] + weight[c] * SKY[c]), first);
        };
        weight = from_fn(|c| weight[c] * hit.colour[c]);
        let lamp = reflected(&hit);
        light = from_fn(|c| light[c] + weight[c] * lamp * LAMP.2[c]);
        (from, to) = (hit.at, unit(add(direction(), 1.0001, hit.normal)));
        first.get_or_insert(hit);
    }
    (light, first)
}

/// The fraction of the light's radiance that a surface reflects, estimated with a random point on the light.
fn reflected(surface: &Hit) -> f32 {
    let (centre, radius, _) = LAMP;
    let out = direction();
    let to = add(add(centre, radius, out), -1.0, surface.at);
    let (distance, to) = (dot(to, to).sqrt(), unit(to));
    let cosines = dot(surface.normal, to).max(0.0) * -dot(out, to).min(0.0);
    let is_free = cosines > 0.0 && hit(surface.at, to).is_none_or(|other| other.t > distance);
    // The lamp's area, over pi for a matte surface.
    if is_free { cosines * 4.0 * radius * radius / (distance * distance) } else { 0.0 }
}
