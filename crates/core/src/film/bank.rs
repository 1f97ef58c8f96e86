//! A bank of a film: the statistics of kept or of discarded samples, of one half or of all.

use crate::{Needs, RgbMoments};

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
    /// Per pixel, the difference between the next sample's index and the count, caused by withdrawn samples. Positive
    /// in the bank that gave samples away, negative in the bank that got them. Empty until samples are withdrawn.
    pub(crate) ahead: Vec<i64>,
}

impl Bank {
    pub(super) fn new(pixels: usize, needs: &Needs) -> Self {
        Self {
            counts: vec![0; pixels],
            means: vec![[0.0; 3]; pixels],
            m2: if needs.variance { vec![[0.0; 3]; pixels] } else { Vec::new() },
            ranges: if needs.extrema { vec![NOTHING; pixels] } else { Vec::new() },
            emission: if needs.emission { vec![[0.0; 3]; pixels] } else { Vec::new() },
            ahead: Vec::new(),
        }
    }

    pub(super) fn moments(&self, i: usize) -> RgbMoments {
        RgbMoments { count: self.counts[i], mean: self.means[i], m2: self.m2.get(i).copied().unwrap_or([f64::NAN; 3]) }
    }

    /// The index of pixel `i`'s next sample in its stream (point sequence).
    pub(crate) fn next_index(&self, i: usize) -> u64 {
        index(self.counts[i], self.ahead.get(i))
    }

    /// Moves the samples of the pixels marked in `withdrawn` from this bank's statistics to those of `other`. Neither
    /// bank reuses a sample index later.
    pub(super) fn withdraw_into(&mut self, other: &mut Self, withdrawn: &[bool]) {
        let pixels = self.counts.len();
        for bank in [&mut *self, &mut *other] {
            bank.ahead.resize(pixels, 0);
        }
        for i in (0..pixels).filter(|&i| withdrawn[i]) {
            let mut moments = other.moments(i);
            let share = self.counts[i] as f32 / (self.counts[i] + moments.count).max(1) as f32;
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
