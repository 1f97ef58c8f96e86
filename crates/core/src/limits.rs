//! When a render ends.

/// What a render may spend.
#[derive(Clone, Debug, PartialEq)]
pub enum Budget {
    /// So many samples in all, exactly.
    Samples(u64),
    /// About so many seconds of tracing and planning. Turned into sample budgets at barriers and
    /// recorded; [`Budget::Recorded`] replays the record to the same bits.
    Seconds(f64),
    /// Until the image's own estimate of its relMSE is at most `relmse`, or `at_most` samples are
    /// spent. Asks for halves.
    Error {
        /// The relMSE to reach, `mean((x - truth)^2 / (truth^2 + 0.01))`.
        relmse: f64,
        /// Samples after which to stop all the same.
        at_most: u64,
    },
    /// The budgets that an earlier render recorded, one per barrier. Renders with halves use other
    /// points: pass the earlier film's [`needs`](crate::Film::needs) to get its bits.
    Recorded(Vec<u64>),
}

/// What happens when a sample is NaN, infinite or negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InvalidSample {
    /// It counts as zero and in `n`, is counted, and can be replayed.
    #[default]
    Reject,
    /// The render fails, naming the sample.
    Fail,
}

/// How the work is handed to threads. Changes no bit of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Rows of pixels per task, at least 1. Rounded up to a multiple of 16 while an integrator
    /// wants_training.
    pub tile_rows: u32,
    /// Samples per pixel and slice; 0 chooses slices of about a fifth of a second.
    pub slice_spp: u32,
    /// Tasks are handed out in the order of a permutation by this number; 0 keeps them in order.
    pub shuffle: u64,
}

impl Default for Schedule {
    fn default() -> Self {
        Self { tile_rows: 1, slice_spp: 0, shuffle: 0 }
    }
}

/// The limits of a render: its one budget, and the bounds for each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// What may be spent.
    pub budget: Budget,
    /// No pixel gets fewer samples than this (the sampler's own floor may be higher).
    pub min_spp: u32,
    /// No pixel gets more samples than this.
    pub max_spp: u32,
    /// What happens to samples that are no radiance.
    pub invalid: InvalidSample,
    /// How the work is cut.
    pub schedule: Schedule,
}

impl Limits {
    /// So many samples in all.
    pub fn samples(total: u64) -> Self {
        Self::new(Budget::Samples(total))
    }

    /// About so many seconds.
    pub fn seconds(seconds: f64) -> Self {
        Self::new(Budget::Seconds(seconds))
    }

    /// Until the predicted relMSE is at most this, or `at_most` samples are spent.
    pub fn error(relmse: f64, at_most: u64) -> Self {
        Self::new(Budget::Error { relmse, at_most })
    }

    /// This budget, at least 1 and at most 2^32 - 1 samples per pixel.
    pub fn new(budget: Budget) -> Self {
        Self { budget, min_spp: 1, max_spp: u32::MAX, invalid: InvalidSample::Reject, schedule: Schedule::default() }
    }
}
