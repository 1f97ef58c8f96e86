//! The data that a sampler reads and plans: budgets, finished rounds, and the division of samples over pixels.

pub use crate::allocate::{Allocation, Ladder, allocate, share};
pub use crate::memory::SamplerMemory;
pub use crate::sampler::{BudgetLeft, Feedback};

use serde::{Deserialize, Serialize};

/// The outcome of planning a round. Exhaustive, so a `match` needs no wildcard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The plan holds a round to trace.
    Trace,
    /// The sampler needs no more samples within this budget; the plan is ignored.
    Done,
}

/// The use of a round's samples: in the image, or only as information for the sampler.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Retention {
    /// The samples stay in the image. If they also decide later counts, the image is biased [Kirk and Arvo 1991].
    #[default]
    Keep,
    /// The samples only inform the sampler and do not enter the image: unbiased, but the round's samples are lost to the image.
    Discard,
}

/// The rule that combines the means of the two halves of a pixel's samples.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Combine {
    /// The mean of the two halves, weighted by their sample counts.
    #[default]
    ByCount,
    /// The plain average of the two halves, whatever their counts. Required for an unbiased image if each half decides
    /// the counts of the other.
    Equally,
    /// A fixed weight of the first half, in `[0, 1]`; the second half gets the rest.
    Fixed(f64),
}

/// The plan of one round: additional samples per pixel, and their use in the image.
///
/// ```
/// use dapple_core::plan::{Plan, Retention};
///
/// // Two more samples for each of six pixels, four for the last.
/// let mut plan = Plan::empty(6);
/// plan.counts.fill(2);
/// plan.counts[5] = 4;
/// plan.retention = Retention::Keep;
/// assert_eq!(plan.total(), 14);
/// ```
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Additional samples per pixel, row by row over the frame's window. All are zero when
    /// [`Sampler::next_round`](crate::Sampler::next_round) gets the plan.
    pub counts: Vec<u32>,
    /// Additional samples per pixel for the second half, in films with halves; `counts` is then for the first half only.
    /// With `None`, samples alternate between the halves.
    pub second_half: Option<Vec<u32>>,
    /// The use of the round's samples: in the image, or only as information for the sampler.
    pub retention: Retention,
    /// The rule that combines the means of a pixel's two halves from this round on.
    pub combine: Combine,
    /// Marks the pixels whose kept samples become discarded samples before the round is traced. These samples stay spent, and
    /// new samples continue their indices. A marked pixel must have no discarded samples yet, and must get new, kept samples
    /// in this round. Marks that depend on the samples' own values still bias the image [Kirk and Arvo 1991].
    #[serde(skip)]
    pub withdraw: Option<Vec<bool>>,
}

impl Plan {
    /// A plan with a count of 0 for each of `pixels` pixels, retention [`Retention::Keep`], and halves combined by
    /// count.
    pub fn empty(pixels: usize) -> Self {
        Self {
            counts: vec![0; pixels],
            second_half: None,
            retention: Retention::Keep,
            combine: Combine::ByCount,
            withdraw: None,
        }
    }

    /// The number of planned samples, summed over pixels and halves.
    pub fn total(&self) -> u64 {
        self.halves().flatten().map(|&n| u64::from(n)).sum()
    }

    /// The counts of all samples, or of each half.
    pub(crate) fn halves(&self) -> impl Iterator<Item = &[u32]> {
        [Some(&self.counts[..]), self.second_half.as_deref()].into_iter().flatten()
    }

    /// The counts of [`Plan::halves`], mutable.
    pub(crate) fn halves_mut(&mut self) -> impl Iterator<Item = &mut Vec<u32>> {
        [Some(&mut self.counts), self.second_half.as_mut()].into_iter().flatten()
    }

    /// A copy of the plan with the counts `of(counts)` and without withdrawals.
    pub(crate) fn with_counts(&self, of: impl Fn(&[u32]) -> Vec<u32>) -> Self {
        let second_half = self.second_half.as_deref().map(&of);
        Self { counts: of(&self.counts), second_half, withdraw: None, ..*self }
    }
}

/// The treatment of pilot samples, from which a sampler computes counts. It determines the image's bias.
///
/// A sampler accepts the policies that its documentation names, and refuses the others with
/// [`Error::OutOfRange`](crate::Error::OutOfRange).
///
/// The formulas below give the expected value of a pixel whose samples are 1 with probability `p`, else 0. The pixel
/// has two pilot samples, and is refined if the two differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PilotPolicy {
    /// The pilot samples stay in the image: least noise. Biased, because kept samples decide how many follow [Kirk and
    /// Arvo 1991]. With `k` additional samples the expected value (see [`PilotPolicy`]) is `p^2 + 2 p (1 - p) (1 + k p)
    /// / (2 + k)`. The bias falls with the pilot's size. Decisions pooled over 5x5 pixels reduce it to 1/25.
    #[default]
    Keep,
    /// Pilot samples of refined pixels are discarded; those of other pixels stay in the image, as in pbrt-v2. More
    /// biased than [`PilotPolicy::Keep`]: the expected value (see [`PilotPolicy`]) is `3 p^2 - 2 p^3`, for any number
    /// of additional samples.
    Refined,
    /// All pilot samples are discarded, so they are lost to the image. Exactly unbiased if the budget is known at the
    /// start.
    Discard,
    /// Each pixel's samples are split into two halves. Each half decides the sample counts of the other half, and the
    /// means of the halves are averaged with equal weights. Exactly unbiased if the budget is known at the start, but
    /// two half-length sequences have more error than one. If the budget is raised later, a half's earlier samples
    /// influence its later counts through the other half.
    Cross,
    /// All samples stay in the image, and a pixel's count depends on the samples of its neighbours only.
    ///
    /// Pixels are coloured like a chessboard. The first round after the pilot reads the pixels of the other colour, the second
    /// round those of the pixel's own colour. So a pixel's samples do not influence its own count, not even indirectly. A bias
    /// of the order of 1 over the number of pixels remains, since all counts depend on the sum of all scores.
    Neighbours,
}

/// The stopping rule of samplers that compare an error estimate with a threshold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stopping {
    /// Stop when the budget is spent exactly; the threshold only ranks pixels.
    #[default]
    Budget,
    /// Stop when all error estimates are below the threshold. The budget is an upper bound; the film's record has the
    /// number of samples spent.
    Threshold,
}

/// Converts `n` to 32 bits. Larger numbers become `u32::MAX`.
#[inline]
pub fn saturating_u32(n: u64) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
