//! Pixels as means of means over ever larger cells.

use crate::FilmPoints;
use crate::method::{FilterMethod, MethodFilter};
use crate::recorders::Singles;
use crate::tree::{Cell, Cells};
use dapple_core::{Error, Film, Filtered, parallel};
use std::array;

dapple_core::options! {
    /// The parameters of [`Staged`].
    pub struct StagedOptions {
        /// Side of the last box in pixels; at 1 each pixel is made of its own samples.
        pub width: f64 = 1.0 => "1", |width| (1.0..=8.0).contains(&width), "1 to 8 pixels";
    }
}

/// Box filters in stages, in which dense clumps of samples do not outweigh the rest of a pixel [after Mitchell 1987].
///
/// The samples in each cell of 1/8 pixel are averaged. A box of 1/4 pixel is the mean of its four cells, a box of 1/2 pixel
/// that of its four boxes of 1/4. A pixel is the mean of the boxes of 1/2 pixel in the last box, by their overlap with it.
/// Cells and boxes without samples are left out at each stage. With `width` above 1 the last box reaches into neighbours.
///
/// It works on the samples of any sampler, whose coordinates come from [`FilmPoints`]. Pixels without samples in the last
/// box are black. There is no error estimate. The sides of cells and boxes are recalled.
///
/// *Bias*: none at `width=1` if samples are independent and uniform in the pixel. Wider boxes blur. *Weaknesses*: with
/// well-distributed points of equal counts, the plain mean is better. A clump in part of a cell still pulls the cell's mean.
pub type Staged = MethodFilter<StagedOptions, FilmPoints>;

/// A mean radiance; `None` without samples.
type Mean = Option<[f64; 3]>;

/// The means of a pixel's four boxes of 1/2 pixel, row by row, in the precision in which they are stored.
type HalfPixels = [Option<[f32; 3]>; 4];

/// The number of cells along each side of a pixel.
const CELLS: usize = 8;

/// The weighted mean of those means that exist.
fn mean_of(means: impl IntoIterator<Item = (f64, Mean)>) -> Mean {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for (weight, mean) in means {
        if let Some(mean) = mean {
            (0..3).for_each(|c| sum[c] += weight * mean[c]);
            weights += weight;
        }
    }
    (weights > 0.0).then(|| sum.map(|x| x / weights))
}

/// The means of the samples in each cell of a pixel, row by row.
fn cells(pixel: &Cell) -> [Mean; CELLS * CELLS] {
    let mut sums = [[0.0; 4]; CELLS * CELLS];
    for (at, value) in pixel.at.iter().zip(&pixel.values) {
        let [column, row] = [at[0], at[1]].map(|u| ((u * CELLS as f32) as usize).min(CELLS - 1));
        let sum = &mut sums[row * CELLS + column];
        (0..3).for_each(|c| sum[c] += f64::from(value[c]));
        sum[3] += 1.0;
    }
    sums.map(|[r, g, b, count]| (count > 0.0).then(|| [r, g, b].map(|x| x / count)))
}

/// The means of boxes of four cells each, `side` along a row.
fn joined<const FROM: usize, const TO: usize>(side: usize, cells: &[Mean; FROM]) -> [Mean; TO] {
    array::from_fn(|number| {
        let above = (number / side * 2) * (2 * side) + number % side * 2;
        let below = above + 2 * side;
        mean_of([above, above + 1, below, below + 1].map(|cell| (1.0, cells[cell])))
    })
}

/// The means of a pixel's four boxes of 1/2 pixel, row by row.
fn half_pixels(pixel: &Cell) -> [Mean; 4] {
    let quarters: [Mean; 16] = joined(4, &cells(pixel));
    joined(2, &quarters)
}

/// The boxes of 1/2 pixel that overlap a box of `width` pixels around pixel number `pixel` of `pixels` in a row or column,
/// each with the overlap.
fn overlaps(width: f64, pixel: usize, pixels: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
    let centre = (2 * pixel + 1) as f64;
    let (low, high) = ((centre - width).max(0.0), (centre + width).min((2 * pixels) as f64));
    let overlap = move |number: usize| high.min((number + 1) as f64) - low.max(number as f64);
    (low as usize..high.ceil() as usize).map(move |number| (number, overlap(number)))
}

/// The last stage: pixel `i` of an image of width and height `size`.
fn last_box(width: f64, all: &[HalfPixels], size: [usize; 2], i: usize) -> [f32; 3] {
    let stored = |column: usize, row: usize| {
        let of_pixel = &all[row / 2 * size[0] + column / 2];
        of_pixel[row % 2 * 2 + column % 2].map(|mean| mean.map(f64::from))
    };
    let columns = overlaps(width, i % size[0], size[0]);
    let boxes = overlaps(width, i / size[0], size[1])
        .flat_map(|(row, down)| columns.clone().map(move |(column, across)| (across * down, column, row)));
    let mean = mean_of(boxes.map(|(weight, column, row)| (weight, stored(column, row))));
    mean.map_or([0.0; 3], |mean| mean.map(|x| x as f32))
}

impl FilterMethod<FilmPoints> for StagedOptions {
    const NAME: &'static str = "staged";
    const BYTES: usize = size_of::<HalfPixels>() + 12;
    const SAMPLES: Option<Singles> = Some(Singles::All);

    fn image(&self, film: &Film, points: &FilmPoints) -> Result<Filtered, Error> {
        let (frame, samples) = (film.frame(), Singles::All.of(film, Self::NAME)?);
        let (now, domain, pixels) = (points.now(), points.domain().place(), Cells::new(frame, 1));
        let all: Vec<HalfPixels> = parallel::map(frame.pixels(), |i| {
            let mut pixel = Cell::default();
            pixels.read(i, &samples, &now, &domain, &mut pixel);
            half_pixels(&pixel).map(|mean| mean.map(|mean| mean.map(|x| x as f32)))
        });
        let size = frame.size();
        let image = |i| last_box(self.width, &all, size.map(|n| n as usize), i);
        Ok(Filtered::new(size, parallel::map(all.len(), image)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::{Made, domain, film_points, image, mean_of, render, squared_error};
    use crate::tree::At;
    use crate::{Subdivision, SubdivisionOptions};
    use dapple_core::samplers::Uniform;
    use dapple_low_discrepancy::{Random, Sobol};

    fn staged(points: FilmPoints, width: f64) -> Staged {
        Staged::new(points, StagedOptions::default().width(width)).expect("a width in range")
    }

    /// The staged mean of grey samples: places in a pixel, and values.
    fn staged_mean(samples: impl IntoIterator<Item = ([f32; 2], f32)>) -> f64 {
        let mut pixel = Cell { size: [1, 1], axes: 2, ..Cell::default() };
        for (place, value) in samples {
            let mut at = At::default();
            at[..2].copy_from_slice(&place);
            pixel.at.push(at);
            pixel.values.push([value; 3]);
        }
        super::mean_of(half_pixels(&pixel).map(|mean| (1.0, mean))).map_or(0.0, |mean| mean[0])
    }

    /// The middles of all cells of 1/`side` pixel.
    fn middles(side: usize) -> impl Iterator<Item = [f32; 2]> + Clone {
        (0..side * side).map(move |i| [i % side, i / side].map(|k| (k as f32 + 0.5) / side as f32))
    }

    #[test]
    fn a_clump_of_samples_counts_as_one_cell() {
        // The clump's place, and that of a sample of value 0 in the other box of 1/2 pixel, and so on.
        let (clump, elsewhere) = ([0.55, 0.3], middles(2).filter(|at| !(at[0] > 0.5 && at[1] < 0.5)));
        for count in [1, 2, 7, 1000] {
            let clump = (0..count).map(|k| ([clump[0] + 0.0001 * k as f32 / 2.0, clump[1]], 1.0));
            let rest = elsewhere.clone().map(|at| (at, 0.0));
            // The plain mean is count / (count + 3).
            assert_eq!(staged_mean(clump.clone().chain(rest.clone())), 0.25, "{count}");
            // Two samples in one other box of 1/4 pixel, in different cells.
            let quarter = [([0.8, 0.3], 0.0), ([0.95, 0.3], 0.0)];
            assert_eq!(staged_mean(clump.clone().chain(quarter).chain(rest.clone())), 0.125, "{count}");
            // The other three cells in the clump's box of 1/4 pixel.
            let cells = [([0.7, 0.3], 0.0), ([0.55, 0.45], 0.0), ([0.7, 0.45], 0.0)];
            assert_eq!(staged_mean(clump.chain(quarter).chain(cells).chain(rest)), 0.25 / 2.0 / 4.0, "{count}");
        }
    }

    #[test]
    fn one_sample_in_each_cell_gives_the_plain_mean() {
        let value = |at: [f32; 2]| at[0] * at[0] + 3.0 * at[1];
        for side in [1, 2, 4, 8] {
            let samples: Vec<_> = middles(side).map(|at| (at, value(at))).collect();
            let plain = samples.iter().map(|x| f64::from(x.1)).sum::<f64>() / samples.len() as f64;
            let found = staged_mean(samples);
            assert!((found - plain).abs() < 1e-14 * plain, "{side}: {found}, not {plain}");
        }
        assert_eq!(staged_mean([]), 0.0);
    }

    #[test]
    fn wider_boxes_count_neighbours_by_their_overlap() {
        // Pixels of the values 0, 1, 4 and 9, with samples in each box of 1/2 pixel.
        let film = render(|at, _| at[0].floor() * at[0].floor(), &mut Uniform::new(Sobol::new(5)), [4, 1], 16.0);
        for (width, expected) in [
            (1.0, [0.0, 1.0, 4.0, 9.0]),
            (1.5, [0.5 / 2.5, 4.0 / 3.0, (0.5 + 8.0 + 4.5) / 3.0, (2.0 + 18.0) / 2.5]),
            (2.0, [1.0 / 3.0, 1.5, 4.5, 22.0 / 3.0]),
            (3.0, [0.5, 5.0 / 3.0, 14.0 / 3.0, 6.5]),
        ] {
            let image = image(&staged(film_points(Sobol::new(5), &[], None), width), &film);
            for (found, expected) in image.iter().zip(expected) {
                assert!((f64::from(found[0]) - expected).abs() < 1e-5, "{width}: {image:?}");
            }
        }
    }

    const EDGE: Made = |at, _| f32::from(u8::from(at[0].fract() < 0.2));

    /// A false alarm at five standard errors has a probability of 6e-7.
    #[test]
    fn independent_samples_have_no_bias() {
        let film = render(EDGE, &mut Uniform::new(Random::new(6)), [64; 2], 6.0);
        let image = image(&staged(film_points(Random::new(6), &[], None), 1.0), &film);
        let mean = mean_of(&image);
        let error = (squared_error(&image, |_| mean) / 4095.0).sqrt();
        let off = |truth: f64| (mean - truth).abs() / error;
        assert!(off(0.2) < 5.0 && off(0.23) > 5.0 && off(0.17) > 5.0, "{mean} with an error of {error}");
    }

    #[test]
    fn samples_placed_at_an_edge_count_less_than_in_the_plain_mean() {
        let mut sampler = Subdivision::new(Sobol::new(4), &domain(&[]), SubdivisionOptions::default()).expect("axes");
        let filter = staged(film_points(Sobol::new(4), &[], Some(sampler.placed())), 1.0);
        let film = render(EDGE, &mut sampler, [8, 8], 200.0);
        let [plain, staged] = [film.image(), image(&filter, &film)].map(|image| squared_error(&image, |_| 0.2));
        assert!(plain > 0.01 && staged < 0.01 * plain, "{plain} and {staged}");
    }
}
