//! Sample positions distributed jointly over pixels, and joint patterns of image position, lens point and time, after
//! Mitchell.

use crate::Sobol;
use crate::keys::{Seed, halves, mix64, nth_key};
use crate::sobol::{owen_reversed, sobol1_reversed};
use dapple_core::{PointSet, SampleId};
use std::sync::LazyLock;

/// A point set whose positions in the pixel are blue noise over the image [after Mitchell 1987]. All other coordinates are
/// from [`Sobol`].
///
/// Mitchell placed about one sample per pixel by error diffusion on a finer grid. Here each pixel has exactly one sample per
/// round, and best-candidate sampling replaces error diffusion. A pattern of 64 x 64 pixels and 16 rounds is computed once per
/// process. The positions of each round together form a net, so that each position is uniform.
///
/// The first pair of block 0 is the position. The pattern has another offset in each tile, in each stream and after every 16
/// samples.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Diffused;
///
/// let points = Diffused::new(7);
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Limits
///
/// * It improves results at one to a few samples per pixel. With more samples, a pixel's positions are hardly better than
///   random, and [`Sobol`] is better.
/// * A jittered grid has less noise power below 0.2 cycles per pixel, but 2x to 4x more from 0.2 to 0.6.
/// * Tile borders are seams: the pixels on both sides are independent.
/// * Coordinates for light, lens and time are not distributed jointly over pixels.
///
/// Name: `diffused`. Parameters: `seed`.
#[derive(Clone, Copy, Debug)]
pub struct Diffused {
    seed: Seed,
    inner: Sobol,
}

impl Diffused {
    /// Makes the point set of a seed. The pattern is the same for all seeds, but its offset differs.
    pub fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed), inner: Sobol::new(seed) }
    }
}

/// The block that holds the position in the pixel.
const POSITION: u32 = 0;

/// Returns the index of a sample in the pattern. Each tile, stream and run of `ROUNDS` samples has its own offset.
fn pattern_index(seed: &Seed, id: &SampleId) -> usize {
    let tile = SampleId::new(id.pixel.map(|c| c / SIDE as u32), id.stream, 0);
    let offset = nth_key(seed.key(&tile, POSITION, id.index / ROUNDS as u64), 3);
    let x = (id.pixel[0] as usize % SIDE + offset as usize % SIDE) % SIDE;
    let y = (id.pixel[1] as usize % SIDE + (offset >> 32) as usize % SIDE) % SIDE;
    (id.index % ROUNDS as u64) as usize * PIXELS + y * SIDE + x
}

/// Returns a sample's random bits for the positions within the pattern's steps.
fn pattern_jitter(seed: &Seed, id: &SampleId, block: u32) -> u64 {
    nth_key(nth_key(seed.key(id, block, 0), 5), id.index)
}

impl PointSet for Diffused {
    fn describe(&self) -> String {
        format!("diffused:seed={}", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let inner = self.inner.block(id, block);
        if block != POSITION {
            return inner;
        }
        let [x, y] = places()[pattern_index(&self.seed, &id)];
        let jitter = pattern_jitter(&self.seed, &id, block);
        [coordinate(x, jitter as u32), coordinate(y, (jitter >> 12) as u32), inner[2], inner[3]]
    }

    fn capacity(&self) -> u64 {
        self.inner.capacity()
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// A point set whose positions, lens points and times are chosen jointly over pixels [after Mitchell 1991].
///
/// Mitchell extends blue noise to the dimensions of distribution ray tracing: samples that are close in the image should be
/// far apart on the lens and in time. The construction here has the same goal, but is not from the paper:
///
/// 1. Positions are those of [`Diffused`].
/// 2. A pattern of 64 x 64 pixels and 16 rounds is filled in random order. Each sample uses the best of 16 candidates for lens
///    and time: the one with the largest distance to its nearest sample. The squared distance is `|dxy|^2 / 16 + |dlens|^2 +
///    dtime^2` with `dxy` in pixels. Candidates are compared with samples of the same round up to 4 pixels away, and with the
///    pixel's own samples.
/// 3. The candidates of a round are a net on the lens and strata of time. Each is used once, so that each sample is uniform.
///
/// Block 0 contains position and lens point, and block [`Mitchell1991::TIME_BLOCK`] the time, as in Dapple's integrators. All
/// other coordinates are those of [`Sobol`].
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Mitchell1991;
///
/// let points = Mitchell1991::new(7);
/// let [time, ..] = points.block(SampleId::new([3, 4], 0, 5), Mitchell1991::TIME_BLOCK);
/// assert!((0.0..1.0).contains(&time));
/// ```
///
/// # Limits
///
/// * It improves results at one to a few samples per pixel. At 16 and more, [`Sobol`] is better.
/// * The pattern is finite. Each tile of 64 x 64 pixels, and each run of 16 samples, uses it at a different offset, with
///   seams.
/// * The distance, the candidates and the order of pixels are not those of the paper.
///
/// Name: `mitchell-1991`. Parameters: `seed`.
#[derive(Clone, Copy, Debug)]
pub struct Mitchell1991 {
    seed: Seed,
    inner: Sobol,
}

impl Mitchell1991 {
    /// The block whose first coordinate is the time within the exposure, as in Dapple's integrators.
    pub const TIME_BLOCK: u32 = 1 << 30;

    /// Makes the point set of a seed. The pattern is the same for all seeds, but its offset differs.
    pub fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed), inner: Sobol::new(seed) }
    }
}

impl PointSet for Mitchell1991 {
    fn describe(&self) -> String {
        format!("mitchell-1991:seed={}", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        if block != 0 && block != Self::TIME_BLOCK {
            return self.inner.block(id, block);
        }
        let at = pattern_index(&self.seed, &id);
        let jitter = pattern_jitter(&self.seed, &id, block);
        let bits = |k: u32| (jitter >> (12 * k)) as u32;
        let [u, v, time] = lens_and_time()[at];
        if block == Self::TIME_BLOCK {
            let inner = self.inner.block(id, block);
            return [coordinate(time, bits(0)), inner[1], inner[2], inner[3]];
        }
        let [x, y] = places()[at];
        [coordinate(x, bits(0)), coordinate(y, bits(1)), coordinate(u, bits(2)), coordinate(v, bits(3))]
    }

    fn capacity(&self) -> u64 {
        self.inner.capacity()
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// The number of candidates for the lens point and time of each sample, which is not from the paper.
const CANDIDATES: u64 = 16;
/// The largest distance in pixels at which samples are compared, and the unit of distances in the image. Not from the paper.
const REACH: i32 = 4;

/// Returns the lens point and time of each sample of the pattern, in steps: round by round, in row-major pixel order.
fn lens_and_time() -> &'static [[u16; 3]] {
    static ALL: LazyLock<Vec<[u16; 3]>> = LazyLock::new(spread_lens_and_time);
    &ALL
}

/// The coordinates of a sample: position (in units of [`REACH`] pixels), lens point and time (each in `[0, 1)`).
type Sample = [f32; 5];

fn sample(place: [u16; 2], by: [i32; 2], values: [u16; 3]) -> Sample {
    let unit = |step: u16| (f32::from(step) + 0.5) / STEPS as f32;
    let place = [0, 1].map(|k| (unit(place[k]) + by[k] as f32) / REACH as f32);
    [place[0], place[1], unit(values[0]), unit(values[1]), unit(values[2])]
}

fn distance(a: &Sample, b: &Sample) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

fn spread_lens_and_time() -> Vec<[u16; 3]> {
    let places = places();
    let mut all: Vec<[u16; 3]> = Vec::with_capacity(ROUNDS * PIXELS);
    for round in 0..ROUNDS {
        let (first, salt) = (round * PIXELS, (ROUNDS + round) as u64);
        let mut pool: Vec<[u16; 3]> =
            net(mix64(!salt)).iter().zip(order(3 * salt)).map(|([u, v], time)| [*u, *v, time as u16]).collect();
        let mut now: Vec<Option<[u16; 3]>> = vec![None; PIXELS];
        for pixel in order(2 * salt) {
            let mut near = Vec::with_capacity(128);
            for by in (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| [dx, dy])) {
                let from = neighbour(pixel, by);
                near.extend(now[from].map(|values| sample(places[first + from], by, values)));
            }
            near.extend((0..round).map(|r| r * PIXELS + pixel).map(|at| sample(places[at], [0, 0], all[at])));
            let key = nth_key(mix64(pixel as u64), salt);
            let candidate = |c| (nth_key(key, c) % pool.len() as u64) as usize;
            let nearest = |at: usize| {
                let at = sample(places[first + pixel], [0, 0], pool[at]);
                near.iter().map(|other| distance(&at, other)).fold(f32::INFINITY, f32::min)
            };
            let best =
                (0..CANDIDATES).map(candidate).map(|at| (nearest(at), at)).reduce(|a, b| if b.0 > a.0 { b } else { a });
            now[pixel] = Some(pool.swap_remove(best.map_or(0, |best| best.1)));
        }
        all.extend(now.into_iter().flatten());
    }
    all
}

/// The side of the pattern in pixels.
const SIDE: usize = 64;
/// The number of pixels of the pattern.
const PIXELS: usize = SIDE * SIDE;
/// The number of samples per pixel, placed in rounds of one per pixel.
const ROUNDS: usize = 16;
/// The number of steps per pixel width in which positions are stored, equal to the number of pixels of the pattern.
const STEPS: u32 = PIXELS as u32;

/// The number of candidates for the position of each sample, which is not from the paper.
const PLACES: u64 = 32;

/// Returns the positions in the pixel, in steps: round by round, in row-major pixel order.
///
/// In each round, the positions of all pixels together form a (0,12,2)-net, distributed over the pixels. A pixel at a random
/// location of the pattern therefore has a uniform position.
fn places() -> &'static [[u16; 2]] {
    static PLACES: LazyLock<Vec<[u16; 2]>> = LazyLock::new(spread_places);
    &PLACES
}

/// Returns the pixels of the pattern in a random order.
fn order(round: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..PIXELS).collect();
    order.sort_by_key(|p| (nth_key(mix64(round), *p as u64), *p));
    order
}

/// Returns the points of an Owen-scrambled (0,12,2)-net, in steps.
fn net(key: u64) -> Vec<[u16; 2]> {
    let [kx, ky] = halves(nth_key(key, 0));
    let coordinate = |reversed: u32, key| (owen_reversed(reversed, key).reverse_bits() >> 20) as u16;
    (0..STEPS).map(|i| [coordinate(i, kx), coordinate(sobol1_reversed(u64::from(i)) as u32, ky)]).collect()
}

/// Returns the pixel at the offset `(dx, dy)`; the pattern is periodic.
fn neighbour(pixel: usize, [dx, dy]: [i32; 2]) -> usize {
    let along = |c: usize, by: i32| (c as i32 + by).rem_euclid(SIDE as i32) as usize;
    along(pixel / SIDE, dy) * SIDE + along(pixel % SIDE, dx)
}

/// Assigns the positions of each round to pixels in random order. Each pixel gets the candidate with the largest distance to
/// its nearest sample of all rounds so far.
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
            let chosen = (0..PLACES).map(candidate).max_by_key(distance).unwrap_or(0);
            now[pixel] = Some(pool.swap_remove(chosen));
        }
        places.extend(now.into_iter().flatten());
    }
    places
}

/// Returns all samples in the pixel and its eight neighbours, in steps from the pixel's corner.
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

/// Converts a stored step to a coordinate in `[0, 1)`. `jitter` has 12 random bits, which select the position within the step.
#[inline]
fn coordinate(step: u16, jitter: u32) -> f32 {
    (u32::from(step) << 12 | jitter & 0xfff) as f32 * (1.0 / 16_777_216.0)
}
