//! Blue-noise errors over the image for any point set, by per-pixel shifts from a tile of ranks.

use crate::keys::{Seed, nth_key};
use dapple_core::{PointSet, SampleId};
use std::sync::LazyLock;

/// A decorator of another point set that distributes errors over the image as blue noise [after Georgiev 2016].
///
/// All pixels of a tile of 128 x 128 pixels share one sequence of the inner point set. Each pixel adds its own shift to each
/// coordinate, modulo 1 [Cranley 1976]. The shifts form a blue-noise mask, computed by the void-and-cluster method [Ulichney
/// 1993]. Neighbouring pixels with similar integrands therefore have different errors, and the error has little energy at low
/// frequencies.
///
/// Each coordinate, stream and tile uses the mask at a different offset.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::{BlueNoise, Sobol};
///
/// let points = BlueNoise::new(7, Sobol::new(7));
/// assert!(points.couples_pixels());
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Limits
///
/// * The sum of squared errors does not decrease; only its distribution over frequencies changes. Denoisers and viewers
///   benefit.
/// * A net shifted modulo 1 is no longer a net; [`BlueNoiseKeys`](crate::BlueNoiseKeys) preserves nets. For the integrand `x y`
///   and 64 samples, shifted Sobol' points have a larger error than scrambled ones.
/// * The benefit decreases with the number of samples, and with the number of coordinates that affect the integrand.
/// * With adaptive sampling, errors of pixels with different sample counts are not blue noise.
/// * Tile borders are seams: the pixels on both sides are independent.
///
/// Name: `blue-noise`. Parameters: `seed`, `of` (the inner point set).
#[derive(Clone, Copy, Debug)]
pub struct BlueNoise<P> {
    seed: Seed,
    inner: P,
}

impl<P: PointSet> BlueNoise<P> {
    /// Makes the point set that distributes the errors of `inner` as blue noise.
    pub fn new(seed: u64, inner: P) -> Self {
        Self { seed: Seed::new(seed), inner }
    }
}

/// The batch number reserved for the keys of tiles. No inner point set of the same seed uses it before sample 2^63.
const TILES: u64 = u64::MAX;

impl<P: PointSet> PointSet for BlueNoise<P> {
    fn describe(&self) -> String {
        format!("blue-noise:seed={},of={}", self.seed.given(), self.inner.describe())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let mut shared = id;
        shared.pixel = id.pixel.map(|c| c / SIDE as u32);
        let place = id.pixel.map(|c| c as usize % SIDE);
        let key = self.seed.key(&shared, block, TILES);
        let ranks = tile();
        let inner = self.inner.block(shared, block);
        std::array::from_fn(|k| {
            let offset = nth_key(key, k as u64);
            let x = (place[0] + offset as usize) % SIDE;
            let y = (place[1] + (offset >> 32) as usize) % SIDE;
            shifted(inner[k], ranks[y * SIDE + x])
        })
    }

    fn capacity(&self) -> u64 {
        self.inner.capacity()
    }

    fn preferred_count(&self, n: u64) -> u64 {
        self.inner.preferred_count(n)
    }

    fn is_independent(&self) -> bool {
        self.inner.is_independent()
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// Returns the coordinate `u` moved by `rank / PIXELS`, modulo 1, exact in all 24 bits.
#[inline]
fn shifted(u: f32, rank: u16) -> f32 {
    const ONE: u32 = 1 << 24;
    let sum = (u * ONE as f32) as u32 + u32::from(rank) * (ONE / PIXELS as u32);
    (sum % ONE) as f32 * (1.0 / ONE as f32)
}

/// The side of the tile in pixels, a power of two.
const SIDE: usize = 128;

/// The number of pixels of the tile. Each pixel has a different rank.
const PIXELS: usize = SIDE * SIDE;

/// The standard deviation, in pixels, of the Gaussian filter [Ulichney 1993].
const SIGMA: f64 = 1.5;

/// The radius at which the filter is cut off, where its weight is below 2e-8.
const RADIUS: i32 = 9;

/// In the initial pattern, one in this many pixels is set. The value is not from the paper.
const INITIAL: usize = 10;

/// Returns the tile in row-major order: a permutation of `0..PIXELS`.
///
/// For every `k`, the pixels with the lowest `k` ranks are evenly distributed, and so are the remaining pixels. The tile is
/// periodic.
fn tile() -> &'static [u16] {
    static TILE: LazyLock<Vec<u16>> = LazyLock::new(ranks);
    &TILE
}

/// Computes the ranks by the method of [Ulichney 1993]. The method's last two phases are combined: the largest void among ones
/// is the tightest cluster among zeros, since the filter is linear.
fn ranks() -> Vec<u16> {
    let mut pattern = Pattern::new();
    let mut ones = 0;
    // Positions are hashed, so that the pattern is the same on every machine.
    for k in 0.. {
        let place = (crate::keys::mix64(k) >> 32) as usize % PIXELS;
        if !pattern.on[place] {
            pattern.set(place, true);
            ones += 1;
        }
        if ones == PIXELS / INITIAL {
            break;
        }
    }
    loop {
        let cluster = pattern.tightest_cluster();
        pattern.set(cluster, false);
        let void = pattern.largest_void();
        pattern.set(void, true);
        if void == cluster {
            break;
        }
    }
    let mut ranks = vec![0; PIXELS];
    let mut first = pattern.clone();
    for rank in (0..ones).rev() {
        let place = first.tightest_cluster();
        first.set(place, false);
        ranks[place] = rank as u16;
    }
    for rank in ones..PIXELS {
        let place = pattern.largest_void();
        pattern.set(place, true);
        ranks[place] = rank as u16;
    }
    ranks
}

/// A binary pattern with its filtered values, and the extrema of each row.
#[derive(Clone)]
struct Pattern {
    on: Vec<bool>,
    /// The filtered pattern as integers, so that setting and clearing a pixel is exact.
    energy: Vec<u64>,
    /// In each row, the set pixel of highest energy and the unset pixel of lowest energy, if there are any.
    extrema: Vec<[Option<usize>; 2]>,
    kernel: Vec<u64>,
}

impl Pattern {
    fn new() -> Self {
        let weight = |dx: i32, dy: i32| {
            let squared = f64::from(dx * dx + dy * dy);
            (libm::exp(-squared / (2.0 * SIGMA * SIGMA)) * f64::from(1 << 30)) as u64
        };
        let kernel = (-RADIUS..=RADIUS).flat_map(|dy| (-RADIUS..=RADIUS).map(move |dx| weight(dx, dy))).collect();
        let extrema = (0..SIDE).map(|row| [None, Some(row * SIDE)]).collect();
        Self { on: vec![false; PIXELS], energy: vec![0; PIXELS], extrema, kernel }
    }

    fn set(&mut self, place: usize, on: bool) {
        self.on[place] = on;
        let (x, y) = (place % SIDE, place / SIDE);
        let width = (2 * RADIUS + 1) as usize;
        for (dy, weights) in self.kernel.chunks_exact(width).enumerate() {
            let row = (y + SIDE + dy - RADIUS as usize) % SIDE;
            for (dx, weight) in weights.iter().enumerate() {
                let at = row * SIDE + (x + SIDE + dx - RADIUS as usize) % SIDE;
                let energy = self.energy[at];
                self.energy[at] = if on { energy + weight } else { energy - weight };
            }
            self.extrema[row] = self.extrema_of(row);
        }
    }

    /// Returns the extrema of a row. Ties are resolved in favour of the first pixel.
    fn extrema_of(&self, row: usize) -> [Option<usize>; 2] {
        let places = row * SIDE..(row + 1) * SIDE;
        let cluster = places.clone().filter(|p| self.on[*p]).rev().max_by_key(|p| self.energy[*p]);
        let void = places.filter(|p| !self.on[*p]).min_by_key(|p| self.energy[*p]);
        [cluster, void]
    }

    fn tightest_cluster(&self) -> usize {
        let found = self.extrema.iter().rev().filter_map(|row| row[0]).max_by_key(|p| self.energy[*p]);
        found.unwrap_or_default()
    }

    fn largest_void(&self) -> usize {
        let found = self.extrema.iter().filter_map(|row| row[1]).min_by_key(|p| self.energy[*p]);
        found.unwrap_or_default()
    }
}
