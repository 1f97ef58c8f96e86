//! Preparation of an integrator before samples, such as tracing photons.

use super::session::State;
use super::team::Team;
use crate::snapshot::OpenRound;
use crate::{Error, Integrator, Pass, PointSet, Prepares, Record, SampleId, streams};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// Samples per pixel of a pass: one for each half of the film, so that the halves can have preparations of their own.
const SAMPLES: usize = 2;

/// Samples per pixel of the next pass: about [`SAMPLES`] for each pixel of the image, handed to the pixels that still have
/// samples in the round. Follows from the plan alone, not from time.
pub(super) fn pass_length(open: &OpenRound, pixels: usize) -> u32 {
    let active = open.above(open.cursor.start) as usize;
    // With counts for each half, a step traces a sample of both.
    let least = if open.plan.second_half.is_some() { 1 } else { SAMPLES };
    u32::try_from((SAMPLES * pixels / active.max(1)).max(least)).unwrap_or(u32::MAX)
}

/// Prepares the integrator for the slice at the cursor, unless it is prepared for it. Rays and seconds go to the record,
/// but for the repetition after a resumption.
pub(super) fn prepare(
    integrator: &mut dyn Integrator,
    points: &dyn PointSet,
    (state, team): (&mut State, Option<&mut Team<'_>>),
    begins: bool,
) -> Result<(), Error> {
    let (film, prepared) = (&mut state.film, &mut state.prepared);
    let passes = film.record.passes;
    let (number, is_new) = match integrator.prepares() {
        Prepares::Never => return Ok(()),
        Prepares::Once => (0, passes == 0),
        Prepares::EveryPass if begins => (passes, true),
        Prepares::EveryPass => (passes.saturating_sub(1), false),
    };
    if *prepared == Some(number) {
        return Ok(());
    }
    let clock = Instant::now();
    let pass = Pass { number, points, frame: film.frame };
    let done = catch_unwind(AssertUnwindSafe(|| integrator.prepare(&pass))).map_err(|payload| {
        let message = super::round::panic_message(&*payload);
        let sample = SampleId::new([number, 0], streams::LIGHT, 0);
        let film = Box::new(std::mem::replace(film, crate::Film::new(*film.frame(), crate::Needs::none())));
        Error::Panicked { sample, message, points: points.describe(), film }
    })?;
    *prepared = Some(number);
    if is_new {
        let seconds = clock.elapsed().as_secs_f64();
        let count = |record: &mut Record| {
            record.passes += 1;
            record.rays += done.rays;
            record.prepare_rays += done.rays;
            record.prepare_seconds += seconds;
        };
        count(&mut state.film.record);
        // All processes prepare the same, which counts once.
        team.and_then(Team::record_before).into_iter().for_each(count);
    }
    Ok(())
}
