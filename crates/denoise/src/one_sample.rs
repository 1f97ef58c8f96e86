//! Pixels whose samples all lie in one half: the other half is interpolated.
//!
//! With one sample per pixel, the second half would be empty, and nothing could tell noise from detail. So such a pixel
//! belongs to a half by its place, as the squares of a chessboard do. The half that it lacks is the mean of its four
//! neighbours there. Both halves are then whole images, and a sample counts in one of them only. Lamps end at their
//! edges: where samples of features alone have met one, only the other light comes from neighbours.

#![expect(clippy::needless_range_loop, reason = "several arrays run along, as in the formulas")]

use crate::features::Features;
use crate::graph::{Graph, Reach, Rows, all};
use crate::light::{Bounds, Light};
use crate::planes::{Colours, Plane, beside, raised};

/// The factor on the squared difference of normals between neighbours.
const TURNED: f32 = 20.0;
/// The standard deviation of the log depth between neighbours: this many times its slope, plus the least value.
const SLOPE: [f32; 2] = [4.0, 1e-2];

/// The emission of a lamp, in units of the image's level. Less is light like any other: at an edge of a dim sky, what is before it
/// and the sky replace each other.
pub(crate) const LAMP: f32 = 4.0;

/// The halves of a film's light, before their variances are known.
#[derive(Clone, Copy)]
pub(crate) struct Halves {
    pub(crate) colours: [Colours; 2],
    pub(crate) counts: [Plane; 2],
    /// The variance of one sample, where it is `known` (1, else 0).
    pub(crate) variance: Colours,
    pub(crate) known: Plane,
}

/// The features and lamps of a film, as far as filters get them.
#[derive(Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    pub(crate) features: Features,
    pub(crate) light: Light<'a>,
    pub(crate) bounds: Bounds,
    /// The radiance that planes count as 1.
    pub(crate) level: f32,
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

impl Halves {
    /// Interpolates the half that pixels lack. Returns the number of samples whose mean has the variance of each half's colour, too.
    ///
    /// Such a pixel then counts half of its samples in each half. The squared difference between the halves estimates the
    /// variance of one sample where that is not known.
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

    /// The half that the samples of a pixel count in, if they all lie in one.
    fn half(&self, i: usize) -> usize {
        (i % self.size[0] + i / self.size[0]) % 2
    }

    /// The number of samples of a pixel by its place.
    fn samples(&self, half: usize, i: usize) -> f32 {
        let [a, b] = self.counts(i);
        match (a > 0.0) != (b > 0.0) {
            true if self.half(i) == half => a + b,
            true => 0.0,
            false => [a, b][half],
        }
    }

    /// The mean of half `half` over the four neighbours of pixel `i`, times the ratio of the albedos, and the number of samples whose
    /// mean has the same variance; `None` if they lack it too. Where the pixel's own emission is known, it takes the place of theirs.
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

    /// The weight of pixel `j` beside its neighbour `i`: it falls with the differences of normal and log depth.
    fn likeness(&self, i: usize, j: usize) -> f32 {
        let Features { mean, slope, .. } = self.around.features;
        let turned: f32 = (0..3).map(|k| (self.at(mean[k], i) - self.at(mean[k], j)).powi(2)).sum();
        let deep = (self.at(mean[6], i) - self.at(mean[6], j)) / (SLOPE[0] * self.at(slope, i) + SLOPE[1]);
        1.0 / (1.0 + TURNED * turned + deep * deep)
    }
}
