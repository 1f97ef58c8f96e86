//! The emission of pixels at edges of lamps. Few pixels have such an edge, so each row lists its own.

use crate::Frame;
use serde::{Deserialize, Serialize};

/// The mean emission of a pixel's samples of features alone, in two parts of independent samples, and their numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct EmissionAlone {
    pub(super) samples: [u32; 2],
    pub(super) mean: [[f32; 3]; 2],
}

impl EmissionAlone {
    /// Adds a sample to a part. Negative and infinite channels and those that are NaN count as black.
    pub(crate) fn push(&mut self, part: usize, emission: [f32; 3]) {
        self.samples[part] += 1;
        let share = 1.0 / self.samples[part] as f32;
        for (mean, value) in self.mean[part].iter_mut().zip(emission) {
            let value = if value.is_finite() { value.max(0.0) } else { 0.0 };
            *mean += (value - *mean) * share;
        }
    }

    /// Number and mean of all samples.
    pub(super) fn whole(&self) -> (u32, [f32; 3]) {
        let ([na, nb], [a, b]) = (self.samples, self.mean);
        let all = na.saturating_add(nb);
        let share = na as f32 / all.max(1) as f32;
        (all, [0, 1, 2].map(|c| b[c] + share * (a[c] - b[c])))
    }
}

/// The emission alone of pixels at edges of lamps: for each row of the window their columns in the full image, ascending. No rows
/// without such pixels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct LampEdges(Vec<Vec<(u32, EmissionAlone)>>);

impl LampEdges {
    /// Returns `true` for values of a film of `frame`: finite and in order.
    pub(crate) fn is_sound(&self, frame: &Frame) -> bool {
        let is_finite = |alone: &EmissionAlone| alone.mean.iter().flatten().all(|value| value.is_finite());
        let is_row = |row: &Vec<(u32, EmissionAlone)>| {
            row.is_sorted_by(|a, b| a.0 < b.0) && row.iter().all(|(_, alone)| is_finite(alone))
        };
        (self.0.is_empty() || self.0.len() == frame.size()[1] as usize) && self.0.iter().all(is_row)
    }

    /// The values of pixel `i` of a film of `frame`; `None` for pixels at no edge.
    pub(super) fn get(&self, frame: &Frame, i: usize) -> Option<&EmissionAlone> {
        if self.0.is_empty() {
            return None;
        }
        // A frame has less than 2^32 pixels, and divisions by 32 bits are faster.
        let (i, width, first) = (u32::try_from(i).ok()?, frame.size()[0], frame.origin()[0]);
        let (column, row) = (first + i % width, self.0.get((i / width) as usize)?);
        row.binary_search_by_key(&column, |(column, _)| *column).ok().map(|place| &row[place].1)
    }

    /// Sets the values of a pixel of the full image, which lies in `frame`.
    pub(crate) fn set(&mut self, frame: &Frame, [column, row]: [u32; 2], alone: EmissionAlone) {
        self.0.resize(frame.size()[1] as usize, Vec::new());
        let row = &mut self.0[(row - frame.origin()[1]) as usize];
        match row.binary_search_by_key(&column, |(column, _)| *column) {
            Ok(place) => row[place].1 = alone,
            Err(place) => row.insert(place, (column, alone)),
        }
    }

    /// The pixels of a film of `frame` with their values.
    fn list(&self, frame: &Frame) -> impl Iterator<Item = ([u32; 2], EmissionAlone)> {
        let rows = (frame.origin()[1]..).zip(&self.0);
        rows.flat_map(|(row, edges)| edges.iter().map(move |(column, alone)| ([*column, row], *alone)))
    }

    /// Those of a part of the window `whole`.
    pub(super) fn cut(&self, whole: &Frame, part: &Frame) -> Self {
        let ([x, y], [width, height]) = (part.origin(), part.size());
        let mut cut = Self::default();
        let inside = |pixel: [u32; 2]| (x..x + width).contains(&pixel[0]) && (y..y + height).contains(&pixel[1]);
        let own = self.list(whole).filter(|(pixel, _)| inside(*pixel));
        own.for_each(|(pixel, alone)| cut.set(part, pixel, alone));
        cut
    }

    /// Sets those of a part of the window `whole`.
    pub(super) fn paste(&mut self, whole: &Frame, part: &Frame, edges: &Self) {
        edges.list(part).for_each(|(pixel, alone)| self.set(whole, pixel, alone));
    }

    /// Those of one half: the samples of the other are removed.
    pub(super) fn half(mut self, half: usize) -> Self {
        for (_, alone) in self.0.iter_mut().flatten() {
            (alone.samples[1 - half], alone.mean[1 - half]) = (0, [0.0; 3]);
        }
        self
    }
}
