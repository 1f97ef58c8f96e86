//! The statistics of single pixels, taken out of a film and put into another.

use super::{Bank, FeatureMoments, Film, SamplePlane};
use crate::{Record, Retention};
use std::borrow::Cow;

/// Some pixels of a film, by their numbers in ascending order.
#[derive(Clone, Copy)]
pub(crate) struct Picked<'a>(pub(crate) &'a [u32]);

/// A selection of a film's pixels, which can be copied out of its planes.
pub(super) trait Selection {
    /// Copies the pixels out of a plane with `each` values per pixel; nothing if the film does not record the plane.
    fn pick<T: Clone>(&self, plane: &[T], each: usize) -> Vec<T>;

    /// The pixels of a bank whose film has `channels` values beside the radiance.
    fn bank(&self, bank: &Bank, channels: usize) -> Bank {
        Bank {
            counts: self.pick(&bank.counts, 1),
            means: self.pick(&bank.means, 1),
            m2: self.pick(&bank.m2, 1),
            ranges: self.pick(&bank.ranges, 1),
            emission: self.pick(&bank.emission, 1),
            channels: self.pick(&bank.channels, channels),
            channels_m2: self.pick(&bank.channels_m2, channels),
            indirect: bank.indirect,
            sums: bank.sums.with(|values, each| self.pick(values, each)),
            samples: bank.samples.with(|rows| self.pick(rows, 1), |paths| self.pick(paths, 1)),
            ahead: self.pick(&bank.ahead, 1),
        }
    }
}

impl Selection for Picked<'_> {
    fn pick<T: Clone>(&self, plane: &[T], each: usize) -> Vec<T> {
        if plane.is_empty() || each == 0 {
            return Vec::new();
        }
        self.0.iter().flat_map(|&i| &plane[i as usize * each..(i as usize + 1) * each]).cloned().collect()
    }
}

impl Picked<'_> {
    /// Puts values of the pixels into a plane. Returns `false` if there are too few or too many.
    fn place<T>(self, plane: &mut [T], values: Vec<T>, each: usize) -> bool {
        if plane.is_empty() || each == 0 {
            return values.is_empty();
        }
        let whole = values.len() == self.0.len() * each;
        let places = self.0.iter().flat_map(|&i| i as usize * each..(i as usize + 1) * each);
        places.zip(values).for_each(|(place, value)| plane[place] = value);
        whole
    }

    fn place_bank(self, to: &mut Bank, from: Bank, channels: usize) -> bool {
        let Bank { counts, means, m2, ranges, emission, channels: values, channels_m2, sums, samples, ahead, .. } =
            from;
        if to.ahead.is_empty() && !ahead.is_empty() {
            to.ahead.resize(to.counts.len(), 0);
        }
        let SamplePlane { limit: _, rows, trajectories } = samples;
        let each = to.sums.kinds.values();
        let placed = [
            self.place(&mut to.counts, counts, 1),
            self.place(&mut to.means, means, 1),
            self.place(&mut to.m2, m2, 1),
            self.place(&mut to.ranges, ranges, 1),
            self.place(&mut to.emission, emission, 1),
            self.place(&mut to.channels, values, channels),
            self.place(&mut to.channels_m2, channels_m2, channels),
            self.place(&mut to.sums.values, sums.values, each),
            self.place(&mut to.samples.rows, rows, 1),
            self.place(&mut to.samples.trajectories, trajectories, 1),
            ahead.is_empty() || self.place(&mut to.ahead, ahead, 1),
        ];
        placed.into_iter().all(|placed| placed)
    }
}

impl Film {
    /// A film whose planes hold only these pixels: all banks, or only those that a round of one retention writes. It has
    /// no splats, no list of rejected samples and no record.
    pub(crate) fn pick(&self, pixels: Picked<'_>, of: Option<Retention>) -> Self {
        let places = self.places(pixels);
        let pixels = Picked(&places);
        let channels = self.needs.values();
        let banks = |banks: &[Bank], retention| match of {
            Some(of) if of != retention => Vec::new(),
            _ => banks.iter().map(|bank| pixels.bank(bank, channels)).collect(),
        };
        Self {
            combine: self.combine,
            kept: banks(&self.kept, Retention::Keep),
            discarded: banks(&self.discarded, Retention::Discard),
            features: pixels.pick(&self.features, 1),
            half_features: pixels.pick(&self.half_features, self.needs.feature_planes()),
            first_hits: pixels.pick(&self.first_hits, usize::from(self.needs.first_hits)),
            costs: pixels.pick(&self.costs, 1),
            half_of: self.half_of,
            record: Record::default(),
            ..Self::without_planes(self.frame, self.needs)
        }
    }

    /// The places of pixels in the planes.
    fn places<'p>(&self, Picked(numbers): Picked<'p>) -> Cow<'p, [u32]> {
        if self.held.is_all() { numbers.into() } else { self.held.places(numbers).into() }
    }

    /// A copy of this film without the planes of its pixels.
    pub(crate) fn without_pixels(&self) -> Self {
        Self {
            record: self.record.clone(),
            rejected: self.rejected.clone(),
            splats: self.splats.clone(),
            unreported: self.unreported,
            ..self.pick(Picked(&[]), None)
        }
    }

    /// Puts the pixels of a [`Film::pick`] into this film. Returns `false` if its planes are of another size.
    pub(crate) fn place(&mut self, pixels: Picked<'_>, part: Self) -> bool {
        let places = self.places(pixels);
        let pixels = Picked(&places);
        let channels = self.needs.values();
        if !part.discarded.is_empty() {
            self.open_discarded();
        }
        let banks = self.kept.iter_mut().zip(part.kept).chain(self.discarded.iter_mut().zip(part.discarded));
        let mut whole = true;
        for (to, from) in banks {
            whole &= pixels.place_bank(to, from, channels);
        }
        let halves: Vec<FeatureMoments> = part.half_features;
        whole &= pixels.place(&mut self.features, part.features, 1);
        whole &= pixels.place(&mut self.half_features, halves, self.needs.feature_planes());
        whole &= pixels.place(&mut self.first_hits, part.first_hits, usize::from(self.needs.first_hits));
        whole & pixels.place(&mut self.costs, part.costs, 1)
    }
}
