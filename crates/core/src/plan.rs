//! The samples of one round, as a sampler plans them.

/// The outcome of planning. There are no others, so a `match` needs no wildcard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The plan is filled in: trace it.
    Trace,
    /// No more samples within this budget; the plan is ignored.
    Done,
}

/// The retention of a round's samples: in the image, or for information only.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Retention {
    /// They stay in the image. If they also decide later counts, the image is biased [Kirk and Arvo 1991].
    #[default]
    Keep,
    /// They only inform the sampler: unbiased, at the price of the round.
    Discard,
}

/// The rule by which the means of two halves become one.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Combine {
    /// Weighted by sample counts.
    #[default]
    ByCount,
    /// The plain average, whatever the counts. Counts that each half decides for the other need it to stay unbiased.
    Equally,
    /// This weight, in `[0, 1]`, for the first half, the rest for the second.
    Fixed(f64),
}

/// One round: additional samples per pixel, and their retention.
///
/// ```
/// use dapple_core::{Plan, Retention};
///
/// // Two more samples for each of six pixels, four for the last.
/// let mut plan = Plan::empty(6);
/// plan.counts.fill(2);
/// plan.counts[5] = 4;
/// plan.retention = Retention::Keep;
/// assert_eq!(plan.total(), 14);
/// ```
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Additional samples per pixel, row by row over the frame's window. All are zero when
    /// [`Sampler::next_round`](crate::Sampler::next_round) gets the plan.
    pub counts: Vec<u32>,
    /// Additional samples per pixel of the second half; `counts` then holds those of the first. With `None`, samples
    /// alternate between the halves. Only in renders with halves.
    pub second_half: Option<Vec<u32>>,
    /// The retention of the samples.
    pub retention: Retention,
    /// The rule that combines the halves from this round on.
    pub combine: Combine,
    /// A mark per pixel whose kept samples leave the image before the round is traced. They join the discarded ones and
    /// stay spent. Such a pixel must get samples in this round, which must be kept. Their indices continue after those
    /// of the withdrawn. Withdrawing by the samples' own values is biased all the same [Kirk and Arvo 1991].
    pub withdraw: Option<Vec<bool>>,
}

impl Plan {
    /// A plan of zero samples for each of this many pixels, kept, with halves combined by count.
    pub fn empty(pixels: usize) -> Self {
        Self {
            counts: vec![0; pixels],
            second_half: None,
            retention: Retention::Keep,
            combine: Combine::ByCount,
            withdraw: None,
        }
    }

    /// The number of samples in all.
    pub fn total(&self) -> u64 {
        let sum = |c: &[u32]| c.iter().map(|&n| u64::from(n)).sum::<u64>();
        sum(&self.counts) + self.second_half.as_deref().map_or(0, sum)
    }
}
