//! Samples added to a film: by the render loop, to the planes of some pixels, or one by one.

use super::planes::{BesideRows, Half, HalfRows, NO_SURFACE, NONE_VALID, SpreadRows, is_none_valid};
use super::{FeatureMoments, Film, Rejected, RejectedReason};
use crate::recorder::{RecordedSample, Recorder};
use crate::{Estimate, FirstHit, Needs, SampleId, plan::Retention, point_set::streams};
use std::sync::Arc;

/// Relative luminance of a linear colour with Rec. 709 primaries [ITU-R BT.709].
#[inline]
pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// The planes of the pixels that one task of a round writes, for kept or for discarded samples.
pub(crate) struct Strip<'a> {
    /// The statistics of each half; the second is empty in a film without halves.
    pub(crate) halves: [HalfRows<'a>; 2],
    spread: SpreadRows<'a>,
    pub(crate) beside: BesideRows<'a>,
    /// For each half, the numbers of withdrawn samples per pixel. Their indices precede those of kept samples. Empty if
    /// none were withdrawn.
    withdrawn: [&'a [u32]; 2],
    retention: Retention,
    needs: Needs,
    recorders: &'a [Arc<dyn Recorder>],
}

impl Film {
    /// Adds a sample as [`Strip::add`] does, without the cost of making a strip for one sample.
    #[inline]
    pub(crate) fn add(
        &mut self,
        retention: Retention,
        (half, local): (usize, usize),
        estimate: &Estimate,
    ) -> Option<RejectedReason> {
        let rejected = self.add_to_half(retention, (half, local), estimate);
        let seen =
            if self.needs.has_places() { self.strip(retention).next(local).iter().sum::<u64>() - 1 } else { u64::MAX };
        self.beside.rows().add(&self.needs, (half, local), seen, estimate);
        rejected
    }

    /// Adds a sample as [`Film::add`] does, but not to the statistics in `beside`.
    fn add_to_half(
        &mut self,
        retention: Retention,
        (half, local): (usize, usize),
        estimate: &Estimate,
    ) -> Option<RejectedReason> {
        let (halves, spread) = match retention {
            Retention::Keep => (&mut self.kept, &mut self.spread),
            Retention::Discard => (&mut self.discarded, &mut self.discarded_spread),
        };
        let sum = self.needs.sum_at(half, local);
        halves[half].rows().add(local, estimate, &self.recorders.active, (&mut spread.rows(), sum))
    }

    /// The planes of all pixels that a round of this retention writes.
    pub(crate) fn strip(&mut self, retention: Retention) -> Strip<'_> {
        let (halves, spread) = match retention {
            Retention::Keep => (&mut self.kept, &mut self.spread),
            Retention::Discard => (&mut self.discarded, &mut self.discarded_spread),
        };
        let (mut halves, mut withdrawn) = (halves.iter_mut(), self.withdrawn.iter());
        Strip {
            halves: [0, 1].map(|_| halves.next().map(Half::rows).unwrap_or_default()),
            spread: spread.rows(),
            beside: self.beside.rows(),
            withdrawn: [0, 1].map(|_| withdrawn.next().map_or(&[][..], Vec::as_slice)),
            retention,
            needs: self.needs,
            recorders: &self.recorders.active,
        }
    }
}

impl Strip<'_> {
    pub(crate) fn pixels(&self) -> usize {
        self.halves[0].counts.len()
    }

    /// Splits off the first `first` pixels.
    pub(crate) fn split(self, first: usize) -> (Self, Self) {
        let pixels = self.pixels();
        let ([a, b], [na, nb]) = (self.halves, self.withdrawn);
        let ((a, a_rest), (b, b_rest)) = (a.split(first, pixels), b.split(first, pixels));
        let (spread, spread_rest) = self.spread.split(first, pixels);
        let (beside, beside_rest) = self.beside.split(first, pixels);
        let [(na, na_rest), (nb, nb_rest)] = [na, nb].map(|counts| counts.split_at(first.min(counts.len())));
        let split = Self { halves: [a, b], spread, beside, withdrawn: [na, nb], ..self };
        let (halves, withdrawn) = ([a_rest, b_rest], [na_rest, nb_rest]);
        (split, Self { halves, spread: spread_rest, beside: beside_rest, withdrawn, ..self })
    }

    /// The number of samples of each half of a pixel.
    #[inline]
    pub(crate) fn counts(&self, local: usize) -> [u64; 2] {
        [0, 1].map(|half: usize| self.halves[half].counts.get(local).map_or(0, |count| u64::from(*count)))
    }

    /// The index of a pixel's next sample in the stream of each half.
    #[inline]
    pub(crate) fn next(&self, local: usize) -> [u64; 2] {
        let (counts, is_kept) = (self.counts(local), self.retention == Retention::Keep);
        [0, 1].map(|half: usize| match self.withdrawn[half].get(local) {
            Some(withdrawn) if is_kept => counts[half] + u64::from(*withdrawn),
            Some(withdrawn) => counts[half] - u64::from(*withdrawn),
            None => counts[half],
        })
    }

    /// Adds a sample, with all that its estimate reports, to a half of pixel `local`. Returns the reason if its radiance is
    /// rejected. The sample then counts as black, and the caller lists it.
    #[inline]
    pub(crate) fn add(&mut self, half: usize, local: usize, estimate: &Estimate) -> Option<RejectedReason> {
        let sums = (&mut self.spread, self.needs.sum_at(half, local));
        let rejected = self.halves[half].add(local, estimate, self.recorders, sums);
        // Kept and discarded samples fill the places of first hits in the order of tracing. These indices give the next place,
        // as long as all rounds have the same retention, which is usual.
        let seen = if self.needs.has_places() { self.next(local).iter().sum::<u64>() - 1 } else { u64::MAX };
        self.beside.add(&self.needs, (half, local), seen, estimate);
        rejected
    }

    #[inline]
    pub(crate) fn has_recorders(&self) -> bool {
        !self.recorders.is_empty()
    }

    /// Reserves room for the recorders' words of pixel `local`, for `samples[half]` more samples in each half.
    pub(crate) fn reserve(&mut self, local: usize, samples: [u64; 2]) {
        for (planes, more) in self.halves.iter_mut().zip(samples).filter(|(planes, _)| !planes.counts.is_empty()) {
            let words = &mut planes.words[local * self.recorders.len()..][..self.recorders.len()];
            words.iter_mut().zip(self.recorders).for_each(|(words, recorder)| recorder.reserve(words, more));
        }
    }
}

impl BesideRows<'_> {
    /// Adds what a sample reports besides its radiance. `seen` is the number of samples that the pixel had before.
    #[inline]
    fn add(&mut self, needs: &Needs, (half, local): (usize, usize), seen: u64, estimate: &Estimate) {
        if needs.wants_first_hit() {
            let k = usize::from(needs.first_hits);
            let features = [self.features.get_mut(local), self.half_features.get_mut(2 * local + half)];
            record_first_hit(features, &mut self.first_hits[k * local..k * (local + 1)], seen, estimate);
            if seen == 0
                && let Some(surface) = self.surfaces.get_mut(local)
            {
                let hit = estimate.first_hit.filter(FirstHit::is_finite);
                *surface = hit.map_or(NO_SURFACE, |hit| [hit.shape, hit.primitive]);
            }
        }
        if let Some(cost) = self.costs.get_mut(local) {
            *cost += u64::from(estimate.cost);
        }
    }
}

impl HalfRows<'_> {
    /// Adds a sample to pixel `local`, and its squared deviations to `spread`. A rejected sample counts as black; the
    /// reason is returned.
    #[inline]
    pub(crate) fn add(
        &mut self,
        local: usize,
        estimate: &Estimate,
        recorders: &[Arc<dyn Recorder>],
        (spread, sum): (&mut SpreadRows<'_>, usize),
    ) -> Option<RejectedReason> {
        let reason = RejectedReason::of(estimate.radiance);
        let radiance = if reason.is_some() { [0.0; 3] } else { estimate.radiance };
        let none_valid = reason.is_some() && (self.counts[local] == 0 || is_none_valid(self.means[local]));
        self.push(local, radiance, spread.m2.get_mut(sum));
        if none_valid {
            self.means[local] = NONE_VALID;
        }
        if !recorders.is_empty() {
            self.record(local, (radiance, estimate), recorders);
        }
        // Most pixels see no lamp, and hosts may leave indirect lighting out.
        let is_some = |part: [f32; 3], mean: &[f32; 3]| part != [0.0; 3] || *mean != [0.0; 3];
        if let Some(mean) = self.emission.get_mut(local)
            && is_some(estimate.emission, mean)
        {
            add_part((mean, None), self.counts[local], estimate.emission, radiance);
        }
        if let Some(mean) = self.indirect.get_mut(local)
            && is_some(estimate.indirect, mean)
        {
            add_part((mean, spread.indirect_m2.get_mut(sum)), self.counts[local], estimate.indirect, radiance);
        }
        reason
    }

    /// Passes a sample to the recorders. Not inlined, because most films have none.
    #[inline(never)]
    fn record(&mut self, local: usize, (radiance, estimate): ([f32; 3], &Estimate), recorders: &[Arc<dyn Recorder>]) {
        let sample = RecordedSample { count: self.counts[local].into(), radiance, estimate };
        let words = &mut self.words[local * recorders.len()..][..recorders.len()];
        words.iter_mut().zip(recorders).for_each(|(words, recorder)| recorder.record(words, &sample));
    }

    /// Adds a valid sample to count, mean and squared deviations, by Welford's method.
    #[inline]
    fn push(&mut self, local: usize, radiance: [f32; 3], m2: Option<&mut [f32; 3]>) {
        let count = self.counts[local].saturating_add(1);
        self.counts[local] = count;
        let share = 1.0 / f64::from(count);
        let mean = &mut self.means[local];
        let before = *mean;
        for c in 0..3 {
            mean[c] += (f64::from(radiance[c]) - mean[c]) * share;
        }
        if let Some(m2) = m2 {
            for c in 0..3 {
                let x = f64::from(radiance[c]);
                m2[c] = with_square(m2[c], (x - before[c]) * (x - mean[c]));
            }
        }
    }
}

/// Adds `square` to a sum of squares, rounded stochastically to `f32`, so that the expected sum is exact. Rounding to nearest
/// would lose small squares: a fraction of 4e-4 in a sum of a million. A hash of the square decides the direction.
#[inline]
fn with_square(sum: f32, square: f64) -> f32 {
    /// The number of mantissa bits that `f64` has and `f32` lacks.
    const MORE: u32 = 29;
    let chance = square.to_bits().wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (64 - MORE);
    let sum = (f64::from(sum) + square).min(f64::from(f32::MAX));
    f64::from_bits((sum.to_bits() + chance) >> MORE << MORE) as f32
}

/// Adds `part` of a sample's `radiance` to its mean over `count` samples, and to the squared deviations `m2` if they are
/// recorded.
#[inline]
fn add_part((mean, mut m2): (&mut [f32; 3], Option<&mut [f32; 3]>), count: u32, part: [f32; 3], radiance: [f32; 3]) {
    let share = 1.0 / count as f32;
    for c in 0..3 {
        // A part of the radiance is at least 0, and at most the radiance.
        let part = part[c].max(0.0).min(radiance[c]);
        let apart = part - mean[c];
        mean[c] += apart * share;
        if let Some(m2) = &mut m2 {
            m2[c] = (m2[c] + apart * (part - mean[c])).min(f32::MAX);
        }
    }
}

/// Normal, albedo, position and depth in the order of [`FeatureMoments`].
#[inline]
fn values(n: &[f32; 3], a: &[f32; 3], p: &[f32; 3], depth: f32) -> [f32; 10] {
    [n[0], n[1], n[2], a[0], a[1], a[2], p[0], p[1], p[2], depth]
}

/// Records the features of a sample, and stores its first hit in `places[seen]` if that exists.
#[inline(never)]
pub(crate) fn record_first_hit(
    features: [Option<&mut FeatureMoments>; 2],
    places: &mut [Option<FirstHit>],
    seen: u64,
    estimate: &Estimate,
) {
    // A NaN would spread through every mean, so such a hit counts as a miss.
    let hit = estimate.first_hit.as_ref().filter(|h| h.is_finite());
    let behind = estimate.features.as_ref().filter(|f| f.is_finite());
    let of_hit = || hit.map(|hit| values(&hit.shading_normal, &hit.albedo, &hit.position, hit.depth));
    let seen_values = behind.map(|f| values(&f.normal, &f.albedo, &f.position, f.depth)).or_else(of_hit);
    let is_rare = behind.is_some_and(|f| f.rare);
    for moments in features.into_iter().flatten() {
        moments.push(seen_values, is_rare);
    }
    if let Some(place) = usize::try_from(seen).ok().and_then(|seen| places.get_mut(seen)) {
        *place = hit.copied();
    }
}

impl Film {
    /// Adds a kept sample to pixel `pixel` of `half` 0 or 1 (ignored by a film without halves). From `estimate`, the film
    /// takes the statistics that it records: radiance, emission, indirect lighting, features, first hit and cost.
    ///
    /// An estimate without a first hit and without features is a miss: the sample reached the background. NaN, infinite and
    /// negative radiances are rejected. The index of a listed sample is the number of samples in its pixel and half before it.
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
        let half = half % self.kept.len();
        self.record.samples += 1;
        self.record.rays += u64::from(estimate.cost);
        let rejected = self.add(Retention::Keep, (half, pixel), estimate);
        self.list_pushed(half, pixel, rejected);
    }

    /// Adds a kept sample of which only the radiance is known.
    ///
    /// Nothing is recorded about what the sample hit. Filters that read features refuse a film that has only such samples.
    ///
    /// # Panics
    ///
    /// If `pixel` is outside the window.
    pub fn push(&mut self, pixel: usize, half: usize, radiance: [f32; 3]) {
        self.push_with_emission(pixel, half, radiance, [0.0; 3]);
    }

    /// Adds a kept sample as [`Film::push`] does. `emission` is the part of `radiance` that directly visible light
    /// sources emit. A film without [`Needs::emission`](crate::Needs::emission) ignores it.
    ///
    /// # Panics
    ///
    /// If `pixel` is outside the window.
    pub fn push_with_emission(&mut self, pixel: usize, half: usize, radiance: [f32; 3], emission: [f32; 3]) {
        let half = half % self.kept.len();
        let estimate = Estimate::new(radiance).with_emission(emission);
        let rejected = self.add_to_half(Retention::Keep, (half, pixel), &estimate);
        self.record.samples += 1;
        self.unreported += 1;
        self.list_pushed(half, pixel, rejected);
    }

    /// Lists the pixel's last sample if it was rejected.
    fn list_pushed(&mut self, half: usize, pixel: usize, rejected: Option<RejectedReason>) {
        if let Some(reason) = rejected {
            let stream = if self.kept.len() == 2 { streams::HALVES[half] } else { streams::WHOLE };
            let index = self.next_index(Retention::Keep, half, pixel) - 1;
            let sample = SampleId::new(self.frame.pixel(pixel), stream, index);
            self.list_rejected(1, vec![Rejected { sample, reason }]);
        }
    }
}
