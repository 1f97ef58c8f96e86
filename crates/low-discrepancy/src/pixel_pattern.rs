//! A periodic pattern of sample positions, evenly spread over pixels.

use crate::keys::{halves, mix64, nth_key};
use crate::sobol::{owen_reversed, sobol1_reversed};
use std::sync::LazyLock;

/// The side of the pattern in pixels.
pub(crate) const SIDE: usize = 64;
/// The number of pixels of the pattern.
pub(crate) const PIXELS: usize = SIDE * SIDE;
/// The number of samples of each pixel, placed in rounds of one per pixel.
pub(crate) const ROUNDS: usize = 16;
/// Positions are stored in this many steps per pixel, one for each pixel of the pattern.
pub(crate) const STEPS: u32 = PIXELS as u32;

/// Candidates for each sample. Our choice.
const CANDIDATES: u64 = 32;

/// The positions in the pixel, in steps: for each round all pixels, row by row.
///
/// In each round the positions of all pixels together are a (0,12,2)-net, dealt to the pixels. So a pixel at a random
/// place of the pattern has a uniform position.
pub(crate) fn places() -> &'static [[u16; 2]] {
    static PLACES: LazyLock<Vec<[u16; 2]>> = LazyLock::new(spread_places);
    &PLACES
}

/// The pixels of the pattern in a random order.
pub(crate) fn order(round: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..PIXELS).collect();
    order.sort_by_key(|p| (nth_key(mix64(round), *p as u64), *p));
    order
}

/// The points of an Owen-scrambled (0,12,2)-net, in steps.
pub(crate) fn net(key: u64) -> Vec<[u16; 2]> {
    let [kx, ky] = halves(nth_key(key, 0));
    let coordinate = |reversed: u32, key| (owen_reversed(reversed, key).reverse_bits() >> 20) as u16;
    (0..STEPS).map(|i| [coordinate(i, kx), coordinate(sobol1_reversed(u64::from(i)) as u32, ky)]).collect()
}

/// The pixel `(dx, dy)` away, on the torus.
pub(crate) fn neighbour(pixel: usize, [dx, dy]: [i32; 2]) -> usize {
    let along = |c: usize, by: i32| (c as i32 + by).rem_euclid(SIDE as i32) as usize;
    along(pixel / SIDE, dy) * SIDE + along(pixel % SIDE, dx)
}

/// Deals the positions of each round to pixels in random order. A pixel takes the candidate whose nearest sample, of any
/// round so far, is farthest.
fn spread_places() -> Vec<[u16; 2]> {
    let mut places: Vec<[u16; 2]> = Vec::with_capacity(ROUNDS * PIXELS);
    for round in 0..ROUNDS {
        let mut pool = net(mix64(!(round as u64)));
        let mut now: Vec<Option<[u16; 2]>> = vec![None; PIXELS];
        for pixel in order(round as u64) {
            let near = samples_around(&places, &now, pixel);
            let key = nth_key(mix64(pixel as u64), round as u64);
            let candidate = |c| (nth_key(key, c) % pool.len() as u64) as usize;
            let distance = |at: &usize| {
                let at = pool[*at].map(i64::from);
                near.iter().map(|p| (p[0] - at[0]).pow(2) + (p[1] - at[1]).pow(2)).min().unwrap_or(0)
            };
            let chosen = (0..CANDIDATES).map(candidate).max_by_key(distance).unwrap_or(0);
            now[pixel] = Some(pool.swap_remove(chosen));
        }
        places.extend(now.into_iter().flatten());
    }
    places
}

/// All samples in the pixel and its eight neighbours, in steps from the pixel's corner.
fn samples_around(places: &[[u16; 2]], now: &[Option<[u16; 2]>], pixel: usize) -> Vec<[i64; 2]> {
    let mut near = Vec::with_capacity(9 * ROUNDS);
    for by in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [dx, dy])) {
        let from = neighbour(pixel, by);
        let earlier = places.iter().skip(from).step_by(PIXELS).copied();
        let moved = |p: [u16; 2]| [0, 1].map(|k| i64::from(p[k]) + i64::from(by[k]) * i64::from(STEPS));
        near.extend(earlier.chain(now[from]).map(moved));
    }
    near
}

/// Turns a stored step into a coordinate in `[0, 1)`. `jitter` has 12 random bits, for the place within the step.
#[inline]
pub(crate) fn coordinate(step: u16, jitter: u32) -> f32 {
    (u32::from(step) << 12 | jitter & 0xfff) as f32 * (1.0 / 16_777_216.0)
}
