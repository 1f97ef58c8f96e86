//! A tile of scrambling keys that make the errors of neighbouring pixels differ.

use crate::keys::{halves, mix64, nth_key};
use crate::sobol::{owen_reversed, pack, sobol1_reversed};
use std::sync::LazyLock;

/// The leading bits of each coordinate that a key of the tile changes.
pub(crate) const BITS: u32 = 6;

/// The side of the tile in pixels.
pub(crate) const SIDE: usize = 1 << BITS;

/// The number of pixels of the tile, and of keys.
pub(crate) const PIXELS: usize = SIDE * SIDE;

/// The sample counts for which the keys are optimised.
const COUNTS: [u32; 5] = [1, 2, 4, 8, 16];

/// Test integrands. Our choice.
const WAVES: usize = 48;

/// The errors of one key: each count's, wave by wave. A multiple of [`LANES`].
const ERRORS: usize = COUNTS.len() * WAVES;

/// Sums that run beside each other, so that compilers can vectorise them.
const LANES: usize = 8;

/// Proposed swaps. Our choice: less than half a second.
const SWAPS: u64 = 400_000;

/// The reach of the window of neighbours in pixels, which is 7 x 7.
const REACH: usize = 3;

/// The distance in pixels at which a neighbour's weight is `1/e` [after Georgiev 2016].
const FALLOFF: f64 = 2.1;

/// The scramble of the shared sequence, the best of 64 in our search. With it, the errors of 256 random half-planes have
/// the least energy at low frequencies.
const SCRAMBLE: u64 = nth_key(0, 1);

/// The keys, row by row: a permutation of `0..PIXELS`. Bits 0 to 5 belong to x, bits 6 to 11 to y.
///
/// Since each key occurs once, each pixel's points are uniform over random offsets of the tile. The tile is periodic.
pub(crate) fn tile() -> &'static [u16] {
    static TILE: LazyLock<Vec<u16>> = LazyLock::new(|| {
        let mut arrangement = Arrangement::new(white(), errors());
        arrangement.optimise(SWAPS);
        arrangement.keys
    });
    &TILE
}

/// The keys in random order.
pub(crate) fn white() -> Vec<u16> {
    let mut keys: Vec<u16> = (0..PIXELS as u16).collect();
    keys.sort_unstable_by_key(|key| mix64(u64::from(*key)));
    keys
}

/// The shared sequence at two indices: two pairs of one Owen-scrambled Sobol' sequence, as 32-bit fractions.
#[inline]
pub(crate) fn sequence(first: u32, second: u32) -> [u32; 4] {
    // The reversed bits of the first coordinate are the index itself.
    let index = pack(first, second);
    let ([x0, x1], [y0, y1]) = (halves(index), halves(sobol1_reversed(index)));
    let [scramble_x, scramble_y] = halves(SCRAMBLE);
    let scrambles = [scramble_x, scramble_y, scramble_x, scramble_y];
    let coordinates = [x0, y0, x1, y1];
    std::array::from_fn(|k| owen_reversed(coordinates[k], scrambles[k]).reverse_bits())
}

/// The frequencies of the test integrands in half-periods: the lowest, except the constant.
fn frequencies() -> Vec<[usize; 2]> {
    let mut all: Vec<[usize; 2]> = (1..256).map(|k| [k % 16, k / 16]).collect();
    all.sort_by_key(|[a, b]| (a * a + b * b, *a));
    all.truncate(WAVES);
    all
}

/// A wave at the centres of all cells, one per key, with mean 0.
///
/// Waves stand for half-planes of random place and direction: their powers fall with the cube of the frequency, as the
/// mean spectrum of such half-planes does.
fn wave([a, b]: [usize; 2]) -> Vec<f64> {
    let cosine = |k: usize, cell: usize| libm::cos(std::f64::consts::PI * k as f64 * (cell as f64 + 0.5) / SIDE as f64);
    let frequency = ((a * a + b * b) as f64).sqrt();
    // A cosine across has half the power of a constant.
    let axes = if a == 0 || b == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
    let amplitude = axes / (frequency * frequency.sqrt());
    let [across, down] = [a, b].map(|k| (0..SIDE).map(|cell| cosine(k, cell)).collect::<Vec<f64>>());
    (0..PIXELS).map(|key| amplitude * across[key % SIDE] * down[key / SIDE]).collect()
}

/// The integration errors of all keys, key by key. Each count has the same sum of squares.
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

/// Keys in their pixels, and the errors around each pixel.
struct Arrangement {
    keys: Vec<u16>,
    /// The errors by key.
    errors: Vec<f32>,
    /// The weighted sums of the neighbours' errors, by pixel.
    around: Vec<f32>,
    /// The weights by distance along x and along y. A pixel is no neighbour of its own.
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

    /// Adds a change of the errors at a pixel to the sums around it.
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

    /// Proposes swaps of the keys of two random pixels, and makes those that lower the energy.
    ///
    /// The energy is the sum over pairs of neighbours of their weight and the product of their errors. As the squares
    /// of all errors keep their sum, it falls exactly if the weighted squared differences of neighbours grow. Annealing
    /// gained nothing at this number of swaps.
    fn optimise(&mut self, swaps: u64) {
        for number in 0..swaps {
            let [a, b] = halves(nth_key(!SCRAMBLE, number)).map(|bits| bits as usize % PIXELS);
            if self.gain(a, b) < 0.0 {
                self.swap(a, b);
            }
        }
    }

    /// Half of the change of the energy if two pixels swap their keys.
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
        // Neighbours see each other's change.
        sums.iter().sum::<f32>() - self.weight(a, b) * squares.iter().sum::<f32>()
    }

    fn swap(&mut self, a: usize, b: usize) {
        let change = std::array::from_fn(|k| self.errors_at(b)[k] - self.errors_at(a)[k]);
        self.add(a, &change);
        self.add(b, &change.map(|c| -c));
        self.keys.swap(a, b);
    }

    /// The weight of two pixels, 0 beyond the window. Distances go around the tile.
    fn weight(&self, a: usize, b: usize) -> f32 {
        let around = |d: usize| d.min(SIDE - d);
        let x = around((a % SIDE).abs_diff(b % SIDE));
        let y = around((a / SIDE).abs_diff(b / SIDE));
        self.weights.get(y).and_then(|row| row.get(x)).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Arrangement {
        fn energy(&self) -> f64 {
            let product = |place: usize| {
                let around = &self.around[place * ERRORS..(place + 1) * ERRORS];
                self.errors_at(place).iter().zip(around).map(|(e, a)| f64::from(e * a)).sum::<f64>()
            };
            (0..PIXELS).map(product).sum()
        }
    }

    #[test]
    fn every_key_occurs_once() {
        for keys in [white(), tile().to_vec()] {
            let mut seen = vec![false; PIXELS];
            for key in keys {
                assert!(!std::mem::replace(&mut seen[usize::from(key)], true), "{key} twice");
            }
        }
    }

    /// A change of the tile changes every image of the point set.
    #[test]
    fn the_tile_never_changes() {
        let digest = tile().iter().fold(0, |digest, key| mix64(digest ^ u64::from(*key)));
        assert_eq!(digest, 0xc233_065e_db68_765a, "{digest:#x}");
    }

    /// Sums that are kept through swaps equal sums made anew, and the energy changes by what `gain` predicts. The
    /// energy of random keys is near 0; its lower bound is about `-1` per pixel and count.
    #[test]
    fn swaps_lower_the_energy_by_their_gain() {
        let errors = errors();
        let mut kept = Arrangement::new(white(), errors.clone());
        let per_pixel = |energy: f64| energy / (PIXELS * COUNTS.len()) as f64;
        let before = kept.energy();
        assert!(per_pixel(before).abs() < 0.05, "{}", per_pixel(before));
        // Neighbours across the border, neighbours in a row, and distant pixels.
        for [a, b] in [[0, PIXELS - 1], [70, 71], [5, 2000]] {
            let (energy, gain) = (kept.energy(), f64::from(kept.gain(a, b)));
            kept.swap(a, b);
            let change = kept.energy() - energy;
            assert!((change - 2.0 * gain).abs() < 1e-3 * (1.0 + change.abs()), "{change}, predicted {}", 2.0 * gain);
        }
        kept.optimise(20_000);
        let anew = Arrangement::new(kept.keys.clone(), errors.clone()).energy();
        assert!((kept.energy() - anew).abs() < 1e-3 * anew.abs());
        let best = Arrangement::new(tile().to_vec(), errors).energy();
        assert!(best < anew && anew < before, "{best}, {anew}, {before}");
        assert!(per_pixel(best) < -0.5, "{}", per_pixel(best));
    }
}
