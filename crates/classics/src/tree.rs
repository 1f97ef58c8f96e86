//! Division of the samples of a few pixels into boxes, in the dimensions of a [`Domain`].
//!
//! A cell is a square of pixels; its box spans these pixels and the whole range of all other axes. A [`Division`] cuts the box
//! until it returns no more cuts. Nothing is kept from round to round: the boxes depend only on the samples.

mod planner;

pub use planner::{Refinement, TreeSampler};

use crate::recorders::{FilmSamples, Singles};
use crate::{Domain, FilmPoints};
use dapple_core::point_set::{mix, streams};
use dapple_core::{Error, Film, Filtered, Frame, PointSet, SampleId, parallel};

/// The coordinates of a sample: the position in pixels from the cell's corner, then the other axes in `[0, 1)`.
pub(crate) type At = [f32; Domain::MOST];

/// The indices of some samples of a cell.
pub(crate) type Items = [u32];

/// The samples in a square of pixels (a cell).
#[derive(Default)]
pub struct Cell {
    pub(crate) at: Vec<At>,
    pub(crate) values: Vec<[f32; 3]>,
    /// The numbers of columns and rows of pixels.
    pub(crate) size: [u32; 2],
    /// The column and row of the cell's first pixel in the window.
    pub(crate) corner: [u32; 2],
    /// The number of axes.
    pub(crate) axes: usize,
}

/// The cells of a window, of `side` x `side` pixels each; those at the right and bottom borders may be smaller.
#[derive(Clone, Copy)]
pub(crate) struct Cells {
    side: u32,
    window: [u32; 2],
}

impl Cells {
    pub(crate) fn new(frame: &Frame, side: u32) -> Self {
        Self { side, window: frame.size() }
    }

    pub(crate) fn count(&self) -> usize {
        self.window.map(|n| n.div_ceil(self.side) as usize).iter().product()
    }

    /// The first pixel of cell `number`, and the cell's numbers of columns and rows.
    fn area(&self, number: usize) -> ([u32; 2], [u32; 2]) {
        let columns = self.window[0].div_ceil(self.side) as usize;
        let corner = [(number % columns) as u32 * self.side, (number / columns) as u32 * self.side];
        (corner, [0, 1].map(|axis| self.side.min(self.window[axis] - corner[axis])))
    }

    /// The pixels of cell `number`, by their index in the window.
    pub(crate) fn pixels(&self, number: usize) -> impl Iterator<Item = usize> + use<> {
        let ([x0, y0], [columns, rows]) = self.area(number);
        let width = self.window[0] as usize;
        (0..rows).flat_map(move |y| (0..columns).map(move |x| (y0 + y) as usize * width + (x0 + x) as usize))
    }

    /// Reads the samples of cell `number`, pixel by pixel, into `cell`.
    pub(crate) fn read(
        &self,
        number: usize,
        samples: &FilmSamples<'_>,
        points: &dyn PointSet,
        domain: &Domain,
        cell: &mut Cell,
    ) {
        let (corner, size) = self.area(number);
        (cell.corner, cell.size, cell.axes) = (corner, size, domain.axes().len());
        cell.at.clear();
        cell.values.clear();
        for (y, x) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (y, x))) {
            let i = (corner[1] + y) as usize * self.window[0] as usize + (corner[0] + x) as usize;
            for (half, (number, (value, _))) in samples.of_pixel(i) {
                let mut at = At::default();
                domain.read(points, samples.film.sample_id(half, i, number), &mut at);
                (at[0], at[1]) = (beside(x, at[0]), beside(y, at[1]));
                cell.at.push(at);
                cell.values.push(value);
            }
        }
    }
}

/// A value per cell that is computed from the cell's samples and kept until their number changes.
#[derive(Default)]
pub(crate) struct Known<T>(pub(crate) Vec<(Option<u64>, T)>);

impl<T: Clone + Default + Send> Known<T> {
    /// The bytes of the values for a frame's cells of `side` pixels.
    pub(crate) fn bytes(frame: &Frame, side: u32) -> u64 {
        (Cells::new(frame, side).count() * size_of::<(Option<u64>, T)>()) as u64
    }

    /// Recomputes the value of each cell with new samples, from the cell's number and samples.
    pub(crate) fn refresh(
        &mut self,
        cells: Cells,
        samples: &FilmSamples<'_>,
        points: &dyn PointSet,
        domain: &Domain,
        of: impl Fn(usize, &Cell) -> T + Sync,
    ) {
        self.0.resize(cells.count(), Default::default());
        parallel::parts(self.0.iter_mut(), |number, known| {
            let now = Some(cells.pixels(number).map(|i| samples.film.count(i)).sum());
            if known.0 != now {
                let mut cell = Cell::default();
                cells.read(number, samples, points, domain, &mut cell);
                **known = (now, of(number, &cell));
            }
        });
    }
}

/// The image of a film, computed by the filter `who` from the boxes of each cell of `side` pixels. A pixel is the sum over
/// boxes of their mean times their volume in the pixel. Boxes without samples are left out, and pixels without boxes are black.
pub(crate) fn image_of_boxes(
    (film, who): (&Film, &str),
    side: u32,
    points: &FilmPoints,
    domain: &Domain,
    rule: &dyn Division,
) -> Result<Filtered, Error> {
    image_of_cells((film, who), side, points, domain, |cell, image| {
        let mut sums = vec![[0.0; 4]; image.len()];
        leaves(rule, cell, &mut |leaf| {
            if leaf.items.is_empty() {
                return;
            }
            let mean = mean(cell, leaf.items);
            for (i, sum) in (0..).zip(&mut sums) {
                let within = leaf.bounds.volume_in_pixel([i % cell.size[0], i / cell.size[0]], cell.axes);
                (0..3).for_each(|c| sum[c] += within * mean[c]);
                sum[3] += within;
            }
        });
        for (pixel, [r, g, b, volume]) in image.iter_mut().zip(sums) {
            *pixel = [r, g, b].map(|x| if volume > 0.0 { (x / volume) as f32 } else { 0.0 });
        }
    })
}

/// The image of a film, computed by the filter `who` from samples with coordinates in `domain`. `of_cell` computes the pixels
/// of each cell of `side` pixels, row by row.
pub(crate) fn image_of_cells(
    (film, who): (&Film, &str),
    side: u32,
    points: &FilmPoints,
    domain: &Domain,
    of_cell: impl Fn(&Cell, &mut [[f32; 3]]) + Sync,
) -> Result<Filtered, Error> {
    let (samples, now, cells) = (Singles::All.of(film, who)?, points.now(), Cells::new(film.frame(), side));
    let [width, height] = cells.window.map(|n| n as usize);
    let columns = width.div_ceil(side as usize);
    let mut radiance = vec![[0.0; 3]; width * height];
    parallel::chunks(&mut radiance, width * side as usize, |band, rows| {
        let (cell, made) = &mut (Cell::default(), Vec::new());
        for number in band * columns..(band + 1) * columns {
            cells.read(number, &samples, &now, domain, cell);
            let [columns, lines] = cell.size.map(|n| n as usize);
            made.clear();
            made.resize(columns * lines, [0.0; 3]);
            of_cell(cell, made);
            for (y, made) in made.chunks(columns).enumerate() {
                rows[y * width + cell.corner[0] as usize..][..columns].copy_from_slice(made);
            }
        }
    });
    Ok(Filtered::new(cells.window, radiance))
}

/// The coordinate `u` in `[0, 1)` beyond the pixel's edge, kept within the pixel.
fn beside(pixel: u32, u: f32) -> f32 {
    (pixel as f32 + u).min(((pixel + 1) as f32).next_down())
}

/// A box: its range along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub(crate) low: At,
    pub(crate) high: At,
}

impl Bounds {
    /// The extent along an axis: in pixels for the position, as a fraction of the range for other axes.
    pub(crate) fn extent(&self, axis: usize) -> f64 {
        f64::from(self.high[axis]) - f64::from(self.low[axis])
    }

    pub(crate) fn volume(&self, axes: usize) -> f64 {
        (0..axes).map(|axis| self.extent(axis)).product()
    }

    /// The box's area in the pixel whose corner is `pixel`, times the box's extents along all other axes.
    pub(crate) fn volume_in_pixel(&self, pixel: [u32; 2], axes: usize) -> f64 {
        let within = |axis: usize| {
            let (low, high) = (f64::from(pixel[axis]), f64::from(pixel[axis] + 1));
            (f64::from(self.high[axis]).min(high) - f64::from(self.low[axis]).max(low)).max(0.0)
        };
        within(0) * within(1) * (2..axes).map(|axis| self.extent(axis)).product::<f64>()
    }

    /// The box's point at these fractions of its extents, each in `[0, 1)`.
    pub(crate) fn point(&self, axes: usize, share: impl Fn(usize) -> f32) -> At {
        let mut at = At::default();
        for (axis, x) in at[..axes].iter_mut().enumerate() {
            let (low, high) = (self.low[axis], self.high[axis]);
            *x = (low + share(axis) * (high - low)).clamp(low, high.next_down().max(low));
        }
        at
    }
}

/// A box that is not cut further, with its samples.
#[derive(Clone, Copy)]
pub struct Leaf<'a> {
    pub(crate) bounds: &'a Bounds,
    pub(crate) items: &'a Items,
    pub(crate) depth: u32,
}

/// A rule by which boxes are cut.
pub trait Division: Sync {
    /// The axis and the coordinate at which a box is cut, after `depth` cuts; `None` to leave the box whole. The order of
    /// `items` may change.
    fn cut(&self, cell: &Cell, items: &mut Items, bounds: &Bounds, depth: u32) -> Option<(usize, f32)>;
}

/// The largest number of cuts that lead to a box.
const DEEPEST: u32 = 48;

/// Visits the boxes of a cell in the order of cuts, the lower side first.
pub(crate) fn leaves(rule: &dyn Division, cell: &Cell, visit: &mut dyn FnMut(&Leaf<'_>)) {
    let mut items: Vec<u32> = (0..cell.at.len() as u32).collect();
    let mut high = [1.0; Domain::MOST];
    (high[0], high[1]) = (cell.size[0] as f32, cell.size[1] as f32);
    divide(rule, cell, (&mut items, Bounds { low: At::default(), high }, 0), visit);
}

fn divide(
    rule: &dyn Division,
    cell: &Cell,
    (items, bounds, depth): (&mut Items, Bounds, u32),
    visit: &mut dyn FnMut(&Leaf<'_>),
) {
    let cut = if depth < DEEPEST { rule.cut(cell, items, &bounds, depth) } else { None };
    let Some((axis, at)) = cut else {
        // Means are summed in this order.
        items.sort_unstable();
        return visit(&Leaf { bounds: &bounds, items, depth });
    };
    let mut lower = 0;
    for next in 0..items.len() {
        if cell.at[items[next] as usize][axis] < at {
            items.swap(lower, next);
            lower += 1;
        }
    }
    let (below, above) = items.split_at_mut(lower);
    let (mut first, mut second) = (bounds, bounds);
    (first.high[axis], second.low[axis]) = (at, at);
    divide(rule, cell, (below, first, depth + 1), visit);
    divide(rule, cell, (above, second, depth + 1), visit);
}

/// The mean radiance of samples; 0 without any.
pub(crate) fn mean(cell: &Cell, items: &Items) -> [f64; 3] {
    let share = 1.0 / items.len().max(1) as f64;
    let mut sum = [0.0; 3];
    for &item in items {
        let value = cell.values[item as usize];
        (0..3).for_each(|c| sum[c] += f64::from(value[c]));
    }
    sum.map(|x| x * share)
}

/// A hash that depends on the seed of a point set.
pub(crate) fn seed_of(points: &dyn PointSet) -> u64 {
    let coordinates = points.block(SampleId::new([0; 2], streams::FIRST_HITS, 0), 0);
    coordinates.iter().fold(1, |seed, x| mix(seed ^ u64::from(x.to_bits())))
}

/// A number in `[0, 1)` from a hash.
pub(crate) fn unit(hash: u64) -> f32 {
    (mix(hash) >> 40) as f32 / (1 << 24) as f32
}
