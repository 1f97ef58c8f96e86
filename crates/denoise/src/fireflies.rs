//! Fireflies: pixels as bright as many pixels around them together, in only one of the two halves.
//!
//! Filters preserve energy: light taken out of a pixel goes to its surroundings. That is right where many pixels together show
//! a rare light path. But a single sample 10^5 times as bright as its surroundings would become a disc of a hundred pixels.

use crate::cells::{CELL, PIXELS, blurred};
use crate::light::Light;
use crate::planes::{found, per_pixel, quantile};
use dapple_core::film::luminance;
use dapple_core::{Film, Filtered, filter::Fireflies};

/// The destination of the energy of fireflies. A firefly is a pixel at least 880 times as bright as its surroundings in one
/// half of the samples, and less than a tenth as bright in the other half.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum FireflyLight {
    /// The fireflies' own pixels.
    #[default]
    Keep,
    /// Nowhere: the energy is lost.
    Drop,
    /// The surrounding pixels, as for all light that filtering moves.
    Spread,
}

dapple_core::choices!(FireflyLight { Keep = "keep", Drop = "drop", Spread = "spread" });

/// The brightness of a firefly relative to its surroundings: 2 % of the number of pixels over which filtering spreads its
/// light. Weaker ones are hardly visible.
const LIGHT: f64 = 0.02 * PIXELS;
/// The number of samples of a half below which a firefly must be proportionally brighter. Single samples of 2,000 times the
/// mean are common in many scenes. A pixel that shows such a sample looks worse than its light spread around it (docs/LOG.md).
const SAMPLES: f64 = 8.0;
/// The brightest pixels (one in this many) are clamped to the next lower brightness, so that fireflies do not hide each other.
const BRIGHT: usize = 50;
/// The fraction of a firefly's light that the other half must not reach.
const ALONE: f64 = 0.1;
/// The radius in pixels within which the other half must not have seen the light. Pixel filters of renderers have this radius.
const NEAR: usize = 2;

/// A pixel as bright as many pixels around it.
pub(crate) struct Firefly {
    pixel: usize,
    /// The halves whose samples are removed before filtering.
    halves: [bool; 2],
    /// The mean of the removed samples times `share`, their fraction of the pixel's samples.
    sum: [f64; 3],
    share: f64,
}

impl Firefly {
    /// Returns `true` if both halves have seen the light.
    fn is_seen_twice(&self) -> bool {
        self.halves == [true; 2]
    }
}

/// The luminance of half `half` of the samples of pixel `i`, without light sources seen directly; 0 without samples.
fn light(film: &Film, half: usize, i: usize) -> f64 {
    let Some(moments) = film.half(half, i).filter(|moments| moments.count > 0) else { return 0.0 };
    let emission = Light::all(film).emission(half, i).unwrap_or_default();
    luminance(std::array::from_fn(|c| (moments.mean[c] - f64::from(emission[c])).abs()))
}

/// The fraction of the samples of pixel `i` that lie in half `half`.
fn share(film: &Film, half: usize, i: usize) -> f64 {
    let [a, b] = [half, 1 - half].map(|half| film.half(half, i).map_or(0, |moments| moments.count) as f64);
    a / (a + b).max(1.0)
}

/// The fireflies of a film.
pub(crate) fn find(film: &Film) -> Vec<Firefly> {
    let [width, height] = film.frame().size().map(|n| n as usize);
    let all = |i: usize| (0..2).map(|half| share(film, half, i) * light(film, half, i)).sum::<f64>();
    let all = per_pixel(width * height, |i| all(i).min(f64::from(f32::MAX)) as f32);
    // Negated, since the brightest come first.
    let Some(brightest) = quantile(all.iter().filter(|light| **light > 0.0).map(|light| -light).collect(), BRIGHT)
    else {
        return Vec::new();
    };
    let cells = [width, height].map(|n| n.div_ceil(CELL));
    let means = per_pixel(cells[0] * cells[1], |cell| {
        let rows = cell / cells[0] * CELL..height.min((cell / cells[0] + 1) * CELL);
        let columns = cell % cells[0] * CELL..width.min((cell % cells[0] + 1) * CELL);
        let count = (rows.len() * columns.len()) as f64;
        let light = |i: usize| f64::from(all[i].min(-brightest));
        rows.flat_map(|y| columns.clone().map(move |x| y * width + x)).map(light).sum::<f64>() / count
    });
    let around = blurred(means, cells);
    let firefly = |i: usize| {
        let cell = i / width / CELL * cells[0] + i % width / CELL;
        let half = usize::from(light(film, 1, i) > light(film, 0, i));
        let own = share(film, half, i) * light(film, half, i);
        let samples = film.half(half, i).map_or(0, |moments| moments.count) as f64;
        (own > LIGHT * (SAMPLES / samples).max(1.0) * around[cell]).then(|| {
            let mut halves = [true; 2];
            halves[1 - half] = !is_alone(film, half, i);
            let mean = |half: usize| film.half(half, i).filter(|_| halves[half]).map(|moments| moments.mean);
            let sums = [0, 1].map(|half| mean(half).unwrap_or_default().map(|c| c * share(film, half, i)));
            let sum = std::array::from_fn(|c| sums[0][c] + sums[1][c]);
            let share = [0, 1].iter().filter(|half| halves[**half]).map(|half| share(film, *half, i)).sum();
            Firefly { pixel: i, halves, sum, share }
        })
    };
    found(width * height, firefly)
}

/// Returns `true` if the other half has seen much less light around pixel `i` than `half` in pixel `i`. If the other half has
/// no samples there, the neighbours in `half` are compared instead.
fn is_alone(film: &Film, half: usize, i: usize) -> bool {
    let [width, height] = film.frame().size().map(|n| n as usize);
    let (x, y) = (i % width, i / width);
    let rows = y.saturating_sub(NEAR)..height.min(y + NEAR + 1);
    let near =
        || rows.clone().flat_map(|y| (x.saturating_sub(NEAR)..width.min(x + NEAR + 1)).map(move |x| y * width + x));
    let is_seen = |half: usize, k: usize| film.half(half, k).is_some_and(|moments| moments.count > 0);
    let by_other = near().filter(|k| is_seen(1 - half, *k)).map(|k| light(film, 1 - half, k)).reduce(f64::max);
    let beside = || near().filter(|k| *k != i).map(|k| light(film, half, k)).fold(0.0, f64::max);
    by_other.unwrap_or_else(beside) < ALONE * light(film, half, i)
}

/// Returns the film without the samples of fireflies; `None` without fireflies.
pub(crate) fn without(film: &Film, fireflies: &[Firefly]) -> Option<Film> {
    let of = |i: usize| fireflies.binary_search_by_key(&i, |firefly| firefly.pixel).ok();
    film.without_samples(|half, i| of(i).is_some_and(|place| fireflies[place].halves[half]))
}

/// Adds the light of fireflies to an image that was filtered without them. [`FireflyLight::Drop`] leaves out light that only
/// one half has seen.
pub(crate) fn restore(image: &mut Filtered, fireflies: &[Firefly], place: FireflyLight) {
    let mut told = Fireflies { dropped: place == FireflyLight::Drop, ..Fireflies::default() };
    for firefly in fireflies {
        let Firefly { pixel, sum, share, .. } = *firefly;
        let colour = &mut image.radiance[pixel];
        let apart: [f64; 3] = std::array::from_fn(|c| sum[c] - share * f64::from(colour[c]));
        if place == FireflyLight::Keep || firefly.is_seen_twice() {
            *colour = std::array::from_fn(|c| (f64::from(colour[c]) + apart[c]).clamp(0.0, f64::from(f32::MAX)) as f32);
        }
        if !firefly.is_seen_twice() {
            told.pixels += 1;
            told.light += luminance(apart);
            // Another sample of the pixel may or may not have this light.
            let square = (apart.iter().map(|d| d * d).sum::<f64>() / 3.0).min(f64::from(f32::MAX)) as f32;
            image.error.iter_mut().for_each(|error| error[pixel] = error[pixel].max(square));
        }
    }
    image.fireflies = told;
}
