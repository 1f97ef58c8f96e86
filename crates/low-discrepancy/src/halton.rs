//! Owen-scrambled Halton points.

use crate::keys::{Seed, halves, next_state, nth_key, unit};
use crate::sobol::owen_reversed;
use dapple_core::{PointSet, SampleId};

/// The Halton sequence [after Halton 1960] with nested (Owen) scrambling in every base, per pixel and pair.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Halton;
///
/// let points = Halton::new(7);
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// assert_eq!(points.preferred_count(7), 12);
/// ```
///
/// # Bases
///
/// * Block 0 has bases 2 and 3 in its first pair and 5 and 7 in its second.
/// * All later pairs have bases 2 and 3 again. A nested scramble in base 6 shuffles the indices of each pair.
///
/// Larger primes are not used: a pair of bases `p` and `q` is no better than random for fewer than `p q` samples, which is 667
/// for 23 and 29.
///
/// # Stratification
///
/// Among any `2^a 3^b` consecutive samples, the first pair has exactly one point in each of the `2^a x 3^b` boxes. Among any
/// `5^a 7^b` consecutive samples, the second pair has exactly one point in each of the `5^a x 7^b` boxes. In a later pair, any
/// `6^k` samples whose first index is a multiple of `6^k` have one point in each of the `2^k x 3^k` boxes. Every prefix is
/// usable; [`PointSet::preferred_count`] returns the best sample counts.
///
/// # Limits
///
/// * It is slower than [`Sobol`](crate::Sobol), whose nets are finer for the same number of samples.
/// * Powers of two are not its best sample counts.
/// * Box edges in bases 3, 5 and 7 are not `f32` numbers. A point within 2^-24 below an edge may be rounded into the
///   next box.
///
/// Name: `halton`. Parameters: `seed`.
#[derive(Clone, Copy, Debug)]
pub struct Halton {
    seed: Seed,
}

impl Halton {
    /// Makes the scrambled Halton sequence of a seed.
    pub const fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed) }
    }
}

impl PointSet for Halton {
    fn describe(&self) -> String {
        format!("halton:seed={}", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let key = self.seed.key(&id, block, id.index >> 32);
        let index = id.index as u32;
        if block == 0 {
            let [x, y] = pair23(u64::from(index), nth_key(key, 0));
            let five = nested::<5, 14>(u64::from(index), nth_key(key, 1));
            let seven = nested::<7, 12>(u64::from(index), nth_key(key, 2));
            return [x, y, unit(five), unit(seven)];
        }
        let [a, b] = pair23(shuffled(index, nth_key(key, 0)), nth_key(key, 1));
        let [c, d] = pair23(shuffled(index, nth_key(key, 2)), nth_key(key, 3));
        [a, b, c, d]
    }

    /// Returns `2^32`, the number of samples after which a newly scrambled sequence begins. Up to this number, the exact points
    /// of a pair are distinct: no two are in the same `2^32 x 3^21` box.
    fn capacity(&self) -> u64 {
        1 << 32
    }

    /// Returns the smallest `m 6^k` of at least `n`, with `m` from 1 to 6: 1, 2, …, 6, 12, 18, 24, 30, 36, 72, … With these
    /// sample counts, the first pair and the shuffled pairs have equally many points in each box of `2^k x 3^k`.
    fn preferred_count(&self, n: u64) -> u64 {
        let mut step = 1_u64;
        while step <= u64::MAX / 36 && n > 6 * step {
            step *= 6;
        }
        n.max(1).checked_next_multiple_of(step).unwrap_or(n)
    }
}

/// Returns the scrambled 2-D point with this index, in bases 2 and 3.
#[inline]
fn pair23(index: u64, key: u64) -> [f32; 2] {
    let [base2, _] = halves(key);
    // The digits of the van der Corput number, reversed, are the index. An f32 cannot hold more than 32 of them.
    let x = owen_reversed(index as u32, base2).reverse_bits();
    [unit(x), unit(nested::<3, 21>(index, nth_key(key, 0)))]
}

/// Returns the scrambled radical inverse of `index` in base `BASE`, in units of 2^-32, rounded down. A random affine map
/// permutes each digit; the map depends on all preceding digits.
///
/// Affine maps `a d + c` with `a` not 0 permute the digits if the base is prime. Over all such maps, two different digits are
/// mapped to every pair of different digits equally often. Owen's variance depends only on pairs of digits, so it is the same
/// as with all permutations [after Matousek 1998].
///
/// The number of digits, `DIGITS`, suffices for an index below 2^32 and for the 24 bits of an `f32`.
#[inline]
fn nested<const BASE: u64, const DIGITS: u32>(mut index: u64, key: u64) -> u32 {
    let mut state = key;
    let mut fraction = 0_u64;
    for _ in 0..DIGITS {
        let digit = index % BASE;
        index /= BASE;
        // Two random numbers below 2^32. The high bits of the state are the most random.
        let factor = 1 + below(state >> 32, BASE - 1);
        let shift = below(state & 0xffff_ffff, BASE);
        fraction = fraction * BASE + (digit * factor + shift) % BASE;
        state = next_state(state, digit);
    }
    // BASE^DIGITS is below 2^34, so 30 bits of quotient fit; an f32 holds 24 of them.
    (((fraction << 30) / BASE.pow(DIGITS)) as u32) << 2
}

/// Scrambles an index in base 6 by a nested scramble. In each block of `6^(k + 1)` indices, it permutes the three thirds, and
/// the two halves of each third. Aligned blocks therefore stay aligned.
///
/// It changes the lowest 12 digits. The blocks of 6^12 = 2.2e9 indices are not permuted.
#[inline]
fn shuffled(index: u32, key: u64) -> u64 {
    const TOP: u32 = 6_u32.pow(12);
    let mut state = next_state(key, u64::from(index / TOP));
    let mut rest = u64::from(index % TOP);
    let mut place = u64::from(TOP / 6);
    let mut result = u64::from(index / TOP) * u64::from(TOP);
    while place > 0 {
        let digit = rest / place;
        rest %= place;
        let third = (digit / 2 * (1 + below(state >> 32, 2)) + below(state & 0xffff_ffff, 3)) % 3;
        let half = (digit ^ (state >> (7 + digit / 2))) & 1;
        result += place * (2 * third + half);
        state = next_state(state, digit);
        place /= 6;
    }
    result
}

/// Returns a number below `n` from 32 random bits, with a bias below `n / 2^32`.
#[inline(always)]
fn below(bits: u64, n: u64) -> u64 {
    (bits * n) >> 32
}
