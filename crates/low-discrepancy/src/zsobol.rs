//! Sobol' points dealt to pixels along a Morton curve.

use crate::Error;
use crate::keys::{Seed, halves, next_state, nth_key, unit};
use crate::sobol::{owen_reversed, pack, sobol1_reversed};
use dapple_core::{PointSet, SampleId};

/// One Sobol' sequence for the image, dealt to the pixels along a randomised Morton curve [after Ahmed 2020].
///
/// Pixels are numbered along a Morton (Z) curve, and each takes `count` consecutive points of one Owen-scrambled
/// sequence. Each base-4 digit of the number is permuted at random, by one of 24 permutations that depends on the digits
/// above it. pbrt-v4's `ZSobolSampler` does the same.
///
/// * The `count` samples of a pixel are a (0,k,2)-net in each pair.
/// * So are the samples of each aligned block of 2x2, 4x4, … pixels together. Errors of neighbours thus cancel: noise has
///   less energy at low frequencies.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::ZSobol;
///
/// // The four pixels of a 2x2 block, one sample each: one in each quarter of the square.
/// let points = ZSobol::new(7, 1)?;
/// let mut quarters: Vec<u32> = (0..4)
///     .map(|pixel| {
///         let [x, y, ..] = points.block(SampleId::new([6 + pixel % 2, 8 + pixel / 2], 0, 0), 0);
///         2 * u32::from(y >= 0.5) + u32::from(x >= 0.5)
///     })
///     .collect();
/// quarters.sort();
/// assert_eq!(quarters, [0, 1, 2, 3]);
/// # Ok::<(), dapple_low_discrepancy::Error>(())
/// ```
///
/// # Limits
///
/// * The count must be known beforehand; it is rounded up to a power of two. Pixels with fewer samples are not spread
///   over the image: their errors are white noise. Further samples begin a new sequence.
/// * The sequence has 2^32 points. Images larger than `2^t x 2^t` pixels, with `2 t` the bits that `count` leaves, are cut
///   into tiles of that size with sequences of their own: 16384 pixels at 16 samples.
/// * With adaptive counts the blocks are incomplete.
///
/// Name: `zsobol`. Parameters: `seed`, `count`.
#[derive(Clone, Copy, Debug)]
pub struct ZSobol {
    seed: Seed,
    log2_count: u32,
}

impl ZSobol {
    /// The largest number of samples per pixel in one sequence.
    pub const MAX_COUNT: u32 = 1 << 24;

    /// Makes the point set with `count` samples per pixel, rounded up to a power of two.
    ///
    /// # Errors
    ///
    /// [`Error::BadCount`] unless `1 <= count <= MAX_COUNT`.
    pub const fn new(seed: u64, count: u32) -> Result<Self, Error> {
        if count == 0 || count > Self::MAX_COUNT {
            return Err(Error::BadCount { count });
        }
        Ok(Self { seed: Seed::new(seed), log2_count: count.next_power_of_two().trailing_zeros() })
    }

    /// The number of samples of each pixel in one sequence, a power of two.
    pub const fn count(&self) -> u32 {
        1 << self.log2_count
    }

    /// The binary logarithm of a tile's side in pixels.
    const fn log2_tile(&self) -> u32 {
        (32 - self.log2_count) / 2
    }
}

impl PointSet for ZSobol {
    fn describe(&self) -> String {
        format!("zsobol:seed={},count={}", self.seed.given(), self.count())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let log2_tile = self.log2_tile();
        let mut shared = id;
        shared.pixel = id.pixel.map(|c| c >> log2_tile);
        let [x, y] = id.pixel.map(|c| spread(c & ((1 << log2_tile) - 1)));
        let within = id.index as u32 & (self.count() - 1);
        let number = (u64::from(x | y << 1) << self.log2_count) as u32 | within;

        let key = self.seed.key(&shared, block, id.index >> self.log2_count);
        let bits = 2 * log2_tile + self.log2_count;
        let index = pack(permuted(number, bits, nth_key(key, 0)), permuted(number, bits, nth_key(key, 1)));
        let [x0, x1] = halves(index);
        let [y0, y1] = halves(sobol1_reversed(index));
        let [scramble_x0, scramble_y0] = halves(nth_key(key, 2));
        let [scramble_x1, scramble_y1] = halves(nth_key(key, 3));
        let scrambled = |reversed, key| unit(owen_reversed(reversed, key).reverse_bits());
        [scrambled(x0, scramble_x0), scrambled(y0, scramble_y0), scrambled(x1, scramble_x1), scrambled(y1, scramble_y1)]
    }

    /// Returns `u64::MAX`, since further samples begin a new sequence.
    fn capacity(&self) -> u64 {
        u64::MAX
    }

    /// Returns the next multiple of [`ZSobol::count`] from `n` on.
    fn preferred_count(&self, n: u64) -> u64 {
        n.max(1).checked_next_multiple_of(u64::from(self.count())).unwrap_or(n)
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// The low 16 bits of a number, moved to the even bits.
#[inline(always)]
const fn spread(x: u32) -> u32 {
    let mut x = x & 0xffff;
    x = (x | x << 8) & 0x00ff_00ff;
    x = (x | x << 4) & 0x0f0f_0f0f;
    x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}

/// The 24 permutations of four digits, each as four pairs of bits from the lowest on.
const PERMUTATIONS: [u8; 24] = {
    let (mut all, mut n, mut code) = ([0; 24], 0, 0_u32);
    while code < 256 {
        let [a, b, c, d] = [code & 3, code >> 2 & 3, code >> 4 & 3, code >> 6];
        if a != b && a != c && a != d && b != c && b != d && c != d {
            all[n] = code as u8;
            n += 1;
        }
        code += 1;
    }
    all
};

/// A number of `bits` bits with its base-4 digits permuted, from the highest on. Each permutation depends on the digits
/// above. An odd number of bits leaves one bit at the end, which is flipped or kept.
#[inline]
fn permuted(number: u32, bits: u32, key: u64) -> u32 {
    let (mut state, mut result) = (key, 0);
    let mut shift = bits;
    while shift >= 2 {
        shift -= 2;
        let digit = number >> shift & 3;
        let permutation = PERMUTATIONS[(((state >> 32) * 24) >> 32) as usize];
        result |= (u32::from(permutation) >> (2 * digit) & 3) << shift;
        state = next_state(state, u64::from(digit));
    }
    if shift == 1 { result | (number & 1) ^ (state >> 63) as u32 } else { result }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sobol;
    use crate::keys::mix64;

    #[test]
    fn permuted_numbers_keep_aligned_blocks() {
        for (bits, key) in [(32, 1), (31, 2), (8, 3), (5, 4), (1, 5), (0, 6)].map(|(bits, k)| (bits, mix64(k))) {
            // The lowest of an odd number of bits is a digit by itself.
            let n = 1_u32 << bits.min(10 - bits % 2);
            let mut seen = vec![false; n as usize];
            let home = permuted(0, bits, key) / n;
            for i in 0..n {
                let to = permuted(i, bits, key);
                assert_eq!(to / n, home, "{bits} bits");
                assert!(!std::mem::replace(&mut seen[(to % n) as usize], true), "{bits} bits: {to} twice");
            }
        }
    }

    /// All 24 orders of a digit occur equally often. Chi-square with 23 degrees of freedom over 24,000 fixed keys; 64 is
    /// exceeded with probability 1e-5. Orders that keep pairs together, as a base-2 scramble makes, are 8 of them.
    #[test]
    fn all_orders_of_a_digit_occur_equally_often() {
        let mut counts = std::collections::BTreeMap::new();
        for key in (0..24_000).map(mix64) {
            *counts.entry([0, 1, 2, 3].map(|d| permuted(d, 2, key))).or_insert(0_u32) += 1;
        }
        let chi2: f64 = counts.values().map(|c| (f64::from(*c) - 1000.0).powi(2) / 1000.0).sum();
        assert!(counts.len() == 24 && chi2 < 64.0, "{} orders, chi2 {chi2:.1}", counts.len());
    }

    /// Returns true if the points have one in each elementary interval of every shape.
    fn is_net(points: &[[f32; 2]]) -> bool {
        let m = points.len().trailing_zeros();
        (0..=m).all(|a| {
            let (wide, high) = ((1_u32 << a) as f32, (1_u32 << (m - a)) as f32);
            let mut seen = vec![false; points.len()];
            let cells = points.iter().map(|[x, y]| (x * wide) as usize * (1 << (m - a)) + (y * high) as usize);
            cells.into_iter().all(|cell| !std::mem::replace(&mut seen[cell], true))
        })
    }

    fn block_of(points: &dyn PointSet, corner: [u32; 2], side: u32, spp: u64, first: usize) -> Vec<[f32; 2]> {
        let places = (0..side * side).flat_map(|p| (0..spp).map(move |i| (p, i)));
        let sample = |(p, i): (u32, u64)| {
            let u = points.block(SampleId::new([corner[0] + p % side, corner[1] + p / side], 0, i), 3);
            [u[first], u[first + 1]]
        };
        places.map(sample).collect()
    }

    #[test]
    fn aligned_blocks_of_pixels_are_nets() {
        for (count, side) in [(1, 1), (1, 2), (1, 16), (2, 8), (8, 4), (16, 4), (64, 1)] {
            for corner in [[0, 0], [48, 16], [32_768, 65_520]] {
                for first in [0, 2] {
                    let net = |points: &dyn PointSet| is_net(&block_of(points, corner, side, count, first));
                    let what = format!("{count} samples, {side}x{side} pixels at {corner:?}");
                    assert!(net(&ZSobol::new(5, count as u32).unwrap()), "{what}");
                    // Negative control: pixels with sequences of their own.
                    assert!(side < 4 || !net(&Sobol::new(5)), "{what}: the control is a net too");
                }
            }
        }
    }

    /// The mean over 8x8 pixels of one sample each has far less error than 64 independent pixels have.
    #[test]
    fn blocks_of_pixels_converge_like_one_sequence() {
        let rms = |points: &dyn PointSet| {
            let error = |b: u32| {
                let block = block_of(points, [b % 16 * 8, b / 16 * 8], 8, 1, 0);
                block.iter().map(|[x, y]| f64::from(x * y)).sum::<f64>() / 64.0 - 0.25
            };
            ((0..256).map(|b| error(b).powi(2)).sum::<f64>() / 256.0).sqrt()
        };
        let (z, padded) = (rms(&ZSobol::new(2, 1).unwrap()), rms(&Sobol::new(2)));
        assert!(padded > 5.0 * z, "{z:.5} against {padded:.5}");
    }
}
