//! Pixels as means of means, over cells and boxes of growing size.

use crate::FilmPoints;
use crate::method::{FilterMethod, MethodFilter};
use crate::recorders::Singles;
use crate::tree::{Cell, Cells};
use dapple_core::{Error, Film, Filtered, parallel};
use std::array;

dapple_core::options! {
    /// The parameters of [`Staged`].
    pub struct StagedOptions {
        /// Side of the final box in pixels; at 1, each pixel uses only its own samples.
        pub width: f64 = 1.0 => "1", |width| (1.0..=8.0).contains(&width), "1 to 8 pixels";
    }
}

/// Box filters in stages, so that dense clumps of samples do not outweigh the rest of a pixel [after Mitchell 1987].
///
/// The samples in each cell of 1/8 pixel are averaged. A box of 1/4 pixel is the mean of its four cells, and a box of 1/2 pixel
/// is the mean of its four boxes of 1/4 pixel. The final box is `width` pixels wide and high, around the pixel's centre. The
/// pixel's value is the mean of the boxes of 1/2 pixel, weighted by their overlap with the final box. Cells and boxes without
/// samples are left out at each stage.
///
/// The filter works with any sampler; [`FilmPoints`] provides the coordinates. Pixels without samples in the final box are
/// black. There is no error estimate. The sides of cells and boxes are quoted from memory.
///
/// *Bias*: none at `width=1` if samples are independent and uniform in the pixel. Wider boxes blur. *Weaknesses*: for
/// well-distributed points with equal counts, the plain mean is better. A clump in one corner of a cell still dominates that
/// cell's mean.
pub type Staged = MethodFilter<StagedOptions, FilmPoints>;

/// A mean radiance; `None` without samples.
type Mean = Option<[f64; 3]>;

/// The means of a pixel's four boxes of 1/2 pixel, row by row, stored in single precision.
type HalfPixels = [Option<[f32; 3]>; 4];

/// The number of cells along each side of a pixel.
const CELLS: usize = 8;

/// The weighted mean of the means that exist.
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

/// The means of boxes of four cells each; a row has `side` boxes.
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

/// The boxes of 1/2 pixel that overlap a box of `width` pixels around pixel number `pixel`, each with its overlap. The row or
/// column has `pixels` pixels.
fn overlaps(width: f64, pixel: usize, pixels: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
    let centre = (2 * pixel + 1) as f64;
    let (low, high) = ((centre - width).max(0.0), (centre + width).min((2 * pixels) as f64));
    let overlap = move |number: usize| high.min((number + 1) as f64) - low.max(number as f64);
    (low as usize..high.ceil() as usize).map(move |number| (number, overlap(number)))
}

/// The last stage: computes pixel `i` of an image of width and height `size`.
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
