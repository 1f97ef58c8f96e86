//! The samples of one round, as a sampler plans them.

/// The outcome of planning a round. Exhaustive, so a `match` needs no wildcard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The plan holds a round to trace.
    Trace,
    /// The sampler wants no more samples within this budget; the plan is ignored.
    Done,
}

/// The use of a round's samples: in the image, or only as information for the sampler.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Retention {
    /// The samples stay in the image. If they also decide later counts, the image is biased [Kirk and Arvo 1991].
    #[default]
    Keep,
    /// The samples only inform the sampler and do not enter the image: unbiased, but the round's samples are lost to
    /// it.
    Discard,
}

/// The rule that combines the means of the two halves of a pixel's samples.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
    /// Additional samples per pixel for the second half; `counts` then holds those of the first half. With `None`,
    /// samples alternate between the halves. Allowed only in films with halves.
    pub second_half: Option<Vec<u32>>,
    /// The use of the round's samples: in the image, or only as information for the sampler.
    pub retention: Retention,
    /// The rule that combines the means of a pixel's two halves from this round on.
    pub combine: Combine,
    /// A mark per pixel whose kept samples are withdrawn from the image before the round is traced. Withdrawn samples
    /// count as discarded and stay spent. A withdrawn pixel must get kept samples in this round, whose indices continue
    /// after the withdrawn ones. It must have no discarded samples yet. Withdrawal that depends on the samples' own values
    /// is still biased [Kirk and Arvo 1991].
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
        let sum = |c: &[u32]| c.iter().map(|&n| u64::from(n)).sum::<u64>();
        sum(&self.counts) + self.second_half.as_deref().map_or(0, sum)
    }
}
