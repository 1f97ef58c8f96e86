//! Progressive multi-jittered (0,2) points.

mod sequence;

use crate::BlueNoise;
use crate::keys::{Seed, halves, nth_key, unit};
use crate::sobol::owen_reversed;
use dapple_core::{PointSet, SampleId};
use sequence::{LENGTH, LOG2_LENGTH, SEQUENCES, sequences};

/// Progressive multi-jittered (0,2) sequences, with blue noise across pixels [after Christensen 2018].
///
/// Every `2^k` points of a sequence from a multiple of `2^k` on are a (0,k,2)-net. Sixteen sequences of 1024 points are
/// made once per process. Each new point goes into a free stratum of every elementary interval; of ten candidates
/// there, the one farthest from all earlier points is taken.
///
/// A sample's pairs take different sequences, as far as there are any. Each pair has a nested shuffle of its indices and
/// a random shift modulo 1 [Cranley 1976]. By default, all pixels of a tile share these, and [`BlueNoise`] adds each
/// pixel's own shift. pbrt-v4's `PMJ02BNSampler` does the same for all pairs but the position in the pixel.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Pmj02;
///
/// let points = Pmj02::new(7);
/// assert!(points.couples_pixels() && !points.with_independent_pixels().couples_pixels());
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Limits
///
/// * The shift breaks nets at the border of the square. [`Sobol`](crate::Sobol) keeps them, and has less error.
/// * After 1024 samples, a pair starts another sequence with its own shift.
/// * The tables take 128 KiB.
/// * The free strata leave the candidates one cell of `1/2n` by `1/2n` for the next `n` points, so candidates differ by
///   little. The published variant without elementary intervals (`pmjbn`) has a clearer blue-noise spectrum.
///
/// Name: `pmj02`. Parameters: `seed`, `pixels` (blue-noise or independent).
#[derive(Clone, Copy, Debug)]
pub struct Pmj02 {
    sequences: Sequences,
    coupled: Option<BlueNoise<Sequences>>,
}

impl Pmj02 {
    /// Makes the point set of a seed, with blue noise across pixels. The sequences themselves are the same for all seeds.
    pub fn new(seed: u64) -> Self {
        let sequences = Sequences { seed: Seed::new(seed) };
        Self { sequences, coupled: Some(BlueNoise::new(seed, sequences)) }
    }

    /// Gives each pixel its own sequences and shifts.
    #[must_use]
    pub fn with_independent_pixels(self) -> Self {
        Self { coupled: None, ..self }
    }
}

impl PointSet for Pmj02 {
    fn describe(&self) -> String {
        let pixels = if self.coupled.is_some() { "blue-noise" } else { "independent" };
        format!("pmj02:seed={},pixels={pixels}", self.sequences.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        match &self.coupled {
            Some(coupled) => coupled.block(id, block),
            None => self.sequences.block(id, block),
        }
    }

    fn capacity(&self) -> u64 {
        self.sequences.capacity()
    }

    fn preferred_count(&self, n: u64) -> u64 {
        self.sequences.preferred_count(n)
    }

    fn couples_pixels(&self) -> bool {
        self.coupled.is_some()
    }
}

/// The sequences, shuffled and shifted for each pixel.
#[derive(Clone, Copy, Debug)]
struct Sequences {
    seed: Seed,
}

/// Blocks whose pairs take different sequences.
const GROUP: u32 = SEQUENCES as u32 / 2;

impl PointSet for Sequences {
    fn describe(&self) -> String {
        format!("pmj02:seed={}", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let batch = id.index / LENGTH as u64;
        let within = (id.index % LENGTH as u64) as u32;
        // Numbers from the end of the range, so that no block has the same key.
        let group = self.seed.key(&id, !(block / GROUP), batch) as usize;
        let key = self.seed.key(&id, block, batch);
        let [shuffle0, shuffle1] = halves(key);
        let reversed = (within << (32 - LOG2_LENGTH)).reverse_bits();
        let pair = |number: u32, shuffle: u32, shift: u64| {
            let sequence = group.wrapping_add((2 * (block % GROUP) + number) as usize) % SEQUENCES;
            let index = owen_reversed(reversed, shuffle).reverse_bits() >> (32 - LOG2_LENGTH);
            let [x, y] = sequences()[sequence * LENGTH + index as usize];
            let [dx, dy] = halves(shift);
            [unit(x.wrapping_add(dx)), unit(y.wrapping_add(dy))]
        };
        let [a, b] = pair(0, shuffle0, nth_key(key, 0));
        let [c, d] = pair(1, shuffle1, nth_key(key, 1));
        [a, b, c, d]
    }

    /// Returns `u64::MAX`, since further samples start other sequences.
    fn capacity(&self) -> u64 {
        u64::MAX
    }

    /// Returns the next power of two from `n` on, or the next multiple of 1024.
    fn preferred_count(&self, n: u64) -> u64 {
        let n = n.max(1);
        if n <= LENGTH as u64 { n.next_power_of_two() } else { n.checked_next_multiple_of(LENGTH as u64).unwrap_or(n) }
    }
}
