//! The ladder: sample counts at which low-discrepancy points are well stratified.

use super::{Allocation, PixelDemand, Steps, share_out};
use crate::{Error, Needs};

/// The ladder: sample counts 1, 2, 3, 4, 6, 8, 12, 16, 24, …, at which low-discrepancy points are well distributed.
///
/// ```
/// use dapple_core::plan::Ladder;
///
/// assert_eq!(Ladder::Whole.next(8), 12);
/// assert_eq!(Ladder::Whole.floor(11), 8);
/// assert_eq!(Ladder::Halves.next(8), 12);
/// assert_eq!(Ladder::Halves.floor(11), 8);
/// assert_eq!((Ladder::Whole.next(4), Ladder::Halves.next(2)), (6, 4));
///
/// // Exactly 100 samples for three pixels, most of them where the score is largest.
/// let counts = Ladder::Whole.allocate(&[1.0, 4.0, 30.0], &[1; 3], u32::MAX, 100, 1.3)?.counts;
/// assert_eq!(counts.iter().sum::<u32>(), 100);
/// assert!(counts[0] < counts[1] && counts[1] < counts[2]);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ladder {
    /// The ladder for one sequence of points per pixel: 1, 2, 3, 4, 6, 8, …
    Whole,
    /// The ladder 2, 4, 6, 8, 12, 16, …, for films that split each pixel's samples into two halves ([`Needs::halves`]).
    Halves,
}

impl Ladder {
    /// The ladder for a film with these `needs`: [`Ladder::Halves`] with halves, else [`Ladder::Whole`].
    pub const fn of(needs: &Needs) -> Self {
        if needs.halves { Self::Halves } else { Self::Whole }
    }

    /// The smallest count on the ladder above `n`; `u32::MAX` if there is none.
    pub fn next(self, n: u32) -> u32 {
        self.rung_after(n).unwrap_or(u32::MAX)
    }

    /// The largest count on the ladder that is at most `n`; `n` if all counts on the ladder are larger.
    pub fn floor(self, n: u32) -> u32 {
        let mut rung = n.min(1);
        let mut next = self.next(0);
        while next <= n && next != u32::MAX {
            rung = next;
            next = self.next(next);
        }
        rung
    }

    /// Allocates samples to pixels as [`allocate`](super::allocate) does, but minimises `sum_p scores[p] * n_p^-exponent`
    /// with counts `n_p` on this ladder. The exponent is 1 for independent samples, and about 1.3 for low-discrepancy nets.
    ///
    /// Counts may leave the ladder in four cases:
    /// * a pixel's floor is off the ladder;
    /// * one pixel takes the remainder, so that the counts sum to `total`;
    /// * `total` is larger than the sum of the largest counts on the ladder up to `ceiling`;
    /// * all scores are equal: counts then differ by at most 1, or by as much as the floors require.
    ///
    /// # Errors
    ///
    /// [`Error::BudgetTooSmall`] if the floors alone exceed `total`;
    /// [`Error::OutOfRange`] if `exponent` is not in (0, 3].
    ///
    /// # Panics
    ///
    /// If `scores` and `floors` differ in length, or have more than 2^32 - 1 elements.
    pub fn allocate(
        self,
        scores: &[f64],
        floors: &[u32],
        ceiling: u32,
        total: u64,
        exponent: f64,
    ) -> Result<Allocation, Error> {
        if !(exponent > 0.0 && exponent <= 3.0) {
            return Err(Error::out_of_range("exponent", exponent, "above 0 and at most 3"));
        }
        let demand = PixelDemand::new(scores, floors, ceiling, total);
        share_out(&demand, self.floor(ceiling), &Rungs::new(exponent, self))
    }

    fn rung_after(self, n: u32) -> Option<u32> {
        let halves = self == Self::Halves;
        let half = if halves { n / 2 } else { n };
        let next = if half < 3 {
            half + 1
        } else {
            let power = 1u64 << half.ilog2();
            let rung = if u64::from(half) < power + power / 2 { power + power / 2 } else { 2 * power };
            u32::try_from(rung).ok()?
        };
        if halves { next.checked_mul(2) } else { Some(next) }
    }
}

/// The counts (rungs) of a ladder and the gains of its steps, for a pixel error `f(n) = n^-exponent`.
struct Rungs {
    rungs: Vec<u32>,
    /// For each rung, the error decrease per sample of the step that ends there. Descending.
    gains: Vec<f64>,
    /// For each bucket of thresholds (see [`bucket`]), the number of rungs whose error decrease per sample exceeds
    /// every threshold in the bucket.
    sure: Vec<u8>,
    exponent: f64,
}

/// The index of the bucket that holds a threshold. Each octave from 2^-256 to 2 has eight equal buckets. The first
/// bucket also holds all smaller thresholds; one more bucket holds all larger ones.
fn bucket(threshold: f64) -> usize {
    const LOWEST: u64 = (1023 - 256) << 3;
    const HIGHEST: u64 = 1024 << 3;
    ((threshold.to_bits() >> 49).clamp(LOWEST, HIGHEST) - LOWEST) as usize
}

impl Rungs {
    fn new(exponent: f64, ladder: Ladder) -> Self {
        let mut rungs = vec![];
        let mut n = 0;
        while let Some(next) = ladder.rung_after(n) {
            rungs.push(next);
            n = next;
        }
        let mut steps = Self { rungs, gains: vec![], sure: vec![], exponent };
        let below = std::iter::once(0).chain(steps.rungs.iter().copied());
        steps.gains = below.zip(&steps.rungs).map(|(n, &m)| steps.compute_gain(n, m)).collect();
        steps.sure = vec![0; bucket(f64::MAX) + 1];
        for gain in &steps.gains {
            // A gain above the whole bucket is reached by every threshold in it.
            steps.sure[..bucket(*gain)].iter_mut().for_each(|n| *n += 1);
        }
        steps
    }

    fn compute_gain(&self, n: u32, m: u32) -> f64 {
        if n == 0 {
            return f64::MAX;
        }
        (f64::from(n).powf(-self.exponent) - f64::from(m).powf(-self.exponent)) / (f64::from(m) - f64::from(n))
    }
}

impl Steps for Rungs {
    fn next(&self, n: u32) -> u32 {
        self.rungs.get(self.rungs.partition_point(|&r| r <= n)).copied().unwrap_or(u32::MAX)
    }

    fn reach(&self, threshold: f64) -> u32 {
        // The result of `partition_point`, in a step or two instead of six.
        let mut k = usize::from(self.sure[bucket(threshold)]);
        k += self.gains[k..].iter().take_while(|g| **g >= threshold).count();
        if k == 0 { 0 } else { self.rungs[k - 1] }
    }

    fn gain(&self, n: u32, m: u32) -> f64 {
        let k = self.rungs.partition_point(|&r| r <= n);
        let below = if k == 0 { 0 } else { self.rungs[k - 1] };
        // Two calls of `powf` per pixel would cost more than all the rest.
        match self.gains.get(k) {
            Some(&gain) if below == n && self.rungs[k] == m => gain,
            _ => self.compute_gain(n, m),
        }
    }
}
