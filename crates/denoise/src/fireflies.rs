//! Fireflies: light that one half of a pixel's samples alone has seen, as much as many pixels around it have.
//!
//! Filters keep the light of an image. They give the surroundings the light that they take out of a pixel. That is right where many
//! pixels together show a rare light. A single sample of 10^5 times the light around it would make a disc of a hundred pixels.

use crate::cells::{CELL, PIXELS, blurred};
use crate::light::Light;
use crate::planes::{found, per_pixel};
use dapple_core::film::luminance;
use dapple_core::{Film, Filtered, filter::Fireflies};

/// The place of the light of fireflies: of pixels with the light of 880 pixels around them, which one half alone has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum FireflyLight {
    /// Their own pixels.
    #[default]
    Keep,
    /// Nowhere: it is left out.
    Drop,
    /// The surroundings, as for all light that filtering takes out.
    Spread,
}

dapple_core::choices!(FireflyLight { Keep = "keep", Drop = "drop", Spread = "spread" });

/// The number of pixels around it whose light a firefly has: 2 % of those that filtering spreads its light over. Brighter by less is
/// hardly seen.
const LIGHT: f64 = 0.02 * PIXELS;
/// The share of a firefly's light that the other half must not have seen.
const ALONE: f64 = 0.1;
/// The pixels to each side in which the other half has not seen it. Pixel filters of renderers are as wide.
const NEAR: usize = 2;

/// A half of a pixel whose samples are a firefly's.
pub(crate) struct Firefly {
    pub(crate) pixel: usize,
    pub(crate) half: usize,
    /// The share of the half in the pixel's samples.
    share: f64,
    mean: [f64; 3],
}

/// The light of half `half` of the samples of pixel `i`, without lamps seen directly; 0 without samples.
fn light(film: &Film, half: usize, i: usize) -> f64 {
    let Some(moments) = film.half(half, i).filter(|moments| moments.count > 0) else { return 0.0 };
    let emission = Light::all(film).emission(half, i).unwrap_or_default();
    luminance(std::array::from_fn(|c| (moments.mean[c] - f64::from(emission[c])).max(0.0)))
}

/// The fireflies of a film, and the light of all its samples.
pub(crate) fn find(film: &Film) -> (Vec<Firefly>, f64) {
    let [width, height] = film.frame().size().map(|n| n as usize);
    let counts = |i: usize| [0, 1].map(|half| film.half(half, i).map_or(0, |moments| moments.count) as f64);
    let share = |half: usize, i: usize| counts(i)[half] / counts(i).iter().sum::<f64>().max(1.0);
    let all = |i: usize| (0..2).map(|half| share(half, i) * light(film, half, i)).sum::<f64>();
    let cells = [width, height].map(|n| n.div_ceil(CELL));
    let means = per_pixel(cells[0] * cells[1], |cell| {
        let rows = cell / cells[0] * CELL..height.min((cell / cells[0] + 1) * CELL);
        let columns = cell % cells[0] * CELL..width.min((cell % cells[0] + 1) * CELL);
        let count = (rows.len() * columns.len()) as f64;
        rows.flat_map(|y| columns.clone().map(move |x| y * width + x)).map(all).sum::<f64>() / count
    });
    let around = blurred(means, cells);
    let reached = PIXELS.min((width * height) as f64);
    let firefly = |i: usize| {
        let half = usize::from(light(film, 1, i) > light(film, 0, i));
        let own = share(half, i) * light(film, half, i);
        let cell = i / width / CELL * cells[0] + i % width / CELL;
        let is_bright = own > LIGHT * (around[cell] - own / reached);
        (is_bright && is_alone(film, half, i)).then(|| {
            let mean = film.half(half, i).map_or([0.0; 3], |moments| moments.mean);
            Firefly { pixel: i, half, share: share(half, i), mean }
        })
    };
    let found = found(width * height, firefly);
    let total = if found.is_empty() { 0.0 } else { (0..width * height).map(all).sum() };
    (found, total)
}

/// Returns `true` if the other half has not seen the light of a half of pixel `i` around it. Without samples in that half, the pixels
/// beside it must not have seen it.
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

/// Puts the light of fireflies back into an image that was made without them, or leaves it out. `total` is the light of all samples.
pub(crate) fn restore(image: &mut Filtered, fireflies: &[Firefly], total: f64, place: FireflyLight) {
    let (mut energy, mut pixels) = (0.0, 0);
    for Firefly { pixel, share, mean, .. } in fireflies {
        let colour = &mut image.radiance[*pixel];
        let apart: [f64; 3] = std::array::from_fn(|c| share * (mean[c] - f64::from(colour[c])));
        energy += luminance(apart);
        pixels += u64::from(luminance(apart) > 0.0);
        if place == FireflyLight::Keep {
            *colour = std::array::from_fn(|c| (f64::from(colour[c]) + apart[c]).clamp(0.0, f64::from(f32::MAX)) as f32);
        }
        // With another sample, the pixel may be without this light, or have it.
        let square = (apart.iter().map(|d| d * d).sum::<f64>() / 3.0).min(f64::from(f32::MAX)) as f32;
        image.error.iter_mut().for_each(|error| error[*pixel] = error[*pixel].max(square));
    }
    let share = energy / (total - energy).max(f64::MIN_POSITIVE);
    image.fireflies = Fireflies { pixels, share, dropped: place == FireflyLight::Drop };
}
