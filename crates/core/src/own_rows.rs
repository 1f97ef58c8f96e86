//! The pixels that a process plans, and numbers that all processes combine.

use crate::snapshot::Broken;
use crate::snapshot::bytes::{Reader, Writer};
use crate::{Error, Exchange, Frame};
use std::ops::Range;

/// The rows of an image that a process plans, and the way to combine numbers with the processes that plan the others.
///
/// One process alone has all rows, and its numbers are everyone's. Whole numbers are combined by sums and maxima, and
/// floats by sums of rows from the top, so that no result depends on the division.
///
/// ```
/// use dapple_core::{Frame, OwnRows};
///
/// let mut part = OwnRows::whole(&Frame::new(3, 2)?);
/// assert_eq!(part.sums([5, 7])?, [5, 7]);
/// assert_eq!(part.sum(|k| k as f64)?, 15.0);
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub struct OwnRows<'a> {
    width: usize,
    runs: Vec<Range<usize>>,
    /// The number of own pixels before each run of rows, and of all.
    before: Vec<usize>,
    /// The number of pixels of all processes.
    all: usize,
    exchange: Option<&'a mut dyn Exchange>,
}

impl OwnRows<'static> {
    /// The rows of a band, counted from the top of the window. A process has all rows of a band or none.
    pub const BAND: usize = crate::bands::BAND;

    /// All rows of a frame's window, for one process.
    pub fn whole(frame: &Frame) -> Self {
        let [width, height] = frame.size().map(|n| n as usize);
        Self::alone(width, height)
    }

    /// All pixels of a list.
    pub(crate) fn list(pixels: usize) -> Self {
        Self::alone(pixels, 1)
    }

    fn alone(width: usize, height: usize) -> Self {
        let runs = std::iter::once(0..height).collect();
        Self { width, runs, before: vec![0, width * height], all: width * height, exchange: None }
    }
}

impl<'a> OwnRows<'a> {
    /// The rows `runs` of a frame's window; every process of `exchange` has others, and none is left out.
    pub(crate) fn of(frame: &Frame, runs: Vec<Range<usize>>, exchange: &'a mut dyn Exchange) -> Self {
        let width = frame.size()[0] as usize;
        let mut before = vec![0];
        before.extend(runs.iter().scan(0, |sum, run| {
            *sum += run.len() * width;
            Some(*sum)
        }));
        Self { width, runs, before, all: frame.pixels(), exchange: Some(exchange) }
    }

    /// True for one process alone.
    pub(crate) fn is_alone(&self) -> bool {
        self.exchange.is_none()
    }

    /// The own rows: runs of rows of the window, from the top.
    pub fn runs(&self) -> &[Range<usize>] {
        &self.runs
    }

    /// The indices of the own pixels in the window, in ascending order.
    pub fn pixels(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().flat_map(|run| run.start * self.width..run.end * self.width)
    }

    /// The number of own pixels.
    pub fn len(&self) -> usize {
        self.before[self.runs.len()]
    }

    /// True if this process has no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of pixels of all processes.
    pub fn all(&self) -> usize {
        self.all
    }

    /// The index in the window of own pixel `k`.
    pub(crate) fn pixel(&self, k: usize) -> usize {
        let run = self.before.partition_point(|&before| before <= k) - 1;
        self.runs[run].start * self.width + k - self.before[run]
    }

    /// The number among the own pixels of a pixel of the window.
    pub(crate) fn position(&self, pixel: usize) -> usize {
        let run = self.runs.partition_point(|run| run.end * self.width <= pixel);
        self.before[run] + pixel - self.runs[run].start * self.width
    }

    /// Everyone's sums of these numbers. They must fit in 64 bits.
    ///
    /// # Errors
    ///
    /// As [`Exchange::all_gather`].
    pub fn sums<const N: usize>(&mut self, mine: [u64; N]) -> Result<[u64; N], Error> {
        let mut sums = mine;
        self.add(&mut sums)?;
        Ok(sums)
    }

    /// Everyone's largest of these numbers.
    ///
    /// # Errors
    ///
    /// As [`Exchange::all_gather`].
    pub fn largest<const N: usize>(&mut self, mine: [u64; N]) -> Result<[u64; N], Error> {
        let mut most = mine;
        self.combine(&mut most, |a, b| a.max(b))?;
        Ok(most)
    }

    /// The sum of a value of each pixel: of each row from left to right, then of the rows from the top. `value` returns that
    /// of own pixel `k`.
    ///
    /// # Errors
    ///
    /// As [`Exchange::all_gather`].
    pub fn sum(&mut self, value: impl Fn(usize) -> f64) -> Result<f64, Error> {
        let width = self.width;
        // Starts from 0: the empty sum of floats is -0.
        let add = |sum: f64, value: f64| sum + value;
        let rows =
            (0..self.len() / width.max(1)).map(|row| (row * width..(row + 1) * width).map(&value).fold(0.0, add));
        if self.exchange.is_none() {
            return Ok(rows.fold(0.0, add));
        }
        let numbers = self.runs.iter().cloned().flatten();
        let mut to = Writer::with_capacity(12 * self.len() / width.max(1));
        for (row, sum) in numbers.zip(rows) {
            to.number(row as u32);
            to.number(sum);
        }
        let mut sums: Vec<(u32, f64)> = Vec::new();
        for (rank, bytes) in self.gather(to.finish())?.iter().enumerate() {
            let mut from = Reader::new(bytes);
            while !from.is_empty() {
                let take = |from: &mut Reader<'_>| Ok((from.number()?, from.number()?));
                sums.push(take(&mut from).map_err(|e| unreadable(rank, &e))?);
            }
        }
        sums.sort_by_key(|(row, _)| *row);
        Ok(sums.into_iter().map(|(_, sum)| sum).fold(0.0, add))
    }

    /// Adds everyone's numbers.
    pub(crate) fn add(&mut self, values: &mut [u64]) -> Result<(), Error> {
        self.combine(values, u64::wrapping_add)
    }

    fn combine(&mut self, values: &mut [u64], with: impl Fn(u64, u64) -> u64) -> Result<(), Error> {
        let Some(exchange) = &mut self.exchange else { return Ok(()) };
        let me = exchange.share().index() as usize;
        let mut to = Writer::with_capacity(8 * values.len());
        to.numbers(values);
        for (rank, bytes) in exchange.all_gather(to.finish())?.iter().enumerate().filter(|(rank, _)| *rank != me) {
            let others: Vec<u64> = Reader::new(bytes).numbers(values.len()).map_err(|e| unreadable(rank, &e))?;
            values.iter_mut().zip(others).for_each(|(value, other)| *value = with(*value, other));
        }
        Ok(())
    }

    /// Everyone's bytes, by number.
    pub(crate) fn gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        match &mut self.exchange {
            Some(exchange) => exchange.all_gather(mine),
            None => Ok(vec![mine]),
        }
    }
}

/// The error for numbers that cannot be read.
pub(crate) fn unreadable(rank: usize, broken: &Broken) -> Error {
    crate::exchange::message::unreadable(rank, broken)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exchange::in_memory;

    #[test]
    fn own_pixels_have_the_numbers_of_the_window() {
        let frame = Frame::new(5, 9).unwrap();
        let mut end = in_memory(1).remove(0);
        let part = OwnRows::of(&frame, vec![1..3, 5..6, 8..9], &mut end);
        let pixels: Vec<usize> = part.pixels().collect();
        assert_eq!(pixels, (5..15).chain(25..30).chain(40..45).collect::<Vec<_>>());
        assert_eq!((part.len(), part.all()), (20, 45));
        for (k, &pixel) in pixels.iter().enumerate() {
            assert_eq!((part.pixel(k), part.position(pixel)), (pixel, k));
        }
    }

    #[test]
    fn sums_of_floats_do_not_depend_on_the_division() {
        let frame = Frame::new(7, 12).unwrap();
        let values: Vec<f64> = (0..84).map(|i| 0.1 * f64::from(i * i)).collect();
        let whole = OwnRows::whole(&frame).sum(|k| values[k]).unwrap();
        for cut in 0..=12 {
            let sums = std::thread::scope(|threads| {
                let ends: Vec<_> = in_memory(2).into_iter().zip([0..cut, cut..12].map(|run| vec![run])).collect();
                let process = |(mut end, runs): (_, Vec<Range<usize>>)| {
                    let own = values[runs[0].start * 7..runs[0].end * 7].to_vec();
                    threads.spawn(move || OwnRows::of(&frame, runs, &mut end).sum(|k| own[k]).unwrap())
                };
                let running: Vec<_> = ends.into_iter().map(process).collect();
                running.into_iter().map(|one| one.join().unwrap()).collect::<Vec<_>>()
            });
            assert_eq!(sums, [whole; 2]);
        }
    }
}
