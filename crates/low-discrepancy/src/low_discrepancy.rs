//! The (0,2)-sequence of pbrt's second edition.

use crate::Error;
use crate::keys::{Seed, halves, nth_key, permute, unit};
use crate::sobol::sobol1_reversed;
use dapple_core::{PointSet, SampleId};

/// The `lowdiscrepancy` sampler of pbrt's second edition, as in its source, after [Kollig 2002].
///
/// Its pairs are van der Corput's sequence and the second dimension of Sobol's.
/// Each is XOR-scrambled by a random number per pixel and pair, and shuffled independently for each pair.
///
/// Each `count` samples of a pair are a (0,k,2)-net. The count must be known beforehand and is rounded up to a power of
/// two, as in pbrt ([`LowDiscrepancy::count`]). Further samples begin another net with fresh scrambles.
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
/// * The first few of `count` samples are in random order, so a prefix is no better than independent numbers.
/// * Twice `count` samples are two independent nets, not one of twice the size.
/// * XOR scrambling keeps the regular structure of the net. Owen scrambling has a lower variance for smooth integrands.
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

    /// The number of samples in one net, a power of two.
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

    /// Returns `u64::MAX`, since each further net is scrambled anew.
    fn capacity(&self) -> u64 {
        u64::MAX
    }

    /// Returns the next multiple of [`LowDiscrepancy::count`] from `n` on.
    fn preferred_count(&self, n: u64) -> u64 {
        n.max(1).checked_next_multiple_of(u64::from(self.count())).unwrap_or(n)
    }
}
