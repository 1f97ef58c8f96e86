//! Rounds of a session, divided into tiles.

use super::budget::Stopwatch;
use super::feature_samples::Turn;
use super::state::{OpenRound, State};
use super::tile::{Tile, area};
use crate::film::Window;
use crate::filter::filled;
use crate::snapshot::{Planner, SavedSampler, View};
use crate::{
    Draws, Error, Estimate, Film, Filter, Filtered, Frame, InvalidSample, Limits, PointSet, Sampler, parallel,
};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A round of a [`Session`](crate::Session): samples that were planned together, and can be traced in any order, by any
/// threads, machines or devices.
///
/// Each task takes a [`Tile`], adds the results of its samples and submits it. Threads share the round by reference.
pub struct Round<'s> {
    points: &'s dyn PointSet,
    sampler: SavedSampler,
    filter: &'s dyn Filter,
    limits: &'s Limits,
    clock: &'s Stopwatch,
    frame: Frame,
    total: u64,
    side: u32,
    features: Turn,
    state: Mutex<Shared<'s>>,
}

/// The state of the render, and the tiles that [`Round::next_tile`] has not handed out.
struct Shared<'s> {
    state: &'s mut State,
    areas: std::vec::IntoIter<[u32; 4]>,
}

impl<'s> Round<'s> {
    pub(super) fn new(
        state: &'s mut State,
        (sampler, filter): (&'s dyn Sampler, &'s dyn Filter),
        limits: &'s Limits,
        clock: &'s Stopwatch,
        (total, side, features): (u64, u32, Turn),
    ) -> Self {
        let frame = state.film.frame;
        let areas = areas(&frame, side).into_iter();
        let (points, sampler) = (sampler.points(), SavedSampler::of(sampler));
        let state = Mutex::new(Shared { state, areas });
        Self { points, sampler, filter, limits, clock, frame, total, side, features, state }
    }

    /// The point set of the render.
    pub fn points(&self) -> &'s dyn PointSet {
        self.points
    }

    /// The number of samples that are not submitted yet.
    pub fn left(&self) -> u64 {
        self.lock().state.open.as_ref().map_or(0, |open| open.plan.total())
    }

    /// The next tile with samples to trace; `None` if all were handed out.
    ///
    /// Tiles are squares with the side [`Session::with_tile_side`](crate::Session::with_tile_side), row by row. A tile that was
    /// handed out but not submitted is part of the round that [`Session::next_round`](crate::Session::next_round) returns next.
    pub fn next_tile(&self) -> Option<Tile<'s>> {
        let mut shared = self.lock();
        loop {
            let [x0, y0, x1, y1] = shared.areas.next()?;
            let open = shared.state.open.as_ref()?;
            let tile = self.cut(&shared.state.film, open, self.frame.crop(x0, y0, x1, y1).ok()?);
            if tile.left() > 0 {
                return Some(tile);
            }
        }
    }

    /// The tile of columns `x0..x1` and rows `y0..y1` of the full image, for renderers with their own tiles. The tile may
    /// have no samples.
    ///
    /// # Errors
    ///
    /// [`Error::BadTile`] for an area that is empty or reaches outside the frame's window.
    pub fn tile(&self, [x0, y0, x1, y1]: [u32; 4]) -> Result<Tile<'s>, Error> {
        let window = area(&self.frame);
        let inside = x0 >= window[0] && y0 >= window[1] && x1 <= window[2] && y1 <= window[3];
        let shared = self.lock();
        match (self.frame.crop(x0, y0, x1, y1), &shared.state.open) {
            (Ok(frame), Some(open)) if inside => Ok(self.cut(&shared.state.film, open, frame)),
            _ => {
                let [left, top, right, bottom] = window;
                let what = format!(
                    "it is empty or outside the window; stay within columns {left}..{right} and rows {top}..{bottom}"
                );
                Err(Error::BadTile { area: [x0, y0, x1, y1], what })
            }
        }
    }

    /// The whole window as one tile, for wavefront renderers, which trace samples of the whole image together.
    pub fn whole(&self) -> Tile<'s> {
        let shared = self.lock();
        let open = shared.state.open.as_ref().expect("a round is open as long as it is borrowed");
        self.cut(&shared.state.film, open, self.frame)
    }

    fn cut(&self, film: &Film, open: &OpenRound, frame: Frame) -> Tile<'s> {
        Tile::new(self.points, film, (open, self.features), frame)
    }

    /// Adds the results of a tile, which must be complete.
    ///
    /// # Errors
    ///
    /// [`Error::BadTile`] for missing results, incorrect use of the tile's methods, a tile of another session or an ended
    /// round, and pixels that were submitted before. [`Error::InvalidSample`] under [`InvalidSample::Fail`]. The round is
    /// then unchanged.
    pub fn submit(&self, tile: Tile<'_>) -> Result<(), Error> {
        let area = tile.area();
        let bad = |what: String| Err(Error::BadTile { area, what });
        if let Some(what) = tile.fault {
            return bad(what);
        }
        if tile.left() > 0 {
            let missing = tile.missing();
            return bad(format!(
                "results of {missing} of its samples are missing; add a result for each of Tile::samples"
            ));
        }
        if let (InvalidSample::Fail, Some((sample, value))) = (self.limits.invalid, tile.tally.first_rejected) {
            return Err(Error::InvalidSample { sample, value, points: self.points.describe() });
        }
        let mut shared = self.lock();
        let State { film, open, repeats, .. } = &mut *shared.state;
        let Some(open) = open else { return bad("its round is over; submit tiles before their round ends".into()) };
        if tile.planned.owner != std::ptr::from_ref(&*open).addr() {
            return bad("it belongs to another session; submit each tile to the round that it came from".into());
        }
        let pixels: Vec<_> = Window::new(&film.frame, &tile.film.frame).runs(1).flatten().collect();
        let all = tile.tally.total();
        let of = |counts: &[u32]| pixels.iter().map(|&i| u64::from(counts[i])).sum::<u64>();
        if open.plan.halves().map(of).sum::<u64>() != all {
            return bad("some of its pixels were submitted already; trace each pixel only once per round".into());
        }
        for counts in open.plan.halves_mut() {
            pixels.iter().for_each(|&i| counts[i] = 0);
        }
        open.submitted += all;
        repeats.add(tile.firsts);
        let retention = tile.retention;
        film.put_back(tile.film, retention);
        tile.tally.add_to(film, retention);
        Ok(())
    }

    /// Traces the rest of the round with `trace` on the current rayon thread pool, tile by tile.
    ///
    /// # Errors
    ///
    /// The errors of [`Round::submit`].
    pub fn trace<E: Into<Estimate>>(&self, trace: impl Fn(&Draws<'_>) -> E + Sync) -> Result<(), Error> {
        let areas = areas(&self.frame, self.side).into_iter();
        parallel::map_parts(areas, |area| self.trace_tile(area, &trace)).into_iter().collect()
    }

    /// Traces the rest of columns `x0..x1` and rows `y0..y1` of the full image on this thread, for renderers with their own
    /// threads and tiles.
    ///
    /// # Errors
    ///
    /// The errors of [`Round::tile`] and [`Round::submit`].
    pub fn trace_tile<E: Into<Estimate>>(
        &self,
        area: [u32; 4],
        trace: impl FnMut(&Draws<'_>) -> E,
    ) -> Result<(), Error> {
        let mut tile = self.tile(area)?;
        tile.trace(trace);
        self.submit(tile)
    }

    /// Traces the rest of the round in batches of at most `most` samples, for wavefront renderers. `trace` returns a result
    /// for each sample of a batch, in the same order.
    ///
    /// # Errors
    ///
    /// The errors of [`Round::submit`].
    pub fn trace_batches<E: Into<Estimate>, B: IntoIterator<Item = E>>(
        &self,
        most: usize,
        mut trace: impl FnMut(&[Draws<'_>]) -> B,
    ) -> Result<(), Error> {
        let mut tile = self.whole();
        let mut samples = tile.samples().peekable();
        while samples.peek().is_some() {
            let batch: Vec<_> = samples.by_ref().take(most.max(1)).collect();
            tile.add_all(&batch, trace(&batch));
        }
        self.submit(tile)
    }

    /// The image of the tiles submitted so far; see [`Session::image`](crate::Session::image). The render is not affected.
    /// A second film is in memory while the image is made.
    ///
    /// # Errors
    ///
    /// The errors of [`Filter::apply`].
    pub fn image(&self) -> Result<Filtered, Error> {
        // The filter needs threads that may wait for the lock in order to submit.
        let film = self.lock().state.film.clone();
        filled(self.filter, &film)
    }

    /// The state of the render as bytes for [`Snapshot::from_bytes`](crate::Snapshot::from_bytes), with all tiles submitted
    /// so far. A resumed render traces all other tiles again.
    pub fn snapshot(&self) -> Vec<u8> {
        let shared = self.lock();
        let (sampler, bounds) = (Planner::Saved(&self.sampler), [self.limits.min_spp, self.limits.max_spp]);
        View { state: shared.state, sampler, bounds, total: self.total, seconds: self.clock.seconds() }.write()
    }

    fn lock(&self) -> MutexGuard<'_, Shared<'s>> {
        // A panic while the lock is held can only come from a failed allocation; the film is whole before and after.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Squares of `side` pixels that cover the frame's window, row by row.
fn areas(frame: &Frame, side: u32) -> Vec<[u32; 4]> {
    let [x0, y0, x1, y1] = area(frame);
    let step = side as usize;
    let row = |y: u32| {
        (x0..x1).step_by(step).map(move |x| [x, y, x1.min(x.saturating_add(side)), y1.min(y.saturating_add(side))])
    };
    (y0..y1).step_by(step).flat_map(row).collect()
}
