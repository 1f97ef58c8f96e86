//! Pooling with neighbours weighted by the similarity of their surfaces.

use crate::Sources;
use crate::pool::{Terms, scores_by_rows};
use dapple_core::{Film, film::Features};
use std::ops::Range;

/// The number of rows in a band; surfaces are compared only within a band. Changing the number changes the bits of images.
const BAND: usize = 16;

/// The differences at which the similarity falls to a quarter: of normals, of albedos, and of depths relative to their
/// geometric mean.
const NORMAL: f32 = 0.3;
const ALBEDO: f32 = 0.1;
const DEPTH: f32 = 0.1;
/// The weight of a dissimilar neighbour. Without it, a pixel unlike all others would have no pool.
const LEAST: f64 = 0.02;
/// The weight of a neighbour in another band of rows.
const UNKNOWN: f64 = 0.5;
/// The radius of the window in which similar pixels are counted. [`STEP`] is the distance between the compared pixels.
const REACH: usize = 12;
const STEP: usize = 6;

/// The mean surface of a pixel's samples, in units of the differences above.
#[derive(Clone, Copy, Debug)]
struct Surface {
    /// Normal, albedo and two zeros (eight contiguous numbers, compared in SIMD lanes), then depth and inverse depth.
    values: [f32; 10],
    /// The variance of the means, which contributes to each squared difference.
    variance: f32,
}

impl Surface {
    /// A surface at infinity, which is unlike all others.
    const MISS: Self =
        Self { values: [1e4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0 / DEPTH, 1.0 / DEPTH], variance: 0.0 };

    fn of(f: &Features) -> Self {
        if f.hits == 0 {
            return Self::MISS;
        }
        let depth = f.depth.clamp(1e-9, 1e18);
        let variance = f.variance.map_or(0.0, |[normal, albedo, _, of_depth]| {
            let of_depth = of_depth / (depth * depth * DEPTH * DEPTH);
            normal / (NORMAL * NORMAL) + albedo / (ALBEDO * ALBEDO) + of_depth
        });
        let ([nx, ny, nz], [r, g, b]) = (f.normal.map(|n| n / NORMAL), f.albedo.map(|a| a / ALBEDO));
        let values = [nx, ny, nz, r, g, b, 0.0, 0.0, depth / DEPTH, 1.0 / (depth * DEPTH)];
        Self { values, variance: variance / f.hits as f32 }
    }

    /// The mean of surfaces; without any, a surface at infinity.
    fn mean<'a>(of: impl Iterator<Item = &'a Self>) -> Self {
        let (mut values, mut variance, mut count) = ([0.0; 10], 0.0, 0.0);
        for surface in of {
            values.iter_mut().zip(&surface.values).for_each(|(sum, value)| *sum += value);
            variance += surface.variance;
            count += 1.0;
        }
        let mean = Self { values: values.map(|sum| sum / count), variance: variance / (count * count) };
        if count > 0.0 { mean } else { Self::MISS }
    }

    /// The similarity of two surfaces: 1 if they differ by no more than their noise, approaching 0 for different ones.
    #[inline]
    fn likeness(&self, other: &Self) -> f64 {
        let [mut d @ .., _, _] = self.values;
        d.iter_mut().zip(&other.values).for_each(|(a, b)| *a = (*a - b) * (*a - b));
        let square = ((d[0] + d[4]) + (d[2] + d[6])) + ((d[1] + d[5]) + (d[3] + d[7]));
        // (a - b)^2 / (a b), with a and b the depths.
        let ([.., depth, inverse], [.., others, other_inverse]) = (self.values, other.values);
        let ratio = depth * other_inverse + others * inverse - 2.0 / (DEPTH * DEPTH);
        let excess = f64::from((square + ratio - self.variance - other.variance).max(0.0));
        1.0 / ((1.0 + excess) * (1.0 + excess))
    }
}

/// The visible surfaces in some rows of an image.
pub(crate) struct Surfaces {
    size: [usize; 2],
    first: usize,
    of: Vec<Surface>,
}

/// A function that returns the surfaces of the bands that contain given rows; `None` if features are unknown.
pub(crate) type SurfacesOfRows<'a> = dyn Fn(Range<usize>) -> Option<Surfaces> + Sync + 'a;

/// The rows of all bands that contain `rows`, in an image of `height` rows.
fn bands(rows: &Range<usize>, height: usize) -> Range<usize> {
    rows.start / BAND * BAND..rows.end.next_multiple_of(BAND).min(height)
}

impl Surfaces {
    /// The bytes for this many rows of `width` pixels, and the rest of their bands.
    pub(crate) fn bytes(width: usize, rows: usize) -> usize {
        (rows + 2 * BAND).saturating_mul(width).saturating_mul(size_of::<Surface>())
    }

    /// The surfaces of a film in the bands that contain `rows`; `None` if it records no features.
    pub(crate) fn of_rows(film: &Film, rows: Range<usize>) -> Option<Self> {
        film.features(0)?;
        let size = film.frame().size().map(|n| n as usize);
        let rows = bands(&rows, size[1]);
        let of = (rows.start * size[0]..rows.end * size[0]).map(|i| surface(film, i)).collect();
        Some(Self { size, first: rows.start, of })
    }

    fn at(&self, [x, y]: [usize; 2]) -> &Surface {
        &self.of[(y - self.first) * self.size[0] + x]
    }

    /// The surface that represents a pixel: the mean of its nearest `sources`, so that its own samples have no effect.
    fn standing(&self, [x, y]: [usize; 2], sources: Sources) -> Surface {
        let (above, left, below, right) = (y.wrapping_sub(1), x.wrapping_sub(1), y + 1, x + 1);
        let nearest = match sources {
            Sources::All => return *self.at([x, y]),
            Sources::Odd => [[x, above], [left, y], [right, y], [x, below]],
            Sources::Even => [[left, above], [right, above], [left, below], [right, below]],
        };
        let rows = self.band(y);
        let known = |[x, y]: &[usize; 2]| *x < self.size[0] && rows.contains(y);
        Surface::mean(nearest.iter().filter(|at| known(at)).map(|at| self.at(*at)))
    }

    /// The mean similarity of a pixel's surface to the surfaces of `sources` around it in its band of rows; the pixel itself
    /// counts with similarity 1.
    fn company(&self, own: &Surface, [x, y]: [usize; 2], sources: Sources) -> f64 {
        let (mut sum, mut count) = (1.0, 1.0);
        // Steps are even, so the adjacent column has the other colour.
        let beside = usize::from(sources == Sources::Odd);
        for row in steps(y, self.band(y)) {
            for column in steps(x, 0..self.size[0]).map(|column| column + beside) {
                if column < self.size[0] && [column, row] != [x, y] {
                    sum += own.likeness(self.at([column, row]));
                    count += 1.0;
                }
            }
        }
        sum / count
    }

    /// The rows of the band that contains `row`.
    fn band(&self, row: usize) -> Range<usize> {
        let first = row / BAND * BAND;
        first..(first + BAND).min(self.size[1])
    }
}

fn surface(film: &Film, i: usize) -> Surface {
    film.features(i).as_ref().map_or(Surface::MISS, Surface::of)
}

/// The similarity of the surfaces of two pixels; 1 in a film without features.
pub(crate) fn likeness(film: &Film, [a, b]: [usize; 2]) -> f64 {
    if film.needs().features { surface(film, a).likeness(&surface(film, b)) } else { 1.0 }
}

/// The numbers in a range at distances 0, [`STEP`], …, [`REACH`] from `at`, in ascending order.
fn steps(at: usize, within: Range<usize>) -> impl Iterator<Item = usize> {
    let before = (at - within.start).min(REACH) / STEP * STEP;
    (at - before..within.end.min(at + REACH + 1)).step_by(STEP)
}

/// The score of each pixel, from its own terms and the weighted sums over `sources` in a window. The window is `2 radius + 1`
/// pixels wide and high, cut off at the borders.
///
/// A neighbour's weight falls with its distance and with the difference of the surfaces. The score is divided by the square
/// root of the mean similarity to the surrounding pixels, since a filter averages over the similar ones.
pub(crate) fn over_similar(
    size: [usize; 2],
    (radius, sources): (usize, Sources),
    surfaces: &SurfacesOfRows<'_>,
    terms: impl Fn(usize) -> Terms + Sync,
    score: impl Fn(&Terms, &Terms) -> f64 + Sync,
) -> Vec<f64> {
    let window = Window::new(radius, sources);
    scores_by_rows(size, radius, terms, surfaces, |scores, y, (all, first), surfaces| {
        let at = |row: usize, column: usize| &all[(row - first) * size[0] + column];
        for (x, place) in scores.iter_mut().enumerate() {
            let known = surfaces.as_ref().map(|surfaces| (surfaces, surfaces.standing([x, y], sources)));
            let mut sums = Terms::default();
            for (row, column, near) in window.around([x, y], size) {
                let like = match &known {
                    // Surfaces are compared only within a band; all pixels of other bands have the same weight.
                    Some(_) if row / BAND != y / BAND => UNKNOWN,
                    Some((surfaces, own)) => LEAST + own.likeness(surfaces.at([column, row])),
                    None => 1.0,
                };
                sums.add_weighted(at(row, column), near * like);
            }
            let score = score(at(y, x), &sums);
            let company = known.map_or(1.0, |(surfaces, own)| surfaces.company(&own, [x, y], sources));
            *place = score / company.sqrt();
        }
    })
}

/// The pixels of a window by their offsets in rows and columns, with weights by distance.
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
    use dapple_core::{Frame, Needs, film::RgbMoments};

    const W: usize = 20;
    const H: usize = 40;

    fn wall(normal: [f32; 3], depth: f32) -> Surface {
        let [x, y, z] = normal.map(|n| n / NORMAL);
        let values = [x, y, z, 5.0, 5.0, 5.0, 0.0, 0.0, depth / DEPTH, 1.0 / (depth * DEPTH)];
        Surface { values, variance: 0.0 }
    }

    /// Three kinds of surfaces in stripes across the bands.
    fn stripes() -> Surfaces {
        let kinds = [wall([0.0, 0.0, 1.0], 2.0), wall([0.0, 1.0, 0.0], 3.0), Surface::MISS];
        let of = (0..H).flat_map(|y| (0..W).map(move |x| (x + 2 * y) / 7 % 3)).map(|kind| kinds[kind]).collect();
        Surfaces { size: [W, H], first: 0, of }
    }

    fn scores(surfaces: &Surfaces, sources: Sources) -> Vec<f64> {
        let terms = |i: usize| {
            let mut moments = RgbMoments::default();
            (moments.count, moments.mean) = (2, [i as f64; 3]);
            Terms::of(&moments, 1.0)
        };
        let score = |_: &Terms, sums: &Terms| sums.mean(0);
        let of_rows = |rows: Range<usize>| {
            let rows = bands(&rows, H);
            let of = surfaces.of[rows.start * W..rows.end * W].to_vec();
            Some(Surfaces { first: rows.start, of, ..*surfaces })
        };
        over_similar([W, H], (2, sources), &of_rows, terms, score)
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
    fn scores_depend_on_surfaces_of_their_band_alone() {
        for sources in [Sources::All, Sources::Odd, Sources::Even] {
            let mut changed = stripes();
            changed.of[16 * W..32 * W].fill(wall([1.0, 0.0, 0.0], 9.0));
            let [before, after] = [stripes(), changed].map(|surfaces| scores(&surfaces, sources));
            let differs = |row: usize| before[row * W..][..W] != after[row * W..][..W];
            assert!((0..H).all(|row| differs(row) == (16..32).contains(&row)), "{sources:?}");
        }
    }

    #[test]
    fn an_own_surface_decides_nothing_beside_other_sources() {
        let (x, y) = (9, 20);
        let mut changed = stripes();
        changed.of[y * W + x] = wall([1.0, 0.0, 0.0], 9.0);
        let differs = |sources| scores(&stripes(), sources)[y * W + x] != scores(&changed, sources)[y * W + x];
        assert!(differs(Sources::All));
        assert!(!differs(Sources::Odd) && !differs(Sources::Even));
    }

    #[test]
    fn a_film_without_features_has_no_surfaces() {
        let frame = Frame::new(4, 4).unwrap();
        assert!(Surfaces::of_rows(&Film::new(frame, Needs::none()), 1..2).is_none());
        let film = Film::new(frame, Needs::none().with_features());
        assert_eq!(Surfaces::of_rows(&film, 1..2).unwrap().of.len(), 16);
    }
}
