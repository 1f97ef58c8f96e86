//! Small scenes made by hand, and short ways to render them.
//!
//! Each test program uses a part of it.
#![allow(dead_code, unreachable_pub)]

#[path = "../../../../scene/tests/scene/support.rs"]
mod made;

#[allow(unused_imports)] // By programs that render bundled scenes only.
pub use made::*;

use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, PointSet, Render, Sampler};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{World, integrator};
use dapple_scene::Scene;

/// The world of a scene; panics with the reasons if it has none.
pub fn world(scene: &Scene) -> World {
    World::new(scene).unwrap_or_else(|e| panic!("{e}"))
}

/// `spp` samples in every pixel of the whole frame.
pub fn film_of(world: &World, size: [u32; 2], spp: u64, points: impl PointSet) -> Film {
    let frame = Frame::new(size[0], size[1]).expect("the size is at least 1x1");
    film_in(world, frame, &mut Uniform::new(points), &Limits::samples(spp * frame.pixels() as u64))
}

pub fn film_in(world: &World, frame: Frame, sampler: &mut dyn Sampler, limits: &Limits) -> Film {
    Render::new(frame, limits).run(&mut *integrator(world), sampler).expect("it renders")
}

/// `spp` Sobol' samples in every pixel of the scene's image.
pub fn image(scene: &Scene, spp: u64, seed: u64) -> Film {
    film_of(&world(scene), scene.film.resolution, spp, Sobol::new(seed))
}

/// Mean of all pixels, per channel.
pub fn mean(film: &Film) -> [f64; 3] {
    let pixels = film.frame().pixels();
    let mut sum = [0.0; 3];
    for i in 0..pixels {
        let m = film.mean(i);
        (0..3).for_each(|c| sum[c] += m[c]);
    }
    sum.map(|s| s / pixels as f64)
}

/// FNV-1a of the means' and counts' bits.
pub fn hash(film: &Film) -> u64 {
    let values =
        (0..film.frame().pixels()).flat_map(|i| film.mean(i).map(f64::to_bits).into_iter().chain([film.count(i)]));
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for byte in values.flat_map(u64::to_le_bytes) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
    hash
}

/// Largest deviations between two sets of independent images, in standard normal units.
#[derive(Clone, Copy, Debug)]
pub struct Agreement {
    /// The largest in any 8x8 block and channel.
    pub worst: f64,
    /// Blocks times channels.
    pub tests: usize,
    /// The largest in the mean of the whole image, over channels.
    pub whole: f64,
    /// True if blocks without variance were equal to the bit.
    pub exact: bool,
}

impl Agreement {
    /// Welch's t of block means between replicates.
    pub fn of(a: &[Film], b: &[Film]) -> Self {
        let [a, b] = [a, b].map(|films| films.iter().map(block_means).collect::<Vec<_>>());
        Self::of_blocks(&a, &b)
    }

    /// Welch's t of block means, `[replicate][block]`.
    pub fn of_blocks(a: &[Vec<[f64; 3]>], b: &[Vec<[f64; 3]>]) -> Self {
        let blocks = a[0].len();
        let mut found = Self { worst: 0.0, tests: 3 * blocks, whole: 0.0, exact: true };
        for c in 0..3 {
            for block in 0..blocks {
                let of = |set: &[Vec<[f64; 3]>]| summary(set.iter().map(|r| r[block][c]));
                match welch(of(a), of(b)) {
                    Some(z) => found.worst = found.worst.max(z),
                    None => found.exact &= of(a).0 == of(b).0,
                }
            }
            let of = |set: &[Vec<[f64; 3]>]| summary(set.iter().map(|r| r.iter().map(|m| m[c]).sum::<f64>()));
            found.whole = found.whole.max(welch(of(a), of(b)).unwrap_or(0.0));
        }
        found
    }

    /// Returns true if nothing differs at this false-alarm rate, Sidak over all tests.
    pub fn holds(&self, alpha: f64) -> bool {
        let level = |tests: usize| super::statistics::critical(super::statistics::sidak(alpha / 2.0, tests) / 2.0);
        self.exact && self.worst < level(self.tests) && self.whole < level(3)
    }
}

/// Means of 8x8 blocks, smaller at the border, row by row.
pub fn block_means(film: &Film) -> Vec<[f64; 3]> {
    let [w, h] = film.frame().size().map(|n| n as usize);
    let pixels: Vec<[f64; 3]> = (0..w * h).map(|i| film.mean(i)).collect();
    block_means_of([w, h], &pixels)
}

pub fn block_means_of([w, h]: [usize; 2], pixels: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let corners = (0..h).step_by(8).flat_map(|y| (0..w).step_by(8).map(move |x| (x, y)));
    corners
        .map(|(x, y)| {
            let (x1, y1) = ((x + 8).min(w), (y + 8).min(h));
            let inside = (y..y1).flat_map(|row| pixels[row * w + x..row * w + x1].iter());
            let sum = inside.fold([0.0; 3], |s: [f64; 3], p| std::array::from_fn(|c| s[c] + p[c]));
            sum.map(|s| s / ((x1 - x) * (y1 - y)) as f64)
        })
        .collect()
}

/// Mean, squared standard error, and degrees of freedom.
pub fn summary(values: impl Iterator<Item = f64> + Clone) -> (f64, f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let squares: f64 = values.map(|v| (v - mean).powi(2)).sum();
    (mean, squares / (n - 1.0) / n, n - 1.0)
}

/// The deviation of two means as a standard normal one of the same probability, after Wallace 1959; `None` without
/// variance.
pub fn welch((a, va, na): (f64, f64, f64), (b, vb, nb): (f64, f64, f64)) -> Option<f64> {
    let variance = va + vb;
    // Rounding is no variance.
    if variance.is_nan() || variance <= 1e-24 * (a * a + b * b) {
        return None;
    }
    let freedom = variance * variance / (va * va / na + vb * vb / nb);
    let t2 = (a - b).powi(2) / variance;
    Some((8.0 * freedom + 1.0) / (8.0 * freedom + 3.0) * (freedom * (t2 / freedom).ln_1p()).sqrt())
}
