//! Interpolation of the missing half in pixels whose samples all lie in one half.
//!
//! With one sample per pixel, the second half would be empty, and noise could not be told from detail. So such a pixel is
//! assigned to one half by its position, like the squares of a chessboard. Its missing half is the mean of its four neighbours
//! in that half. Both halves are then complete images, and each sample counts in only one of them. Lights keep their edges:
//! where feature-only samples saw a light, only the other light is interpolated.

#![expect(clippy::needless_range_loop, reason = "several arrays run along, as in the formulas")]

use crate::features::Features;
use crate::graph::{Graph, Reach, Rows, all};
use crate::light::{Bounds, Light};
use crate::planes::{Colours, Plane, beside, raised};

/// The factor on the squared difference of normals, in the weight of a neighbour.
const TURNED: f32 = 20.0;
/// The standard deviation of log depth between neighbours: the first number times the slope, plus the second.
const SLOPE: [f32; 2] = [4.0, 1e-2];

/// The smallest emission that counts as a light's, in units of the image's level. Less is interpolated like other light: at the
/// edge of a dim sky, each sample sees either the sky or an object in front of it.
pub(crate) const LAMP: f32 = 4.0;

/// The halves of a film's light, before their variances are known.
#[derive(Clone, Copy)]
pub(crate) struct Halves {
    pub(crate) colours: [Colours; 2],
    pub(crate) counts: [Plane; 2],
    /// The variance of one sample, where `known` is 1 (else `known` is 0).
    pub(crate) variance: Colours,
    pub(crate) known: Plane,
}

/// The features and lights of a film that interpolation uses.
#[derive(Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    pub(crate) features: Features,
    pub(crate) light: Light<'a>,
    pub(crate) bounds: Bounds,
    /// The radiance that is scaled to 1 in planes.
    pub(crate) level: f32,
}

impl Surroundings<'_> {
    fn in_levels(&self, emission: [f32; 3]) -> [f32; 3] {
        let is_lamp = emission.iter().any(|e| *e > LAMP * self.level);
        emission.map(|e| if is_lamp { e.min(self.bounds.emission as f32) / self.level } else { 0.0 })
    }

    /// The emission of pixel `j` that its neighbour `i`, whose emission is known, must not copy. It is 0 unless feature-only
    /// samples saw a light in one of the two pixels; otherwise they may have missed an edge between both.
    fn not_shared(&self, i: usize, j: usize) -> [f32; 3] {
        let is_met = [i, j].iter().any(|i| self.light.film.emission_alone(0, *i).is_some());
        if is_met { self.in_levels(self.light.mean_emission(j)) } else { [0.0; 3] }
    }
}

impl Halves {
    /// Interpolates missing halves. Also returns the equivalent sample count of each half: the mean of that many samples has
    /// the same variance as the half's colour.
    ///
    /// A completed pixel counts half of its samples in each half. Where the variance of one sample is unknown, the squared
    /// difference between the halves estimates it.
    pub(crate) fn complete<'a>(self, graph: &Graph<'a>, around: Surroundings<'a>) -> (Self, [Plane; 2]) {
        let size = graph.size;
        let ([[ra, ga, ba], [rb, gb, bb]], [na, nb], [vr, vg, vb]) = (self.colours, self.counts, self.variance);
        let own = [ra, ga, ba, rb, gb, bb, na, nb, vr, vg, vb, self.known];
        let Features { mean, slope, .. } = around.features;
        let mut reads = all(own[..8].iter().copied().chain(mean), Reach::rows(1));
        reads.extend(all(own[8..].iter().copied().chain([slope]), Reach::rows(0)));
        let planes = graph.rows(reads, move |rows, y, mut to: [&mut [f32]; 14]| {
            for (to, plane) in to.iter_mut().zip(own.into_iter().chain([na, nb])) {
                to.copy_from_slice(rows.row(plane, y));
            }
            let near = Near { halves: self, around, rows, size };
            for x in 0..size[0] {
                let i = y * size[0] + x;
                let (own, other) = (near.half(i), 1 - near.half(i));
                let [a, b] = near.counts(i);
                if (a > 0.0) == (b > 0.0) {
                    continue;
                }
                let count = a + b;
                (to[12 + own][x], to[12 + other][x]) = (count, 0.0);
                let Some((colour, of_mean)) = near.between(i, other) else { continue };
                for (c, value) in colour.into_iter().enumerate() {
                    let apart = to[3 * own + c][x] - value;
                    if to[11][x] == 0.0 {
                        to[8 + c][x] = apart * apart / (1.0 / count + 1.0 / of_mean);
                    }
                    to[3 * other + c][x] = value;
                }
                to[11][x] = 1.0;
                to[12 + other][x] = of_mean;
                (to[6][x], to[7][x]) = (0.5 * count, 0.5 * count);
            }
        });
        let [ra, ga, ba, rb, gb, bb, na, nb, vr, vg, vb, known, sa, sb] = planes;
        let halves = Self { colours: [[ra, ga, ba], [rb, gb, bb]], counts: [na, nb], variance: [vr, vg, vb], known };
        (halves, [sa, sb])
    }
}

/// The rows around a pixel.
struct Near<'a> {
    halves: Halves,
    around: Surroundings<'a>,
    rows: &'a Rows,
    size: [usize; 2],
}

impl Near<'_> {
    fn at(&self, plane: Plane, i: usize) -> f32 {
        self.rows.row(plane, i / self.size[0])[i % self.size[0]]
    }

    fn counts(&self, i: usize) -> [f32; 2] {
        self.halves.counts.map(|plane| self.at(plane, i))
    }

    /// The half to which the samples of a pixel are assigned if they all lie in one half.
    fn half(&self, i: usize) -> usize {
        (i % self.size[0] + i / self.size[0]) % 2
    }

    /// The number of samples of a pixel in a half, after this assignment.
    fn samples(&self, half: usize, i: usize) -> f32 {
        let [a, b] = self.counts(i);
        match (a > 0.0) != (b > 0.0) {
            true if self.half(i) == half => a + b,
            true => 0.0,
            false => [a, b][half],
        }
    }

    /// The mean of half `half` over the four neighbours of pixel `i`, scaled by the ratio of the albedos, and the number of
    /// samples whose mean has the same variance. `None` if the neighbours lack that half too. If the pixel's own emission is
    /// known, it replaces the neighbours' emission.
    fn between(&self, i: usize, half: usize) -> Option<([f32; 3], f32)> {
        let (around, albedo) = (&self.around, self.around.features.albedo());
        let divisor = |c: usize, i: usize| raised(self.at(albedo[c], i));
        let emission = around.light.emission_of_lacking(i).map(|emission| around.in_levels(emission));
        let (mut sum, mut weights, mut variance) = ([0.0; 3], 0.0, 0.0);
        for j in beside(i, self.size).filter(|j| self.samples(half, *j) > 0.0) {
            let weight = self.likeness(i, j);
            let lamp = if emission.is_some() { around.not_shared(i, j) } else { [0.0; 3] };
            let colour = |c: usize| self.at(self.halves.colours[half][c], j);
            (0..3).for_each(|c| sum[c] += weight * (colour(c) - lamp[c]).max(0.0) / divisor(c, j));
            weights += weight;
            variance += weight * weight / self.samples(half, j);
        }
        let own = emission.unwrap_or_default();
        let colour = [0, 1, 2].map(|c| own[c] + sum[c] / weights * divisor(c, i));
        (weights > 0.0).then_some((colour, weights * weights / variance))
    }

    /// The weight of pixel `j` for its neighbour `i`, which falls with the differences of normal and log depth.
    fn likeness(&self, i: usize, j: usize) -> f32 {
        let Features { mean, slope, .. } = self.around.features;
        let turned: f32 = (0..3).map(|k| (self.at(mean[k], i) - self.at(mean[k], j)).powi(2)).sum();
        let deep = (self.at(mean[6], i) - self.at(mean[6], j)) / (SLOPE[0] * self.at(slope, i) + SLOPE[1]);
        1.0 / (1.0 + TURNED * turned + deep * deep)
    }
}
