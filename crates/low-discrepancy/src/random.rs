//! Independent uniform numbers, the baseline.

use crate::keys::{Seed, halves, mix64, unit};
use dapple_core::{PointSet, SampleId};
use rand::Rng;
use rand_pcg::Pcg64Mcg;

/// Independent uniform random numbers: plain Monte Carlo, the baseline of all other point sets.
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
        // Rotated, so that the two halves of the state never meet as equal numbers.
        let sample = mix64(id.index ^ key.rotate_left(32));
        let mut pcg = Pcg64Mcg::new(u128::from(key) << 64 | u128::from(sample));
        let [a, b] = halves(pcg.next_u64());
        let [c, d] = halves(pcg.next_u64());
        [unit(a), unit(b), unit(c), unit(d)]
    }

    /// Returns `u64::MAX`, since samples repeat only by chance.
    fn capacity(&self) -> u64 {
        u64::MAX
    }

    fn is_independent(&self) -> bool {
        true
    }
}
