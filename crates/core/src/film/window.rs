//! Parts of films: the statistics of some pixels, taken out and put back.

use super::pick::Selection;
use super::{Bank, Film, HeldRows, Rejected, Splats};
use crate::{Error, Frame, Record, Retention};
use std::ops::Range;

impl Film {
    /// A film of some rows of this film's window, with its record and their rejected samples. Discarded rounds are left out.
    ///
    /// ```
    /// use dapple_core::{Film, Frame, Needs};
    ///
    /// let mut film = Film::new(Frame::new(2, 4)?, Needs::none());
    /// film.push(5, 0, [0.5; 3]);
    /// let rows = film.of_rows(2..4)?;
    /// assert_eq!((rows.frame().size(), rows.count(1)), ([2, 2], 1));
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::BadCrop`] for no rows or rows beyond the window.
    pub fn of_rows(&self, rows: Range<u32>) -> Result<Film, Error> {
        let part = self.part(self.frame.rows(rows)?, Retention::Keep);
        let rejected = self.rejected_in(&part.frame);
        Ok(Film { record: self.record.clone(), unreported: self.unreported, rejected, ..part })
    }

    /// The rejected samples of some rows.
    pub(super) fn rejected_in(&self, rows: &Frame) -> Vec<Rejected> {
        let (first, height) = (rows.origin()[1], rows.size()[1]);
        let rejected = self.rejected.iter().filter(|r| (first..first + height).contains(&r.sample.pixel[1]));
        rejected.copied().collect()
    }

    /// A film of the part `frame` of this film's window, with the statistics that a round of this retention writes.
    pub(crate) fn part(&self, frame: Frame, retention: Retention) -> Film {
        let rows = Rows::new(&self.frame, &frame);
        let channels = self.needs.values();
        let banks = self.written(retention).iter().map(|bank| rows.bank(bank, channels)).collect();
        let (kept, discarded) = if retention == Retention::Keep { (banks, Vec::new()) } else { (Vec::new(), banks) };
        Film {
            frame,
            needs: self.needs,
            combine: self.combine,
            kept,
            discarded,
            features: rows.pick(&self.features, 1),
            half_features: rows.pick(&self.half_features, self.needs.feature_planes()),
            first_hits: rows.pick(&self.first_hits, usize::from(self.needs.first_hits)),
            costs: rows.pick(&self.costs, 1),
            splats: Splats::default(),
            rejected: Vec::new(),
            record: Record::default(),
            unreported: 0,
            half_of: self.half_of,
            held: HeldRows::default(),
        }
    }

    /// Puts back a [`Film::part`] that has gained samples, and adds its record.
    pub(crate) fn put_back(&mut self, mut part: Film, retention: Retention) {
        let rows = Rows::new(&self.frame, &part.frame);
        let (to, from) = match retention {
            Retention::Keep => (&mut self.kept, &mut part.kept),
            Retention::Discard => (&mut self.discarded, &mut part.discarded),
        };
        let each = self.needs.values();
        for (to, from) in to.iter_mut().zip(from) {
            rows.paste(&mut to.counts, &from.counts, 1);
            rows.paste(&mut to.means, &from.means, 1);
            rows.paste(&mut to.m2, &from.m2, 1);
            rows.paste(&mut to.ranges, &from.ranges, 1);
            rows.paste(&mut to.emission, &from.emission, 1);
            rows.paste(&mut to.channels, &from.channels, each);
            rows.paste(&mut to.channels_m2, &from.channels_m2, each);
            rows.paste(&mut to.sums.values, &from.sums.values, self.needs.sums.values());
            rows.give(&mut to.samples.rows, &mut from.samples.rows);
            rows.give(&mut to.samples.trajectories, &mut from.samples.trajectories);
        }
        rows.paste(&mut self.features, &part.features, 1);
        rows.paste(&mut self.half_features, &part.half_features, self.needs.feature_planes());
        rows.paste(&mut self.first_hits, &part.first_hits, usize::from(self.needs.first_hits));
        rows.paste(&mut self.costs, &part.costs, 1);
        self.record.samples += part.record.samples;
        self.record.rays += part.record.rays;
        self.record.blocks += part.record.blocks;
        self.unreported += part.unreported;
        if part.record.rejected > 0 {
            self.list_rejected(part.record.rejected, part.rejected);
        }
    }

    /// The statistics that a round of this retention writes.
    fn written(&self, retention: Retention) -> &[Bank] {
        if retention == Retention::Keep { &self.kept } else { &self.discarded }
    }
}

/// The rows of a part within the planes of a whole.
struct Rows {
    /// The index of the part's first pixel in the whole.
    first: usize,
    /// Pixels per row of the whole, and of the part.
    strides: [usize; 2],
    rows: usize,
}

impl Selection for Rows {
    fn pick<T: Clone>(&self, plane: &[T], each: usize) -> Vec<T> {
        if plane.is_empty() || each == 0 {
            return Vec::new();
        }
        let [stride, width] = self.strides;
        let row = |r: usize| (self.first + r * stride) * each;
        (0..self.rows).flat_map(|r| plane[row(r)..row(r) + width * each].iter().cloned()).collect()
    }
}

impl Rows {
    fn new(whole: &Frame, part: &Frame) -> Self {
        let [dx, dy] = [0, 1].map(|axis| (part.origin()[axis] - whole.origin()[axis]) as usize);
        let stride = whole.size()[0] as usize;
        Self { first: dy * stride + dx, strides: [stride, part.size()[0] as usize], rows: part.size()[1] as usize }
    }

    /// Moves the rows of samples of the part into a plane.
    fn give<T: Default>(&self, plane: &mut [T], part: &mut [T]) {
        let [stride, width] = self.strides;
        for (r, values) in part.chunks_exact_mut(width.max(1)).enumerate() {
            plane[self.first + r * stride..][..width]
                .iter_mut()
                .zip(values)
                .for_each(|(to, from)| *to = std::mem::take(from));
        }
    }

    /// Copies the values of the part into a plane.
    fn paste<T: Clone>(&self, plane: &mut [T], part: &[T], each: usize) {
        let [stride, width] = self.strides;
        for (r, values) in part.chunks_exact((width * each).max(1)).enumerate() {
            let first = (self.first + r * stride) * each;
            plane[first..first + width * each].clone_from_slice(values);
        }
    }
}
