//! Weights of non-local means, tile by tile.

use rayon::prelude::*;

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

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct WeightTile {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
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
    across: Vec<f64>,
    row: Vec<f64>,
    each: usize,
}

impl TileWeights {
    pub(super) fn new(kernel: Kernel) -> Self {
        let (side, margin) = (2 * kernel.radius + 1, 2 * kernel.patch);
        let each = side * side;
        Self {
            weights: vec![0.0; each * TILE[0] * TILE[1]],
            across: vec![0.0; TILE[0] * (TILE[1] + margin)],
            row: vec![0.0; TILE[0] + margin],
            each,
        }
    }

    /// The weights of the tile's pixel with this number, in the order of [`Kernel::offsets`]; 0 outside the image.
    pub(super) fn of(&self, pixel: usize) -> &[f64] {
        &self.weights[pixel * self.each..][..self.each]
    }

    /// Computes the weights of all pixels of the tile.
    pub(super) fn compute(&mut self, guide: &Guide<'_>, kernel: Kernel, tile: WeightTile) {
        for (k, offset) in kernel.offsets().enumerate() {
            self.compute_offset(guide, kernel, tile, (k, offset));
        }
    }

    fn compute_offset(
        &mut self,
        guide: &Guide<'_>,
        kernel: Kernel,
        tile: WeightTile,
        (number, [dx, dy]): (usize, [isize; 2]),
    ) {
        let [w, h] = guide.size.map(|n| n as isize);
        // Columns and rows at which both pixels of a pair lie in the image.
        let columns = [0.max(-dx), w.min(w - dx)];
        let rows = [0.max(-dy), h.min(h - dy)];
        let f = kernel.patch as isize;
        let (left, top) = (tile.left as isize, tile.top as isize);
        let patch = 2 * kernel.patch + 1;
        let wide = tile.width + 2 * kernel.patch;
        for k in 0..tile.height + 2 * kernel.patch {
            let y = top + k as isize - f;
            let inside = (rows[0]..rows[1]).contains(&y);
            for (k, value) in self.row[..wide].iter_mut().enumerate() {
                let x = left + k as isize - f;
                *value = if inside && (columns[0]..columns[1]).contains(&x) {
                    kernel.difference(guide, (y * w + x) as usize, ((y + dy) * w + x + dx) as usize)
                } else {
                    0.0
                };
            }
            let across = &mut self.across[k * tile.width..][..tile.width];
            across.iter_mut().zip(self.row.windows(patch)).for_each(|(sum, window)| *sum = window.iter().sum());
        }
        let overlap = |at: isize, [first, end]: [isize; 2]| (end.min(at + f + 1) - first.max(at - f)) as f64;
        for y in 0..tile.height {
            for x in 0..tile.width {
                let (px, py) = (left + x as isize, top + y as isize);
                let inside = (columns[0]..columns[1]).contains(&px) && (rows[0]..rows[1]).contains(&py);
                let weight = if inside {
                    let sum: f64 = (0..patch).map(|k| self.across[(y + k) * tile.width + x]).sum();
                    let distance = sum / (overlap(px, columns) * overlap(py, rows));
                    libm::exp(-distance.max(0.0))
                } else {
                    0.0
                };
                let own = if dx == 0 && dy == 0 { weight.max(LEAST_OWN) } else { weight };
                self.weights[(y * tile.width + x) * self.each + number] = own;
            }
        }
    }
}

/// The tiles of the band of rows with this number, from left to right.
pub(super) fn tiles_of_band([width, height]: [usize; 2], band: usize) -> impl Iterator<Item = WeightTile> {
    let top = band * TILE[1];
    (0..width).step_by(TILE[0]).map(move |left| WeightTile {
        left,
        top,
        width: TILE[0].min(width - left),
        height: TILE[1].min(height - top),
    })
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
            for tile in tiles_of_band(guide.size, band) {
                weights.compute(guide, kernel, tile);
                for pixel in 0..tile.width * tile.height {
                    let (x, y) = (tile.left + pixel % tile.width, pixel / tile.width);
                    let i = (tile.top + y) * width + x;
                    let (mut sum, mut total) = ([0.0; N], 0.0);
                    for (&weight, [dx, dy]) in weights.of(pixel).iter().zip(kernel.offsets()) {
                        let q = (i as isize + dy * width as isize + dx) as usize;
                        if weight > 0.0 && known[q] {
                            total += weight;
                            (0..N).for_each(|c| sum[c] += weight * values[q][c]);
                        }
                    }
                    rows[y * width + x] = if total > 0.0 { sum.map(|s| s / total) } else { values[i] };
                }
            }
        },
    );
    all
}
