//! Non-local means weights, tile by tile, and first-order regression on features, whose fits contribute to every pixel of their
//! window.

use super::Rgb;
use crate::windows::{FEATURES, PatchSums, PixelTile};
use dapple_core::parallel;
use std::ops::Range;

/// The image from which weights are computed: values with their variances.
#[derive(Clone, Copy)]
pub(super) struct Guide<'a> {
    pub(super) size: [usize; 2],
    pub(super) value: &'a [[f64; 3]],
    pub(super) variance: &'a [[f64; 3]],
    /// The number of channels that are compared, 1 to 3.
    pub(super) channels: usize,
}

/// The window, the patch and the bandwidth of non-local means.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kernel {
    /// Pixels searched to each side.
    pub(super) radius: usize,
    /// Pixels compared to each side.
    pub(super) patch: usize,
    /// The number of standard deviations in which differences are measured.
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

    /// The squared difference between the pixels `p` and `q`, minus the difference expected from noise.
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

/// The weights of a tile: for each pixel, one weight per offset of the window.
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

    /// The weights of pixel number `pixel` of the tile, in the order of [`Kernel::offsets`]; 0 outside the image.
    pub(super) fn of(&self, pixel: usize) -> &[f64] {
        &self.weights[pixel * self.each..][..self.each]
    }

    /// Computes the weights of all pixels of the tile.
    pub(super) fn compute(&mut self, guide: &Guide<'_>, kernel: Kernel, tile: PixelTile) {
        let [w, h] = guide.size.map(|n| n as isize);
        let patch = kernel.patch as isize;
        for (number, [dx, dy]) in kernel.offsets().enumerate() {
            // The columns and rows for which both pixels of a pair lie in the image.
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

/// The non-local mean of `values` with weights from `guide`. Only pixels in `known` contribute. If none is in reach, the value
/// stays unchanged.
pub(super) fn nl_average<const N: usize>(
    guide: &Guide<'_>,
    kernel: Kernel,
    values: &[[f64; N]],
    known: &[bool],
) -> Vec<[f64; N]> {
    let [width, height] = guide.size;
    let mut all = vec![[0.0; N]; width * height];
    parallel::chunks(&mut all, width * TILE[1], |band, rows| {
        let mut weights = TileWeights::new(kernel);
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
    });
    all
}

/// The unknowns of a fit: the mean and a slope per feature.
const UNKNOWNS: usize = FEATURES + 1;

/// The smallest pivot of the normal equations, relative to the largest. Regressors with smaller pivots are left out.
const DEPENDENT: f64 = 1e-10;

/// The data of a regression: colours, a mask of the pixels that have a colour, and the features of all pixels.
#[derive(Clone, Copy)]
pub(super) struct Data<'a> {
    pub(super) colour: &'a [[f64; 3]],
    pub(super) known: &'a [bool],
    pub(super) features: &'a [[f64; FEATURES]],
}

/// Fits the colours in the window of each pixel by an affine function of the features [Bitterli 2016].
///
/// All fitted values of a pixel are averaged with the weights of their windows.
///
/// Pixels that no window reaches keep their colour. Bands of rows are summed in order, so the result does not depend on
/// threads.
pub(super) fn regress(guide: &Guide<'_>, kernel: Kernel, data: &Data<'_>) -> Rgb {
    let [width, height] = guide.size;
    let bands = height.div_ceil(TILE[1]);
    let splat = |band: usize| -> Band {
        let mut weights = TileWeights::new(kernel);
        let mut sums = Band::new(guide.size, band, kernel.radius);
        for tile in PixelTile::of_band(guide.size, TILE, band) {
            weights.compute(guide, kernel, tile);
            for (pixel, [x, y]) in tile.pixels().enumerate() {
                sums.fit(guide.size, kernel, data, y * width + x, weights.of(pixel));
            }
        }
        sums
    };
    let all: Vec<Band> = parallel::map(bands, splat);
    let mut sums = vec![[0.0; 4]; width * height];
    for band in all {
        let places = &mut sums[band.first * width..];
        places.iter_mut().zip(&band.sums).for_each(|(sum, value)| (0..4).for_each(|c| sum[c] += value[c]));
    }
    let mean = |(&[weight, r, g, b], colour): (&[f64; 4], &[f64; 3])| {
        if weight > 0.0 { [r / weight, g / weight, b / weight] } else { *colour }
    };
    sums.iter().zip(data.colour).map(mean).collect()
}

/// The sums of weights and of weighted fits, over the rows that the windows of a band of rows reach.
struct Band {
    first: usize,
    sums: Vec<[f64; 4]>,
}

impl Band {
    fn new([width, height]: [usize; 2], band: usize, radius: usize) -> Self {
        let first = (band * TILE[1]).saturating_sub(radius);
        let end = ((band + 1) * TILE[1] + radius).min(height);
        Self { first, sums: vec![[0.0; 4]; (end - first) * width] }
    }

    /// Fits the window around pixel `i`, and adds the fitted values to the sums.
    fn fit(&mut self, [width, _]: [usize; 2], kernel: Kernel, data: &Data<'_>, i: usize, weights: &[f64]) {
        let near = || {
            let window = weights.iter().zip(kernel.offsets()).filter(|(w, _)| **w > 0.0);
            window.map(|(&w, [dx, dy])| (w, (i as isize + dy * width as isize + dx) as usize))
        };
        let own = &data.features[i];
        let row = |q: usize| -> [f64; UNKNOWNS] {
            let feature = &data.features[q];
            std::array::from_fn(|k| if k == 0 { 1.0 } else { feature[k - 1] - own[k - 1] })
        };
        let mut equations = NormalEquations::default();
        near().filter(|&(_, q)| data.known[q]).for_each(|(w, q)| equations.add(w, &row(q), &data.colour[q]));
        let Some(fit) = equations.solved() else { return };
        for (w, q) in near() {
            let x = row(q);
            let sums = &mut self.sums[q - self.first * width];
            sums[0] += w;
            for c in 0..3 {
                let fitted: f64 = (0..UNKNOWNS).map(|k| x[k] * fit[k][c]).sum();
                sums[1 + c] += w * fitted;
            }
        }
    }
}

/// The normal equations of a weighted fit of three channels.
#[derive(Clone, Copy, Default)]
pub(super) struct NormalEquations {
    /// The normal matrix; only the lower triangle is used.
    matrix: [[f64; UNKNOWNS]; UNKNOWNS],
    right: [[f64; 3]; UNKNOWNS],
}

impl NormalEquations {
    pub(super) fn add(&mut self, weight: f64, row: &[f64; UNKNOWNS], colour: &[f64; 3]) {
        for a in 0..UNKNOWNS {
            let weighted = weight * row[a];
            (0..=a).for_each(|b| self.matrix[a][b] += weighted * row[b]);
            (0..3).for_each(|c| self.right[a][c] += weighted * colour[c]);
        }
    }

    /// The solution by a pivoted Cholesky decomposition; `None` without data. Linearly dependent regressors have slope 0.
    pub(super) fn solved(&self) -> Option<[[f64; 3]; UNKNOWNS]> {
        let full = |a: usize, b: usize| self.matrix[a.max(b)][a.min(b)];
        let largest = (0..UNKNOWNS).map(|k| full(k, k)).fold(0.0, f64::max);
        if largest <= 0.0 || !largest.is_finite() {
            return None;
        }
        // Row k of the factor belongs to the regressor order[k].
        let mut order: [usize; UNKNOWNS] = std::array::from_fn(|k| k);
        let mut factor = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut rank = 0;
        while rank < UNKNOWNS {
            let rest =
                |k: usize| full(order[k], order[k]) - (0..rank).map(|j| factor[k][j] * factor[k][j]).sum::<f64>();
            let best = (rank..UNKNOWNS).fold(rank, |best, k| if rest(k) > rest(best) { k } else { best });
            let pivot = rest(best);
            if pivot <= DEPENDENT * largest {
                break;
            }
            order.swap(rank, best);
            factor.swap(rank, best);
            factor[rank][rank] = pivot.sqrt();
            for k in rank + 1..UNKNOWNS {
                let known: f64 = (0..rank).map(|j| factor[k][j] * factor[rank][j]).sum();
                factor[k][rank] = (full(order[k], order[rank]) - known) / factor[rank][rank];
            }
            rank += 1;
        }
        let mut solution = [[0.0; 3]; UNKNOWNS];
        for c in [0, 1, 2] {
            let mut y = [0.0; UNKNOWNS];
            for k in 0..rank {
                let known: f64 = (0..k).map(|j| factor[k][j] * y[j]).sum();
                y[k] = (self.right[order[k]][c] - known) / factor[k][k];
            }
            for k in (0..rank).rev() {
                let known: f64 = (k + 1..rank).map(|j| factor[j][k] * y[j]).sum();
                y[k] = (y[k] - known) / factor[k][k];
                solution[order[k]][c] = y[k];
            }
        }
        Some(solution)
    }
}
