//! The samples that a sampler looks at before its counts adapt.

use crate::{Budget, Combine, Feedback, Frame, Ladder, Limits, Plan, Retention};

/// What becomes of the pilot, and so what bias the image has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PilotPolicy {
    /// The pilot stays in the image: least noise. Biased, since samples that are kept also decide
    /// how many follow [Kirk and Arvo 1991]; the bias falls with the pilot's size, and pooling over
    /// neighbours dilutes a pixel's own vote to 1/25.
    #[default]
    Keep,
    /// The pilot is thrown away: exactly unbiased, at the price of its samples.
    Discard,
    /// Two halves; each half's counts are decided by the other's samples, and the halves are averaged
    /// equally: exactly unbiased where the budget is known at the start, at the price of two shorter
    /// nets. Where it is raised later, a half's earlier samples reach its later counts through the
    /// other half's.
    Cross,
}

impl PilotPolicy {
    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Keep => "keep",
            Self::Discard => "discard",
            Self::Cross => "cross",
        }
    }

    fn wanted(asked: u32, mean: u32, ladder: Ladder) -> u32 {
        if asked > 0 { asked } else { PILOT.max(ladder.floor(mean / 4)) }
    }

    /// Whether these limits pay for the pilot and nothing else, so that no counts are planned: `wanted` as for
    /// [`PilotPolicy::begin`].
    pub fn is_all(self, wanted: u32, frame: &Frame, limits: &Limits) -> bool {
        let Budget::Samples(total) = limits.budget else { return false };
        let pixels = frame.pixels() as u64;
        let mean = clamped(total / pixels);
        self != Self::Discard && total.is_multiple_of(pixels) && Self::wanted(wanted, mean, Ladder::Whole) >= mean
    }

    /// Begins a round: says how halves are combined, and asks for what the pilot still lacks, if it can be paid for.
    /// `wanted` samples per pixel; 0 takes 4, or the rung at a quarter of the mean budget where that is more. Where
    /// nothing is missing, `plan`'s counts are 0.
    pub fn begin(self, seen: &Feedback<'_>, wanted: u32, plan: &mut Plan) -> PilotRound {
        let budget = seen.budget;
        plan.combine = if self == Self::Cross { Combine::Equally } else { Combine::ByCount };
        let mean = budget.total / seen.pixels() as u64;
        // A discarded pilot may take half of what there is, and never the floor's share.
        let affordable = match self {
            Self::Discard => mean.saturating_sub(u64::from(budget.min_spp.max(1))).min(mean / 2),
            _ => mean,
        };
        let ladder = if self == Self::Cross { Ladder::Halves } else { Ladder::of(seen.film.needs()) };
        let mean = clamped(affordable);
        let samples = match Self::wanted(wanted, mean, ladder).min(mean) {
            // One sample has no variance: nothing would be learned from what is thrown away.
            1 if self == Self::Discard => 0,
            samples => samples,
        };
        for (i, count) in plan.counts.iter_mut().enumerate() {
            let done = if self == Self::Discard { seen.film.discarded(i).count } else { seen.film.count(i) };
            *count = samples.saturating_sub(clamped(done));
        }
        let is_missing = plan.total() > 0 && plan.total() <= budget.left();
        if is_missing {
            plan.retention = if self == Self::Discard { Retention::Discard } else { Retention::Keep };
        } else {
            plan.counts.fill(0);
        }
        PilotRound { samples, is_missing }
    }
}

/// How a sampler's pilot stands at the beginning of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PilotRound {
    /// Its samples per pixel.
    pub samples: u32,
    /// Whether this round is (the rest of) the pilot, and its plan is made.
    pub is_missing: bool,
}

/// PilotPolicy where nothing else is said: enough for pooling over 25 pixels, few enough for 8 spp.
const PILOT: u32 = 4;

fn clamped(n: u64) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
