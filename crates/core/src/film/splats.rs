//! Splats: light that samples add to pixels other than their own.

use crate::{Frame, film::RejectedReason};
use serde::{Deserialize, Serialize};

/// The number of units per 1.0: sums are in units of 2^-64.
const UNIT: f64 = 18_446_744_073_709_551_616.0;
/// The largest valid splat; larger splats count as infinite. Sums saturate at ten times this value.
const LARGEST: f32 = 9.0e17;

/// The sums of all splats per pixel, for each half of the samples.
///
/// Sums are integers in units of 2^-64, so that they do not depend on the order of splats.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Splats {
    /// The window of the planes; `None` without planes.
    pub(crate) frame: Option<Frame>,
    /// Linear RGB per pixel; one plane, or one per half. Empty if the film does not record splats.
    pub(crate) sums: Vec<Vec<[i128; 3]>>,
    /// For each plane, the number of samples that could splat, withdrawn ones included.
    pub(crate) samples: [u64; 2],
}

impl Splats {
    pub(crate) fn new(frame: Frame, halves: usize) -> Self {
        Self { frame: Some(frame), sums: vec![vec![[0; 3]; frame.pixels()]; halves], samples: [0; 2] }
    }

    /// Returns `true` if there are `planes` planes, each with one sum per pixel of the window.
    pub(crate) fn is_sound(&self, planes: usize) -> bool {
        let pixels = self.frame.map_or(0, |frame| frame.pixels());
        self.sums.len() == planes && self.sums.iter().all(|sums| sums.len() == pixels)
    }

    /// Empty planes of the same window.
    pub(crate) fn empty(&self) -> Self {
        self.frame.map_or(Self::default(), |frame| Self::new(frame, self.sums.len()))
    }

    /// The splats of one half, for a film without halves.
    pub(super) fn half(&self, half: usize) -> Self {
        let sums = self.sums.get(half).cloned().into_iter().collect();
        Self { frame: self.frame, sums, samples: [self.samples[half], 0] }
    }

    /// Adds the splats of another part of the same render.
    pub(crate) fn join(&mut self, other: &Self) {
        let to = self.sums.iter_mut().flatten().flatten();
        to.zip(other.sums.iter().flatten().flatten()).for_each(|(to, from)| *to = to.saturating_add(*from));
        (0..2).for_each(|half| self.samples[half] = self.samples[half].saturating_add(other.samples[half]));
    }

    /// Counts samples that could splat, by half.
    pub(crate) fn count(&mut self, samples: [u64; 2]) {
        if !self.sums.is_empty() {
            (0..2).for_each(|half| self.samples[half] += samples[half]);
        }
    }

    /// The reason why a splat is rejected; `None` for a valid one.
    pub(crate) fn reason_to_reject(radiance: [f32; 3]) -> Option<RejectedReason> {
        let is_large = radiance.iter().any(|&x| x > LARGEST);
        if is_large { Some(RejectedReason::NotFinite) } else { RejectedReason::of(radiance) }
    }

    /// Adds a splat at column and row of the full image. Drops it outside the window, and if it is rejected.
    pub(crate) fn add(&mut self, half: usize, [column, row]: [u32; 2], radiance: [f32; 3]) {
        let Some(frame) = self.frame else { return };
        let ([x, y], [width, height]) = (frame.origin(), frame.size());
        let (Some(column), Some(row)) = (column.checked_sub(x), row.checked_sub(y)) else { return };
        if column >= width || row >= height || Self::reason_to_reject(radiance).is_some() {
            return;
        }
        if let Some(sums) = self.sums.get_mut(half) {
            let sum = &mut sums[row as usize * width as usize + column as usize];
            (0..3).for_each(|c| sum[c] = sum[c].saturating_add((f64::from(radiance[c]) * UNIT) as i128));
        }
    }

    /// The mean radiance that splats add to pixel `i` in one half: their sum divided by the number of samples per pixel.
    ///
    /// Samples of a cropped window splat onto the whole image. Their number per pixel is therefore taken over all pixels
    /// of the full image.
    pub(super) fn mean(&self, half: usize, i: usize) -> [f64; 3] {
        match (self.frame, self.sums.get(half)) {
            (Some(frame), Some(sums)) if self.samples[half] > 0 => {
                let [width, height] = frame.resolution().map(f64::from);
                let share = width * height / self.samples[half] as f64 / UNIT;
                sums[i].map(|sum| sum as f64 * share)
            }
            _ => [0.0; 3],
        }
    }
}
