//! Blue-noise errors over the image with intact nets, by a tile of scrambling keys.

use crate::keys::{Seed, halves, mix64, nth_key, unit};
use crate::sobol::{owen_reversed, pack, sobol1_reversed};
use dapple_core::{PointSet, SampleId};
use std::sync::LazyLock;

/// Sobol' points whose errors are blue noise over the image, by optimised scrambling keys [after Heitz et al. 2019].
///
/// All pixels of a tile of 64 x 64 pixels share one Owen-scrambled Sobol' sequence of pairs. Each pixel has its own key for
/// each coordinate, and applies it to the coordinate by exclusive or. This keeps every net intact.
///
/// The upper 6 bits of the two keys come from a mask of 64 x 64 entries, in which each of the 4096 combinations occurs once.
/// Keys are swapped between pixels so that the integration errors of neighbours differ as much as possible, at 1, 2, 4, 8 and
/// 16 samples jointly. The lower bits are random. Each pair, block, stream and tile uses the mask at a different offset, so
/// each pixel's samples are uniform.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::BlueNoiseKeys;
///
/// let points = BlueNoiseKeys::new(7);
/// assert!(points.couples_pixels());
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Precision
///
/// The table shows the error's energy at low frequencies (means over 4 x 4 pixels), divided by the energy with
/// [`Sobol`](crate::Sobol). "Shifted" is [`BlueNoise`](crate::BlueNoise). The optimisation used neither integrand:
///
/// | samples | half-plane | half-plane, shifted | `x y` | `x y`, shifted |
/// |---|---|---|---|---|
/// | 1 | 0.38 | 0.42 | 0.32 | 0.40 |
/// | 2 | 0.58 | 1.13 | 0.45 | 0.80 |
/// | 4 | 0.48 | 1.09 | 0.13 | 2.1 |
/// | 8 | 0.56 | 0.89 | 0.29 | 4.3 |
/// | 16 | 0.80 | 1.59 | 0.42 | 11 |
///
/// The mean squared error per pixel is 0.24 to 1.4 times the error of independent pixels, since all pixels share one scramble.
/// For `x y` at 16 samples, it is 1/19 of the error of shifted points.
///
/// # Differences from the publication
///
/// * The test integrands are 48 cosine waves with the power spectrum of random half-planes. With the same number of half-planes
///   as test integrands, the errors of other half-planes have more energy at low frequencies.
/// * There are no ranking keys (exclusive ors of the sample index). They would make a pixel's first samples less uniform.
///   Instead, the scrambling keys are optimised for all sample counts jointly.
/// * Two coordinates are optimised, and all pairs use the same mask.
///
/// A second paper of the same year permutes the pixels' seeds between frames [Heitz and Belcour 2019]. It is not implemented,
/// since it needs a previous frame rendered with the same seeds, and a still image has none.
///
/// # Limits
///
/// * From 32 samples on, smooth integrands do not improve, and edges improve little.
/// * With adaptive sampling, errors of pixels with different sample counts are not blue noise.
/// * Tile borders are seams: the pixels on both sides are independent.
/// * All pairs share the scramble. At 2 samples, integrands that depend on several pairs have up to 1.5x the squared error.
/// * Creating the first such point set in a process takes about half a second.
///
/// Name: `blue-noise` with `keys=optimised`. Parameters: `seed`.
#[derive(Clone, Copy)]
pub struct BlueNoiseKeys {
    seed: Seed,
    keys: &'static [u16],
}

/// Formats the seed, without the keys.
impl std::fmt::Debug for BlueNoiseKeys {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BlueNoiseKeys").field("seed", &self.seed).finish_non_exhaustive()
    }
}

impl BlueNoiseKeys {
    /// Makes the point set of a seed. The first call in a process optimises the keys.
    pub fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed), keys: tile() }
    }
}

impl PointSet for BlueNoiseKeys {
    fn describe(&self) -> String {
        format!("blue-noise:seed={},keys=optimised,of=sobol", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let batch = id.index >> 32;
        let mut shared = id;
        shared.pixel = id.pixel.map(|c| c / SIDE as u32);
        // The complement keeps the keys of tiles apart from the keys of pixels.
        let key = self.seed.key(&shared, block, !batch);
        let own = self.seed.key(&id, block, batch);
        let index = halves(nth_key(key, 0)).map(|shuffle| shuffled(id.index as u32, shuffle));
        let points = sequence(index[0], index[1]);
        let place = id.pixel.map(|c| c as usize % SIDE);
        let mut block = [0.0; 4];
        for (pair, offset) in halves(nth_key(key, 1)).into_iter().enumerate() {
            let x = (place[0] + offset as usize) % SIDE;
            let y = (place[1] + (offset >> BITS) as usize) % SIDE;
            let cell = u32::from(self.keys[y * SIDE + x]);
            let fine = halves(nth_key(own, pair as u64)).map(|bits| bits >> BITS);
            block[2 * pair] = unit(points[2 * pair] ^ (cell << (32 - BITS) | fine[0]));
            block[2 * pair + 1] = unit(points[2 * pair + 1] ^ (cell >> BITS << (32 - BITS) | fine[1]));
        }
        block
    }

    /// Returns `2^32`, as for [`Sobol`](crate::Sobol).
    fn capacity(&self) -> u64 {
        1 << 32
    }

    /// Returns the smallest count of at least `n` that [`Sobol`](crate::Sobol) prefers.
    fn preferred_count(&self, n: u64) -> u64 {
        crate::sobol::preferred_count(n)
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// Returns a permutation of the indices that maps each set `0..2^k` to itself: a nested shuffle of the bits below the leading
/// one.
#[inline]
fn shuffled(index: u32, shuffle: u32) -> u32 {
    let below = index.checked_ilog2().map_or(0, |leading| (1 << leading) - 1);
    let nested = owen_reversed(index.reverse_bits(), shuffle).reverse_bits();
    index & !below | nested & below
}

/// The number of leading bits of each coordinate that a key of the tile changes.
const BITS: u32 = 6;

/// The side of the tile in pixels.
const SIDE: usize = 1 << BITS;

/// The number of pixels of the tile, which is also the number of keys.
const PIXELS: usize = SIDE * SIDE;

/// The sample counts for which the keys are optimised.
const COUNTS: [u32; 5] = [1, 2, 4, 8, 16];

/// The number of test integrands, which is not from the paper.
const WAVES: usize = 48;

/// The number of errors per key: for each count, one per wave. It is a multiple of [`LANES`].
const ERRORS: usize = COUNTS.len() * WAVES;

/// The number of sums computed in parallel, so that compilers can vectorise them.
const LANES: usize = 8;

/// The number of proposed swaps, which take less than half a second. It is not from the paper.
const SWAPS: u64 = 400_000;

/// The radius of the neighbourhood in pixels; the neighbourhood is 7 x 7 pixels.
const REACH: usize = 3;

/// The distance in pixels at which a neighbour's weight is `1/e` [after Georgiev 2016].
const FALLOFF: f64 = 2.1;

/// The scramble of the shared sequence. Of 64 candidates, it gives the errors of 256 random half-planes the least low-frequency
/// energy.
const SCRAMBLE: u64 = nth_key(0, 1);

/// Returns the keys in row-major pixel order: a permutation of `0..PIXELS`. Bits 0 to 5 belong to x, bits 6 to 11 to y.
///
/// Since each key occurs once, each pixel's points are uniform over random offsets of the tile. The tile is periodic.
fn tile() -> &'static [u16] {
    static TILE: LazyLock<Vec<u16>> = LazyLock::new(|| {
        let mut arrangement = Arrangement::new(white(), errors());
        arrangement.optimise(SWAPS);
        arrangement.keys
    });
    &TILE
}

/// Returns the keys in random order.
fn white() -> Vec<u16> {
    let mut keys: Vec<u16> = (0..PIXELS as u16).collect();
    keys.sort_unstable_by_key(|key| mix64(u64::from(*key)));
    keys
}

/// Returns the points of the shared sequence at two indices: two pairs of one Owen-scrambled Sobol' sequence, as 32-bit
/// fractions.
#[inline]
fn sequence(first: u32, second: u32) -> [u32; 4] {
    // The reversed bits of the first coordinate are the index itself.
    let index = pack(first, second);
    let ([x0, x1], [y0, y1]) = (halves(index), halves(sobol1_reversed(index)));
    let [scramble_x, scramble_y] = halves(SCRAMBLE);
    let scrambles = [scramble_x, scramble_y, scramble_x, scramble_y];
    let coordinates = [x0, y0, x1, y1];
    std::array::from_fn(|k| owen_reversed(coordinates[k], scrambles[k]).reverse_bits())
}

/// Returns the frequencies of the test integrands in half-periods: the lowest ones, except the constant.
fn frequencies() -> Vec<[usize; 2]> {
    let mut all: Vec<[usize; 2]> = (1..256).map(|k| [k % 16, k / 16]).collect();
    all.sort_by_key(|[a, b]| (a * a + b * b, *a));
    all.truncate(WAVES);
    all
}

/// Returns the values of a wave at the centres of all cells, one per key. Their mean is 0.
///
/// Waves represent half-planes of random position and direction: their powers fall with the cube of the frequency, like the
/// mean spectrum of such half-planes.
fn wave([a, b]: [usize; 2]) -> Vec<f64> {
    let cosine = |k: usize, cell: usize| libm::cos(std::f64::consts::PI * k as f64 * (cell as f64 + 0.5) / SIDE as f64);
    let frequency = ((a * a + b * b) as f64).sqrt();
    // A cosine across has half the power of a constant.
    let axes = if a == 0 || b == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
    let amplitude = axes / (frequency * frequency.sqrt());
    let [across, down] = [a, b].map(|k| (0..SIDE).map(|cell| cosine(k, cell)).collect::<Vec<f64>>());
    (0..PIXELS).map(|key| amplitude * across[key % SIDE] * down[key / SIDE]).collect()
}

/// Returns the integration errors of all keys, grouped by key and normalised to the same sum of squares for each count.
fn errors() -> Vec<f32> {
    let waves: Vec<Vec<f64>> = frequencies().into_iter().map(wave).collect();
    let mut errors = vec![0.0; PIXELS * ERRORS];
    for (number, count) in COUNTS.into_iter().enumerate() {
        let cells: Vec<usize> = (0..count)
            .map(|index| {
                let [x, y, ..] = sequence(index, 0).map(|u| (u >> (32 - BITS)) as usize);
                y << BITS | x
            })
            .collect();
        let error = |key: usize, wave: &Vec<f64>| cells.iter().map(|cell| wave[cell ^ key]).sum::<f64>();
        let all: Vec<f64> = (0..PIXELS).flat_map(|key| waves.iter().map(move |w| error(key, w))).collect();
        let scale = (PIXELS as f64 / all.iter().map(|e| e * e).sum::<f64>()).sqrt();
        for (key, of_key) in all.chunks_exact(WAVES).enumerate() {
            let place = key * ERRORS + number * WAVES;
            for (to, from) in errors[place..place + WAVES].iter_mut().zip(of_key) {
                *to = (from * scale) as f32;
            }
        }
    }
    errors
}

/// The assignment of keys to pixels, and the errors around each pixel.
struct Arrangement {
    keys: Vec<u16>,
    /// The errors, indexed by key.
    errors: Vec<f32>,
    /// The weighted sums of the neighbours' errors, indexed by pixel.
    around: Vec<f32>,
    /// The weights of neighbours, by distance along y and along x. A pixel is not its own neighbour.
    weights: [[f32; REACH + 1]; REACH + 1],
}

impl Arrangement {
    fn new(keys: Vec<u16>, errors: Vec<f32>) -> Self {
        let weight = |x: usize, y: usize| match x * x + y * y {
            0 => 0.0,
            squared => libm::exp(-(squared as f64) / (FALLOFF * FALLOFF)) as f32,
        };
        let weights = std::array::from_fn(|y| std::array::from_fn(|x| weight(x, y)));
        let mut new = Self { keys, errors, around: vec![0.0; PIXELS * ERRORS], weights };
        for place in 0..PIXELS {
            let change = std::array::from_fn(|k| new.errors_at(place)[k]);
            new.add(place, &change);
        }
        new
    }

    fn errors_at(&self, place: usize) -> &[f32] {
        let key = usize::from(self.keys[place]);
        &self.errors[key * ERRORS..(key + 1) * ERRORS]
    }

    /// Updates the sums around a pixel after a change of its errors.
    fn add(&mut self, place: usize, change: &[f32; ERRORS]) {
        let (x, y) = (place % SIDE, place / SIDE);
        for dy in 0..=2 * REACH {
            for dx in 0..=2 * REACH {
                let weight = self.weights[dy.abs_diff(REACH)][dx.abs_diff(REACH)];
                let at = (y + SIDE + dy - REACH) % SIDE * SIDE + (x + SIDE + dx - REACH) % SIDE;
                for (sum, c) in self.around[at * ERRORS..(at + 1) * ERRORS].iter_mut().zip(change) {
                    *sum += weight * c;
                }
            }
        }
    }

    /// Proposes swaps of the keys of two random pixels, and performs those that lower the energy.
    ///
    /// The energy is the sum over pairs of neighbours of their weight times the product of their errors. Since the sum of
    /// squared errors is constant, the energy falls if and only if the weighted squared differences of neighbours grow.
    /// Annealing did not improve the result at this number of swaps.
    fn optimise(&mut self, swaps: u64) {
        for number in 0..swaps {
            let [a, b] = halves(nth_key(!SCRAMBLE, number)).map(|bits| bits as usize % PIXELS);
            if self.gain(a, b) < 0.0 {
                self.swap(a, b);
            }
        }
    }

    /// Returns half of the change of the energy if two pixels swap their keys.
    fn gain(&self, a: usize, b: usize) -> f32 {
        let (errors_a, errors_b) = (self.errors_at(a), self.errors_at(b));
        let [around_a, around_b] = [a, b].map(|place| &self.around[place * ERRORS..(place + 1) * ERRORS]);
        let (mut sums, mut squares) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        for start in (0..ERRORS).step_by(LANES) {
            for lane in 0..LANES {
                let k = start + lane;
                let change = errors_b[k] - errors_a[k];
                sums[lane] += change * (around_a[k] - around_b[k]);
                squares[lane] += change * change;
            }
        }
        // If the two pixels are neighbours, both errors of their pair change.
        sums.iter().sum::<f32>() - self.weight(a, b) * squares.iter().sum::<f32>()
    }

    fn swap(&mut self, a: usize, b: usize) {
        let change = std::array::from_fn(|k| self.errors_at(b)[k] - self.errors_at(a)[k]);
        self.add(a, &change);
        self.add(b, &change.map(|c| -c));
        self.keys.swap(a, b);
    }

    /// Returns the weight of two pixels, which is 0 outside the neighbourhood. Distances are periodic.
    fn weight(&self, a: usize, b: usize) -> f32 {
        let around = |d: usize| d.min(SIDE - d);
        let x = around((a % SIDE).abs_diff(b % SIDE));
        let y = around((a / SIDE).abs_diff(b / SIDE));
        self.weights.get(y).and_then(|row| row.get(x)).copied().unwrap_or(0.0)
    }
}
