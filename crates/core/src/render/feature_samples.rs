//! Samples of features alone, before samples of each pixel.
//!
//! The features of a pixel at an edge are as noisy as its colour, and with the same noise: filters then keep it. A sample of
//! features costs one ray, or a few behind glass, where a sample of light takes several.
//!
//! So does the emission of lamps seen directly: at their edges, more samples of it alone take most of the noise away.

use crate::film::{EmissionAlone, FeatureMoments, record_first_hit};
use crate::{Draws, Estimate, Needs, PointSet, SampleId, plan::Retention, point_set::streams};

/// The largest number of samples of features alone in a pixel.
const MOST: u64 = 16;

/// The rays of samples of features alone, and the blocks of random numbers that they took.
#[derive(Clone, Copy, Default)]
pub(super) struct Cost {
    pub(super) rays: u64,
    pub(super) blocks: u64,
}

/// The place of samples of features alone in a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// Before a pixel's first kept sample, in whatever round.
    First,
    /// Before a pixel's samples of this round.
    Now,
    /// Not in this round.
    Never,
}

impl Turn {
    /// This turn, or never if a film that records this gets no samples of features alone. Features that are recorded by half
    /// stay those of the samples.
    pub(super) fn of_film(self, needs: &Needs, retention: Retention) -> Self {
        let wanted = needs.features && !needs.feature_halves && retention == Retention::Keep;
        if wanted { self } else { Self::Never }
    }

    /// Returns `true` if it is the turn of a pixel with these features and this number of kept samples, at the begin of its
    /// samples of a round or later. A pixel gets samples of features alone once.
    pub(super) fn is_now(self, moments: &FeatureMoments, kept: u64, begins: bool) -> bool {
        match self {
            Self::First => kept == 0,
            Self::Now => begins && u64::from(moments.samples) <= kept,
            Self::Never => false,
        }
    }
}

/// The number of samples of features alone that each half of a pixel at the edge of a lamp gets for its emission.
const EMISSION: u64 = 32;
/// The ratio of two samples' emission from which on a pixel counts as one at the edge of a lamp. Skies vary by less.
const EDGE: f32 = 2.0;

/// Adds samples of features alone to the features of a pixel, for a film that records `needs`. Returns their cost, and their emission
/// at the edge of a lamp.
///
/// Their number follows from themselves, so that it depends on no plan, and a render with a larger budget goes on from one
/// with a smaller one. Samples whose emission is averaged have streams of their own. Those by which an edge is found are not among
/// them: with them, and with later ones of the same stream, which fill their gaps, a lamp that covers little of a pixel would lose
/// light.
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
