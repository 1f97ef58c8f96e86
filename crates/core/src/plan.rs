//! What a sampler asks for in one round.

/// Whether a round follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The plan is filled in: trace it.
    Trace,
    /// Nothing more to ask for within the budget shown; the plan is ignored.
    Done,
}

/// What becomes of a round's samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Retention {
    /// They stay in the image. If they also decide later counts, the image is biased
    /// [Kirk and Arvo 1991].
    #[default]
    Keep,
    /// They only inform the sampler: unbiased, at the price of the round.
    Discard,
}

/// How the means of two halves become one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Combine {
    /// Weighted by their sample counts.
    #[default]
    ByCount,
    /// The plain average, whatever their counts: what cross-half decisions need to stay unbiased.
    Equally,
    /// This weight, in `[0, 1]`, for the first half, the rest for the second.
    Fixed(f64),
}

/// One round: how many more samples each pixel gets, and what becomes of them.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Additional samples per pixel, row by row over the frame's window. All zero when handed to
    /// [`Sampler::next_round`](crate::Sampler::next_round).
    pub counts: Vec<u32>,
    /// Additional samples per pixel of the second half. When set, `counts` holds those of the first;
    /// otherwise samples alternate between the halves. Only in renders with halves.
    pub second_half: Option<Vec<u32>>,
    /// Whether the samples are kept.
    pub retention: Retention,
    /// How the halves are combined from this round on.
    pub combine: Combine,
    /// Pixels, row by row over the frame's window, whose kept samples so far leave the image before
    /// the round is traced: they join the discarded ones, and stay spent. Such a pixel must get
    /// samples in this round, and those must be kept; their indices go on where the withdrawn ones
    /// ended. Withdrawing by what the samples themselves say is biased all the same
    /// [Kirk and Arvo 1991].
    pub withdraw: Option<Vec<bool>>,
}

impl Plan {
    /// An empty plan for so many pixels: zero samples each, kept, halves combined by count.
    pub fn empty(pixels: usize) -> Self {
        Self {
            counts: vec![0; pixels],
            second_half: None,
            retention: Retention::Keep,
            combine: Combine::ByCount,
            withdraw: None,
        }
    }

    /// Samples asked for in all.
    pub fn total(&self) -> u64 {
        let sum = |c: &[u32]| c.iter().map(|&n| u64::from(n)).sum::<u64>();
        sum(&self.counts) + self.second_half.as_deref().map_or(0, sum)
    }
}
