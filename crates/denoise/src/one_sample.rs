//! Pixels whose samples all lie in one half: the other half is interpolated.
//!
//! With one sample per pixel, the second half would be empty, and nothing could tell noise from detail. So such a pixel
//! belongs to a half by its place, as the squares of a chessboard do. The half that it lacks is the mean of its four
//! neighbours there. Both halves are then whole images, and a sample counts in one of them only. Lamps end at their
//! edges: where samples of features alone have met one, only the other light comes from neighbours.

use crate::features::Features;
use crate::light::{Bounds, Light};
use crate::planes::{Colours, Plane, beside, found};

/// The factor on the squared difference of normals between neighbours.
const TURNED: f32 = 20.0;
/// The standard deviation of the log depth between neighbours: this many times its slope, plus the least value.
const SLOPE: [f32; 2] = [4.0, 1e-2];

/// The emission of a lamp, in units of the image's level. Less is light like any other: at an edge of a dim sky, what is before it
/// and the sky replace each other.
pub(crate) const LAMP: f32 = 4.0;

/// The halves of a film's light, before their variances are known.
pub(crate) struct Halves {
    pub(crate) colours: [Colours; 2],
    pub(crate) counts: [Plane; 2],
    /// The variance of one sample, where it is `known` (1, else 0).
    pub(crate) variance: Colours,
    pub(crate) known: Plane,
}

/// The features and lamps of a film, as far as filters get them.
pub(crate) struct Surroundings<'a> {
    pub(crate) features: &'a Features,
    pub(crate) light: Light<'a>,
    pub(crate) bounds: Bounds,
    /// The radiance that planes count as 1.
    pub(crate) level: f32,
    /// The size of the film.
    pub(crate) size: [usize; 2],
}

impl Surroundings<'_> {
    fn in_levels(&self, emission: [f32; 3]) -> [f32; 3] {
        let is_lamp = emission.iter().any(|e| *e > LAMP * self.level);
        emission.map(|e| if is_lamp { e.min(self.bounds.emission as f32) / self.level } else { 0.0 })
    }

    /// The emission of pixel `j` that its neighbour `i`, whose emission is known, does not share. Samples of features alone may have
    /// missed the edge of a lamp between both, unless they met it in one of them.
    fn not_shared(&self, i: usize, j: usize) -> [f32; 3] {
        let is_met = [i, j].iter().any(|i| self.light.film.emission_alone(0, *i).is_some());
        if is_met { self.in_levels(self.light.mean_emission(j)) } else { [0.0; 3] }
    }
}

/// The half that a pixel lacked.
struct Between {
    pixel: u32,
    colour: [f32; 3],
    /// The number of samples whose mean has the same variance.
    samples: f32,
}

/// The memory of [`Halves::complete`] in planes: a list, and the numbers of samples.
pub(crate) const PLANES: usize = size_of::<Between>().div_ceil(4) + 2;

impl Halves {
    /// Interpolates the half that pixels lack. Returns the number of samples whose mean has the variance of each half's
    /// colour; `None` if these are the counts, since no pixel lacks just one half.
    ///
    /// Such a pixel then counts half of its samples in each half. The squared difference between the halves estimates the
    /// variance of one sample where that is not known.
    pub(crate) fn complete(&mut self, around: &Surroundings<'_>) -> Option<[Plane; 2]> {
        let width = around.size[0];
        let is_single = |&i: &usize| (self.counts[0][i] > 0.0) != (self.counts[1][i] > 0.0);
        let half = |i: usize| (i % width + i / width) % 2;
        let pixels = 0..self.known.len();
        if !pixels.clone().any(|i| is_single(&i)) {
            return None;
        }
        let mut samples = self.counts.clone();
        for i in pixels.clone().filter(is_single) {
            let count = samples[0][i] + samples[1][i];
            (samples[half(i)][i], samples[1 - half(i)][i]) = (count, 0.0);
        }
        let between = |i: usize| self.between(i, 1 - half(i), &samples, around);
        let all = found(pixels.len(), |i| if is_single(&i) { between(i) } else { None });
        for Between { pixel, colour, samples: of_mean } in all {
            let i = pixel as usize;
            let (own, other) = (half(i), 1 - half(i));
            let count = samples[own][i];
            for (c, value) in colour.into_iter().enumerate() {
                let apart = self.colours[own][c][i] - value;
                if self.known[i] == 0.0 {
                    self.variance[c][i] = apart * apart / (1.0 / count + 1.0 / of_mean);
                }
                self.colours[other][c][i] = value;
            }
            self.known[i] = 1.0;
            samples[other][i] = of_mean;
            self.counts.iter_mut().for_each(|plane| plane[i] = 0.5 * count);
        }
        Some(samples)
    }

    /// The mean of half `half` over the four neighbours of pixel `i`, times the ratio of the albedos; `None` if they lack it
    /// too. Where the pixel's own emission is known, it takes the place of theirs. `samples` are the counts by place.
    fn between(&self, i: usize, half: usize, samples: &[Plane; 2], around: &Surroundings<'_>) -> Option<Between> {
        let Surroundings { features: f, size, .. } = *around;
        let emission = around.light.emission_of_lacking(i).map(|emission| around.in_levels(emission));
        let (mut sum, mut weights, mut variance) = ([0.0; 3], 0.0, 0.0);
        for j in beside(i, size).filter(|j| samples[half][*j] > 0.0) {
            let weight = likeness(f, i, j);
            let lamp = if emission.is_some() { around.not_shared(i, j) } else { [0.0; 3] };
            (0..3).for_each(|c| sum[c] += weight * (self.colours[half][c][j] - lamp[c]).max(0.0) / f.divisor(c, j));
            weights += weight;
            variance += weight * weight / samples[half][j];
        }
        let own = emission.unwrap_or_default();
        let colour = [0, 1, 2].map(|c| own[c] + sum[c] / weights * f.divisor(c, i));
        (weights > 0.0).then_some(Between { pixel: i as u32, colour, samples: weights * weights / variance })
    }
}

/// The weight of pixel `j` beside its neighbour `i`: it falls with the differences of normal and log depth.
fn likeness(f: &Features, i: usize, j: usize) -> f32 {
    let turned: f32 = (0..3).map(|k| (f.mean[k][i] - f.mean[k][j]).powi(2)).sum();
    let deep = (f.mean[6][i] - f.mean[6][j]) / (SLOPE[0] * f.slope[i] + SLOPE[1]);
    1.0 / (1.0 + TURNED * turned + deep * deep)
}
