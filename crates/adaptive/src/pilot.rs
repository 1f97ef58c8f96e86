//! The samples that a sampler looks at before its counts adapt.

use dapple_core::{Budget, Combine, Feedback, Frame, Ladder, Limits, PilotPolicy, Plan, Retention, saturating_u32};

/// A uniform pilot: its size and its retention.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pilot {
    /// The retention of its samples. [`PilotPolicy::Refined`] is treated as [`PilotPolicy::Keep`].
    pub policy: PilotPolicy,
    /// Samples per pixel; 0 takes 4, or the rung of the ladder at a quarter of the mean budget where that is more.
    pub samples: u32,
}

impl Pilot {
    /// A pilot of so many samples per pixel, 0 to choose, with this retention.
    pub const fn new(policy: PilotPolicy, samples: u32) -> Self {
        Self { policy, samples }
    }

    fn wanted(self, mean: u32, ladder: Ladder) -> u32 {
        if self.samples > 0 { self.samples } else { LEAST.max(ladder.floor(mean / 4)) }
    }

    /// True if these limits pay for the pilot and nothing else, so that no counts are planned.
    pub fn is_all(self, frame: &Frame, limits: &Limits) -> bool {
        let Budget::Samples(total) = limits.budget else { return false };
        let pixels = frame.pixels() as u64;
        let mean = saturating_u32(total / pixels);
        self.policy != PilotPolicy::Discard && total.is_multiple_of(pixels) && self.wanted(mean, Ladder::Whole) >= mean
    }

    /// Begins a round: sets how halves are combined, and requests the samples that the pilot still lacks, if the budget
    /// pays for them. Where nothing is missing, `plan`'s counts are 0.
    pub fn begin(self, seen: &Feedback<'_>, plan: &mut Plan) -> PilotRound {
        let budget = seen.budget;
        let (crosses, discards) = (self.policy == PilotPolicy::Cross, self.policy == PilotPolicy::Discard);
        plan.combine = if crosses { Combine::Equally } else { Combine::ByCount };
        let mean = budget.total / seen.pixels() as u64;
        // A discarded pilot may take half of the budget, and never the floor's share.
        let affordable =
            if discards { mean.saturating_sub(u64::from(budget.min_spp.max(1))).min(mean / 2) } else { mean };
        let ladder = if crosses { Ladder::Halves } else { Ladder::of(seen.film.needs()) };
        let mean = saturating_u32(affordable);
        let samples = match self.wanted(mean, ladder).min(mean) {
            // One sample has no variance: a discarded one would teach nothing.
            1 if discards => 0,
            samples => samples,
        };
        for (i, count) in plan.counts.iter_mut().enumerate() {
            let done = if discards { seen.film.discarded(i).count } else { seen.film.count(i) };
            *count = samples.saturating_sub(saturating_u32(done));
        }
        let is_missing = plan.total() > 0 && plan.total() <= budget.left();
        if is_missing {
            plan.retention = if discards { Retention::Discard } else { Retention::Keep };
        } else {
            plan.counts.fill(0);
        }
        PilotRound { samples, is_missing }
    }
}

/// The state of a sampler's pilot at the beginning of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PilotRound {
    /// Its samples per pixel.
    pub samples: u32,
    /// True if this round is (the rest of) the pilot, and its plan is made.
    pub is_missing: bool,
}

/// The least pilot that is chosen: enough for pooling over 25 pixels, few enough for 8 spp.
const LEAST: u32 = 4;
