//! Weighted means over windows, both halves at once, the weights of each from the other half's guide.

use crate::planes::{Colours, Inputs, Plane};
use crate::tile::{
    Differences, Guide, HEIGHT, LANES, Likeness, Local, REACH, Row, Tile, WIDTH, count_weights, exp_minus, origins, vectors,
};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// A window, and which of its pixels count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// Pixels to each side, at most [`REACH`].
    pub(crate) radius: usize,
    /// Weights below this count for nothing.
    pub(crate) cut: f32,
    /// The spatial weight is `exp(-falloff r^2)`.
    pub(crate) falloff: f32,
}

/// The weighted means of `values` (both halves').
pub(crate) fn average(
    inputs: &Inputs,
    values: [&Colours; 2],
    guides: &[Guide; 2],
    like: &Likeness,
    window: &Window,
) -> [Colours; 2] {
    let arch = Arch::new();
    let task = |&origin: &[usize; 2]| arch.dispatch(TileTask { inputs, values, guides, like, window, origin });
    let tiles: Vec<Vec<Row>> = origins(inputs.size).par_iter().map(task).collect();
    [0, 1].map(|half| std::array::from_fn(|c| assembled(inputs.size, &tiles, 4 * half + c)))
}

struct TileTask<'a> {
    inputs: &'a Inputs,
    values: [&'a Colours; 2],
    guides: &'a [Guide; 2],
    like: &'a Likeness,
    window: &'a Window,
    origin: [usize; 2],
}

/// Eight planes of a tile: red, green, blue and weight of either half; rows, of each the even and the odd columns.
type Sums = Vec<Row>;

#[inline(always)]
fn place(plane: usize, y: usize, parity: usize) -> usize {
    (plane * HEIGHT + y) * 2 + parity
}

impl WithSimd for TileTask<'_> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Sums {
        let tile = Tile::new(self.inputs, self.origin, self.like);
        let guides = [0, 1].map(|h| tile.guide(&self.guides[h]));
        let colours = self.values.map(|v| [0, 1, 2].map(|c| tile.copy(&v[c])));
        let counts = [0, 1].map(|h| tile.copy_or_zero(&self.inputs.halves[h].count));
        let mut sums = vec![[0.0; LANES]; place(8, 0, 0)];
        let mut differences = [Differences::new(), Differences::new()];
        let side = 2 * self.window.radius + 1;
        for o in 0..side * side {
            let offset = [o % side, o / side].map(|d| d as isize - self.window.radius as isize);
            for (differences, guide) in differences.iter_mut().zip(&guides) {
                differences.compare(simd, guide, tile.extent()[0], self.like.patch, offset);
            }
            self.gather(simd, &tile, &mut differences, &colours, &counts, offset, &mut sums);
        }
        divide(&mut sums);
        sums
    }
}

impl TileTask<'_> {
    /// Adds the pixels that lie `offset` from the tile's.
    #[inline(always)]
    fn gather<S: Simd>(
        &self,
        simd: S,
        tile: &Tile,
        differences: &mut [Differences; 2],
        colours: &[[Local; 3]; 2],
        counts: &[Local; 2],
        offset: [isize; 2],
        sums: &mut Sums,
    ) {
        let [dx, dy] = offset.map(|d| d as f32);
        let spatial = exp_minus(self.window.falloff * (dx * dx + dy * dy));
        let (spatial, cut) = (simd.splat_f32s(spatial), simd.splat_f32s(self.window.cut));
        for y in 0..tile.extent()[0] {
            for differences in &mut *differences {
                differences.sum_columns(simd, y, self.like.patch);
            }
            for parity in 0..2 {
                let by_features = tile.feature_distances(simd, y, parity, offset);
                for half in 0..2 {
                    let patch = differences[1 - half].patches(simd, parity, self.like.patch);
                    let mut row = tile.weights(simd, &patch, &by_features, self.like, [y, parity], offset);
                    let weight = S::as_mut_simd_f32s(&mut row).0;
                    let here = vectors::<S>(counts[half].moved(y, parity, [0, 0]));
                    let there = vectors::<S>(counts[half].moved(y, parity, offset));
                    for i in 0..LANES / S::F32_LANES {
                        let kept = simd.greater_than_or_equal_f32s(weight[i], cut);
                        let count = simd.mul_f32s(count_weights(simd, here[i], there[i]), spatial);
                        let kept = simd.select_f32s(kept, weight[i], simd.splat_f32s(0.0));
                        weight[i] = simd.mul_f32s(kept, count);
                    }
                    for c in 0..3 {
                        let colour = vectors::<S>(colours[half][c].moved(y, parity, offset));
                        let sum = S::as_mut_simd_f32s(&mut sums[place(4 * half + c, y, parity)]).0;
                        for i in 0..LANES / S::F32_LANES {
                            sum[i] = simd.add_f32s(sum[i], simd.mul_f32s(weight[i], colour[i]));
                        }
                    }
                    let sum = S::as_mut_simd_f32s(&mut sums[place(4 * half + 3, y, parity)]).0;
                    for i in 0..LANES / S::F32_LANES {
                        sum[i] = simd.add_f32s(sum[i], weight[i]);
                    }
                }
            }
        }
    }
}

/// Black where no sample is in reach.
#[inline(always)]
fn divide(sums: &mut Sums) {
    for half in 0..2 {
        for c in 0..3 {
            for at in 0..2 * HEIGHT {
                let weights = sums[place(4 * half + 3, 0, 0) + at];
                let values = &mut sums[place(4 * half + c, 0, 0) + at];
                for i in 0..LANES {
                    values[i] = if weights[i] > 0.0 { values[i] / weights[i] } else { 0.0 };
                }
            }
        }
    }
}

fn assembled([width, height]: [usize; 2], tiles: &[Sums], plane: usize) -> Plane {
    let columns = width.div_ceil(WIDTH);
    let mut all = vec![0.0; width * height];
    all.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (column, row) in row.chunks_mut(WIDTH).enumerate() {
            let tile = &tiles[y / HEIGHT * columns + column];
            let rows = [0, 1].map(|parity| &tile[place(plane, y % HEIGHT, parity)]);
            for (x, value) in row.iter_mut().enumerate() {
                *value = rows[x & 1][x / 2];
            }
        }
    });
    all
}

/// A guide of a half's own means; three variances of it, or one for all channels together.
pub(crate) fn guide(inputs: &Inputs, half: usize, pooled: bool, demodulated: bool) -> Guide {
    let own = &inputs.halves[half];
    let divided = |c: usize, plane: &Plane, power: i32| -> Plane {
        if !demodulated {
            return plane.clone();
        }
        plane.iter().enumerate().map(|(i, value)| value / inputs.divisor(c, i).powi(power)).collect()
    };
    let colour: Colours = std::array::from_fn(|c| divided(c, &own.colour[c], 1));
    let [r, g, b]: Colours = std::array::from_fn(|c| divided(c, &own.variance[c], 2));
    if !pooled {
        return Guide { colour, variance: vec![r, g, b] };
    }
    let sum = r.iter().zip(&g).zip(&b).map(|((r, g), b)| r + g + b).collect();
    Guide { colour, variance: vec![sum] }
}

const _: () = assert!(REACH == 7, "windows wider than that do not fit into a tile's margin");
