//! The sizes of slices: the work between two calls of the monitor.

use super::round::BLOCK;
use super::team::Team;
use crate::snapshot::{Cursor, OpenRound};
use crate::{Film, Limits};

/// The target duration in seconds of a slice, the work between two calls of the monitor. A single row of pixels may
/// take longer.
const SLICE_SECONDS: f64 = 0.2;
/// The least of that target as a meeting of processes comes near.
const SHORTEST: f64 = 0.005;
/// The number of samples in a round's first slice. It takes a millisecond at 1 us per sample, and a second at 1 ms per
/// sample.
const FIRST_SLICE: f64 = 1024.0;
/// The largest number of samples in a slice, as a multiple of the samples already traced in the round.
const GROWTH: f64 = 8.0;

/// The size of the next slice: samples per pixel, and rows of pixels.
///
/// Both follow from the sampling rate of this round, which took `seconds` so far. If one sample in every pixel takes
/// longer than a slice should, the slice covers only some rows. The samples per pixel then belong to the whole pass
/// over the rows.
/// `pass` are the samples per pixel of a training pass or of an integrator's pass, if there is one.
pub(super) fn next_slice(
    open: &OpenRound,
    film: &Film,
    (pass, wants_training): (Option<u32>, bool),
    seconds: f64,
    (limits, team): (&Limits, Option<&Team<'_>>),
) -> (u32, u32) {
    let [width, height] = film.frame.size();
    let fixed = limits.schedule.slice_spp;
    if fixed > 0 {
        return (pass.unwrap_or(fixed), height);
    }
    let Cursor { start, end, row } = open.cursor;
    let rows = |counts: &[u32]| -> usize {
        let rows = counts.chunks(width as usize).enumerate();
        let own = rows.filter(|(row, _)| team.is_none_or(|team| team.owns(*row)));
        let to_come = |(row, counts): (usize, &[u32])| {
            let start = team.map_or(start, |team| team.shifted(row, [start; 2])[0]);
            counts.iter().filter(|&&n| n > start).count()
        };
        own.map(to_come).sum()
    };
    let active = (rows(&open.plan.counts) + open.plan.second_half.as_deref().map_or(0, rows)) as f64;
    let traced = (film.record.samples - open.before) as f64;
    // The first rows may be the quickest, so the length grows step by step.
    let until_meeting = team.filter(|_| !wants_training).and_then(Team::until_meeting);
    let target = until_meeting.map_or(SLICE_SECONDS, |left| left.clamp(SHORTEST, SLICE_SECONDS));
    let promised = (traced / seconds.max(1e-3) * target).min(GROWTH * traced);
    let samples = promised.max(FIRST_SLICE);
    let length = pass.unwrap_or((samples / active).clamp(1.0, 65536.0) as u32);
    let slices = f64::from(if row == 0 { length } else { end - start }) * active / samples;
    if slices < 2.0 && row == 0 {
        return (length, height);
    }
    let rows = (f64::from(height) / slices).clamp(1.0, f64::from(height)).round() as u32;
    (length, if wants_training || team.is_some() { rows.next_multiple_of(BLOCK as u32) } else { rows })
}

/// Samples per pixel of the next training pass: the mean number of all samples before, so that passes double in length.
/// Depends on the plans only: not on time, nor on the process that traced the samples.
pub(super) fn pass_length(open: &OpenRound) -> u32 {
    let traced = open.before(open.cursor.start);
    let mean = (open.before + open.submitted + traced) / open.plan.counts.len() as u64;
    u32::try_from(mean).unwrap_or(u32::MAX).max(1)
}
