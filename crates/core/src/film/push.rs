//! Samples added to a film one by one, without the render loop.

use super::{Film, Rejected, add_emission, reason_to_reject, record_first_hit, widen};
use crate::{Estimate, SampleId, streams};

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
        let seen: u64 = self.kept.iter().map(|bank| bank.next_index(pixel)).sum();
        self.add(pixel, half, estimate);
        let k = usize::from(self.needs.first_hits);
        let places = &mut self.first_hits[pixel * k..(pixel + 1) * k];
        record_first_hit(self.features.get_mut(pixel), places, seen, estimate);
        self.record.rays += u64::from(estimate.cost);
        if let Some(cost) = self.costs.get_mut(pixel) {
            *cost += u64::from(estimate.cost);
        }
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
        self.add(pixel, half, &Estimate::new(radiance).with_emission(emission));
        self.radiance_only += 1;
    }

    /// Adds a sample's radiance and emission.
    fn add(&mut self, pixel: usize, half: usize, estimate: &Estimate) {
        let halves = self.kept.len() == 2;
        let half = if halves { half & 1 } else { 0 };
        let bank = &mut self.kept[half];
        let index = bank.next_index(pixel);
        let reason = reason_to_reject(estimate.radiance);
        let radiance = if reason.is_some() { [0.0; 3] } else { estimate.radiance };
        let mut moments = bank.moments(pixel);
        moments.push(radiance);
        bank.counts[pixel] = moments.count;
        bank.means[pixel] = moments.mean;
        if let Some(m2) = bank.m2.get_mut(pixel) {
            *m2 = moments.m2;
        }
        if let Some(range) = bank.ranges.get_mut(pixel) {
            widen(range, radiance);
        }
        if let Some(mean) = bank.emission.get_mut(pixel) {
            add_emission(mean, moments.count, estimate.emission, radiance);
        }
        self.record.samples += 1;
        if let Some(reason) = reason {
            let stream = if halves { streams::HALVES[half] } else { streams::WHOLE };
            let sample = SampleId { pixel: self.frame.pixel(pixel), stream, index };
            self.list_rejected(1, vec![Rejected { sample, reason }]);
        }
    }
}
