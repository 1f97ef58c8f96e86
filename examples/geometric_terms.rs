//! The worth of a-priori terms for light and gloss to the sampler `adaptive`: errors over those of uniform counts, at
//! equal samples.
//!
//! ```sh
//! cargo run --release --example geometric_terms -- --full
//! ```
//!
//! Both enter through [`ErrorMap`], the sampler's interface for external errors; the library is unchanged.
//!
//! * `light`: the variance of one sample of direct light, from four shadow rays at each of a pixel's first four hits.
//!   These rays are not counted in the budget.
//! * `gloss`: the distance of surfaces from diffuse.
//!
//! The number after a name is the term's weight in the score, a geometric mean with the pilot's variance; 1 is the term
//! alone. Prints Markdown (`docs/results/to_csv.py` makes CSV of it). Without `--full` a small form runs in seconds.

#![expect(clippy::print_stdout, reason = "a program whose table is its result")]

use dapple::adaptive::{Adaptive, AdaptiveOptions, ErrorMap, MapErrors, PilotPolicy};
use dapple::core::samplers::Uniform;
use dapple::core::{Film, FirstHit, Frame, Limits, Needs, Render, Sampler, luminance};
use dapple::geometry::Ray;
use dapple::job::registry;
use dapple::metrics::{Pixels, compare};
use dapple::renderer::light::Target;
use dapple::renderer::{World, integrator};
use dapple_scene::{self as scene, bundled};
use glam::Vec3;
use std::sync::Arc;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// First hits used, per pixel.
const HITS: u8 = 4;
/// Shadow rays per hit.
const RAYS: u32 = 4;

#[derive(Clone, Copy)]
enum Term {
    Light,
    Gloss,
}

/// The variance of one sample of direct light at these hits of pixel `i`, relative to its squared mean.
fn light(world: &World, i: usize, hits: &[Option<FirstHit>], epsilon: f64) -> f64 {
    let mut values = Vec::new();
    for (k, hit) in hits.iter().enumerate() {
        for ray in 0..RAYS {
            // A lattice, shifted in each pixel.
            let at = (i as u64 * u64::from(HITS) + k as u64) * u64::from(RAYS) + u64::from(ray);
            let u = [1.618_033_988_749_895_f64, 1.324_717_957_244_746, 1.220_744_084_605_76]
                .map(|step| (at as f64 / step).fract() as f32);
            values.push(hit.map_or(0.0, |hit| arriving(world, &hit, u)));
        }
    }
    let n = values.len().max(2) as f64;
    let mean = values.iter().sum::<f64>() / n;
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0) / (mean * mean + epsilon)
}

/// Light from one of the lamps that a hit scatters as a diffuse surface.
fn arriving(world: &World, hit: &FirstHit, [choice, u, v]: [f32; 3]) -> f64 {
    let normal = Vec3::from(hit.geometric_normal);
    let from = Vec3::from(hit.position) + normal * (0.05 * hit.footprint);
    let Some(sample) = world.lights().sample(from, choice, [u, v]) else { return 0.0 };
    let cosine = sample.wi.dot(Vec3::from(hit.shading_normal)).max(0.0);
    let ray = match sample.target {
        Target::Surface(point) => Ray { tmax: 0.999, ..Ray::new(from, point.position - from) },
        Target::Point(point) => Ray { tmax: 0.999, ..Ray::new(from, point - from) },
        Target::Far => Ray::new(from, sample.wi),
    };
    if cosine == 0.0 || world.geometry().occluded(&ray) {
        return 0.0;
    }
    let radiance = sample.radiance * Vec3::from(hit.albedo) * (cosine / (sample.pdf * std::f32::consts::PI));
    luminance(radiance.to_array().map(f64::from))
}

/// The squared distance of a pixel's surfaces from diffuse; at least 0.1, so that other terms still count.
fn gloss(hits: &[Option<FirstHit>]) -> f64 {
    let of = |hit: &Option<FirstHit>| hit.map_or(0.0, |hit| f64::from(1.0 - hit.roughness).powi(2));
    0.1 + hits.iter().map(of).sum::<f64>() / hits.len().max(1) as f64
}

/// A term as remaining errors: that of one sample, divided by the sampler's model of convergence.
fn term(term: Term, world: Arc<World>, options: AdaptiveOptions) -> ErrorMap {
    let of: MapErrors = Box::new(move |film: &Film| {
        let value = |i: usize| {
            let hits = film.first_hits(i);
            let one = match term {
                Term::Light => light(&world, i, hits, options.epsilon),
                Term::Gloss => gloss(hits),
            };
            (one / (film.count(i).max(1) as f64).powf(options.exponent)) as f32
        };
        Ok((0..film.frame().pixels()).map(value).collect())
    });
    ErrorMap { name: "term".into(), needs: Needs::none().with_first_hits(HITS), of, bytes_per_pixel: 4 }
}

/// A scene and its reference.
struct Course {
    world: Arc<World>,
    side: u32,
    image: Vec<[f32; 3]>,
}

impl Course {
    fn of(name: &str, side: u32, reference_spp: u64) -> Result<Self> {
        let mut scene = bundled::files(name).ok_or("no such bundled scene")?.read()?;
        scene.film.pixel_filter = scene::PixelFilter::default();
        let world = Arc::new(World::with_resolution(&scene, [side; 2])?);
        let mut course = Self { world, side, image: Vec::new() };
        course.image = course.render(None, 777, reference_spp)?;
        Ok(course)
    }

    /// Renders with a term and its weight; without one, uniformly.
    fn render(&self, by: Option<(Option<Term>, f64)>, seed: u64, spp: u64) -> Result<Vec<[f32; 3]>> {
        let points = registry::points("sobol", registry::Setting { seed, spp: Some(spp) })?;
        let mut sampler: Box<dyn Sampler> = match by {
            None => Box::new(Uniform::new(points)),
            Some((which, mix)) => {
                let options = AdaptiveOptions::default().policy(PilotPolicy::Keep).epsilon(0.01).mix(mix);
                let sampler = Adaptive::with_options(points, options)?;
                match which {
                    Some(which) => Box::new(sampler.with_error_map(term(which, self.world.clone(), options))?),
                    None => Box::new(sampler),
                }
            }
        };
        let frame = Frame::new(self.side, self.side)?;
        let limits = Limits::samples(spp * frame.pixels() as u64);
        let mut integrator = integrator(&self.world);
        Ok(Render::new(frame, &limits).run(&mut *integrator, &mut *sampler)?.image())
    }

    /// sRGB MSE and relMSE, summed over seeds.
    fn errors(&self, by: Option<(Option<Term>, f64)>, spp: u64, seeds: u64) -> Result<[f64; 2]> {
        let mut sums = [0.0; 2];
        for seed in 1..=seeds {
            let (size, found) = ([self.side; 2], self.render(by, seed, spp)?);
            let compared = compare(Pixels::new(size, &found)?, Pixels::new(size, &self.image)?)?;
            sums = [sums[0] + compared.srgb8_mse, sums[1] + compared.rel_mse];
        }
        Ok(sums)
    }
}

fn main() -> Result<()> {
    let full = std::env::args().any(|a| a == "--full");
    let (side, seeds, reference, budgets): (_, _, _, &[u64]) =
        if full { (96, 4, 1024, &[8, 32]) } else { (16, 1, 64, &[8]) };
    let names = ["teapot", "terrain", "cornell", "glass", "room"];
    let scenes = names.map(|name| Course::of(name, side, reference)).into_iter().collect::<Result<Vec<_>>>()?;
    println!(
        "{side}x{side} pixels, {seeds} seeds, references of {reference} spp; sRGB MSE / relMSE over uniform counts."
    );
    for &spp in budgets {
        println!("\n| {spp} spp | {} | geometric mean |\n|---|{}---|", names.join(" | "), "---|".repeat(names.len()));
        let uniform: Vec<[f64; 2]> = scenes.iter().map(|s| s.errors(None, spp, seeds)).collect::<Result<_>>()?;
        let shares = [0.25, 0.5, 1.0];
        let terms = [("light", Term::Light), ("gloss", Term::Gloss)];
        let each = terms.iter().flat_map(|(name, t)| shares.map(|mix| (format!("{name} {mix}"), Some(*t), mix)));
        for (name, which, mix) in std::iter::once(("neither".to_owned(), None, 0.5)).chain(each) {
            let (mut row, mut logs) = (format!("| {name} |"), [0.0; 2]);
            for (scene, uniform) in scenes.iter().zip(&uniform) {
                let found = scene.errors(Some((which, mix)), spp, seeds)?;
                let ratio = [0, 1].map(|k| found[k] / uniform[k]);
                (0..2).for_each(|k| logs[k] += ratio[k].ln() / scenes.len() as f64);
                row += &format!(" {:.3} / {:.3} |", ratio[0], ratio[1]);
            }
            println!("{row} {:.3} / {:.3} |", logs[0].exp(), logs[1].exp());
        }
    }
    Ok(())
}
