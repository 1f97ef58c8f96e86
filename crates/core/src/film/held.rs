//! The rows of a window that a film's planes hold.

use super::{Bank, Film};
use crate::{Frame, Needs};
use std::ops::Range;

/// The rows that the planes of a film hold: all from the top, or the own rows of one process and those around them.
///
/// Planes of some rows begin with the own ones, from the top, so that bands of 16 own rows are contiguous.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct HeldRows {
    width: usize,
    /// The place of each row of the window in the planes; [`ABSENT`] if they lack it. Empty if they hold all.
    places: Vec<u32>,
    /// The row of the window at each place.
    rows: Vec<u32>,
    /// The number of own rows.
    own: usize,
}

const ABSENT: u32 = u32::MAX;

impl HeldRows {
    /// The rows `own` of a frame's window, and the rows `around` them, both from the top.
    pub(crate) fn some(frame: &Frame, own: &[Range<usize>], around: &[usize]) -> Self {
        let [width, height] = frame.size().map(|n| n as usize);
        let rows: Vec<u32> =
            own.iter().cloned().flatten().chain(around.iter().copied()).map(|row| row as u32).collect();
        let mut places = vec![ABSENT; height];
        rows.iter().zip(0..).for_each(|(&row, place)| places[row as usize] = place);
        Self { width, places, rows, own: own.iter().map(Range::len).sum() }
    }

    /// True if the planes hold the whole window, from the top.
    pub(crate) fn is_all(&self) -> bool {
        self.places.is_empty()
    }

    /// The number of pixels in each plane.
    pub(crate) fn pixels(&self, frame: &Frame) -> usize {
        if self.is_all() { frame.pixels() } else { self.rows.len() * self.width }
    }

    /// The place in the planes of pixel `i` of the window.
    ///
    /// # Panics
    ///
    /// If the planes lack the pixel's row.
    #[inline]
    pub(crate) fn at(&self, i: usize) -> usize {
        if self.is_all() { i } else { self.place(i / self.width) * self.width + i % self.width }
    }

    /// The place of a row of the window among the rows of the planes.
    pub(super) fn place(&self, row: usize) -> usize {
        match self.places[row] {
            ABSENT => panic!("row {row} is with another process; a sampler reads Sampler::halo rows around its own"),
            place => place as usize,
        }
    }

    /// True if the planes hold pixel `i` of the window.
    pub(crate) fn has(&self, i: usize) -> bool {
        self.is_all() || self.places[i / self.width] != ABSENT
    }

    /// True if the planes hold the own rows of `other`, which holds some.
    pub(crate) fn has_own_of(&self, other: &Self) -> bool {
        self.is_all() || other.own().iter().all(|&row| self.places.get(row as usize).is_some_and(|at| *at != ABSENT))
    }

    /// The places of some pixels, by their numbers in the window.
    pub(super) fn places(&self, pixels: &[u32]) -> Vec<u32> {
        pixels.iter().map(|&i| self.at(i as usize) as u32).collect()
    }

    /// The own rows, from the top.
    pub(crate) fn own(&self) -> &[u32] {
        &self.rows[..self.own]
    }

    /// The places of the own pixels among those of whole rows.
    pub(crate) fn own_places(&self, pixels: &Range<usize>) -> Range<usize> {
        if self.is_all() {
            return pixels.clone();
        }
        let before = |i: usize| self.own().partition_point(|&row| (row as usize) < i / self.width) * self.width;
        before(pixels.start)..before(pixels.end)
    }

    /// The number in the window of the pixel at the beginning of a row in the planes.
    pub(crate) fn pixel(&self, place: usize) -> usize {
        if self.is_all() { place } else { self.rows[place / self.width] as usize * self.width }
    }

    /// The places of rows here and in `before`, of the rows that both have.
    fn shared(&self, before: &Self) -> Vec<[usize; 2]> {
        let old = |row: usize| if before.is_all() { row as u32 } else { before.places[row] };
        let rows = self.rows.iter().zip(0..).map(|(&row, place)| [place, old(row as usize) as usize]);
        rows.filter(|[_, old]| *old != ABSENT as usize).collect()
    }
}

impl Film {
    /// True if the film holds all rows of its window. A film of one process among several may hold its rows only: other
    /// pixels cannot be read.
    pub fn is_whole(&self) -> bool {
        self.held.is_all()
    }

    /// The bytes of the planes, without the samples that are kept one by one.
    pub fn bytes(&self) -> usize {
        let discarded = if self.discarded.is_empty() { 0 } else { Self::bank_bytes_per_pixel(&self.needs) };
        let splats: usize = self.splats.sums.iter().map(|plane| size_of_val(&plane[..])).sum();
        let each = Self::bytes_per_pixel(&Needs { splats: false, ..self.needs }) + discarded;
        self.held.pixels(&self.frame) * each + splats
    }

    /// Holds other rows of the window. Rows that are new have no samples.
    pub(crate) fn hold(&mut self, held: HeldRows) {
        let (needs, pixels, width) = (self.needs, held.pixels(&self.frame), held.width);
        let shared = held.shared(&self.held);
        for bank in self.kept.iter_mut().chain(&mut self.discarded) {
            let before = std::mem::replace(bank, Bank::new(pixels, &needs));
            bank.bring(&before, &shared, width, &needs);
        }
        let mut before = Self::without_planes(self.frame, needs);
        std::mem::swap(&mut before.features, &mut self.features);
        std::mem::swap(&mut before.half_features, &mut self.half_features);
        std::mem::swap(&mut before.first_hits, &mut self.first_hits);
        std::mem::swap(&mut before.costs, &mut self.costs);
        self.clear_beside(pixels);
        self.bring_beside(&before, &shared, width);
        self.held = held;
    }

    /// Copies rows of another film of the window's width, each as places here and there: the statistics that both record. This
    /// film has samples in no other bank.
    pub(super) fn bring(&mut self, from: &Self, shared: &[[usize; 2]]) {
        let (needs, width) = (self.needs, self.frame.size()[0] as usize);
        let kept = self.kept.iter_mut().zip(&from.kept);
        kept.chain(self.discarded.iter_mut().zip(&from.discarded))
            .for_each(|(to, from)| to.bring(from, shared, width, &needs));
        self.bring_beside(from, shared, width);
    }

    fn bring_beside(&mut self, from: &Self, shared: &[[usize; 2]], width: usize) {
        let needs = self.needs;
        bring(&mut self.features, &from.features, shared, width);
        bring(&mut self.half_features, &from.half_features, shared, width * needs.feature_planes());
        bring(&mut self.first_hits, &from.first_hits, shared, width * usize::from(needs.first_hits));
        bring(&mut self.costs, &from.costs, shared, width);
    }
}

impl Bank {
    /// Copies the rows of another bank, each as places here and there: the statistics that both record.
    fn bring(&mut self, from: &Self, shared: &[[usize; 2]], width: usize, needs: &Needs) {
        let wide = width * needs.values();
        bring(&mut self.counts, &from.counts, shared, width);
        bring(&mut self.means, &from.means, shared, width);
        bring(&mut self.m2, &from.m2, shared, width);
        bring(&mut self.ranges, &from.ranges, shared, width);
        bring(&mut self.emission, &from.emission, shared, width);
        bring(&mut self.channels, &from.channels, shared, wide);
        bring(&mut self.channels_m2, &from.channels_m2, shared, wide);
        bring(&mut self.sums.values, &from.sums.values, shared, width * needs.sums.values());
        bring(&mut self.samples.rows, &from.samples.rows, shared, width);
        bring(&mut self.samples.trajectories, &from.samples.trajectories, shared, width);
        if !from.ahead.is_empty() {
            self.ahead.resize(self.counts.len(), 0);
            bring(&mut self.ahead, &from.ahead, shared, width);
        }
    }
}

/// Copies rows of `each` values from a plane; none if one of the films does not record it.
fn bring<T: Clone>(to: &mut [T], from: &[T], shared: &[[usize; 2]], each: usize) {
    let both = !to.is_empty() && !from.is_empty() && each > 0;
    for [new, old] in shared.iter().filter(|_| both) {
        to[new * each..(new + 1) * each].clone_from_slice(&from[old * each..(old + 1) * each]);
    }
}
