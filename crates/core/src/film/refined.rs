//! Means whose emission is refined by samples of features alone.

use super::Film;
use crate::RgbMoments;

/// The mean emission of a pixel's samples of features alone, in two parts of independent samples, and their numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct EmissionAlone {
    pub(crate) samples: [u32; 2],
    pub(crate) mean: [[f32; 3]; 2],
}

impl EmissionAlone {
    /// Adds a sample to a part. Negative and infinite channels and those that are NaN count as black.
    pub(crate) fn push(&mut self, part: usize, emission: [f32; 3]) {
        self.samples[part] += 1;
        let share = 1.0 / self.samples[part] as f32;
        for (mean, value) in self.mean[part].iter_mut().zip(emission) {
            let value = if value.is_finite() { value.max(0.0) } else { 0.0 };
            *mean += (value - *mean) * share;
        }
    }

    /// Removes the samples of the other part.
    pub(crate) fn keep(&mut self, part: usize) {
        (self.samples[1 - part], self.mean[1 - part]) = (0, [0.0; 3]);
    }

    /// Number and mean of all samples.
    fn whole(&self) -> (u32, [f32; 3]) {
        let ([na, nb], [a, b]) = (self.samples, self.mean);
        let share = na as f32 / (na + nb).max(1) as f32;
        (na + nb, [0, 1, 2].map(|c| b[c] + share * (a[c] - b[c])))
    }
}

/// Refined means.
///
/// At the edge of a lamp, most of a pixel's noise is that of the lamp's share in the pixel. A sample of
/// [features alone](crate::Integrator::features_alone) knows its emission for the cost of a ray. So there the mean emission of the
/// pixel's samples of light is replaced by that of both kinds of samples. The expected value stays, since a pixel's light and
/// number of samples have no influence on its samples of features alone.
///
/// All other pixels, and films without [`Needs::emission`](crate::Needs::emission), have the plain means.
impl Film {
    /// The number and the mean emission of pixel `i`'s samples of features alone at the edge of a lamp: of half 0 or 1, or of
    /// all of them in a film without halves. `None` without such samples.
    pub fn emission_alone(&self, half: usize, i: usize) -> Option<(u32, [f32; 3])> {
        if !self.needs.emission {
            return None;
        }
        let alone = &self.beside.features.get(i)?.emission;
        let found = if self.needs.halves { (alone.samples[half & 1], alone.mean[half & 1]) } else { alone.whole() };
        (found.0 > 0).then_some(found)
    }

    /// The difference of the refined and the plain mean emission of a half, or of a film without halves.
    fn refinement(&self, half: usize, i: usize) -> Option<[f64; 3]> {
        let (samples, alone) = self.emission_alone(half, i)?;
        let (plain, count) = (self.emission(half, i)?, self.kept[half % self.kept.len()].counts[i]);
        let share = f64::from(samples) / (f64::from(samples) + count as f64);
        (count > 0).then(|| [0, 1, 2].map(|c| share * (f64::from(alone[c]) - f64::from(plain[c]))))
    }

    /// The refined mean emission of pixel `i`: of half 0 or 1, or of all samples in a film without halves. `None` without
    /// [`Needs::emission`](crate::Needs::emission).
    pub fn refined_emission(&self, half: usize, i: usize) -> Option<[f32; 3]> {
        let plain = self.emission(half, i)?;
        let Some(change) = self.refinement(half, i) else { return Some(plain) };
        Some([0, 1, 2].map(|c| (f64::from(plain[c]) + change[c]).max(0.0) as f32))
    }

    /// [`Film::half`] with the refined mean.
    pub fn refined_half(&self, half: usize, i: usize) -> Option<RgbMoments> {
        let mut moments = self.half(half, i)?;
        if let Some(change) = self.refinement(half, i) {
            moments.mean = changed(moments.mean, change);
        }
        Some(moments)
    }

    /// [`Film::mean`] with the refined mean of both halves.
    pub fn refined_mean(&self, i: usize) -> [f64; 3] {
        let first = if self.kept.len() == 2 { self.first_half_weight(i) } else { 1.0 };
        let halves = [first, 1.0 - first].into_iter().take(self.kept.len()).enumerate();
        halves.fold(self.mean(i), |mean, (half, weight)| match self.refinement(half, i) {
            Some(change) => changed(mean, change.map(|change| weight * change)),
            None => mean,
        })
    }
}

/// A sum, at least 0, since means are rounded.
fn changed(mean: [f64; 3], change: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| (mean[c] + change[c]).max(0.0))
}
