//! Neighbours that count by the likeness of the surfaces they show.

use crate::Sources;
use crate::pool::{Terms, near, rows_of_task};
use dapple_core::{Features, Film, OwnRows};
use rayon::prelude::*;
use std::ops::Range;

/// The differences at which likeness falls to a quarter: of normals, of albedos, and of depths relative to their geometric
/// mean.
const NORMAL: f32 = 0.3;
const ALBEDO: f32 = 0.1;
const DEPTH: f32 = 0.1;
/// The weight of a neighbour that is not alike. Without it, a pixel that is like no other would have no pool.
const LEAST: f64 = 0.02;
/// The weight of a neighbour in another band of rows, whose surface another process may have.
const UNKNOWN: f64 = 0.5;
/// The window in which like pixels are counted: its radius, and the distance between the pixels that are compared.
const REACH: usize = 12;
const STEP: usize = 6;

/// The mean surface of a pixel's samples, in units of the differences above.
#[derive(Clone, Copy, Debug)]
struct Surface {
    /// Normal and albedo, and two zeros: eight numbers side by side are compared in SIMD lanes.
    normal_and_albedo: [f32; 8],
    depth: f32,
    inverse_depth: f32,
    /// The variance of the means, which is part of each squared difference.
    variance: f32,
}

impl Surface {
    /// A surface at infinity, which is like no other.
    const MISS: Self = Self {
        normal_and_albedo: [1e4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        depth: 1.0 / DEPTH,
        inverse_depth: 1.0 / DEPTH,
        variance: 0.0,
    };

    fn of(f: &Features) -> Self {
        if f.hits == 0 {
            return Self::MISS;
        }
        let depth = f.depth.clamp(1e-9, 1e18);
        let sum = |of: &[f32]| of.iter().sum::<f32>();
        let variance = f.variance.map_or(0.0, |v| {
            let of_depth = v[9] / (depth * depth * DEPTH * DEPTH);
            sum(&v[..3]) / (NORMAL * NORMAL) + sum(&v[3..6]) / (ALBEDO * ALBEDO) + of_depth
        });
        let ([nx, ny, nz], [r, g, b]) = (f.normal.map(|n| n / NORMAL), f.albedo.map(|a| a / ALBEDO));
        Self {
            normal_and_albedo: [nx, ny, nz, r, g, b, 0.0, 0.0],
            depth: depth / DEPTH,
            inverse_depth: 1.0 / (depth * DEPTH),
            variance: variance / f.hits as f32,
        }
    }

    /// The mean of surfaces, or one at infinity without any.
    fn mean<'a>(of: impl Iterator<Item = &'a Self>) -> Self {
        let mut mean = Self { normal_and_albedo: [0.0; 8], depth: 0.0, inverse_depth: 0.0, variance: 0.0 };
        let mut count = 0.0;
        for surface in of {
            let values = mean.normal_and_albedo.iter_mut().zip(&surface.normal_and_albedo);
            values.for_each(|(sum, value)| *sum += value);
            mean.depth += surface.depth;
            mean.inverse_depth += surface.inverse_depth;
            mean.variance += surface.variance;
            count += 1.0;
        }
        if count == 0.0 {
            return Self::MISS;
        }
        mean.normal_and_albedo.iter_mut().for_each(|value| *value /= count);
        let (depth, inverse_depth) = (mean.depth / count, mean.inverse_depth / count);
        Self { depth, inverse_depth, variance: mean.variance / (count * count), ..mean }
    }

    /// The likeness of two surfaces: 1 if they differ by no more than their noise, towards 0 for unlike ones.
    #[inline]
    fn likeness(&self, other: &Self) -> f64 {
        let mut d = self.normal_and_albedo;
        d.iter_mut().zip(&other.normal_and_albedo).for_each(|(a, b)| *a = (*a - b) * (*a - b));
        let square = ((d[0] + d[4]) + (d[2] + d[6])) + ((d[1] + d[5]) + (d[3] + d[7]));
        // (a - b)^2 / (a b), with a and b the depths.
        let ratio = self.depth * other.inverse_depth + other.depth * self.inverse_depth - 2.0 / (DEPTH * DEPTH);
        let excess = f64::from((square + ratio - self.variance - other.variance).max(0.0));
        1.0 / ((1.0 + excess) * (1.0 + excess))
    }
}

/// The surfaces that some rows of an image show.
pub(crate) struct Surfaces {
    rows: Range<usize>,
    width: usize,
    of: Vec<Surface>,
}

impl Surfaces {
    pub(crate) const BYTES: usize = size_of::<Surface>();

    /// The surfaces of some rows of a film; `None` if it records no features.
    pub(crate) fn of_rows(film: &Film, rows: Range<usize>) -> Option<Self> {
        let width = film.frame().size()[0] as usize;
        let pixels = (rows.start * width..rows.end * width).into_par_iter().with_min_len(4096);
        let of: Option<Vec<_>> = pixels.map(|i| film.features(i).as_ref().map(Surface::of)).collect();
        of.map(|of| Self { rows, width, of })
    }

    fn at(&self, [x, y]: [usize; 2]) -> &Surface {
        &self.of[(y - self.rows.start) * self.width + x]
    }

    /// The surface that stands for a pixel: the mean of its nearest `sources`, so that its own samples decide nothing.
    fn standing(&self, [x, y]: [usize; 2], sources: Sources) -> Surface {
        let (above, left, below, right) = (y.wrapping_sub(1), x.wrapping_sub(1), y + 1, x + 1);
        let nearest = match sources {
            Sources::All => return *self.at([x, y]),
            Sources::Odd => [[x, above], [left, y], [right, y], [x, below]],
            Sources::Even => [[left, above], [right, above], [left, below], [right, below]],
        };
        let rows = self.band(y);
        let known = |[x, y]: &[usize; 2]| *x < self.width && rows.contains(y);
        Surface::mean(nearest.iter().filter(|at| known(at)).map(|at| self.at(*at)))
    }

    /// The likeness of a pixel's surface and those of `sources` around it in its band of rows: the mean, with a 1 for itself.
    fn company(&self, own: &Surface, [x, y]: [usize; 2], sources: Sources) -> f64 {
        let (mut sum, mut count) = (1.0, 1.0);
        // Steps are even, so the column beside has the other colour.
        let beside = usize::from(sources == Sources::Odd);
        for row in steps(y, self.band(y)) {
            for column in steps(x, 0..self.width).map(|column| column + beside) {
                if column < self.width && [column, row] != [x, y] {
                    sum += own.likeness(self.at([column, row]));
                    count += 1.0;
                }
            }
        }
        sum / count
    }

    /// The known rows of a row's band.
    fn band(&self, row: usize) -> Range<usize> {
        let first = row / OwnRows::BAND * OwnRows::BAND;
        first..(first + OwnRows::BAND).min(self.rows.end)
    }
}

/// The numbers of a range at distances of 0, [`STEP`], …, [`REACH`] from `at`, in ascending order.
fn steps(at: usize, within: Range<usize>) -> impl Iterator<Item = usize> {
    let before = (at - within.start).min(REACH) / STEP * STEP;
    (at - before..within.end.min(at + REACH + 1)).step_by(STEP)
}

/// The score of each pixel of the rows `own`, from its own terms and the weighted sums of `sources` in a window. The
/// window is `2 radius + 1` pixels wide and high, cut off at the borders.
///
/// A neighbour's weight falls with its distance and with the difference of the surfaces. The score is divided by the root
/// of the mean likeness of the pixels around, of which a filter gathers the like ones.
pub(crate) fn over_like_windows(
    [w, h]: [usize; 2],
    own: Range<usize>,
    (radius, sources): (usize, Sources),
    surfaces: Option<&Surfaces>,
    terms: impl Fn(usize) -> Terms + Sync,
    score: impl Fn(&Terms, &Terms) -> f64 + Sync,
) -> Vec<f64> {
    let mut scores = vec![0.0; w * own.len()];
    let rows = rows_of_task(w, radius);
    let window = Window::new(radius, sources);
    scores.par_chunks_mut(rows * w.max(1)).enumerate().for_each(|(task, scores)| {
        let first = own.start + task * rows;
        let last = first + scores.len() / w - 1;
        let around = near(first, radius, h).start..near(last, radius, h).end;
        let all: Vec<Terms> = (around.start * w..around.end * w).map(&terms).collect();
        for (y, scores) in (first..).zip(scores.chunks_mut(w)) {
            for (x, place) in scores.iter_mut().enumerate() {
                let known = surfaces.map(|surfaces| (surfaces, surfaces.standing([x, y], sources)));
                let mut sums = Terms::default();
                for (row, column, near) in window.around([x, y], [w, h]) {
                    let like = match &known {
                        // A process has all rows of a band or none, and the rows of others must count alike everywhere.
                        Some(_) if row / OwnRows::BAND != y / OwnRows::BAND => UNKNOWN,
                        Some((surfaces, own)) => LEAST + own.likeness(surfaces.at([column, row])),
                        None => 1.0,
                    };
                    sums.add_weighted(&all[(row - around.start) * w + column], near * like);
                }
                let score = score(&all[(y - around.start) * w + x], &sums);
                let company = known.map_or(1.0, |(surfaces, own)| surfaces.company(&own, [x, y], sources));
                *place = score / company.sqrt();
            }
        }
    });
    scores
}

/// The pixels of a window by their offsets in rows and columns, with the weights of their distances.
struct Window(Vec<([isize; 2], f64)>);

impl Window {
    fn new(radius: usize, sources: Sources) -> Self {
        let r = radius as isize;
        let reach = ((radius + 1) * (radius + 1)) as f64;
        let offsets = (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| [dy, dx]));
        let counts = |[dy, dx]: &[isize; 2]| match sources {
            Sources::All => true,
            Sources::Odd => (dx + dy) % 2 != 0,
            Sources::Even => (dx + dy) % 2 == 0 && (*dx, *dy) != (0, 0),
        };
        let weighted = |[dy, dx]: [isize; 2]| {
            let left = (1.0 - (dx * dx + dy * dy) as f64 / reach).max(0.0);
            ([dy, dx], left * left * left)
        };
        Self(offsets.filter(counts).map(weighted).filter(|(_, weight)| *weight > 0.0).collect())
    }

    /// The row, column and weight of each pixel around `x`, `y` in an image of `w` x `h` pixels.
    fn around(&self, [x, y]: [usize; 2], [w, h]: [usize; 2]) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        self.0.iter().filter_map(move |([dy, dx], weight)| {
            let row = y.checked_add_signed(*dy).filter(|row| *row < h)?;
            let column = x.checked_add_signed(*dx).filter(|column| *column < w)?;
            Some((row, column, *weight))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::{Frame, Needs, RgbMoments};

    const W: usize = 20;
    const H: usize = 40;

    fn wall(normal: [f32; 3], depth: f32) -> Surface {
        let [x, y, z] = normal.map(|n| n / NORMAL);
        let normal_and_albedo = [x, y, z, 5.0, 5.0, 5.0, 0.0, 0.0];
        Surface { normal_and_albedo, depth: depth / DEPTH, inverse_depth: 1.0 / (depth * DEPTH), variance: 0.0 }
    }

    /// Three kinds of surfaces in stripes across the bands.
    fn stripes(rows: Range<usize>) -> Surfaces {
        let kinds = [wall([0.0, 0.0, 1.0], 2.0), wall([0.0, 1.0, 0.0], 3.0), Surface::MISS];
        let of = rows.clone().flat_map(|y| (0..W).map(move |x| (x + 2 * y) / 7 % 3)).map(|kind| kinds[kind]).collect();
        Surfaces { rows, width: W, of }
    }

    fn scores(surfaces: &Surfaces, sources: Sources) -> Vec<f64> {
        let terms = |i: usize| {
            let mut moments = RgbMoments::default();
            (moments.count, moments.mean) = (2, [i as f64; 3]);
            Terms::of(&moments, 1.0)
        };
        let score = |_: &Terms, sums: &Terms| sums.means()[0];
        over_like_windows([W, H], surfaces.rows.clone(), (2, sources), Some(surfaces), terms, score)
    }

    #[test]
    fn surfaces_are_alike_up_to_their_noise() {
        let (one, turned) = (wall([0.0, 0.0, 1.0], 2.0), wall([0.0, 0.3, 1.0], 2.0));
        assert!((one.likeness(&one) - 1.0).abs() < 1e-4, "depths are rounded");
        assert!((one.likeness(&turned) - 0.25).abs() < 1e-3, "one unit apart: 1 / (1 + 1)^2");
        assert_eq!(Surface { variance: 1.01, ..one }.likeness(&turned), 1.0);
        assert!((wall([0.0, 0.0, 1.0], 2.2).likeness(&one) - 0.275).abs() < 1e-3, "0.2^2 / (2 * 2.2) / 0.1^2 = 0.909");
        assert!(one.likeness(&Surface::MISS) < 1e-9);
        assert!(Surface::MISS.likeness(&Surface::MISS) > 0.9999);
    }

    #[test]
    fn rows_of_a_band_have_the_scores_of_the_whole_image() {
        for sources in [Sources::All, Sources::Odd, Sources::Even] {
            let (whole, band) = (scores(&stripes(0..H), sources), scores(&stripes(16..32), sources));
            assert_eq!(whole[16 * W..32 * W], band);
        }
    }

    #[test]
    fn an_own_surface_decides_nothing_beside_other_sources() {
        let (x, y) = (9, 20);
        let mut changed = stripes(0..H);
        changed.of[y * W + x] = wall([1.0, 0.0, 0.0], 9.0);
        let differs = |sources| scores(&stripes(0..H), sources)[y * W + x] != scores(&changed, sources)[y * W + x];
        assert!(differs(Sources::All));
        assert!(!differs(Sources::Odd) && !differs(Sources::Even));
    }

    #[test]
    fn a_film_without_features_has_no_surfaces() {
        let frame = Frame::new(4, 4).unwrap();
        assert!(Surfaces::of_rows(&Film::new(frame, Needs::none()), 0..4).is_none());
        let film = Film::new(frame, Needs::none().with_features());
        assert_eq!(Surfaces::of_rows(&film, 0..4).unwrap().of.len(), 16);
    }
}
