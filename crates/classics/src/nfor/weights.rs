//! Weights of non-local means, tile by tile.

use crate::windows::{PatchSums, PixelTile};
use rayon::prelude::*;
use std::ops::Range;

/// The image that weights are computed from: values with their variances.
#[derive(Clone, Copy)]
pub(super) struct Guide<'a> {
    pub(super) size: [usize; 2],
    pub(super) value: &'a [[f64; 3]],
    pub(super) variance: &'a [[f64; 3]],
    /// The number of channels that count, 1 to 3.
    pub(super) channels: usize,
}

/// The window, the patch and the bandwidth of non-local means.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kernel {
    /// Pixels searched to each side.
    pub(super) radius: usize,
    /// Pixels compared to each side.
    pub(super) patch: usize,
    /// Differences are measured in this many standard deviations.
    pub(super) k: f64,
}

/// The width and the height of a tile in pixels.
pub(super) const TILE: [usize; 2] = [32, 16];

/// The smallest weight of a pixel in its own window, as published.
const LEAST_OWN: f64 = 1e-4;
/// The largest squared difference of a pair of pixels, as published.
const FARTHEST: f64 = 1e4;
/// The number added to the divisor of a squared difference, as published.
const EPSILON: f64 = 1e-7;

impl Kernel {
    /// The offsets of the window, row by row.
    pub(super) fn offsets(self) -> impl Iterator<Item = [isize; 2]> {
        let r = self.radius as isize;
        (-r..=r).flat_map(move |dy| (-r..=r).map(move |dx| [dx, dy]))
    }

    /// The squared difference between the pixels `p` and `q`, less what their noise explains.
    fn difference(self, guide: &Guide<'_>, p: usize, q: usize) -> f64 {
        let ([u, v], [uv, vv]) = ([&guide.value[p], &guide.value[q]], [&guide.variance[p], &guide.variance[q]]);
        let mut sum = 0.0;
        for c in 0..guide.channels {
            let d = u[c] - v[c];
            let noise = uv[c] + vv[c].min(uv[c]);
            sum += ((d * d - noise) / (EPSILON + self.k * self.k * (uv[c] + vv[c]))).min(FARTHEST);
        }
        sum / guide.channels as f64
    }
}

/// The weights of a tile: for each pixel, one per offset of the window.
pub(super) struct TileWeights {
    weights: Vec<f64>,
    differences: PatchSums,
    each: usize,
}

impl TileWeights {
    pub(super) fn new(kernel: Kernel) -> Self {
        let each = (2 * kernel.radius + 1) * (2 * kernel.radius + 1);
        let weights = vec![0.0; each * TILE[0] * TILE[1]];
        Self { weights, differences: PatchSums::new(TILE, kernel.patch), each }
    }

    /// The weights of the tile's pixel with this number, in the order of [`Kernel::offsets`]; 0 outside the image.
    pub(super) fn of(&self, pixel: usize) -> &[f64] {
        &self.weights[pixel * self.each..][..self.each]
    }

    /// Computes the weights of all pixels of the tile.
    pub(super) fn compute(&mut self, guide: &Guide<'_>, kernel: Kernel, tile: PixelTile) {
        let [w, h] = guide.size.map(|n| n as isize);
        let patch = kernel.patch as isize;
        for (number, [dx, dy]) in kernel.offsets().enumerate() {
            // Columns and rows at which both pixels of a pair lie in the image.
            let (columns, rows) = (0.max(-dx)..w.min(w - dx), 0.max(-dy)..h.min(h - dy));
            let is_inside = |x: isize, y: isize| columns.contains(&x) && rows.contains(&y);
            let difference = |x: isize, y: isize| match is_inside(x, y) {
                true => kernel.difference(guide, (y * w + x) as usize, ((y + dy) * w + x + dx) as usize),
                false => 0.0,
            };
            let overlap =
                |at: isize, all: &Range<isize>| (all.end.min(at + patch + 1) - all.start.max(at - patch)) as f64;
            let sums = self.differences.compute(tile, difference);
            for (pixel, ([x, y], sum)) in tile.pixels().zip(sums).enumerate() {
                let (x, y) = (x as isize, y as isize);
                let distance = sum / (overlap(x, &columns) * overlap(y, &rows));
                let weight = if is_inside(x, y) { libm::exp(-distance.max(0.0)) } else { 0.0 };
                let own = if dx == 0 && dy == 0 { weight.max(LEAST_OWN) } else { weight };
                self.weights[pixel * self.each + number] = own;
            }
        }
    }
}

/// The non-local mean of `values` with weights from `guide`. Only `known` pixels count; where none is in reach, the value
/// itself is the result.
pub(super) fn nl_average<const N: usize>(
    guide: &Guide<'_>,
    kernel: Kernel,
    values: &[[f64; N]],
    known: &[bool],
) -> Vec<[f64; N]> {
    let [width, height] = guide.size;
    let mut all = vec![[0.0; N]; width * height];
    all.par_chunks_mut(width * TILE[1]).enumerate().for_each_init(
        || TileWeights::new(kernel),
        |weights, (band, rows)| {
            for tile in PixelTile::of_band(guide.size, TILE, band) {
                weights.compute(guide, kernel, tile);
                for (pixel, [x, y]) in tile.pixels().enumerate() {
                    let i = y * width + x;
                    let (mut sum, mut total) = ([0.0; N], 0.0);
                    for (&weight, [dx, dy]) in weights.of(pixel).iter().zip(kernel.offsets()) {
                        let q = (i as isize + dy * width as isize + dx) as usize;
                        if weight > 0.0 && known[q] {
                            total += weight;
                            (0..N).for_each(|c| sum[c] += weight * values[q][c]);
                        }
                    }
                    rows[(y - tile.top) * width + x] = if total > 0.0 { sum.map(|s| s / total) } else { values[i] };
                }
            }
        },
    );
    all
}
