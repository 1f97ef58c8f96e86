//! Dapple in a path tracer that passes a generator of the crate `rand` to every function.
//!
//! ```sh
//! cargo run --release --example rng_everywhere
//! ```
//!
//! It renders the scene with the host's own loop and with Dapple, with equal numbers of samples, and prints the errors against
//! a reference of many samples. Only the code between the two `plug` marks uses Dapple.

#![expect(clippy::print_stdout, reason = "the program prints its result")]

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::array::from_fn;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;
const SPP: u32 = 16;
const REFERENCE_SPP: u32 = 512;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = scene();
    let reference = render(&scene, REFERENCE_SPP, 1);
    let error = |image: &[[f32; 3]]| {
        let pairs = image.as_flattened().iter().zip(reference.as_flattened());
        pairs.map(|(x, r)| (x - r).powi(2) / (r * r + 0.01)).sum::<f32>() / (3 * WIDTH * HEIGHT) as f32
    };
    let (plain, dapple) = (error(&render(&scene, SPP, 2)), error(&render_with_dapple(&scene, 2)?.radiance));
    println!("relMSE {plain:.2e} without Dapple, {dapple:.2e} with Dapple: ratio {:.3}", dapple / plain);
    Ok(())
}

// --- plug
use dapple::{Draws, Error, Estimate, Filtered, FirstHit, Frame, Limits, Session};

fn render_with_dapple(scene: &[Sphere], seed: u64) -> Result<Filtered, Error> {
    let session = Session::new(Frame::new(WIDTH, HEIGHT)?, Limits::spp(SPP.into()), dapple::default_pair(seed))?;
    let trace = |sample: &Draws<'_>| {
        let mut rng = sample.rng();
        let ray = camera_ray(sample.pixel(), &mut rng);
        let first = |h: Hit<'_>| FirstHit::new(rgb(h.at), rgb(h.normal), h.t as f32).with_albedo(rgb(h.sphere.colour));
        Estimate::new(rgb(radiance(scene, &ray, 0, &mut rng))).with_first_hit(hit(scene, &ray).map(first))
    };
    session.run(|round| round.trace(trace))
}
// --- end of plug

/// The host's own loop: the same number of samples in each pixel.
fn render(scene: &[Sphere], spp: u32, seed: u64) -> Vec<[f32; 3]> {
    let pixel = |i: u32| {
        let mut rng = Pcg64Mcg::seed_from_u64(seed << 32 | u64::from(i));
        let mean = (0..spp).fold([0.0; 3], |mean, _| {
            let ray = camera_ray([i % WIDTH, i / WIDTH], &mut rng);
            add(mean, 1.0 / f64::from(spp), radiance(scene, &ray, 0, &mut rng))
        });
        rgb(mean)
    };
    (0..WIDTH * HEIGHT).into_par_iter().map(pixel).collect()
}

type Vec3 = [f64; 3];

fn add(a: Vec3, s: f64, b: Vec3) -> Vec3 {
    from_fn(|i| a[i] + s * b[i])
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: Vec3) -> Vec3 {
    a.map(|x| x / dot(a, a).sqrt())
}

fn rgb(v: Vec3) -> [f32; 3] {
    v.map(|x| x as f32)
}

struct Ray {
    from: Vec3,
    to: Vec3,
}

struct Sphere {
    centre: Vec3,
    radius: f64,
    colour: Vec3,
    /// The spread of glossy reflections; `None` for a matte sphere.
    rough: Option<f64>,
    /// The emitted radiance, as a factor of `colour`; 0 unless the sphere is a light.
    shine: f64,
}

struct Hit<'a> {
    t: f64,
    at: Vec3,
    normal: Vec3,
    sphere: &'a Sphere,
}

fn scene() -> Vec<Sphere> {
    let sphere = |centre, radius, colour, rough, shine| Sphere { centre, radius, colour, rough, shine };
    vec![
        sphere([0.0, -100.0, 0.0], 100.0, [0.6, 0.6, 0.55], None, 0.0),
        sphere([-1.5, 1.0, 0.8], 1.0, [0.8, 0.3, 0.2], None, 0.0),
        sphere([0.8, 0.8, 0.9], 0.8, [0.8, 0.7, 0.5], Some(0.2), 0.0),
        sphere([-0.2, 0.4, -0.9], 0.4, [0.3, 0.5, 0.8], None, 0.0),
        sphere([1.6, 3.6, -0.6], 0.9, [1.0, 0.9, 0.8], None, 8.0),
    ]
}

/// A ray through a random point in a pixel, from a random point on the lens.
fn camera_ray([column, row]: [u32; 2], rng: &mut impl Rng) -> Ray {
    let x = (f64::from(column) + rng.random::<f64>()) / f64::from(WIDTH) - 0.5;
    let y = (f64::from(row) + rng.random::<f64>()) / f64::from(WIDTH) - 0.35;
    let [right, up, _] = in_ball(rng);
    let eye = [0.03 * right, 1.3 + 0.03 * up, -6.0];
    Ray { from: eye, to: unit(add([5.6 * x, 1.0 - 5.6 * y, 0.0], -1.0, eye)) }
}

/// A random point in the unit ball, by rejection sampling in a cube.
fn in_ball(rng: &mut impl Rng) -> Vec3 {
    loop {
        let point = from_fn(|_| rng.random_range(-1.0..1.0));
        if dot(point, point) < 1.0 {
            return point;
        }
    }
}

/// The nearest sphere on a ray.
fn hit<'a>(scene: &'a [Sphere], ray: &Ray) -> Option<Hit<'a>> {
    let distance = |sphere: &Sphere| {
        let to = add(sphere.centre, -1.0, ray.from);
        let middle = dot(to, ray.to);
        let half = (sphere.radius * sphere.radius - (dot(to, to) - middle * middle)).sqrt(); // NaN beside the sphere
        [middle - half, middle + half].into_iter().find(|&t| t > 1e-6)
    };
    let met = scene.iter().filter_map(|sphere| Some((distance(sphere)?, sphere)));
    let (t, sphere) = met.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let at = add(ray.from, t, ray.to);
    Some(Hit { t, at, normal: unit(add(at, -1.0, sphere.centre)), sphere })
}

/// The light that arrives along a ray.
fn radiance(scene: &[Sphere], ray: &Ray, depth: u32, rng: &mut impl Rng) -> Vec3 {
    let Some(Hit { at, normal, sphere, .. }) = hit(scene, ray) else { return [0.12, 0.16, 0.22] };
    if sphere.shine > 0.0 {
        return sphere.colour.map(|c| c * sphere.shine);
    }
    let to = match sphere.rough {
        None => add(normal, 1.0, unit(in_ball(rng))),
        Some(rough) => add(add(ray.to, -2.0 * dot(ray.to, normal), normal), rough, in_ball(rng)),
    };
    if depth == 6 || dot(to, normal) <= 1e-9 {
        return [0.0; 3];
    }
    let light = radiance(scene, &Ray { from: add(at, 1e-6, normal), to: unit(to) }, depth + 1, rng);
    from_fn(|c| sphere.colour[c] * light[c])
}
