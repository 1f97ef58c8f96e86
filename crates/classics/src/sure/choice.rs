//! The choice between the filters of a bank.

use super::bank::{self, BANK, OfPixel};
use super::planes::Planes;
use dapple_core::Film;
use rayon::prelude::*;

/// A pixel of the best filter.
#[derive(Clone, Copy, Default)]
pub(super) struct Chosen {
    pub(super) radiance: [f32; 3],
    /// The smoothed estimate of the squared error; may be negative.
    pub(super) error: f64,
    /// The smoothed priority of further samples, 0 or above.
    pub(super) priority: f64,
}

/// The largest memory of [`choose`] in bytes per pixel.
pub(super) const BYTES: usize = Planes::BYTES + size_of::<OfPixel>() + size_of::<Chosen>();

/// Applies the bank with windows of this radius, and takes each pixel from the filter with the least error. Errors are
/// smoothed with a standard deviation of `sigma` pixels.
pub(super) fn choose(film: &Film, radius: usize, sigma: f64) -> Vec<Chosen> {
    let planes = Planes::new(film);
    let all = bank::apply(&planes, radius);
    let spatial = falloff(sigma);
    (0..all.len()).into_par_iter().with_min_len(64).map(|i| chosen(&planes, &all, i, &spatial)).collect()
}

/// `-d^2 / (2 sigma^2)` for distances `d` from 0 to two standard deviations.
fn falloff(sigma: f64) -> Vec<f64> {
    let reach = (2.0 * sigma).round() as u32;
    (0..=reach).map(|d| -0.5 * f64::from(d * d) / (sigma * sigma)).collect()
}

fn chosen(planes: &Planes, all: &[OfPixel], i: usize, spatial: &[f64]) -> Chosen {
    let reach = spatial.len() as isize - 1;
    let (x, y) = ((i % planes.size[0]) as isize, (i / planes.size[0]) as isize);
    let (mut weight, mut error, mut priority) = (0.0, [0.0; BANK], [0.0; BANK]);
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let Some(j) = planes.at(x + dx, y + dy).filter(|&j| planes.known[j]) else { continue };
            let near = spatial[dx.unsigned_abs()] + spatial[dy.unsigned_abs()];
            let w = libm::exp(near + planes.likeness(i, j));
            weight += w;
            for k in 0..BANK {
                error[k] += w * all[j].error[k];
                priority[k] += w * all[j].priority[k];
            }
        }
    }
    // A pixel without samples takes the widest filter, and its own error is unknown.
    let widest = 1;
    if !planes.known[i] || weight <= 0.0 {
        let unknown = if weight > 0.0 { error[widest] / weight } else { f64::INFINITY };
        let priority = if weight > 0.0 { priority[widest] / weight } else { 0.0 };
        return Chosen { radiance: all[i].filtered[0], error: unknown, priority: priority.max(0.0) };
    }
    let best = (1..BANK).fold(0, |best, k| if error[k] < error[best] { k } else { best });
    let radiance = if best == 0 { planes.colour[i].map(|c| c as f32) } else { all[i].filtered[best - 1] };
    Chosen { radiance, error: error[best] / weight, priority: (priority[best] / weight).max(0.0) }
}
