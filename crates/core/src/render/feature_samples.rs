//! Feature-only samples, taken before a pixel's ordinary samples.
//!
//! At an edge, a pixel's features are as noisy as its colour, and the noise is the same: filters then preserve it. A
//! feature-only sample costs one ray, or a few behind glass; an ordinary sample costs several.
//!
//! The same holds for the emission of light sources seen directly: at their edges, more feature-only samples remove most of
//! the noise.

use crate::film::{EmissionAlone, FeatureMoments, record_first_hit};
use crate::{Draws, Estimate, Needs, PointSet, SampleId, plan::Retention, point_set::streams};

/// The maximum number of feature-only samples in a pixel, besides those for emission.
const MOST: u64 = 16;

/// The rays and the blocks of random numbers that feature-only samples took.
#[derive(Clone, Copy, Default)]
pub(super) struct Cost {
    pub(super) rays: u64,
    pub(super) blocks: u64,
}

/// The time at which a pixel gets feature-only samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// Before a pixel's first kept sample, in any round.
    First,
    /// Before a pixel's samples of this round.
    Now,
    /// Not in this round.
    Never,
}

impl Turn {
    /// Returns `self`, or `Never` if a film with these `needs` gets no feature-only samples. Features recorded per half
    /// come from ordinary samples only.
    pub(super) fn of_film(self, needs: &Needs, retention: Retention) -> Self {
        let wanted = needs.features && !needs.feature_halves && retention == Retention::Keep;
        if wanted { self } else { Self::Never }
    }

    /// Returns `true` if a pixel with these features gets feature-only samples now. `kept` is the pixel's number of kept
    /// samples. `begins` is `true` at the start of its samples in a round. A pixel gets feature-only samples once.
    pub(super) fn is_now(self, moments: &FeatureMoments, kept: u64, begins: bool) -> bool {
        match self {
            Self::First => kept == 0,
            Self::Now => begins && u64::from(moments.samples) <= kept,
            Self::Never => false,
        }
    }
}

/// The number of feature-only samples for emission that each half of a pixel gets at the edge of a light source.
const EMISSION: u64 = 32;
/// The ratio of two samples' emission above which a pixel counts as lying at the edge of a light source. Skies vary by less.
const EDGE: f32 = 2.0;

/// Adds feature-only samples to the features of a pixel, for a film with these `needs`. Returns their cost, and their
/// emission if the pixel is at the edge of a light source.
///
/// The number of samples depends on the samples alone and not on the plan. A render that resumes one with a smaller
/// budget therefore takes the same samples.
///
/// The samples whose emission is averaged have streams of their own. The samples that detect an edge are excluded, and so
/// are later samples of their stream, which fill the gaps between them. Including either would lose light if a light source
/// covers little of the pixel.
pub(super) fn add(
    moments: &mut FeatureMoments,
    points: &dyn PointSet,
    pixel: [u32; 2],
    needs: &Needs,
    mut sample: impl FnMut(&Draws<'_>) -> Option<Estimate>,
) -> (Cost, Option<EmissionAlone>) {
    let wanted = Needs { features: true, emission: needs.emission, ..Needs::none() };
    let mut cost = Cost::default();
    let mut next = |moments: &mut FeatureMoments, stream: u32, index: u64| {
        let draws = Draws::for_film(points, SampleId::new(pixel, stream, index), wanted);
        let estimate = sample(&draws)?;
        record_first_hit([Some(moments), None], &mut [], u64::MAX, &estimate);
        cost.rays += u64::from(estimate.cost);
        cost.blocks += u64::from(draws.blocks_requested());
        Some(estimate.emission)
    };
    // The emission of the first sample, summed over channels.
    let (mut first, mut is_edge) = (None, false);
    for index in 0..MOST.min(points.capacity()) {
        if !moments.wants_more() || is_edge {
            break;
        }
        let Some(emission) = next(moments, streams::FEATURES, index) else { break };
        if wanted.emission {
            let sum: f32 = emission.iter().sum();
            let first = *first.get_or_insert(sum);
            is_edge = first.max(sum) > EDGE * first.min(sum);
        }
    }
    if !is_edge {
        return (cost, None);
    }
    let mut alone = EmissionAlone::default();
    for (half, index) in (0..EMISSION.min(points.capacity())).flat_map(|index| [0, 1].map(|half| (half, index))) {
        let Some(emission) = next(moments, streams::EMISSION[half], index) else { break };
        alone.push(half, emission);
    }
    (cost, Some(alone))
}
