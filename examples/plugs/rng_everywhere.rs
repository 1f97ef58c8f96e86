//! Dapple in a path tracer that passes a generator of the crate `rand` to every function.
//!
//! ```sh
//! cargo run --release --example rng_everywhere
//! ```
//!
//! It renders the scene with the host's own loop and with Dapple, as many samples each, and prints the errors against a
//! reference of many samples. Only the part between the marks of the plug knows Dapple.

#![expect(clippy::print_stdout, reason = "the program prints its result")]

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::ops::{Add, Mul, Sub};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;
const SPP: u32 = 16;
const REFERENCE_SPP: u32 = 2048;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = scene();
    let reference = render(&scene, REFERENCE_SPP, 1);
    let error = |image: &[[f32; 3]]| {
        let pairs = image.as_flattened().iter().zip(reference.as_flattened());
        pairs.map(|(x, r)| (x - r).powi(2) / (r * r + 0.01)).sum::<f32>() / (3 * WIDTH * HEIGHT) as f32
    };
    let (plain, dapple) = (error(&render(&scene, SPP, 2)), error(&render_with_dapple(&scene, 2)?));
    println!("relMSE {plain:.2e} by itself, {dapple:.2e} with Dapple: {:.3} of it", dapple / plain);
    Ok(())
}

// --- plug
use dapple::{Error, Estimate, FirstHit, Frame, Limits, Session};

fn render_with_dapple(scene: &[Sphere], seed: u64) -> Result<Vec<[f32; 3]>, Error> {
    let mut session = Session::new(Frame::new(WIDTH, HEIGHT)?, Limits::spp(SPP.into()), dapple::default_pair(seed))?;
    while let Some(round) = session.next_round()? {
        round.trace(|sample| {
            let mut rng = sample.rng();
            let ray = camera_ray(sample.pixel(), &mut rng);
            let first = hit(scene, &ray)
                .map(|h| FirstHit::new(rgb(h.at), rgb(h.normal), h.t as f32).with_albedo(rgb(h.sphere.colour)));
            Estimate::new(rgb(radiance(scene, &ray, 0, &mut rng))).with_first_hit(first)
        })?;
    }
    Ok(session.finish()?.radiance)
}
// --- end of plug

/// The host's own loop: as many samples in each pixel.
fn render(scene: &[Sphere], spp: u32, seed: u64) -> Vec<[f32; 3]> {
    let pixel = |i: u32| {
        let mut rng = Pcg64Mcg::seed_from_u64(seed << 32 | u64::from(i));
        let sum = (0..spp).fold(Vec3(0.0, 0.0, 0.0), |sum, _| {
            let ray = camera_ray([i % WIDTH, i / WIDTH], &mut rng);
            sum + radiance(scene, &ray, 0, &mut rng)
        });
        rgb(sum * (1.0 / f64::from(spp)))
    };
    (0..WIDTH * HEIGHT).into_par_iter().map(pixel).collect()
}

#[derive(Clone, Copy)]
struct Vec3(f64, f64, f64);

impl Add for Vec3 {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1, self.2 + o.2)
    }
}

impl Sub for Vec3 {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + o * -1.0
    }
}

impl Mul<f64> for Vec3 {
    type Output = Self;
    fn mul(self, s: f64) -> Self {
        Self(self.0 * s, self.1 * s, self.2 * s)
    }
}

impl Mul for Vec3 {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self(self.0 * o.0, self.1 * o.1, self.2 * o.2)
    }
}

impl Vec3 {
    fn dot(self, o: Self) -> f64 {
        self.0 * o.0 + self.1 * o.1 + self.2 * o.2
    }

    fn unit(self) -> Self {
        self * self.dot(self).sqrt().recip()
    }
}

fn rgb(v: Vec3) -> [f32; 3] {
    [v.0 as f32, v.1 as f32, v.2 as f32]
}

struct Ray {
    from: Vec3,
    to: Vec3,
}

enum Material {
    Matte,
    /// Reflects, spread by the given roughness.
    Metal(f64),
    /// Shines with the given strength.
    Lamp(f64),
}

struct Sphere {
    centre: Vec3,
    radius: f64,
    colour: Vec3,
    material: Material,
}

struct Hit<'a> {
    t: f64,
    at: Vec3,
    normal: Vec3,
    sphere: &'a Sphere,
}

fn scene() -> Vec<Sphere> {
    use Material::{Lamp, Matte, Metal};
    let sphere = |centre, radius, colour, material| Sphere { centre, radius, colour, material };
    vec![
        sphere(Vec3(0.0, -100.0, 0.0), 100.0, Vec3(0.6, 0.6, 0.55), Matte),
        sphere(Vec3(-1.5, 1.0, 0.8), 1.0, Vec3(0.8, 0.3, 0.2), Matte),
        sphere(Vec3(0.8, 0.8, 0.9), 0.8, Vec3(0.8, 0.7, 0.5), Metal(0.2)),
        sphere(Vec3(-0.2, 0.4, -0.9), 0.4, Vec3(0.3, 0.5, 0.8), Matte),
        sphere(Vec3(1.6, 3.6, -0.6), 0.9, Vec3(1.0, 0.9, 0.8), Lamp(8.0)),
    ]
}

/// A ray through a random place in a pixel, from a random place on the lens.
fn camera_ray([column, row]: [u32; 2], rng: &mut impl Rng) -> Ray {
    let x = (f64::from(column) + rng.random::<f64>()) / f64::from(WIDTH) - 0.5;
    let y = (f64::from(row) + rng.random::<f64>()) / f64::from(WIDTH) - 0.35;
    let lens = in_ball(rng) * 0.03;
    let (eye, focus) = (Vec3(lens.0, 1.3 + lens.1, -6.0), Vec3(5.6 * x, 1.0 - 5.6 * y, 0.0));
    Ray { from: eye, to: (focus - eye).unit() }
}

/// A random point in the unit ball: the first of the random points in a cube that lies in it.
fn in_ball(rng: &mut impl Rng) -> Vec3 {
    loop {
        let mut side = || rng.random_range(-1.0..1.0);
        let point = Vec3(side(), side(), side());
        if point.dot(point) < 1.0 {
            return point;
        }
    }
}

/// The nearest sphere on a ray.
fn hit<'a>(scene: &'a [Sphere], ray: &Ray) -> Option<Hit<'a>> {
    let distance = |sphere: &Sphere| {
        let to = sphere.centre - ray.from;
        let (middle, r2) = (to.dot(ray.to), sphere.radius * sphere.radius);
        let half = (r2 - (to.dot(to) - middle * middle)).sqrt(); // NaN beside the sphere
        [middle - half, middle + half].into_iter().find(|&t| t > 1e-6)
    };
    let met = scene.iter().filter_map(|sphere| Some((distance(sphere)?, sphere)));
    let (t, sphere) = met.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let at = ray.from + ray.to * t;
    Some(Hit { t, at, normal: (at - sphere.centre).unit(), sphere })
}

/// The light that arrives along a ray.
fn radiance(scene: &[Sphere], ray: &Ray, depth: u32, rng: &mut impl Rng) -> Vec3 {
    let Some(hit) = hit(scene, ray) else { return Vec3(0.12, 0.16, 0.22) };
    let colour = hit.sphere.colour;
    let to = match hit.sphere.material {
        Material::Lamp(strength) => return colour * strength,
        Material::Matte => hit.normal + in_ball(rng).unit(),
        Material::Metal(rough) => ray.to - hit.normal * (2.0 * ray.to.dot(hit.normal)) + in_ball(rng) * rough,
    };
    if depth == 6 || to.dot(hit.normal) <= 1e-9 {
        return Vec3(0.0, 0.0, 0.0);
    }
    let next = Ray { from: hit.at + hit.normal * 1e-6, to: to.unit() };
    colour * radiance(scene, &next, depth + 1, rng)
}
