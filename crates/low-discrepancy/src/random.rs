//! Independent uniform numbers, the baseline, and jittered grids.

use crate::Error;
use crate::keys::{Seed, halves, mix64, nth_key, permute, unit};
use dapple_core::{PointSet, SampleId};
use rand::Rng;
use rand_pcg::Pcg64Mcg;

/// Independent uniform random numbers: plain Monte Carlo, the baseline for all other point sets.
///
/// The generator is [`Pcg64Mcg`] [after O'Neill 2014]. Its 128 bits of state are hashed from (seed, pixel, stream,
/// index, block), so any sample can be computed alone.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Random;
///
/// let points = Random::new(7);
/// let id = SampleId::new([3, 4], 0, 5);
/// assert_eq!(points.block(id, 0), Random::new(7).block(id, 0));
/// assert_ne!(points.block(id, 0), Random::new(8).block(id, 0));
/// ```
///
/// Limit: the variance of `n` samples falls as `1 / n`, never faster.
///
/// Name: `random`. Parameters: `seed`.
#[derive(Clone, Copy, Debug)]
pub struct Random {
    seed: Seed,
}

impl Random {
    /// Makes the point set of independent random numbers for a seed.
    pub const fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed) }
    }
}

impl PointSet for Random {
    fn describe(&self) -> String {
        format!("random:seed={}", self.seed.given())
    }

    #[inline]
    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let key = self.seed.key(&id, block, 0);
        // Rotated, so that the lower half of the state is not a hash of the upper half.
        let sample = mix64(id.index ^ key.rotate_left(32));
        let mut pcg = Pcg64Mcg::new(u128::from(key) << 64 | u128::from(sample));
        let [a, b] = halves(pcg.next_u64());
        let [c, d] = halves(pcg.next_u64());
        [unit(a), unit(b), unit(c), unit(d)]
    }

    fn is_independent(&self) -> bool {
        true
    }
}

/// Jittered sampling: each 2-D pair has one random point in every cell of a `strata x strata` grid [after Cook 1986].
/// Each pair visits the cells in its own random order.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Stratified;
///
/// let points = Stratified::new(7, 8)?;
/// assert_eq!((points.cells(), points.preferred_count(65)), (64, 128));
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// # Ok::<(), dapple_low_discrepancy::Error>(())
/// ```
///
/// # Limits
///
/// * The sample count must be known in advance. A partly used grid is a random subset of its cells, hardly better than
///   [`Random`] if the subset is small.
/// * Projections on one axis have only `strata` strata.
/// * Samples beyond `strata²` start another grid with its own order and jitter. Multiples of `strata²` samples are stratified,
///   but no more finely.
///
/// Name: `stratified`. Parameters: `seed`, `strata` (along each axis).
#[derive(Clone, Copy, Debug)]
pub struct Stratified {
    seed: Seed,
    strata: u32,
}

impl Stratified {
    /// The largest number of strata per axis. Even then, each cell has 2^12 x 2^12 different points.
    pub const MAX_STRATA: u32 = 1 << 12;

    /// Makes the point set with grids of `strata x strata` cells.
    ///
    /// # Errors
    ///
    /// [`Error::BadStrata`] unless `1 <= strata <= MAX_STRATA`.
    pub const fn new(seed: u64, strata: u32) -> Result<Self, Error> {
        if strata == 0 || strata > Self::MAX_STRATA {
            return Err(Error::BadStrata { strata });
        }
        Ok(Self { seed: Seed::new(seed), strata })
    }

    /// The number of samples in one grid: `strata²`.
    pub const fn cells(&self) -> u32 {
        self.strata * self.strata
    }

    /// Returns the point in `[0, 1)^2` that the random bits `jitter` select in cell `cell`.
    #[inline]
    fn point(&self, cell: u32, jitter: u64) -> [f32; 2] {
        let [jx, jy] = halves(jitter);
        let column = cell % self.strata;
        let row = cell / self.strata;
        [unit(in_stratum(column, self.strata, jx)), unit(in_stratum(row, self.strata, jy))]
    }
}

/// Returns the coordinate that `jitter` selects in stratum `k` of `n`, in units of 2^-32, with 24 significant bits. Integer
/// arithmetic prevents points from being rounded into the next cell.
#[inline]
fn in_stratum(k: u32, n: u32, jitter: u32) -> u32 {
    let start = (u64::from(k) << 24).div_ceil(u64::from(n));
    let end = (u64::from(k + 1) << 24).div_ceil(u64::from(n));
    let offset = (u64::from(jitter) * (end - start)) >> 32;
    ((start + offset) as u32) << 8
}

impl PointSet for Stratified {
    fn describe(&self) -> String {
        format!("stratified:seed={},strata={}", self.seed.given(), self.strata)
    }

    #[inline]
    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let cells = u64::from(self.cells());
        let (grid, within) = (id.index / cells, (id.index % cells) as u32);
        let key = self.seed.key(&id, block, grid);
        let order = [nth_key(key, 0), nth_key(key, 1)];
        // Each sample has its own jitter, so its index in the grid is hashed with the key.
        let jitter = nth_key(key, 2);
        let jitter = [nth_key(jitter, 2 * u64::from(within)), nth_key(jitter, 2 * u64::from(within) + 1)];
        let [a, b] = self.point(permute(within, self.cells(), order[0]), jitter[0]);
        let [c, d] = self.point(permute(within, self.cells(), order[1]), jitter[1]);
        [a, b, c, d]
    }

    /// Returns the smallest multiple of `strata²` of at least `n`.
    fn preferred_count(&self, n: u64) -> u64 {
        n.max(1).checked_next_multiple_of(u64::from(self.cells())).unwrap_or(n)
    }
}
