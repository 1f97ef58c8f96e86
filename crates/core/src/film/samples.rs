//! Samples kept one by one.

use super::{Bank, BankRows, Film};
use crate::{Needs, SampleId, Trajectory, streams};
use std::slice::ChunksMut;

/// The radiance of each pixel's first samples in a bank.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SamplePlane {
    /// The largest number of samples per pixel.
    pub(crate) limit: u32,
    /// The samples of each pixel in the order of tracing, as many as the pixel's count but at most `limit`. Empty if the
    /// film keeps no samples.
    pub(crate) rows: Vec<Vec<[f32; 3]>>,
    /// The trajectories of these samples. Empty if the film keeps none.
    pub(crate) trajectories: Vec<Vec<Trajectory>>,
}

impl SamplePlane {
    pub(super) fn new(pixels: usize, needs: &Needs) -> Self {
        let rows = if needs.samples > 0 { pixels } else { 0 };
        let trajectories = if needs.trajectories { rows } else { 0 };
        Self { limit: needs.samples, rows: vec![Vec::new(); rows], trajectories: vec![Vec::new(); trajectories] }
    }

    /// A plane of other pixels, made from this plane's samples and their trajectories.
    pub(crate) fn with(
        &self,
        rows: impl FnOnce(&[Vec<[f32; 3]>]) -> Vec<Vec<[f32; 3]>>,
        trajectories: impl FnOnce(&[Vec<Trajectory>]) -> Vec<Vec<Trajectory>>,
    ) -> Self {
        Self { limit: self.limit, rows: rows(&self.rows), trajectories: trajectories(&self.trajectories) }
    }

    /// Moves the samples of pixel `i` to the end of those in `other`, as far as its limit allows.
    pub(super) fn give(&mut self, other: &mut Self, i: usize) {
        move_row(&mut self.rows, &mut other.rows, i, other.limit);
        move_row(&mut self.trajectories, &mut other.trajectories, i, other.limit);
    }

    pub(crate) fn rows(&mut self) -> SampleRows<'_> {
        SampleRows { limit: self.limit, rows: &mut self.rows, trajectories: &mut self.trajectories }
    }

    fn of(&self, i: usize) -> &[[f32; 3]] {
        self.rows.get(i).map_or(&[], |row| row)
    }
}

/// Moves the row of pixel `i` to the end of that in `to`, which has at most `limit` values.
fn move_row<T>(from: &mut [Vec<T>], to: &mut [Vec<T>], i: usize, limit: u32) {
    if let (Some(from), Some(to)) = (from.get_mut(i), to.get_mut(i)) {
        let mut row = std::mem::take(from);
        row.truncate((limit as usize).saturating_sub(to.len()));
        if to.is_empty() { *to = row } else { to.append(&mut row) }
    }
}

/// The samples of some pixels, which one task writes.
pub(crate) struct SampleRows<'a> {
    pub(crate) limit: u32,
    pub(crate) rows: &'a mut [Vec<[f32; 3]>],
    pub(crate) trajectories: &'a mut [Vec<Trajectory>],
}

impl<'a> SampleRows<'a> {
    /// The next rows of both planes.
    pub(crate) fn next(
        limit: u32,
        rows: &mut ChunksMut<'a, Vec<[f32; 3]>>,
        trajectories: &mut ChunksMut<'a, Vec<Trajectory>>,
    ) -> Self {
        let (rows, trajectories) = (rows.next().unwrap_or_default(), trajectories.next().unwrap_or_default());
        Self { limit, rows, trajectories }
    }

    /// Adds a sample with its trajectory. Outlined because most films keep no samples.
    #[inline(never)]
    pub(super) fn push(&mut self, local: usize, radiance: [f32; 3], trajectory: Option<&Trajectory>) {
        let row = &mut self.rows[local];
        if row.len() < self.limit as usize {
            row.push(radiance);
            if let Some(row) = self.trajectories.get_mut(local) {
                row.push(trajectory.filter(|t| t.is_sound()).copied().unwrap_or_default());
            }
        }
    }

    fn reserve(&mut self, local: usize, more: u64) {
        if let Some(row) = self.rows.get_mut(local) {
            let room = (self.limit as usize).saturating_sub(row.len());
            let more = room.min(usize::try_from(more).unwrap_or(usize::MAX));
            row.reserve_exact(more);
            if let Some(row) = self.trajectories.get_mut(local) {
                row.reserve_exact(more);
            }
        }
    }
}

/// Makes room for `counts` more samples of a pixel, so that its rows do not grow while they are traced. `counts` are those of a
/// plan: with `None` for the second half, samples go to the half with fewer of them.
pub(crate) fn reserve_samples(banks: &mut [BankRows<'_>], local: usize, counts: (u32, Option<u32>)) {
    let (first, second) = (u64::from(counts.0), counts.1.map(u64::from));
    match banks {
        [whole] => whole.samples.reserve(local, first),
        [a, b] => {
            let (before, other) = (a.counts[local], b.counts[local]);
            let alternating = (before + other + first).div_ceil(2).clamp(before, before + first) - before;
            a.samples.reserve(local, if second.is_some() { first } else { alternating });
            b.samples.reserve(local, second.unwrap_or(first - alternating));
        }
        _ => {}
    }
}

impl Film {
    /// The radiance of the first kept samples of pixel `i` in half 0 or 1, linear RGB in the order of tracing: as many as
    /// [`Needs::samples`](crate::Needs::samples), or as the pixel has. A film without halves ignores `half`.
    ///
    /// A rejected sample is 0. Splats are not in the samples. Coordinates are not stored: a point set returns those of
    /// [`Film::sample_id`].
    ///
    /// ```
    /// use dapple_core::{Film, Frame, Needs};
    ///
    /// let mut film = Film::new(Frame::new(1, 1)?, Needs::none().with_samples(2));
    /// [1.0, f32::NAN, 3.0].map(|x| film.push(0, 0, [x; 3]));
    /// assert_eq!(film.samples(0, 0), [[1.0; 3], [0.0; 3]]);
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    pub fn samples(&self, half: usize, i: usize) -> &[[f32; 3]] {
        self.kept[half % self.kept.len()].samples.of(self.held.at(i))
    }

    /// The trajectories of the samples in [`Film::samples`], in the same order; none without
    /// [`Needs::trajectories`](crate::Needs::trajectories). Samples without one have inverse depth 0 and no motion.
    ///
    /// ```
    /// use dapple_core::{Estimate, Film, Frame, Needs, Trajectory};
    ///
    /// let mut film = Film::new(Frame::new(1, 1)?, Needs::none().with_samples(2).with_trajectories());
    /// let moving = Trajectory::new(0.5, [1.0, 0.0, 0.0]);
    /// film.push_estimate(0, 0, &Estimate::new([1.0; 3]).with_trajectory(moving));
    /// film.push_estimate(0, 0, &Estimate::new([0.0; 3]));
    /// assert_eq!(film.trajectories(0, 0), [moving, Trajectory::default()]);
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    pub fn trajectories(&self, half: usize, i: usize) -> &[Trajectory] {
        self.kept[half % self.kept.len()].samples.trajectories.get(self.held.at(i)).map_or(&[], |row| row)
    }

    /// The identity of sample `number` in [`Film::samples`]. The point set of the render returns its coordinates.
    pub fn sample_id(&self, half: usize, i: usize, number: usize) -> SampleId {
        let half = half % self.kept.len();
        let stream = match (self.kept.len(), self.half_of) {
            (1, None) => streams::WHOLE,
            (1, Some(half)) => streams::HALVES[half & 1],
            _ => streams::HALVES[half],
        };
        let withdrawn = super::bank::index(0, self.kept[half].ahead.get(self.held.at(i)));
        SampleId::new(self.frame.pixel(i), stream, withdrawn + number as u64)
    }

    /// The radiance of the first discarded samples of pixel `i` in half 0 or 1, as [`Film::samples`] returns those of kept
    /// ones. Withdrawn samples follow those that were discarded before them.
    pub fn discarded_samples(&self, half: usize, i: usize) -> &[[f32; 3]] {
        let bank: Option<&Bank> = self.discarded.get(half % self.kept.len());
        bank.map_or(&[], |bank| bank.samples.of(self.held.at(i)))
    }

    /// The number of samples that the film keeps one by one.
    pub(crate) fn samples_kept(&self) -> usize {
        let banks = self.kept.iter().chain(&self.discarded);
        banks.flat_map(|bank| &bank.samples.rows).map(Vec::len).sum()
    }
}
