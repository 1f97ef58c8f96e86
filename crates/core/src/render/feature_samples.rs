//! Samples of features alone, before samples of each pixel.
//!
//! The features of a pixel at an edge are as noisy as its colour, and with the same noise: filters then keep it. A sample of
//! features costs one ray, or a few behind glass, where a sample of light takes several.

use crate::film::{FeatureMoments, record_first_hit};
use crate::{Draws, Estimate, Needs, PointSet, Retention, SampleId, streams};

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

/// Adds samples of features alone to the features of a pixel.
///
/// Their number follows from themselves, so that it depends on no plan, and a render with a larger budget goes on from one
/// with a smaller one.
pub(super) fn add(
    moments: &mut FeatureMoments,
    points: &dyn PointSet,
    pixel: [u32; 2],
    mut sample: impl FnMut(&Draws<'_>) -> Option<Estimate>,
) -> Cost {
    let mut cost = Cost::default();
    for index in 0..MOST.min(points.capacity()) {
        if !moments.wants_more() {
            break;
        }
        let id = SampleId::new(pixel, streams::FEATURES, index);
        let draws = Draws::of_round(points, id, &Needs::none().with_features());
        let Some(estimate) = sample(&draws) else { break };
        record_first_hit([Some(moments), None], &mut [], u64::MAX, &estimate);
        cost.rays += u64::from(estimate.cost);
        cost.blocks += u64::from(draws.blocks_requested());
    }
    cost
}
