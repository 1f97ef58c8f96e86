//! Samples added to a film one by one, without the render loop.

use super::{BankRows, Film, Rejected, RejectedReason, first_hits_of, record_first_hit};
use crate::{Estimate, Retention, SampleId, streams};

impl Film {
    /// Adds a kept sample to pixel `pixel` with all that its estimate reports, as a render does: radiance, emission,
    /// features or first hit, and cost. The film ignores what it does not record.
    ///
    /// An estimate without a first hit and without features is a miss: the sample saw the background. The sample's index
    /// in the stream is the pixel's count so far. NaN, infinite and negative radiances are rejected. `half` is 0 or 1; a
    /// film without halves ignores it.
    ///
    /// ```
    /// use dapple_core::{Estimate, Film, FirstHit, Frame, Needs};
    ///
    /// let mut film = Film::new(Frame::new(2, 1)?, Needs::none().with_halves().with_features());
    /// let wall = FirstHit::new([0.0, 0.0, 2.0], [0.0, 0.0, -1.0], 2.0).with_albedo([0.5; 3]);
    /// film.push_estimate(0, 0, &Estimate::new([0.3; 3]).with_first_hit(wall));
    /// film.push_estimate(0, 1, &Estimate::new([0.2; 3]).with_first_hit(wall));
    /// film.push_estimate(1, 0, &Estimate::new([1.0; 3])); // the sky
    /// assert_eq!(film.features(0).map(|f| (f.samples, f.hits, f.albedo)), Some((2, 2, [0.5; 3])));
    /// assert_eq!(film.features(1).map(|f| (f.samples, f.hits)), Some((1, 0)));
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    ///
    /// # Panics
    ///
    /// If `pixel` is outside the window.
    pub fn push_estimate(&mut self, pixel: usize, half: usize, estimate: &Estimate) {
        let half = self.half_or_whole(half);
        let rejected = self.add(Retention::Keep, half, self.held.at(pixel), estimate);
        self.list_pushed(half, pixel, rejected);
    }

    /// Adds a kept sample as [`Film::push_estimate`] does, of which only the radiance is known.
    ///
    /// Nothing is recorded of what the sample hit. Filters that read features refuse a film filled only like this.
    ///
    /// # Panics
    ///
    /// If `pixel` is outside the window.
    pub fn push(&mut self, pixel: usize, half: usize, radiance: [f32; 3]) {
        self.push_with_emission(pixel, half, radiance, [0.0; 3]);
    }

    /// Adds a kept sample as [`Film::push`] does, with the part of its radiance that light sources seen directly emit. A
    /// film without [`Needs::emission`](crate::Needs::emission) ignores that part.
    ///
    /// # Panics
    ///
    /// If `pixel` is outside the window.
    pub fn push_with_emission(&mut self, pixel: usize, half: usize, radiance: [f32; 3], emission: [f32; 3]) {
        let half = self.half_or_whole(half);
        let place = self.held.at(pixel);
        let rejected = self.kept[half].rows().add(place, &Estimate::new(radiance).with_emission(emission));
        self.record.samples += 1;
        self.unreported += 1;
        self.list_pushed(half, pixel, rejected);
    }

    /// Adds a sample at a place of the planes, with all that its estimate reports. Returns the reason if its radiance is rejected; it then counts as
    /// black, and the caller lists it.
    #[inline]
    pub(crate) fn add(
        &mut self,
        retention: Retention,
        half: usize,
        pixel: usize,
        estimate: &Estimate,
    ) -> Option<RejectedReason> {
        let rejected = self.rows(retention, half).add(pixel, estimate);
        self.record.samples += 1;
        self.record.rays += u64::from(estimate.cost);
        if self.needs.wants_first_hit() {
            let banks = if retention == Retention::Keep { &self.kept } else { &self.discarded };
            let seen = banks.iter().map(|bank| bank.next_index(pixel)).sum::<u64>() - 1;
            let places = first_hits_of(&mut self.first_hits, pixel, usize::from(self.needs.first_hits));
            let of_half = self.half_features.get_mut(2 * pixel + half);
            record_first_hit([self.features.get_mut(pixel), of_half], places, seen, estimate);
        }
        if let Some(cost) = self.costs.get_mut(pixel) {
            *cost += u64::from(estimate.cost);
        }
        rejected
    }

    /// The statistics of a half, of kept or discarded samples.
    #[inline]
    pub(crate) fn rows(&mut self, retention: Retention, half: usize) -> BankRows<'_> {
        let banks = if retention == Retention::Keep { &mut self.kept } else { &mut self.discarded };
        banks[half].rows()
    }

    /// The half to which a pushed sample belongs: 0 in a film without halves.
    fn half_or_whole(&self, half: usize) -> usize {
        if self.kept.len() == 2 { half & 1 } else { 0 }
    }

    /// Lists the pixel's last sample if it was rejected.
    fn list_pushed(&mut self, half: usize, pixel: usize, rejected: Option<RejectedReason>) {
        if let Some(reason) = rejected {
            let stream = if self.kept.len() == 2 { streams::HALVES[half] } else { streams::WHOLE };
            let sample =
                SampleId::new(self.frame.pixel(pixel), stream, self.kept[half].next_index(self.held.at(pixel)) - 1);
            self.list_rejected(1, vec![Rejected { sample, reason }]);
        }
    }
}
