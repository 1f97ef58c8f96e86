//! The emission of pixels at the edges of light sources. Few pixels have such an edge, so each row lists its own.

use crate::Frame;
use serde::{Deserialize, Serialize};

/// The numbers and the mean emission of a pixel's feature-only samples, in two independent halves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct EmissionAlone {
    pub(super) samples: [u32; 2],
    pub(super) mean: [[f32; 3]; 2],
}

impl EmissionAlone {
    /// Adds a sample to half `part`. Channels that are negative, infinite or NaN count as 0.
    pub(crate) fn push(&mut self, part: usize, emission: [f32; 3]) {
        self.samples[part] += 1;
        let share = 1.0 / self.samples[part] as f32;
        for (mean, value) in self.mean[part].iter_mut().zip(emission) {
            let value = if value.is_finite() { value.max(0.0) } else { 0.0 };
            *mean += (value - *mean) * share;
        }
    }

    /// Number and mean of the samples of both halves.
    pub(super) fn whole(&self) -> (u32, [f32; 3]) {
        let ([na, nb], [a, b]) = (self.samples, self.mean);
        let all = na.saturating_add(nb);
        let share = na as f32 / all.max(1) as f32;
        (all, [0, 1, 2].map(|c| b[c] + share * (a[c] - b[c])))
    }
}

/// The emission of pixels at the edges of light sources: for each row of the window, a list sorted by column in the full
/// image. There are no rows if no pixel has such an edge.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct LampEdges(Vec<Vec<(u32, EmissionAlone)>>);

impl LampEdges {
    /// Returns `true` if the values are finite, sorted, and fit a film of `frame`.
    pub(crate) fn is_sound(&self, frame: &Frame) -> bool {
        let is_finite = |alone: &EmissionAlone| alone.mean.iter().flatten().all(|value| value.is_finite());
        let is_row = |row: &Vec<(u32, EmissionAlone)>| {
            row.is_sorted_by(|a, b| a.0 < b.0) && row.iter().all(|(_, alone)| is_finite(alone))
        };
        (self.0.is_empty() || self.0.len() == frame.size()[1] as usize) && self.0.iter().all(is_row)
    }

    /// The values of pixel `i` of a film of `frame`; `None` for pixels without an edge.
    pub(super) fn get(&self, frame: &Frame, i: usize) -> Option<&EmissionAlone> {
        if self.0.is_empty() {
            return None;
        }
        // A frame has less than 2^32 pixels, and divisions by 32 bits are faster.
        let (i, width, first) = (u32::try_from(i).ok()?, frame.size()[0], frame.origin()[0]);
        let (column, row) = (first + i % width, self.0.get((i / width) as usize)?);
        row.binary_search_by_key(&column, |(column, _)| *column).ok().map(|place| &row[place].1)
    }

    /// Sets the values of a pixel, given by column and row in the full image. The pixel must lie in `frame`.
    pub(crate) fn set(&mut self, frame: &Frame, [column, row]: [u32; 2], alone: EmissionAlone) {
        self.0.resize(frame.size()[1] as usize, Vec::new());
        let row = &mut self.0[(row - frame.origin()[1]) as usize];
        match row.binary_search_by_key(&column, |(column, _)| *column) {
            Ok(place) => row[place].1 = alone,
            Err(place) => row.insert(place, (column, alone)),
        }
    }

    /// The pixels with values, in a film of `frame`: column and row in the full image, and the values.
    fn list(&self, frame: &Frame) -> impl Iterator<Item = ([u32; 2], EmissionAlone)> {
        let rows = (frame.origin()[1]..).zip(&self.0);
        rows.flat_map(|(row, edges)| edges.iter().map(move |(column, alone)| ([*column, row], *alone)))
    }

    /// The values inside the window `part`, which lies in `whole`.
    pub(super) fn cut(&self, whole: &Frame, part: &Frame) -> Self {
        let ([x, y], [width, height]) = (part.origin(), part.size());
        let mut cut = Self::default();
        let inside = |pixel: [u32; 2]| (x..x + width).contains(&pixel[0]) && (y..y + height).contains(&pixel[1]);
        let own = self.list(whole).filter(|(pixel, _)| inside(*pixel));
        own.for_each(|(pixel, alone)| cut.set(part, pixel, alone));
        cut
    }

    /// Sets the values inside the window `part`, which lies in `whole`.
    pub(super) fn paste(&mut self, whole: &Frame, part: &Frame, edges: &Self) {
        edges.list(part).for_each(|(pixel, alone)| self.set(whole, pixel, alone));
    }

    /// The values of one half, without the samples of the other half.
    pub(super) fn half(mut self, half: usize) -> Self {
        for (_, alone) in self.0.iter_mut().flatten() {
            (alone.samples[1 - half], alone.mean[1 - half]) = (0, [0.0; 3]);
        }
        self
    }
}
