//! Budgets and other limits of a render.

use crate::{Frame, macros::setters};

/// The amount of work that a render may do.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// A number of samples in all. It is spent exactly, unless the sampler stops at a threshold.
    Samples(u64),
    /// A mean number of samples per pixel, above 0. The total is rounded to a whole number of samples, at least 1.
    PerPixel(f64),
    /// A time in seconds for planning, tracing and the filter, met approximately. Between rounds, the render loop converts the
    /// time to sample budgets, which the film records. Each pixel gets its minimum number of samples, however long that takes.
    Seconds(f64),
    /// No limit: each round doubles the number of samples, for as long as the caller requests rounds.
    Open,
    /// As many samples as an estimated relMSE of at most `relmse` requires, but no more than `at_most`. The film then also
    /// splits each pixel's samples into two halves.
    Error {
        /// The largest accepted relMSE: `mean((x - truth)^2 / (truth^2 + 0.01))` over pixels and channels.
        relmse: f64,
        /// The largest number of samples, spent if the goal is not reached.
        at_most: u64,
    },
}

/// The treatment of a sample that is NaN, infinite or negative.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InvalidSample {
    /// The sample counts as black, and is listed by the film for replay.
    #[default]
    Reject,
    /// The render fails and names the sample.
    Fail,
}

/// The division of work among threads. The image is bit-identical for all values.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Rows of pixels per task, at least 1; 1 by default. Rounded up to a multiple of 16 in training passes.
    pub tile_rows: u32,
    /// Samples per pixel between two calls of [`Monitor::progress`](crate::render::Monitor::progress); 0, the default, for about
    /// 0.2 seconds.
    pub progress_spp: u32,
    /// The seed of a random permutation of tasks, for tests. 0, the default, keeps tasks in order.
    pub shuffle: u64,
}

impl Default for Schedule {
    fn default() -> Self {
        Self { tile_rows: 1, progress_spp: 0, shuffle: 0 }
    }
}

impl Schedule {
    setters! {
        /// Sets the rows of pixels per task.
        with_tile_rows(tile_rows: u32);
        /// Sets the samples per pixel between two calls of the monitor; 0 selects as many as take about 0.2 seconds.
        with_progress_spp(progress_spp: u32);
        /// Sets the seed of a random permutation of tasks; 0 keeps tasks in order.
        with_shuffle(shuffle: u64);
    }
}

/// The limits of a render: one budget, and bounds for each pixel.
///
/// ```
/// use dapple_core::{InvalidSample, Limits};
///
/// let limits = Limits::samples(100_000).with_min_spp(4).with_max_spp(256).with_invalid(InvalidSample::Fail);
/// assert_eq!((limits.min_spp, limits.max_spp), (4, 256));
///
/// // Or a minute, or until the predicted relMSE is 0.001.
/// let minute = Limits::seconds(60.0);
/// let accurate = Limits::error(0.001, 10_000_000);
/// # assert!(minute != accurate);
/// ```
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// The amount of work: a number of samples, a time, or an error to reach.
    pub budget: Budget,
    /// The minimum number of samples per pixel, 1 by default. A sampler's own floor may be higher.
    pub min_spp: u32,
    /// The maximum number of samples per pixel, 2^32 - 1 by default.
    pub max_spp: u32,
    /// The treatment of samples that are NaN, infinite or negative.
    pub invalid: InvalidSample,
    /// The division of work among threads.
    pub schedule: Schedule,
}

impl Budget {
    /// Returns `true` for a budget given in samples, which does not change during the render.
    pub(crate) fn is_of_samples(&self) -> bool {
        matches!(self, Self::Samples(_) | Self::PerPixel(_))
    }

    /// The number of samples in an image of this frame, for a budget in samples or samples per pixel; `None` for others.
    pub fn samples(&self, frame: &Frame) -> Option<u64> {
        match self {
            Self::Samples(total) => Some(*total),
            Self::PerPixel(spp) => Some(((spp * frame.pixels() as f64).round() as u64).max(1)),
            _ => None,
        }
    }
}

/// The number of samples per pixel assumed for time limits and open budgets.
const ASSUMED_SPP: u32 = 64;

impl Limits {
    /// Limits of `spp` samples per pixel on average.
    pub fn spp(spp: f64) -> Self {
        Self::new(Budget::PerPixel(spp))
    }

    /// Limits of `total` samples in all.
    pub fn samples(total: u64) -> Self {
        Self::new(Budget::Samples(total))
    }

    /// Limits of about this many seconds.
    pub fn seconds(seconds: f64) -> Self {
        Self::new(Budget::Seconds(seconds))
    }

    /// Limits of a render that continues until the caller stops it.
    pub fn open() -> Self {
        Self::new(Budget::Open)
    }

    /// Limits that end when the predicted relMSE is at most `relmse`, or `at_most` samples are spent.
    pub fn error(relmse: f64, at_most: u64) -> Self {
        Self::new(Budget::Error { relmse, at_most })
    }

    /// Limits of `budget`, with at least 1 and at most 2^32 - 1 samples per pixel.
    pub fn new(budget: Budget) -> Self {
        Self { budget, min_spp: 1, max_spp: u32::MAX, invalid: InvalidSample::Reject, schedule: Schedule::default() }
    }

    /// The number of samples to expect for an image of this frame: exact for a budget in samples, `at_most` for an error
    /// limit, and `min(64, max_spp)` samples per pixel for time limits and open budgets.
    pub fn expected_samples(&self, frame: &Frame) -> u64 {
        match &self.budget {
            Budget::Error { at_most, .. } => *at_most,
            budget => budget.samples(frame).unwrap_or(frame.pixels() as u64 * u64::from(self.max_spp.min(ASSUMED_SPP))),
        }
    }

    setters! {
        /// Sets the minimum number of samples per pixel.
        with_min_spp(min_spp: u32);
        /// Sets the maximum number of samples per pixel.
        with_max_spp(max_spp: u32);
        /// Sets the treatment of samples that are NaN, infinite or negative.
        with_invalid(invalid: InvalidSample);
        /// Sets the division of work among threads.
        with_schedule(schedule: Schedule);
    }
}
