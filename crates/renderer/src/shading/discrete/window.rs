//! A rectangular part of a density on the unit square.

use super::{BELOW_ONE, Discrete, PiecewiseConstant2d, start};
use std::ops::Range;

/// A rectangle of a [`PiecewiseConstant2d`] as a density of its own: the whole density divided by [`Window::mass`]. It
/// uses the cumulative sums of the whole and stores about 28 bytes per row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Window {
    /// The distribution over the rows of the rectangle.
    rows: Discrete,
    first_row: usize,
    /// For each row, the cumulative probabilities of the whole's row where the rectangle begins and ends. Read from the whole,
    /// each of both would miss the cache.
    edges: Vec<[f64; 2]>,
    mass: f64,
}

impl Window {
    /// Makes the rectangle of these columns and rows of `whole`. Returns `None` if all its weights are 0.
    ///
    /// # Panics
    ///
    /// Panics if `whole` has fewer columns or rows and some weight is positive.
    pub(crate) fn new(whole: &PiecewiseConstant2d, columns: Range<usize>, rows: Range<usize>) -> Option<Self> {
        if whole.is_empty() || columns.is_empty() {
            return None;
        }
        let edges = |row: usize| {
            let ends = whole.row(row);
            [start(ends, columns.start), ends[columns.end - 1]]
        };
        let (first_row, edges): (_, Vec<[f64; 2]>) = (rows.start, rows.clone().map(edges).collect());
        let share = |(row, [from, to]): (usize, &[f64; 2])| {
            let of_whole = whole.rows.ends[row] - start(&whole.rows.ends, row);
            of_whole * (to - from)
        };
        let rows = Discrete::from_checked(rows.zip(&edges).map(share));
        (!rows.is_empty()).then(|| Self { mass: rows.total(), rows, first_row, edges })
    }

    /// Returns the rectangle's fraction of the whole probability, above 0.
    pub(crate) fn mass(&self) -> f64 {
        self.mass
    }

    /// Samples a point of the rectangle as [`PiecewiseConstant2d::sample_near`] does. The density returned is the
    /// whole's, so that it equals [`PiecewiseConstant2d::pdf`].
    #[inline(always)]
    pub(crate) fn sample_near(
        &self,
        whole: &PiecewiseConstant2d,
        u: [f32; 2],
        near: impl FnOnce(usize),
    ) -> Option<([f32; 2], f32)> {
        let mut row = self.rows.sample(u[1])?;
        let [from, to] = self.edges[row.index];
        row.index += self.first_row;
        let across = from + f64::from(u[0].clamp(0.0, BELOW_ONE)) * (to - from);
        // A sampled row has `from < to`. The sum may round to `to`, so it is clamped.
        Some(whole.sample_row(row, across.clamp(from, to.next_down()), near))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole() -> PiecewiseConstant2d {
        let weights: Vec<f32> = (0..70).map(|i| ((i * i) % 11) as f32 * if i % 7 == 3 { 1e-7 } else { 1.0 }).collect();
        PiecewiseConstant2d::new(&weights, [10, 7]).expect("weights")
    }

    #[test]
    fn windows_share_the_whole_and_keep_to_themselves() {
        let whole = whole();
        let mut sum = 0.0;
        for (columns, rows) in [(0..3, 0..7), (3..4, 0..7), (4..10, 0..6), (4..10, 6..7)] {
            let window = Window::new(&whole, columns.clone(), rows.clone()).expect("not black");
            sum += window.mass();
            for i in 0..4096_u32 {
                let u = [(i % 64) as f32 / 63.0, (i / 64) as f32 / 63.0];
                let (uv, density) = window.sample_near(&whole, u, |_| ()).expect("not black");
                let [column, row] = [(uv[0] * 10.0) as usize, (uv[1] * 7.0) as usize];
                assert!(columns.contains(&column) && rows.contains(&row), "{uv:?} is not in {columns:?} {rows:?}");
                assert!(density > 0.0 && density == whole.pdf(uv));
            }
        }
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
    }

    #[test]
    fn the_window_of_everything_draws_as_the_whole() {
        let whole = whole();
        let window = Window::new(&whole, 0..10, 0..7).expect("not black");
        for i in 0..1024_u32 {
            let u = [(i % 32) as f32 / 32.0, (i / 32) as f32 / 32.0];
            assert_eq!(window.sample_near(&whole, u, |_| ()), whole.sample(u));
        }
    }

    #[test]
    fn black_windows_are_none() {
        let mut weights = vec![1.0; 12];
        weights[5] = 0.0;
        let whole = PiecewiseConstant2d::new(&weights, [4, 3]).expect("weights");
        assert!(Window::new(&whole, 1..2, 1..2).is_none() && Window::new(&whole, 2..2, 0..3).is_none());
        let black = PiecewiseConstant2d::new(&[0.0; 4], [2, 2]).expect("weights");
        assert!(Window::new(&black, 0..2, 0..2).is_none());
    }
}
