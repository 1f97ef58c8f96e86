//! Rank-1 lattices.

use crate::keys::{Seed, halves, nth_key, unit};
use crate::sobol::owen_reversed;
use dapple_core::{PointSet, SampleId};

/// The second component of the generating vector `(1, MULTIPLIER)`.
const MULTIPLIER: u32 = 1_063_578_985;

/// An extensible rank-1 lattice of Korobov type with random shifts, for each pair of coordinates [after Korobov 1959;
/// extensible as in Hickernell 2000].
///
/// Point `i` is `phi(i) (1, a)` modulo 1, with van der Corput's sequence `phi` in base 2. Any `2^m` points whose first index
/// is a multiple of `2^m` form a complete shifted lattice. Each pair has its own random shift [Cranley 1976] and a nested
/// shuffle of its indices.
///
/// # The multiplier
///
/// `a = 1,063,578,985` was found by a beam search over its bits, lowest first. The search is not from a publication.
///
/// * Bits 0 to 17: the criterion is `P_2`, the squared worst-case error on periodic functions whose Fourier coefficients fall
///   as `1 / (h k)`. For each size from `2^4` to `2^18` points, `P_2` is divided by the value of the best multiplier for the
///   size. The search minimises the largest of these ratios, which is 2.17.
/// * Bits 18 to 31: the criterion is the squared minimum distance on the torus, divided by the value of the hexagonal lattice
///   of equal density. From `2^19` to `2^32` points, the ratio is at least 0.54.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Lattice;
///
/// let points = Lattice::new(7);
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Limits
///
/// * Lattices are best for periodic functions. They alias on edges along a lattice's directions.
/// * For functions that are not periodic, such as `x y`, the error of `n = 2^k` samples falls as `1/n`, not faster.
/// * The relation between two pairs is random, as in [`Sobol`](crate::Sobol).
///
/// Name: `lattice`. Parameters: `seed`.
#[derive(Clone, Copy, Debug)]
pub struct Lattice {
    seed: Seed,
}

impl Lattice {
    /// Makes the shifted lattice of a seed.
    pub const fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed) }
    }
}

impl PointSet for Lattice {
    fn describe(&self) -> String {
        format!("lattice:seed={}", self.seed.given())
    }

    #[inline]
    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let key = self.seed.key(&id, block, id.index >> 32);
        let reversed = (id.index as u32).reverse_bits();
        let [shuffle0, shuffle1] = halves(key);
        let pair = |shuffle: u32, shift: u64| {
            let [x, y] = halves(shift);
            let [u, v] = lattice_point(owen_reversed(reversed, shuffle));
            [unit(u.wrapping_add(x)), unit(v.wrapping_add(y))]
        };
        let [a, b] = pair(shuffle0, nth_key(key, 0));
        let [c, d] = pair(shuffle1, nth_key(key, 1));
        [a, b, c, d]
    }

    /// Returns `2^32`. Later samples come from a newly shifted lattice.
    fn capacity(&self) -> u64 {
        1 << 32
    }

    /// Returns the smallest power of two of at least `n`.
    fn preferred_count(&self, n: u64) -> u64 {
        n.max(1).checked_next_power_of_two().unwrap_or(n)
    }
}

/// Returns the unshifted point with this first coordinate, in units of 2^-32.
#[inline(always)]
const fn lattice_point(x: u32) -> [u32; 2] {
    [x, x.wrapping_mul(MULTIPLIER)]
}
