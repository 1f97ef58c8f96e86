//! An image whose rows are divided among processes: what each takes from the others.
//!
//! A process has the planes of its own rows and of a halo around them. Values of the whole image are combined from all
//! own rows, in the order of the rows: the bits do not depend on the division.

use crate::error_map::Pair;
use crate::planes::{Inputs, Plane};
use crate::tile::HEIGHT;
use dapple_core::{Band, Error, Exchange, Film, Filter, Filtered, Frame};
use std::ops::Range;

/// The rows of planes in the image that they are part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    /// The scale of the planes: 0, or how often the image was halved.
    pub(crate) scale: usize,
    /// The first row of the planes in the whole image at this scale.
    pub(crate) top: usize,
    /// The number of rows of the whole image at this scale.
    pub(crate) height: usize,
    /// The first own row and the one after the last, in the whole image at this scale.
    pub(crate) own: [usize; 2],
}

impl Place {
    /// Returns true if rows `first..end` of the planes, of which the first ones may lie before them, hold an own row.
    pub(crate) fn has_own(&self, first: isize, end: isize) -> bool {
        let own = self.own.map(|row| row as isize - self.top as isize);
        first < own[1] && own[0] < end
    }

    /// Returns true if the tile whose first row in the planes is `row` holds an own row.
    pub(crate) fn has_own_in_tile(&self, row: usize) -> bool {
        self.has_own(row as isize, (row + HEIGHT) as isize)
    }

    /// The rows of the planes that are own ones.
    pub(crate) fn rows(&self) -> Range<usize> {
        self.own[0] - self.top..self.own[1] - self.top
    }

    /// The indices of the own pixels in planes of this width.
    pub(crate) fn own_pixels(&self, width: usize) -> Range<usize> {
        (self.own[0] - self.top) * width..(self.own[1] - self.top) * width
    }

    /// The own rows of an image of the rows of these planes.
    pub(crate) fn own_rows(&self, image: Filtered) -> Filtered {
        let own = self.own_pixels(image.size[0] as usize);
        if own.len() == image.radiance.len() {
            return image;
        }
        let error = image.error.map(|error| error[own.clone()].to_vec());
        let size = [image.size[0], (self.own[1] - self.own[0]) as u32];
        Filtered::new(size, image.radiance[own].to_vec()).with_error(error)
    }
}

/// This process among those that filter the image.
pub(crate) struct Among<'e> {
    /// `None` for a single process.
    exchange: Option<&'e mut dyn Exchange>,
    /// The own rows of each process, from the top.
    bands: Vec<[usize; 2]>,
    /// The rows that each process has of the finest planes.
    rows: Vec<[usize; 2]>,
    me: usize,
    height: usize,
}

/// The bytes of a process that cannot go on.
const FAILED: &[u8] = b"failed";

impl<'e> Among<'e> {
    /// The only process, for an image of this height.
    pub(crate) fn alone(height: usize) -> Self {
        Self { exchange: None, bands: vec![[0, height]], rows: vec![[0, height]], me: 0, height }
    }

    /// This process with the band of `filter`'s image that it makes of `film`, among all processes of `exchange`. Returns
    /// the first row of the film in the whole image too.
    ///
    /// # Errors
    ///
    /// The film's, and then all processes fail. [`Error::Mismatch`] if the bands are not all rows from the top.
    pub(crate) fn new(
        filter: &dyn Filter,
        film: &Film,
        band: &Band,
        exchange: &'e mut dyn Exchange,
    ) -> Result<(Self, usize), Error> {
        let who = filter.name();
        let ready = film.require(who, &filter.needs()).and_then(|()| {
            let read = filter.rows_read(band.frame(), band.rows()).map(|rows| band.frame().rows(rows)).transpose()?;
            let what = "the film holds other rows than the filter reads; cut it by rows_read";
            if read == Some(*film.frame()) { Ok(()) } else { Err(refused(who, what)) }
        });
        let among = Self::joined(who, band, exchange, ready)?;
        Ok((among, (film.frame().origin()[1] - band.frame().origin()[1]) as usize))
    }

    /// This process with its band among all processes, which all fail if `ready` is the error of one.
    pub(crate) fn joined(
        who: &str,
        band: &Band,
        exchange: &'e mut dyn Exchange,
        ready: Result<(), Error>,
    ) -> Result<Self, Error> {
        let [rows, size] = [[band.rows().start, band.rows().end], band.frame().size()];
        let mine: Vec<u8> = match ready {
            Ok(()) => rows.iter().chain(&size).flat_map(|n| n.to_le_bytes()).collect(),
            Err(_) => FAILED.to_vec(),
        };
        let me = exchange.share().index() as usize;
        let all = exchange.all_gather(mine)?;
        ready?;
        let mut bands = Vec::new();
        for (number, bytes) in all.iter().enumerate() {
            if bytes == FAILED {
                return Err(refused(who, &format!("process {number} failed; its own message gives the reason")));
            }
            let [first, end, width, height] = numbers(bytes).unwrap_or_default();
            if [width, height] != size {
                let what = "the processes filter images of different sizes; start all with the same arguments";
                return Err(refused(who, what));
            }
            bands.push([first as usize, end as usize]);
        }
        let height = size[1] as usize;
        let follow = bands.windows(2).all(|pair| pair[0][1] == pair[1][0]);
        if !follow || bands.first().map(|b| b[0]) != Some(0) || bands.last().map(|b| b[1]) != Some(height) {
            let what = "the bands leave out rows or overlap; give each process the next band from the top";
            return Err(refused(who, what));
        }
        Ok(Self { exchange: Some(exchange), rows: bands.clone(), bands, me, height })
    }

    /// Learns which rows of the finest planes each process has; `own` are those of this one.
    pub(crate) fn share_rows(&mut self, own: [usize; 2]) -> Result<(), Error> {
        let Some(exchange) = &mut self.exchange else { return Ok(()) };
        let all = exchange.all_gather(own.iter().flat_map(|row| (*row as u32).to_le_bytes()).collect())?;
        self.rows = all.iter().map(|bytes| numbers(bytes).unwrap_or([0; 2]).map(|row| row as usize)).collect();
        Ok(())
    }

    /// The rows that a process has of the finest planes.
    pub(crate) fn rows(&self, process: usize) -> [usize; 2] {
        self.rows[process]
    }

    /// Replaces the rows of images that are not own ones by those of their owners. `reads` returns the rows that a process
    /// has of the images.
    pub(crate) fn complete<const N: usize>(
        &mut self,
        inputs: &Inputs,
        images: [Pair; N],
        reads: impl Fn(&Self, usize) -> [usize; 2],
    ) -> Result<[Pair; N], Error> {
        let planes = images.into_iter().flat_map(|Pair(image)| image).flatten().collect();
        let mut planes = self.fetch(&inputs.place, planes, inputs.size[0], reads)?.into_iter();
        Ok(std::array::from_fn(|_| Pair([0, 1].map(|_| std::array::from_fn(|_| planes.next().unwrap_or_default())))))
    }

    /// The number of rows of the whole image.
    pub(crate) fn height(&self) -> usize {
        self.height
    }

    /// The place of planes of this process that begin with row `top` of a scale.
    pub(crate) fn place(&self, scale: usize, top: usize) -> Place {
        Place { scale, top, height: self.height_at(scale), own: self.own(self.me, scale) }
    }

    fn height_at(&self, scale: usize) -> usize {
        coarse_row(self.height, scale)
    }

    /// The own rows of a process at a scale: those whose first row at the finest scale is its own.
    pub(crate) fn own(&self, process: usize, scale: usize) -> [usize; 2] {
        self.bands[process].map(|row| coarse_row(row, scale))
    }

    /// The sum over all rows of the whole image, taken from row to row. `rows` are the sums of the own rows.
    pub(crate) fn sum<const N: usize>(&mut self, rows: &[[f64; N]]) -> Result<[f64; N], Error> {
        let add = |mut sum: [f64; N], row: &[f64; N]| {
            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
            sum
        };
        let Some(exchange) = &mut self.exchange else { return Ok(rows.iter().fold([0.0; N], add)) };
        let all = exchange.all_gather(rows.iter().flatten().flat_map(|v| v.to_le_bytes()).collect())?;
        let values: Vec<f64> =
            all.iter().flat_map(|bytes| bytes.as_chunks::<8>().0).map(|b| f64::from_le_bytes(*b)).collect();
        Ok(values.as_chunks::<N>().0.iter().fold([0.0; N], add))
    }

    /// The sums over the own pixels of each own row of the planes of `place`, added up by [`Among::sum`].
    pub(crate) fn sum_pixels<const N: usize>(
        &mut self,
        place: &Place,
        width: usize,
        of: impl Fn(usize) -> [f64; N],
    ) -> Result<[f64; N], Error> {
        let row = |row: usize| {
            (row * width..(row + 1) * width).fold([0.0; N], |mut sum, i| {
                sum.iter_mut().zip(of(i)).for_each(|(sum, value)| *sum += value);
                sum
            })
        };
        let rows: Vec<[f64; N]> = (place.own[0] - place.top..place.own[1] - place.top).map(row).collect();
        self.sum(&rows)
    }

    /// The sums of whole numbers of all processes.
    fn count(&mut self, mut own: Vec<u64>) -> Result<Vec<u64>, Error> {
        let Some(exchange) = &mut self.exchange else { return Ok(own) };
        let all = exchange.all_gather(own.iter().flat_map(|v| v.to_le_bytes()).collect())?;
        own.fill(0);
        for bytes in all {
            let values = bytes.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b));
            own.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
        Ok(own)
    }

    /// The sum of a whole number of each process.
    pub(crate) fn total(&mut self, own: u64) -> Result<u64, Error> {
        Ok(self.count(vec![own])?[0])
    }

    /// The largest value of all processes, at least 0.
    pub(crate) fn largest(&mut self, own: f32) -> Result<f32, Error> {
        let Some(exchange) = &mut self.exchange else { return Ok(own.max(0.0)) };
        let all = exchange.all_gather(own.to_le_bytes().to_vec())?;
        let values = all.iter().filter_map(|bytes| Some(f32::from_le_bytes(*bytes.first_chunk()?)));
        Ok(values.fold(0.0, f32::max))
    }

    /// Of `n` positive values of all processes, the one with `rank(n)` smaller or equal ones before it in order; `None`
    /// of no values.
    ///
    /// It is found digit by digit, by counts of the values with each digit: positive numbers have the order of their bits.
    pub(crate) fn in_order(&mut self, own: &[f32], rank: impl Fn(u64) -> u64) -> Result<Option<f32>, Error> {
        /// The number of bits below each digit, and of its own: few enough that messages stay small.
        const DIGITS: [[u32; 2]; 3] = [[21, 11], [10, 11], [0, 10]];
        let (mut found, mut place) = (0_u64, None);
        for [below, width] in DIGITS {
            let mut counts = vec![0; 1 << width];
            for bits in own.iter().map(|value| u64::from(value.to_bits())) {
                if bits >> (below + width) == found >> (below + width) {
                    counts[(bits >> below) as usize % (1 << width)] += 1;
                }
            }
            let counts = self.count(counts)?;
            let n = counts.iter().sum();
            if n == 0 {
                return Ok(None);
            }
            let (digit, rest) = bucket(&counts, place.unwrap_or_else(|| rank(n)));
            (found, place) = (found | (digit as u64) << below, Some(rest));
        }
        Ok(Some(f32::from_bits(found as u32)))
    }

    /// Brings own rows of planes to the processes that read them. `planes` begin with row `top` of `place.scale` and hold
    /// the own rows; the result begins with row `reads(process)[0]`. `reads` returns the rows that a process needs.
    pub(crate) fn fetch(
        &mut self,
        place: &Place,
        planes: Vec<Plane>,
        width: usize,
        reads: impl Fn(&Self, usize) -> [usize; 2],
    ) -> Result<Vec<Plane>, Error> {
        if self.is_alone() {
            return Ok(planes);
        }
        let (processes, me) = (self.bands.len(), self.me);
        let own: Vec<[usize; 2]> = (0..processes).map(|process| self.own(process, place.scale)).collect();
        let read: Vec<[usize; 2]> = (0..processes).map(|process| reads(self, process)).collect();
        let common = |a: [usize; 2], b: [usize; 2]| [a[0].max(b[0]), a[1].min(b[1]).max(a[0].max(b[0]))];
        let send = |to: usize| -> Vec<u8> {
            let [first, end] = common(own[me], read[to]);
            if first == end || to == me {
                return Vec::new();
            }
            let rows = (first - place.top) * width..(end - place.top) * width;
            let mut bytes = vec![0; 4 * planes.len() * rows.len()];
            for (to, plane) in bytes.chunks_exact_mut(4 * rows.len()).zip(&planes) {
                let values = to.as_chunks_mut::<4>().0.iter_mut().zip(&plane[rows.clone()]);
                values.for_each(|(to, value)| *to = value.to_le_bytes());
            }
            bytes
        };
        let to_each = (0..processes).map(send).collect();
        let Some(exchange) = &mut self.exchange else { return Ok(planes) };
        let got = exchange.all_to_all(to_each)?;
        let ([top, bottom], count) = (read[me], planes.len());
        let mut fetched = moved(planes, [place.top, top], common(own[me], read[me]), [width, bottom - top]);
        for (from, bytes) in got.iter().enumerate().filter(|(from, _)| *from != me) {
            let [first, end] = common(own[from], read[me]);
            let pixels = (end - first) * width;
            if bytes.len() != 4 * count * pixels {
                let what = "a process sent rows of another size; start all with the same program and arguments";
                return Err(refused("the filter across processes", what));
            }
            if pixels == 0 {
                continue;
            }
            for (plane, bytes) in fetched.iter_mut().zip(bytes.chunks_exact(4 * pixels)) {
                let to = &mut plane[(first - top) * width..][..pixels];
                to.iter_mut().zip(bytes.as_chunks::<4>().0).for_each(|(to, b)| *to = f32::from_le_bytes(*b));
            }
        }
        Ok(fetched)
    }

    /// Returns true for a single process.
    pub(crate) fn is_alone(&self) -> bool {
        self.exchange.is_none()
    }

    /// The first row of the planes of this process, by its number; 0 for a single process.
    pub(crate) fn top(&self, of: impl Fn(&Self, usize) -> usize) -> usize {
        if self.is_alone() { 0 } else { of(self, self.me) }
    }

    /// The own rows of a process at the finest scale.
    pub(crate) fn band(&self, process: usize) -> [usize; 2] {
        self.bands[process]
    }
}

/// The rows of a frame's window that a filter reads for `rows`: `reach` more above and below, from a multiple of `aligned`
/// to a multiple of [`HEIGHT`].
pub(crate) fn rows_around(frame: &Frame, rows: Range<u32>, reach: usize, aligned: usize) -> Range<u32> {
    let (first, end) = ((rows.start as usize).saturating_sub(reach), rows.end as usize + reach);
    let end = end.next_multiple_of(HEIGHT).min(frame.size()[1] as usize);
    (first - first % aligned) as u32..end as u32
}

/// The row of a scale that holds a row of the finest scale, or the next one if that is not its first row.
pub(crate) fn coarse_row(row: usize, scale: usize) -> usize {
    row.div_ceil(1 << scale)
}

/// Planes of `height` rows that begin with row `to`, from planes that begin with row `from`: the rows `own` of them.
fn moved(
    planes: Vec<Plane>,
    [from, to]: [usize; 2],
    [first, end]: [usize; 2],
    [width, height]: [usize; 2],
) -> Vec<Plane> {
    if from == to && planes.iter().all(|plane| plane.len() == width * height) {
        return planes;
    }
    let one = |plane: Plane| {
        let mut all = vec![0.0; width * height];
        if first < end {
            let rows = (first - from) * width..(end - from) * width;
            all[(first - to) * width..][..rows.len()].copy_from_slice(&plane[rows]);
        }
        all
    };
    planes.into_iter().map(one).collect()
}

/// The bucket of the value at this place in order, and its place within the bucket.
fn bucket(counts: &[u64], mut place: u64) -> (usize, u64) {
    for (number, count) in counts.iter().enumerate() {
        if place < *count {
            return (number, place);
        }
        place -= count;
    }
    (counts.len() - 1, 0)
}

fn refused(who: &str, what: &str) -> Error {
    Error::Mismatch { who: who.to_owned(), what: what.to_owned() }
}

fn numbers<const N: usize>(bytes: &[u8]) -> Option<[u32; N]> {
    let (chunks, []) = bytes.as_chunks::<4>() else { return None };
    let values: &[[u8; 4]; N] = chunks.try_into().ok()?;
    Some(values.map(u32::from_le_bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_statistics_are_those_of_sorted_values() {
        let value = |k: u32| f32::from_bits(k.wrapping_mul(2_654_435_769) % 0x7f80_0000);
        for n in [1, 2, 5, 1000] {
            let values: Vec<f32> = (1..=n).map(|k| value(k % 700)).collect();
            let mut sorted = values.clone();
            sorted.sort_by(f32::total_cmp);
            for rank in [0, n / 4, n / 2, n - 1] {
                let found = Among::alone(1).in_order(&values, |_| u64::from(rank)).unwrap();
                assert_eq!(found, Some(sorted[rank as usize]), "{rank} of {n}");
            }
        }
        assert_eq!(Among::alone(1).in_order(&[], |n| n / 2).unwrap(), None);
        assert_eq!(Among::alone(1).in_order(&[f32::INFINITY], |_| 0).unwrap(), Some(f32::INFINITY));
    }
}
