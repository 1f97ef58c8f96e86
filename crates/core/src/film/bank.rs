//! A bank of a film: the statistics of kept or of discarded samples, of one half or of all.

use super::{FeatureMoments, RejectedReason, SamplePlane, SampleRows, SumPlane, SumRows, reason_to_reject};
use crate::{Estimate, FirstHit, Needs, RgbMoments, SurfaceFeatures};

/// The smallest and the largest value of red, green, blue and luminance among a set of samples.
pub(crate) type Range = [[f32; 4]; 2];

/// The range of an empty set of samples.
const NOTHING: Range = [[f32::INFINITY; 4], [f32::NEG_INFINITY; 4]];

/// Relative luminance of a linear colour with Rec. 709 primaries [ITU-R BT.709].
#[inline]
pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Per-pixel statistics of one set of samples: kept in the image or discarded, in one half or all.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Bank {
    pub(crate) counts: Vec<u64>,
    pub(crate) means: Vec<[f64; 3]>,
    pub(crate) m2: Vec<[f64; 3]>,
    pub(crate) ranges: Vec<Range>,
    /// The mean emission of light sources seen directly.
    pub(crate) emission: Vec<[f32; 3]>,
    /// The means of the values beside the radiance, pixel by pixel, and their sums of squared deviations. The last three of
    /// a pixel are its indirect light, if that is recorded.
    pub(crate) channels: Vec<f32>,
    pub(crate) channels_m2: Vec<f32>,
    /// True if the indirect light is recorded.
    pub(crate) indirect: bool,
    pub(crate) sums: SumPlane,
    pub(crate) samples: SamplePlane,
    /// Per pixel, the difference between the next sample's index and the count, caused by withdrawn samples. Positive
    /// in the bank that gave samples away, negative in the bank that got them. Empty until samples are withdrawn.
    pub(crate) ahead: Vec<i64>,
}

impl Bank {
    pub(crate) fn new(pixels: usize, needs: &Needs) -> Self {
        Self {
            counts: vec![0; pixels],
            means: vec![[0.0; 3]; pixels],
            m2: if needs.variance { vec![[0.0; 3]; pixels] } else { Vec::new() },
            ranges: if needs.extrema { vec![NOTHING; pixels] } else { Vec::new() },
            emission: if needs.emission { vec![[0.0; 3]; pixels] } else { Vec::new() },
            channels: vec![0.0; pixels * needs.values()],
            channels_m2: if needs.variance { vec![0.0; pixels * needs.values()] } else { Vec::new() },
            indirect: needs.indirect,
            sums: SumPlane::new(pixels, needs.sums),
            samples: SamplePlane::new(pixels, needs),
            ahead: Vec::new(),
        }
    }

    /// Replaces the radiance by three of the channels.
    pub(super) fn take_colour(&mut self, channels: [usize; 3]) {
        let each = self.channels.len() / self.counts.len().max(1);
        let of = |plane: &[f32], i: usize| channels.map(|c| f64::from(plane[i * each + c]));
        for i in 0..self.counts.len() {
            self.means[i] = of(&self.channels, i);
            if let Some(m2) = self.m2.get_mut(i) {
                *m2 = of(&self.channels_m2, i);
            }
        }
        (self.channels, self.channels_m2) = (Vec::new(), Vec::new());
        (self.ranges, self.emission, self.indirect) = (Vec::new(), Vec::new(), false);
        (self.sums, self.samples) = (SumPlane::default(), SamplePlane::default());
    }

    pub(super) fn moments(&self, i: usize) -> RgbMoments {
        RgbMoments { count: self.counts[i], mean: self.means[i], m2: self.m2.get(i).copied().unwrap_or([f64::NAN; 3]) }
    }

    /// The index of pixel `i`'s next sample in its stream (point sequence).
    pub(crate) fn next_index(&self, i: usize) -> u64 {
        index(self.counts[i], self.ahead.get(i))
    }

    /// Moves the samples at these places from this bank's statistics to those of `other`. Neither bank reuses a sample
    /// index later.
    pub(super) fn withdraw_into(&mut self, other: &mut Self, places: &[usize]) {
        let pixels = self.counts.len();
        for bank in [&mut *self, &mut *other] {
            bank.ahead.resize(pixels, 0);
        }
        for &i in places {
            let mut moments = other.moments(i);
            let share = self.counts[i] as f32 / (self.counts[i] + moments.count).max(1) as f32;
            self.give_channels(other, i, share);
            self.sums.give(&mut other.sums, i, (self.counts[i], moments.count));
            self.samples.give(&mut other.samples, i);
            moments.merge(&self.moments(i));
            (other.counts[i], other.means[i]) = (moments.count, moments.mean);
            if let (Some(to), Some(from)) = (other.m2.get_mut(i), self.m2.get_mut(i)) {
                (*to, *from) = (moments.m2, [0.0; 3]);
            }
            if let (Some(to), Some(from)) = (other.ranges.get_mut(i), self.ranges.get_mut(i)) {
                join(to, from);
                *from = NOTHING;
            }
            if let (Some(to), Some(from)) = (other.emission.get_mut(i), self.emission.get_mut(i)) {
                (0..3).for_each(|c| to[c] += share * (from[c] - to[c]));
                *from = [0.0; 3];
            }
            let moved = self.counts[i] as i64;
            self.ahead[i] += moved;
            other.ahead[i] -= moved;
            (self.counts[i], self.means[i]) = (0, [0.0; 3]);
        }
    }

    /// Merges pixel `i`'s channels into those of `other`, in which they get the weight `share` [Chan, Golub and LeVeque 1979].
    fn give_channels(&mut self, other: &mut Self, i: usize, share: f32) {
        let each = self.channels.len() / self.counts.len().max(1);
        let before = self.counts[i] as f32 * (1.0 - share);
        for k in i * each..(i + 1) * each {
            let apart = self.channels[k] - other.channels[k];
            other.channels[k] += share * apart;
            if let (Some(to), Some(from)) = (other.channels_m2.get_mut(k), self.channels_m2.get_mut(k)) {
                *to += *from + apart * apart * before;
                *from = 0.0;
            }
            self.channels[k] = 0.0;
        }
    }
}

/// The index of a pixel's next sample in its point sequence, from the pixel's count and its entry in [`Bank::ahead`].
#[inline]
pub(crate) fn index(count: u64, ahead: Option<&i64>) -> u64 {
    count.wrapping_add_signed(ahead.copied().unwrap_or(0))
}

/// Adds a sample's emission to the mean over `count` samples, this one included. Each channel is at most the sample's
/// radiance; NaN counts as 0.
#[inline]
pub(crate) fn add_emission(mean: &mut [f32; 3], count: u64, emission: [f32; 3], radiance: [f32; 3]) {
    let share = 1.0 / count as f32;
    for c in 0..3 {
        mean[c] += (emission[c].max(0.0).min(radiance[c]) - mean[c]) * share;
    }
}

/// Extends a range to include a sample.
#[inline]
pub(crate) fn widen(range: &mut Range, radiance: [f32; 3]) {
    let [r, g, b] = radiance;
    let value = [r, g, b, luminance(radiance.map(f64::from)) as f32];
    join(range, &[value, value]);
}

/// Extends a range to include another range.
pub(super) fn join(range: &mut Range, other: &Range) {
    for c in 0..4 {
        range[0][c] = range[0][c].min(other[0][c]);
        range[1][c] = range[1][c].max(other[1][c]);
    }
}

/// The planes of a [`Bank`] over some pixels, which one task writes.
pub(crate) struct BankRows<'a> {
    pub(crate) counts: &'a mut [u64],
    pub(crate) means: &'a mut [[f64; 3]],
    pub(crate) m2: &'a mut [[f64; 3]],
    pub(crate) ranges: &'a mut [Range],
    pub(crate) emission: &'a mut [[f32; 3]],
    pub(crate) channels: &'a mut [f32],
    pub(crate) channels_m2: &'a mut [f32],
    pub(crate) indirect: bool,
    pub(crate) sums: SumRows<'a>,
    pub(crate) samples: SampleRows<'a>,
    /// Per pixel, the next sample's index minus the count ([`Bank::ahead`]); empty if no samples were withdrawn.
    pub(crate) ahead: &'a [i64],
}

impl Bank {
    /// All planes of the bank.
    pub(crate) fn rows(&mut self) -> BankRows<'_> {
        let Self { counts, means, m2, ranges, emission, channels, channels_m2, indirect, sums, samples, ahead } = self;
        let (sums, samples, indirect) = (sums.rows(), samples.rows(), *indirect);
        BankRows { counts, means, m2, ranges, emission, channels, channels_m2, indirect, sums, samples, ahead }
    }
}

impl BankRows<'_> {
    /// The index of the pixel's next sample in its stream (point sequence).
    #[inline]
    pub(crate) fn next_index(&self, local: usize) -> u64 {
        index(self.counts[local], self.ahead.get(local))
    }

    /// Adds a sample's radiance and emission. Returns the reason if it is rejected; it then counts as black.
    #[inline]
    pub(crate) fn add(&mut self, local: usize, estimate: &Estimate) -> Option<RejectedReason> {
        let reason = reason_to_reject(estimate.radiance);
        let radiance = if reason.is_some() { [0.0; 3] } else { estimate.radiance };
        self.push(local, radiance);
        if !self.samples.rows.is_empty() {
            self.samples.push(local, radiance, estimate.trajectory.as_ref());
        }
        if let Some(mean) = self.emission.get_mut(local) {
            add_emission(mean, self.counts[local], estimate.emission, radiance);
        }
        if self.indirect {
            let part = |c: usize| estimate.indirect[c].max(0.0).min(radiance[c]);
            let each = self.channels.len() / self.counts.len().max(1);
            self.add_values(local, (local + 1) * each - 3, &[part(0), part(1), part(2)]);
        }
        reason
    }

    /// Adds the channels of the sample that was added last. NaN and infinite values count as 0.
    pub(crate) fn add_channels(&mut self, local: usize, values: &[f32]) {
        let each = self.channels.len() / self.counts.len().max(1);
        let channels = if self.indirect { each - 3 } else { each };
        self.add_values(local, local * each, &values[..values.len().min(channels)]);
    }

    /// Adds values of the sample that was added last to those from place `first` of the plane.
    #[inline]
    fn add_values(&mut self, local: usize, first: usize, values: &[f32]) {
        let share = 1.0 / self.counts[local] as f32;
        for (k, &value) in (first..).zip(values) {
            let value = if value.is_finite() { value } else { 0.0 };
            let apart = value - self.channels[k];
            self.channels[k] += apart * share;
            if let Some(m2) = self.channels_m2.get_mut(k) {
                *m2 += apart * (value - self.channels[k]);
            }
        }
    }

    /// Adds a sample to the running mean and deviations [Welford 1962]; see [`RgbMoments`](crate::RgbMoments).
    #[inline]
    fn push(&mut self, local: usize, radiance: [f32; 3]) {
        self.counts[local] += 1;
        let share = 1.0 / self.counts[local] as f64;
        let mean = &mut self.means[local];
        let before = *mean;
        for c in 0..3 {
            mean[c] += (f64::from(radiance[c]) - mean[c]) * share;
        }
        if let Some(m2) = self.m2.get_mut(local) {
            for c in 0..3 {
                let x = f64::from(radiance[c]);
                m2[c] += (x - before[c]) * (x - mean[c]);
            }
        }
        if let Some(range) = self.ranges.get_mut(local) {
            widen(range, radiance);
        }
        if !self.sums.values.is_empty() {
            self.sums.push(local, self.counts[local], radiance);
        }
    }
}

/// The places for the first hits of the pixel's first `k` samples.
#[inline]
pub(crate) fn first_hits_of(hits: &mut [Option<FirstHit>], local: usize, k: usize) -> &mut [Option<FirstHit>] {
    &mut hits[local * k..(local + 1) * k]
}

/// Adds a sample to the pixel's features, and to those of its half. Stores its first hit too if `seen`, the number of the pixel's samples before it,
/// leaves a place. Outlined because most renders record no first hits.
#[inline(never)]
pub(crate) fn record_first_hit(
    features: [Option<&mut FeatureMoments>; 2],
    places: &mut [Option<FirstHit>],
    seen: u64,
    estimate: &Estimate,
) {
    // A NaN would spread through every mean, so such a hit counts as a miss.
    let hit = estimate.first_hit.as_ref().filter(|h| h.is_finite());
    for moments in features.into_iter().flatten() {
        let behind = estimate.features.filter(SurfaceFeatures::is_finite);
        moments.push(behind.or_else(|| hit.map(SurfaceFeatures::from)));
    }
    if let Some(place) = usize::try_from(seen).ok().and_then(|seen| places.get_mut(seen)) {
        *place = hit.copied();
    }
}
