//! The error of images denoised from different buffers: halves, variances and features.
//!
//! ```sh
//! cargo run --release --example denoise_buffers -- --full
//! ```
//!
//! Figures are sRGB MSE (0 to 255) at 16 samples per pixel, less the noise of the reference images. Prints Markdown. Without
//! `--full`, a small version runs in seconds.

#![expect(clippy::print_stdout, reason = "a program whose table is its result")]

use dapple_core::samplers::Uniform;
use dapple_core::{Film, Filter, Filtered, Frame, Limits, Needs, Render};
use dapple_denoise::{ClusterRegression, Denoise, SampleBuffers, Variance, denoise, denoise_whole};
use dapple_job::registry::{self, PointSettings};
use dapple_metrics::{Pixels, compare};
use dapple_renderer::{World, integrator};
use dapple_scene::bundled;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SCENES: [&str; 5] = ["cornell", "terrain", "glass", "room", "cabin"];
const SPP: u64 = 16;

/// A rendered image as buffers.
struct Buffers {
    size: [u32; 2],
    halves: [Vec<[f32; 3]>; 2],
    variances: [Vec<[f32; 3]>; 2],
    counts: [Vec<u32>; 2],
    mean: Vec<[f32; 3]>,
    variance: Vec<[f32; 3]>,
    count: Vec<u32>,
    normal: Vec<[f32; 3]>,
    albedo: Vec<[f32; 3]>,
    position: Vec<[f32; 3]>,
    depth: Vec<f32>,
    coverage: Vec<f32>,
    emission: Vec<[f32; 3]>,
    /// Sample variances of normal, albedo, position and depth.
    spread: [Vec<[f32; 3]>; 3],
    depth_spread: Vec<f32>,
}

impl Buffers {
    fn of(film: &Film) -> Self {
        let pixels = 0..film.frame().pixels();
        let colours = |of: &dyn Fn(usize) -> [f64; 3]| pixels.clone().map(|i| of(i).map(|v| v as f32)).collect();
        let half = |h: usize, i: usize| film.half(h, i).unwrap_or_default();
        let features = |of: fn(dapple_core::film::Features) -> [f32; 3]| {
            pixels.clone().map(|i| film.features(i).map_or([0.0; 3], of)).collect()
        };
        let scalar = |of: fn(dapple_core::film::Features) -> f32| {
            pixels.clone().map(|i| film.features(i).map_or(0.0, of)).collect()
        };
        let spread = |i: usize| film.features(i).and_then(|f| f.variance).unwrap_or_default();
        let three = |k: usize| pixels.clone().map(|i| [spread(i)[k] / 3.0; 3]).collect();
        Self {
            size: film.frame().size(),
            halves: [0, 1].map(|h| colours(&|i| half(h, i).mean)),
            variances: [0, 1].map(|h| colours(&|i| half(h, i).variance().unwrap_or_default())),
            counts: [0, 1].map(|h| pixels.clone().map(|i| half(h, i).count as u32).collect()),
            mean: film.image(),
            variance: colours(&|i| film.moments(i).variance().unwrap_or_default()),
            count: film.counts().into_iter().map(|n| n as u32).collect(),
            normal: features(|f| f.normal),
            albedo: features(|f| f.albedo),
            position: features(|f| f.position),
            depth: scalar(|f| f.depth),
            coverage: scalar(|f| f.hits as f32 / f.samples.max(1) as f32),
            emission: colours(&|i| {
                let [a, b] = [0, 1].map(|h| film.emission(h, i).unwrap_or_default());
                let [na, nb] = [0, 1].map(|h| half(h, i).count as f64);
                [0, 1, 2].map(|c| (na * f64::from(a[c]) + nb * f64::from(b[c])) / (na + nb).max(1.0))
            }),
            spread: [0, 1, 2].map(three),
            depth_spread: pixels.clone().map(|i| spread(i)[3]).collect(),
        }
    }

    fn halves(&self, variance: bool) -> Denoise<'_> {
        let [a, b] = [0, 1].map(|h: usize| {
            let half = SampleBuffers::new(&self.halves[h], &self.counts[h]);
            if variance { half.variance(Variance::OfSamples(&self.variances[h])) } else { half }
        });
        denoise(self.size, &a, &b)
    }

    fn whole(&self) -> Denoise<'_> {
        let all = SampleBuffers::new(&self.mean, &self.count).variance(Variance::OfSamples(&self.variance));
        denoise_whole(self.size, &all)
    }

    fn surfaces<'a>(&'a self, image: Denoise<'a>) -> Denoise<'a> {
        image.normal(&self.normal).albedo(&self.albedo)
    }

    /// Adds all features with their variances.
    fn known<'a>(&'a self, image: Denoise<'a>) -> Denoise<'a> {
        let [normal, albedo, position] = &self.spread;
        image
            .noisy_normal(&self.normal, Variance::OfSamples(normal))
            .noisy_albedo(&self.albedo, Variance::OfSamples(albedo))
            .noisy_position(&self.position, Variance::OfSamples(position))
            .noisy_depth(&self.depth, Variance::OfSamples(&self.depth_spread))
            .coverage(&self.coverage)
            .emission(&self.emission)
    }

    /// Adds all features without variances.
    fn guided<'a>(&'a self, image: Denoise<'a>) -> Denoise<'a> {
        let image = self.surfaces(image).position(&self.position).depth(&self.depth);
        image.coverage(&self.coverage).emission(&self.emission)
    }
}

const HEADS: [&str; 12] = [
    "none",
    "depth",
    "normal",
    "normal, albedo",
    "all",
    "all and their variance",
    "all, no variance of radiance",
    "one image, none",
    "one image, normal, albedo",
    "one image, all",
    "one image, all and their variance",
    "film",
];

fn images(film: &Film, b: &Buffers) -> Result<[Filtered; HEADS.len()]> {
    Ok([
        b.halves(true).run()?,
        b.halves(true).depth(&b.depth).run()?,
        b.halves(true).normal(&b.normal).run()?,
        b.surfaces(b.halves(true)).run()?,
        b.guided(b.halves(true)).run()?,
        b.known(b.halves(true)).run()?,
        b.guided(b.halves(false)).run()?,
        b.whole().run()?,
        b.surfaces(b.whole()).run()?,
        b.guided(b.whole()).run()?,
        b.known(b.whole()).run()?,
        ClusterRegression::new().apply(film)?,
    ])
}

fn main() -> Result<()> {
    let full = std::env::args().any(|word| word == "--full");
    let points = std::env::args().find(|word| word == "random").unwrap_or("sobol".to_owned());
    let (scenes, size, reference_spp) = if full { (&SCENES[..], [484, 272], 256) } else { (&SCENES[..1], [32; 2], 64) };
    let [width, height] = size;
    println!("{width}x{height} pixels, {SPP} spp, points {points}; references of {reference_spp} spp.\n");
    println!("| scene | unfiltered | {} |", HEADS.join(" | "));
    println!("|---|---|{}", "---|".repeat(HEADS.len()));
    let mut logs = [0.0; HEADS.len() + 1];
    for name in scenes {
        let scene = bundled::files(name).ok_or("a bundled scene is missing")?.read()?;
        let world = World::with_resolution(&scene, size)?;
        let frame = Frame::new(width, height)?;
        let film = |seed, spp: u64, needs| -> Result<Film> {
            let points = registry::points(&points, PointSettings { seed, spp: None })?;
            let limits = Limits::samples(spp * frame.pixels() as u64);
            Ok(Render::new(frame, &limits).needs(needs).run(&mut *integrator(&world), &mut Uniform::new(points))?)
        };
        let halves = film(99, reference_spp, Needs::none().with_halves())?;
        let noisy = film(1, SPP, ClusterRegression::new().needs().with_half_variance())?;
        let buffers = Buffers::of(&noisy);
        let [a, b] = [halves.half_film(0)?.image(), halves.half_film(1)?.image()];
        let reference = halves.image();
        let apart = |a: &[[f32; 3]], b: &[[f32; 3]]| -> Result<f64> {
            Ok(compare(Pixels::new(size, a)?, Pixels::new(size, b)?)?.srgb8_mse)
        };
        // The noise of the reference is a quarter of the squared difference of its halves.
        let noise = 0.25 * apart(&a, &b)?;
        let error = |image: &[[f32; 3]]| -> Result<f64> { Ok(apart(image, &reference)? - noise) };
        let mut errors = vec![error(&noisy.image())?];
        for image in images(&noisy, &buffers)? {
            errors.push(error(&image.radiance)?);
        }
        logs.iter_mut().zip(&errors).for_each(|(sum, e)| *sum += (e / errors[0]).ln() / scenes.len() as f64);
        let cells: Vec<String> = errors.iter().map(|e| format!("{e:.1}")).collect();
        println!("| {name} | {} |", cells.join(" | "));
    }
    let cells: Vec<String> = logs.iter().map(|l| format!("{:.3}", l.exp())).collect();
    println!("| of unfiltered, geometric mean | {} |", cells.join(" | "));
    Ok(())
}
