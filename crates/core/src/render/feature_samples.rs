//! Samples of features alone, before the first sample of each pixel.
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

/// Returns `true` if a film that records this gets samples of features alone. Features that are recorded by half stay those
/// of the samples.
pub(super) fn are_wanted(needs: &Needs, retention: Retention) -> bool {
    needs.features && !needs.feature_halves && retention == Retention::Keep
}

/// Adds samples of features alone to the features of a pixel that has no kept sample yet.
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
