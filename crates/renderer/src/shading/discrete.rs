//! Sampling of items and grid cells in proportion to weights.

use super::Error;

/// The largest f32 below 1.
pub(crate) const BELOW_ONE: f32 = 1.0 - 0.5 * f32::EPSILON;
/// The largest number of rows or columns of a grid. Cells then stay wide enough to contain several f32 values.
const MAX_SIDE: usize = 1 << 20;

/// A discrete distribution over items, with probabilities proportional to their weights.
///
/// Sampling inverts the cumulative distribution. Unlike with an alias table, well-distributed random numbers select
/// well-distributed items. A guide table [Chen and Asau 1974] finds the item in constant expected time. Sums are in f64.
///
/// A distribution without a positive weight is *empty*: no item can be sampled.
///
/// A random number of 24 bits selects an item, or a range of items, with a probability that is a multiple of 2^-24. With 10^6
/// items, this rounding changes the frequency of a single item by some percent, and of a long range by much less.
#[derive(Clone, Debug, PartialEq)]
pub struct Discrete {
    /// `ends[i]` is the cumulative probability of items `0..=i`. It is 1 at and after the last item with a positive weight.
    ends: Vec<f64>,
    /// `guide[j]` is the item that the random number `j / n` selects, for n items.
    guide: Vec<u32>,
    total: f64,
}

/// An item sampled from a [`Discrete`] distribution, with its probability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The index of the sampled item.
    pub index: usize,
    /// The probability of the sampled item, above 0; equal to [`Discrete::pmf`].
    pub pmf: f32,
    /// The random number rescaled to the item's interval, so that it is uniform in `[0, 1)` again.
    pub u: f32,
}

impl Discrete {
    /// Makes the distribution with one item per weight.
    ///
    /// # Errors
    ///
    /// [`Error::Weight`] if a weight is negative, infinite or NaN. [`Error::TooMany`] for more than 2^32 - 1 weights.
    pub fn new(weights: &[f32]) -> Result<Self, Error> {
        if u32::try_from(weights.len()).is_err() {
            return Err(Error::TooMany { count: weights.len(), most: u32::MAX as usize });
        }
        check(weights)?;
        Ok(Self::from_checked(weights.iter().map(|&w| f64::from(w))))
    }

    fn from_checked(weights: impl Iterator<Item = f64>) -> Self {
        let (ends, total) = cumulative(weights);
        let guide = if total > 0.0 { guide(&ends, ends.len()).collect() } else { Vec::new() };
        Self { ends, guide, total }
    }

    /// Selects an item by a random number `u`, clamped to `[0, 1)`. Items of weight 0 are never selected. Returns
    /// `None` if the distribution is empty.
    #[inline]
    pub fn sample(&self, u: f32) -> Option<Choice> {
        if !(self.total > 0.0) {
            return None;
        }
        let u = f64::from(u.clamp(0.0, BELOW_ONE));
        let slot = (u * self.guide.len() as f64) as usize;
        let first = self.guide[slot] as usize;
        let last = self.guide.get(slot + 1).map_or(self.ends.len() - 1, |&i| i as usize);
        Some(invert(&self.ends, first, last, u))
    }

    /// Returns the probability of item `index`. It is 0 if the distribution is empty, or if the item's weight is so small
    /// relative to the others that the item is never selected.
    ///
    /// # Panics
    ///
    /// Panics if `index` is not below [`len`](Self::len) and the distribution is not empty.
    #[inline]
    pub fn pmf(&self, index: usize) -> f32 {
        if self.total > 0.0 { (self.ends[index] - start(&self.ends, index)) as f32 } else { 0.0 }
    }

    /// Returns the number of items, including those of weight 0.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Returns true if no item has a positive weight.
    pub fn is_empty(&self) -> bool {
        !(self.total > 0.0)
    }

    /// Returns the sum of all weights.
    pub fn total(&self) -> f64 {
        self.total
    }
}

/// A distribution over the cells of a grid, with probabilities proportional to the cells' weights.
///
/// Sampling inverts the cumulative distribution of the rows, then the one of the cells in the selected row. A cell of weight 0
/// is never sampled. The distribution takes about 5 bytes of memory per cell.
#[derive(Clone, Debug, PartialEq)]
pub struct PiecewiseConstant2d {
    rows: Discrete,
    /// The cumulative probabilities of each row's cells, row after row, like `ends` of a [`Discrete`]. Single precision
    /// suffices, since random numbers have no more digits.
    columns: Vec<f32>,
    /// The guide tables of the rows, row after row, each with `slots + 1` entries. Entry `j` is the column selected by the
    /// random number `j / slots`; the last entry is the last column.
    guides: Vec<u32>,
    slots: usize,
    width: usize,
}

/// A cell sampled from a [`PiecewiseConstant2d`] distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridCell {
    /// The column and row of the sampled cell.
    pub place: [usize; 2],
    /// The random numbers rescaled to the cell, so that each is uniform in `[0, 1)` again.
    pub u: [f32; 2],
}

/// The number of columns per guide slot. Without a guide table, a binary search through a row misses the cache at
/// nearly every step.
const TO_A_SLOT: usize = 4;

impl PiecewiseConstant2d {
    /// Makes the distribution with these weights, given row by row for `size = [columns, rows]`.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if there are not `columns * rows` weights; [`Error::TooMany`] for a side above 2^20;
    /// [`Error::Weight`] as for [`Discrete::new`].
    pub fn new(weights: &[f32], size: [usize; 2]) -> Result<Self, Error> {
        if let Some(&count) = size.iter().find(|&&n| n > MAX_SIDE) {
            return Err(Error::TooMany { count, most: MAX_SIDE });
        }
        if size[0] * size[1] != weights.len() {
            return Err(Error::Shape { count: weights.len(), size });
        }
        check(weights)?;
        let slots = size[0].div_ceil(TO_A_SLOT);
        let mut columns = Vec::with_capacity(weights.len());
        let mut guides = Vec::with_capacity((slots + 1) * size[1]);
        let mut totals = Vec::with_capacity(size[1]);
        for row in weights.chunks(size[0].max(1)) {
            let (ends, total) = cumulative(row.iter().map(|&w| f64::from(w)));
            let ends: Vec<f32> = ends.into_iter().map(|end| end as f32).collect();
            guides.extend(guide(&ends, slots));
            guides.push(ends.len() as u32 - 1);
            columns.extend(ends);
            totals.push(total);
        }
        Ok(Self { rows: Discrete::from_checked(totals.into_iter()), columns, guides, slots, width: size[0] })
    }

    /// Selects a cell by random numbers, clamped to `[0, 1)`: `u[1]` selects the row and `u[0]` the column. Returns `None` if
    /// all weights are 0.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> Option<GridCell> {
        let row = self.rows.sample(u[1])?;
        let across = f64::from(u[0].clamp(0.0, BELOW_ONE));
        let slot = row.index * (self.slots + 1) + (across * self.slots as f64) as usize;
        let [first, last] = [self.guides[slot] as usize, self.guides[slot + 1] as usize];
        let column = invert(&self.columns[row.index * self.width..][..self.width], first, last, across);
        Some(GridCell { place: [column.index, row.index], u: [column.u, row.u] })
    }

    /// Returns true if no cell has a positive weight.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Returns the sum of all weights.
    pub fn total(&self) -> f64 {
        self.rows.total()
    }
}

fn check(weights: &[f32]) -> Result<(), Error> {
    match weights.iter().position(|w| !(*w >= 0.0 && w.is_finite())) {
        Some(index) => Err(Error::Weight { index, value: weights[index] }),
        None => Ok(()),
    }
}

/// Returns the cumulative sums divided by the total, and the total. All sums are 0 if the total is 0.
fn cumulative(weights: impl Iterator<Item = f64>) -> (Vec<f64>, f64) {
    let mut total = 0.0;
    let mut ends: Vec<f64> = weights
        .map(|w| {
            total += w;
            total
        })
        .collect();
    if total > 0.0 {
        ends.iter_mut().for_each(|end| *end /= total);
    }
    (ends, total)
}

/// Returns the items selected by the random numbers `slot / slots`.
fn guide<T: Copy + Into<f64>>(ends: &[T], slots: usize) -> impl Iterator<Item = u32> {
    let (mut item, last) = (0, ends.len() - 1);
    (0..slots).map(move |slot| {
        while item < last && ends[item].into() <= slot as f64 / slots as f64 {
            item += 1;
        }
        item as u32
    })
}

#[inline]
fn start<T: Copy + Into<f64>>(ends: &[T], index: usize) -> f64 {
    if index == 0 { 0.0 } else { ends[index - 1].into() }
}

/// Returns the first item in `first..=last` whose end is above `u`. An item of weight 0 ends where its predecessor
/// does, so it is never selected.
#[inline]
fn invert<T: Copy + Into<f64>>(ends: &[T], first: usize, last: usize, u: f64) -> Choice {
    let index = first + ends[first..last].partition_point(|&end| end.into() <= u);
    let begin = start(ends, index);
    let width = ends[index].into() - begin;
    Choice { index, pmf: width as f32, u: (((u - begin) / width) as f32).clamp(0.0, BELOW_ONE) }
}
