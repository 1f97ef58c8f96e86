//! Samples of features alone, in pixels with few samples.
//!
//! The features of a pixel at an edge are as noisy as its colour, and with the same noise: filters then keep it. A sample of
//! features costs one ray, or a few behind glass, where a sample of light takes several.

use super::band::Band;
use super::round::{Inputs, Tally};
use crate::film::record_first_hit;
use crate::{Draws, Needs, Retention, SampleId, streams};
use std::cell::Cell;

/// The largest number of samples of features alone in a pixel.
const MOST: u64 = 16;

/// Adds samples of features alone to a pixel whose first kept samples have just been traced.
///
/// Their number follows from the features that the pixel has then, so that it depends on nothing but the plan. Features
/// that are recorded by half stay those of the samples.
pub(super) fn add(
    round: &Inputs<'_>,
    band: &mut Band<'_>,
    local: usize,
    pixel: [u32; 2],
    tally: &mut Tally,
    current: &Cell<Option<SampleId>>,
) {
    let Needs { features, feature_halves, .. } = round.needs;
    if !features || feature_halves || round.plan.retention != Retention::Keep {
        return;
    }
    let i = band.first + local;
    let planned =
        round.plan.counts[i] as u64 + round.plan.second_half.as_ref().map_or(0, |second| u64::from(second[i]));
    if band.banks.iter().map(|bank| bank.counts[local]).sum::<u64>() != planned {
        return;
    }
    let Some(moments) = band.features.get_mut(local) else { return };
    for index in 0..MOST.min(round.points.capacity()) {
        if !moments.wants_more() {
            break;
        }
        let id = SampleId::new(pixel, streams::FEATURES, index);
        current.set(Some(id));
        let draws = Draws::of_round(round.points, id, &Needs::none().with_features());
        let Some(estimate) = round.integrator.features_alone(&draws) else { break };
        record_first_hit([Some(moments), None], &mut [], u64::MAX, &estimate);
        tally.rays += u64::from(estimate.cost);
        tally.blocks += u64::from(draws.blocks_requested());
    }
}
