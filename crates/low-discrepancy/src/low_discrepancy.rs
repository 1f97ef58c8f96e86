//! Nets of a fixed size: the (0,2)-sequence of pbrt's second edition, and a Sobol' sequence assigned to pixels along a Morton
//! curve.

use crate::Error;
use crate::keys::{Seed, halves, next_state, nth_key, permute, unit};
use crate::sobol::{owen_reversed, pack, sobol1_reversed};
use dapple_core::{PointSet, SampleId};

/// The `lowdiscrepancy` sampler of pbrt's second edition, implemented like its source, after [Kollig 2002].
///
/// The coordinates of a pair are van der Corput's sequence and the second dimension of Sobol's. Each coordinate is
/// XOR-scrambled by a random number per pixel and pair, and each pair is shuffled independently.
///
/// The first `count = 2^k` samples of a pair are a (0,k,2)-net. The sample count must be known in advance and is rounded up
/// to a power of two, as in pbrt ([`LowDiscrepancy::count`]). Further samples start another net with new scrambles.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::LowDiscrepancy;
///
/// let points = LowDiscrepancy::new(7, 33)?;
/// assert_eq!(points.count(), 64);
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// # Ok::<(), dapple_low_discrepancy::Error>(())
/// ```
///
/// # Limits
///
/// [`Sobol`](crate::Sobol) has none of these:
///
/// * The samples of a net are in random order, so fewer than `count` samples are no better than independent numbers.
/// * Twice `count` samples are two independent nets, not one net of twice the size.
/// * XOR scrambling preserves the regular structure of the net. Owen scrambling has a lower variance for smooth integrands.
///
/// Name: `lowdiscrepancy`. Parameters: `seed`, `count`.
#[derive(Clone, Copy, Debug)]
pub struct LowDiscrepancy {
    seed: Seed,
    log2_count: u32,
}

impl LowDiscrepancy {
    /// The size of the largest net: an `f32` cannot distinguish more points along one axis.
    pub const MAX_COUNT: u32 = 1 << 24;

    /// Makes the point set with nets of `count` samples, rounded up to a power of two.
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

    /// The number of samples per net, a power of two.
    pub const fn count(&self) -> u32 {
        1 << self.log2_count
    }
}

impl PointSet for LowDiscrepancy {
    fn describe(&self) -> String {
        format!("lowdiscrepancy:seed={},count={}", self.seed.given(), self.count())
    }

    #[inline]
    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let within = id.index as u32 & (self.count() - 1);
        let key = self.seed.key(&id, block, id.index >> self.log2_count);
        let pair = |order: u64, scramble: u64| {
            let index = permute(within, self.count(), order);
            let [sx, sy] = halves(scramble);
            let x = index.reverse_bits() ^ sx;
            let y = (sobol1_reversed(u64::from(index)) as u32).reverse_bits() ^ sy;
            [unit(x), unit(y)]
        };
        let [a, b] = pair(nth_key(key, 0), nth_key(key, 1));
        let [c, d] = pair(nth_key(key, 2), nth_key(key, 3));
        [a, b, c, d]
    }

    /// Returns the smallest multiple of [`LowDiscrepancy::count`] of at least `n`.
    fn preferred_count(&self, n: u64) -> u64 {
        n.max(1).checked_next_multiple_of(u64::from(self.count())).unwrap_or(n)
    }
}

/// One Sobol' sequence for the whole image, assigned to pixels along a randomised Morton curve [after Ahmed 2020].
///
/// Pixels are numbered along a Morton (Z) curve, and each uses `count` consecutive points of one Owen-scrambled sequence. Each
/// base-4 digit of the pixel's number is mapped by one of 24 permutations, selected at random depending on the higher digits.
/// pbrt-v4's `ZSobolSampler` does the same.
///
/// * The `count = 2^k` samples of a pixel are a (0,k,2)-net in each pair.
/// * The samples of each aligned block of 2x2, 4x4, … pixels together are a net, too. Errors of neighbours therefore partly
///   cancel, and noise has less energy at low frequencies.
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
/// * The sample count must be known in advance; it is rounded up to a power of two. With fewer samples, the errors over the
///   image are white noise. Further samples start a new sequence.
/// * The sequence has 2^32 points. Larger images are divided into tiles with separate sequences. A tile has `2^t x 2^t` pixels
///   with `t = floor((32 - log2(count)) / 2)`, which is 16384 x 16384 at 16 samples.
/// * With adaptive sample counts, the nets of blocks are incomplete.
///
/// Name: `zsobol`. Parameters: `seed`, `count`.
#[derive(Clone, Copy, Debug)]
pub struct ZSobol {
    seed: Seed,
    log2_count: u32,
}

impl ZSobol {
    /// The largest number of samples per pixel in one sequence.
    pub const MAX_COUNT: u32 = LowDiscrepancy::MAX_COUNT;

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

    /// The number of samples per pixel in one sequence, a power of two.
    pub const fn count(&self) -> u32 {
        1 << self.log2_count
    }

    /// Returns the binary logarithm of a tile's side in pixels.
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

    /// Returns the smallest multiple of [`ZSobol::count`] of at least `n`.
    fn preferred_count(&self, n: u64) -> u64 {
        n.max(1).checked_next_multiple_of(u64::from(self.count())).unwrap_or(n)
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// Returns the low 16 bits of a number, moved to the even bits.
#[inline(always)]
const fn spread(x: u32) -> u32 {
    let mut x = x & 0xffff;
    x = (x | x << 8) & 0x00ff_00ff;
    x = (x | x << 4) & 0x0f0f_0f0f;
    x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}

/// The 24 permutations of four digits, each as four pairs of bits, starting with the lowest bits.
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

/// Returns a number of `bits` bits with its base-4 digits permuted, from the highest to the lowest. Each permutation depends
/// on the higher digits. If the number of bits is odd, the lowest bit is randomly flipped.
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
