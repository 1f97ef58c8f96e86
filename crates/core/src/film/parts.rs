//! Parts of films: some rows, a tile, one half.

use super::planes::Window;
use super::{Beside, Film, Rejected};
use crate::film::Features;
use crate::{Combine, Error, Frame, Needs, Record, Retention, streams};
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
    fn rejected_in(&self, rows: &Frame) -> Vec<Rejected> {
        let (first, height) = (rows.origin()[1], rows.size()[1]);
        let rejected = self.rejected.iter().filter(|r| (first..first + height).contains(&r.sample.pixel[1]));
        rejected.copied().collect()
    }

    /// A film of the part `frame` of this film's window, with the statistics that a round of this retention reads and writes.
    pub(crate) fn part(&self, frame: Frame, retention: Retention) -> Film {
        let window = Window::new(&self.frame, &frame);
        let cut = |banks: &[_], wanted: bool| match wanted {
            true => banks.iter().map(|bank: &super::Bank| bank.cut(&window)).collect(),
            false => Vec::new(),
        };
        Film {
            combine: self.combine,
            kept: cut(&self.kept, retention == Retention::Keep),
            discarded: cut(&self.discarded, retention == Retention::Discard),
            withdrawn: self.withdrawn.iter().map(|withdrawn| window.cut(withdrawn)).collect(),
            beside: self.beside.cut(&window),
            recorders: self.recorders.clone(),
            half_of: self.half_of,
            ..Self::without_planes(frame, self.needs)
        }
    }

    /// Puts back a [`Film::part`] that has gained samples, and adds its record.
    pub(crate) fn put_back(&mut self, part: Film, retention: Retention) {
        let window = Window::new(&self.frame, &part.frame);
        let (to, from) = match retention {
            Retention::Keep => (&mut self.kept, part.kept),
            Retention::Discard => (&mut self.discarded, part.discarded),
        };
        to.iter_mut().zip(from).for_each(|(to, from)| to.paste(&window, from));
        self.beside.paste(&window, part.beside);
        self.record.samples += part.record.samples;
        self.record.rays += part.record.rays;
        self.record.blocks += part.record.blocks;
        self.unreported += part.unreported;
        if part.record.rejected > 0 {
            self.list_rejected(part.record.rejected, part.rejected);
        }
    }

    /// Mean and variance of the features of pixel `i`'s samples in half 0 or 1; `None` without
    /// [`Needs::feature_halves`].
    pub fn half_features(&self, half: usize, i: usize) -> Option<Features> {
        self.beside.half_features.get(2 * i + (half & 1)).map(Into::into)
    }

    /// The samples of half 0 or 1 as a film without halves, so that a filter can be applied to one half alone.
    ///
    /// Counts, moments, emission, words of recorders, splats and discarded samples are those of the half. So are
    /// features if the film records them [per half](Needs::feature_halves); else they are those of both halves, as first
    /// hits always are. [Emission alone](Film::emission_alone) is that of the half. Costs and the record of rounds are left
    /// out. A filter that needs halves refuses the film.
    ///
    /// The film takes [`Film::bytes_per_pixel`] of its own [`Needs`].
    ///
    /// ```
    /// use dapple_core::{Film, Frame, Needs};
    ///
    /// let mut film = Film::new(Frame::new(1, 1)?, Needs::none().with_halves());
    /// film.push(0, 0, [1.0; 3]);
    /// film.push(0, 1, [4.0; 3]);
    /// film.push(0, 1, [2.0; 3]);
    /// let second = film.half_film(1)?;
    /// assert_eq!((second.count(0), second.mean(0)), (2, [3.0; 3]));
    /// assert!(!second.needs().halves);
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::NotRecorded`] for a film without halves.
    pub fn half_film(&self, half: usize) -> Result<Self, Error> {
        if self.kept.len() != 2 {
            return Err(Error::NotRecorded { who: "half_film".into(), what: "independent halves" });
        }
        let half = half & 1;
        let kept = vec![self.kept[half].clone()];
        let discarded: Vec<_> = self.discarded.get(half).cloned().into_iter().collect();
        let mut features = match self.beside.half_features.as_chunks().0 {
            [] => self.beside.features.clone(),
            pairs => pairs.iter().map(|pair: &[_; 2]| pair[half]).collect(),
        };
        features.iter_mut().for_each(|f| f.emission.keep(half));
        let own = [streams::HALVES[half], streams::DISCARDED_HALVES[half]];
        let rejected: Vec<_> = self.rejected.iter().filter(|r| own.contains(&r.sample.stream)).copied().collect();
        let samples = kept.iter().chain(&discarded).flat_map(|bank| &bank.counts).sum();
        Ok(Self {
            combine: Combine::ByCount,
            kept,
            discarded,
            withdrawn: self.withdrawn.get(half).cloned().into_iter().collect(),
            beside: Beside { features, first_hits: self.beside.first_hits.clone(), ..Beside::default() },
            recorders: self.recorders.clone(),
            splats: self.splats.half(half),
            // Of samples that report no hits, only whether all are such is read.
            unreported: if self.unreported < self.record.samples { 0 } else { samples },
            record: Record { samples, rejected: rejected.len() as u64, ..Record::default() },
            rejected,
            half_of: Some(half),
            ..Self::without_planes(
                self.frame,
                Needs { halves: false, feature_halves: false, cost: false, ..self.needs },
            )
        })
    }
}
