//! The record of a render: rounds, totals, and rejected samples.

use crate::SampleId;
use serde::{Deserialize, Serialize};

/// The largest number of rejected samples that the film lists. [`Record::rejected`] counts all.
pub(crate) const REJECTED_LISTED: usize = 1024;

/// The reason why a sample is rejected.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RejectedReason {
    /// A channel of the radiance was NaN or infinite.
    NotFinite,
    /// A channel of the radiance was negative.
    Negative,
}

impl RejectedReason {
    /// The reason why a film rejects this radiance; `None` for a valid one.
    #[inline]
    pub fn of([r, g, b]: [f32; 3]) -> Option<Self> {
        if r >= 0.0 && g >= 0.0 && b >= 0.0 && r < f32::INFINITY && g < f32::INFINITY && b < f32::INFINITY {
            None
        } else if r.is_finite() && g.is_finite() && b.is_finite() {
            Some(Self::Negative)
        } else {
            Some(Self::NotFinite)
        }
    }
}

/// A sample that was rejected as NaN, infinite or negative. It counts as black, and can be replayed with the point set.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rejected {
    /// The pixel, stream and index of the rejected sample.
    pub sample: SampleId,
    /// The reason for the rejection.
    pub reason: RejectedReason,
}

/// The sample count and timings of one round (samples that are planned together).
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoundRecord {
    /// The number of samples traced in the round.
    pub samples: u64,
    /// `true` if the samples stayed in the image, `false` if they were discarded.
    pub kept: bool,
    /// Wall-clock seconds spent on planning the round.
    pub plan_seconds: f64,
    /// Wall-clock seconds spent on tracing the round.
    pub trace_seconds: f64,
}

/// The budgets, rounds, totals and timings of a render.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The total sample budget at each call of [`Sampler::next_round`](crate::Sampler::next_round), in order.
    pub budgets: Vec<u64>,
    /// The sample counts and timings of the rounds, in order.
    pub rounds: Vec<RoundRecord>,
    /// The number of samples traced, discarded ones included.
    pub samples: u64,
    /// The number of rays traced: the sum of [`Estimate::cost`](crate::Estimate::cost), plus `prepare_rays`.
    pub rays: u64,
    /// The number of blocks of four random numbers that the integrator requested.
    pub blocks: u64,
    /// The number of times that the integrator was prepared ([`Integrator::prepare`](crate::Integrator::prepare)).
    pub passes: u32,
    /// The number of rays traced to prepare the integrator.
    pub prepare_rays: u64,
    /// Wall-clock seconds spent on preparing the integrator; part of the rounds' `trace_seconds`.
    pub prepare_seconds: f64,
    /// The number of samples rejected as NaN, infinite or negative.
    pub rejected: u64,
    /// The last prediction of the filtered image's relMSE ([`Render::error_of`](crate::Render::error_of)), if any.
    #[serde(skip)]
    pub filtered_relmse: Option<f64>,
    /// `true` if a monitor stopped the render before its limits.
    #[serde(skip)]
    pub interrupted: bool,
}

impl Record {
    /// Wall-clock seconds spent on planning, summed over rounds.
    pub fn plan_seconds(&self) -> f64 {
        self.rounds.iter().map(|r| r.plan_seconds).sum()
    }

    /// Wall-clock seconds spent on tracing, summed over rounds.
    pub fn trace_seconds(&self) -> f64 {
        self.rounds.iter().map(|r| r.trace_seconds).sum()
    }
}

/// Sorts rejected samples by pixel, stream and index, and keeps the first [`REJECTED_LISTED`].
pub(crate) fn keep_first(rejected: &mut Vec<Rejected>) {
    rejected.sort_by_key(|r| (r.sample.pixel[1], r.sample.pixel[0], r.sample.stream, r.sample.index));
    rejected.truncate(REJECTED_LISTED);
}
