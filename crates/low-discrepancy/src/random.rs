//! Independent uniform numbers, the baseline.

use crate::keys::{Seed, halves, mix64, unit};
use dapple_core::{PointSet, SampleId};

/// Independent uniform random numbers: plain Monte Carlo, the baseline of all other point sets.
///
/// The generator is PCG XSL 128/64 (MCG) [after O'Neill 2014], with the bits of `rand_pcg::Pcg64Mcg`. Its 128 bits of state are hashed from (seed, pixel, stream,
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
        let mut pcg = Pcg::new(u128::from(key) << 64 | u128::from(sample));
        let [a, b] = halves(pcg.next());
        let [c, d] = halves(pcg.next());
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

/// The generator PCG XSL 128/64 (MCG): a multiplicative congruential generator, whose output is folded and rotated
/// [after O'Neill 2014].
struct Pcg {
    state: u128,
}

impl Pcg {
    const MULTIPLIER: u128 = 0x2360_ED05_1FC6_5DA4_4385_DF64_9FCC_F645;

    /// The state must be odd.
    #[inline]
    const fn new(state: u128) -> Self {
        Self { state: state | 1 }
    }

    #[inline]
    const fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_mul(Self::MULTIPLIER);
        let folded = (self.state >> 64) as u64 ^ self.state as u64;
        folded.rotate_right((self.state >> 122) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::Pcg;
    use crate::keys::mix64;
    use rand::Rng;
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn the_generator_has_the_bits_of_rand_pcg() {
        for n in 0..1000_u64 {
            let state = u128::from(mix64(n)) << 64 | u128::from(mix64(!n));
            let (mut ours, mut theirs) = (Pcg::new(state), Pcg64Mcg::new(state));
            for _ in 0..4 {
                assert_eq!(ours.next(), theirs.next_u64(), "{n}");
            }
        }
    }
}
