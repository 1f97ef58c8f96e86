//! Dapple in your own renderer, in 100 lines: a small sphere tracer that uses Dapple's samplers.
//! `cargo run --release --example minimal -- out` writes `out/uniform.ppm`, `out/adaptive.ppm` and `out/samples.ppm`
//! (white = many samples), and prints the error of both images. It uses only Dapple's samplers and point sets.
#![expect(clippy::print_stdout, reason = "the program prints its result")]

use dapple_adaptive::Adaptive;
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, Frame, Integrator, Limits, Render, Worker};
use dapple_low_discrepancy::Sobol;
use std::f32::consts::TAU;

type V = [f32; 3];

fn add(a: V, s: f32, b: V) -> V {
    [0, 1, 2].map(|i| a[i] + s * b[i])
}

fn dot(a: V, b: V) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: V) -> V {
    a.map(|x| x / dot(a, a).sqrt())
}

/// Centre, radius and colour. The last ball is the ground.
const BALLS: [(V, f32, V); 4] = [
    ([-1.3, 1.0, 0.6], 1.0, [0.8, 0.3, 0.2]),
    ([0.9, 0.7, -0.6], 0.7, [0.2, 0.5, 0.8]),
    ([0.1, 0.3, -1.9], 0.3, [0.9, 0.7, 0.2]),
    ([0.0, -100.0, 0.0], 100.0, [0.6, 0.6, 0.6]),
];
const EYE: V = [0.0, 1.2, -6.0];
const SUN: V = [0.5, 0.7, -0.5];

/// The nearest ball on a ray, and the distance to the hit.
fn meet(from: V, direction: V) -> Option<(usize, f32)> {
    let distance = |(centre, radius, _): &(V, f32, V)| {
        let to = add(*centre, -1.0, from);
        let (b, across) = (dot(to, direction), add(to, -dot(to, direction), direction));
        let t = b - (radius * radius - dot(across, across)).sqrt(); // NaN beside the ball
        (t > 1e-3).then_some(t)
    };
    BALLS.iter().enumerate().filter_map(|(i, b)| Some((i, distance(b)?))).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Named groups of four random numbers: for the pixel and lens, and for the light.
const FILM: Block = Block::new(0);
const LIGHT: Block = Block::new(1);

struct Balls;

/// The interface to Dapple: the random numbers of one sample in, its radiance out.
impl Integrator for Balls {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let ([u, v, lens, turn], [x, y]) = (draws.block(FILM), draws.pixel());
        let (x, y) = ((x as f32 + u) / 120.0 - 1.0, 0.4 - (y as f32 + v) / 120.0);
        // A lens of radius 0.1 in focus on the plane z = -0.6.
        let (r, (sin, cos)) = (0.1 * lens.sqrt(), (TAU * turn).sin_cos());
        let from = add(EYE, r, [cos, sin, 0.0]);
        let direction = unit(add(add(EYE, 5.4, [0.5 * x, 0.5 * y, 1.0]), -1.0, from));
        let sky = |d: V| [0.25, 0.35, 0.5].map(|c| c + 0.3 * (1.0 - d[1].max(0.0)));
        let Some((ball, t)) = meet(from, direction) else {
            return Estimate::new(sky(direction));
        };
        let (centre, _, colour) = BALLS[ball];
        let at = add(from, t, direction);
        let normal = unit(add(at, -1.0, centre));
        // A square sun, and the sky by cosine-weighted directions.
        let [a, b, z, turn] = draws.block(LIGHT);
        let sun = unit(add(SUN, 0.3, [a - 0.5, 0.0, b - 0.5]));
        let lit = if meet(at, sun).is_none() { 1.1 * dot(normal, sun).max(0.0) } else { 0.0 };
        let (z, (sin, cos)) = (1.0 - 2.0 * z, (TAU * turn).sin_cos());
        let up = unit(add(normal, 0.999, [(1.0 - z * z).sqrt() * cos, z, (1.0 - z * z).sqrt() * sin]));
        let open = if meet(at, up).is_none() { sky(up) } else { [0.0; 3] };
        Estimate::new([0, 1, 2].map(|c| colour[c] * (lit + open[c]))).with_cost(3)
    }
}

fn image(mut sampler: impl dapple_core::Sampler, spp: u64) -> Result<Film, dapple_core::Error> {
    Render::new(Frame::new(240, 135)?, &Limits::samples(spp * 240 * 135)).run(&mut Balls, &mut sampler)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args_os().nth(1).map_or_else(std::env::temp_dir, std::path::PathBuf::from);
    let uniform = image(Uniform::new(Sobol::new(2)), 16)?;
    let adaptive = image(Adaptive::variance(Sobol::new(2)), 16)?; // the only line that differs
    let truth = image(Uniform::new(Sobol::new(1)), 256)?.image();
    let wrong = |(x, r): (&f32, &f32)| (x - r).powi(2) / (r * r + 0.01) / (3 * 240 * 135) as f32;
    let error = |x: &[V]| x.as_flattened().iter().zip(truth.as_flattened()).map(wrong).sum::<f32>();
    println!("relMSE {:.2e} uniform, {:.2e} adaptive", error(&uniform.image()), error(&adaptive.image()));
    let most = adaptive.counts().into_iter().max().unwrap_or(1) as f32;
    let samples = adaptive.counts().iter().map(|&n| [(n as f32 / most).powf(2.2); 3]).collect();
    for (name, pixels) in [("uniform", uniform.image()), ("adaptive", adaptive.image()), ("samples", samples)] {
        let mut file = b"P6\n240 135\n255\n".to_vec();
        file.extend(pixels.as_flattened().iter().map(|x| (255.0 * x.min(1.0).powf(1.0 / 2.2) + 0.5) as u8));
        std::fs::write(folder.join(name).with_extension("ppm"), file)?;
    }
    Ok(())
}
