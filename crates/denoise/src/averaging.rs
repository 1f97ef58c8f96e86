//! Weighted means over windows of pixels, for both halves of the samples at once. The weights of each half come from a
//! guide: the colours and variances of the other half.

use crate::guide::Guide;
use crate::inputs::Inputs;
use crate::planes::{Colours, Plane, dispatch};
use crate::tile::{
    Differences, HEIGHT, LANES, Likeness, LocalGuide, REACH, Stack, Tile, WIDTH, count_weights, exp_minus, number,
    origins, sharpness, stride, tiles, vectors,
};
use dapple_core::{FilterMemory, Frame, ImagePlanes};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

/// A window around a pixel, and its spatial weights.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// The radius in pixels, at most [`REACH`].
    pub(crate) radius: usize,
    /// The largest squared distance in a window that is a disc; `None` for a square.
    pub(crate) disc: Option<usize>,
    /// The least weight of a pixel that counts; smaller weights are replaced by 0.
    pub(crate) cut: f32,
    /// The falloff of the spatial weight `exp(-falloff r^2)`, with `r` in pixels.
    pub(crate) falloff: f32,
}

/// The weight below which a pixel is left out. It would vanish in a sum, but its products are slow subnormal numbers.
/// Leaving such pixels out saves a third of the time of `cluster-regression` (docs/results/filters.md).
pub(crate) const VANISHING: f32 = 1e-20;

/// The weighted means of `values` over a window around each pixel, for both halves.
pub(crate) fn average(
    inputs: &Inputs,
    values: [&Colours; 2],
    guides: &[Guide; 2],
    like: &Likeness,
    window: &Window,
) -> [Colours; 2] {
    average_where(inputs, values, guides, like, window, &|_| true)
}

/// Averages the tiles for whose origin `wanted` returns true; the other tiles keep their values. With two guides, each
/// half takes its weights from the other half's guide. A single guide serves both halves.
pub(crate) fn average_where<const G: usize>(
    inputs: &Inputs,
    values: [&Colours; 2],
    guides: &[Guide; G],
    like: &Likeness,
    window: &Window,
    wanted: &(impl Fn([usize; 2]) -> bool + Sync),
) -> [Colours; 2] {
    let sharp = like.features.map(|scales| sharpness(&inputs.features, &scales));
    let sharp = sharp.as_ref();
    let task = |scratch: &mut Scratch<G>, &origin: &[usize; 2]| {
        wanted(origin).then(|| dispatch(TileTask { inputs, values, guides, like, sharp, window, origin, scratch }))
    };
    let tiles: Vec<Option<Sums>> = origins(inputs.size).par_iter().map_init(Scratch::default, task).collect();
    [0, 1].map(|half| std::array::from_fn(|c| assembled(inputs.size, &tiles, &values[half][c], half, c)))
}

/// The memory of a filter that computes one average over [`Inputs`]. `pooled` guides have one plane of variance instead
/// of three.
pub(crate) fn memory(frame: &Frame, labels: bool, like: &Likeness, pooled: bool) -> FilterMemory {
    let [kept, making] = Inputs::bytes_per_pixel(labels);
    let guides = 2 * (3 + if pooled { 1 } else { 3 });
    let sharp = if like.features.is_some() { 3 } else { 0 };
    // The result of both halves stands beside the tiles that it is assembled from.
    let sums = tiles(frame.size()) * (size_of::<[f32; 4 * LANES]>() * place(2, 0, 0)) as u64;
    let averaging = frame.bytes(kept + 4 * (guides + sharp + 6)).saturating_add(sums);
    FilterMemory::new(frame, making, ImagePlanes::RadianceAndError).at_least(averaging)
}

struct TileTask<'a, const G: usize> {
    inputs: &'a Inputs,
    values: [&'a Colours; 2],
    guides: &'a [Guide; G],
    like: &'a Likeness,
    sharp: Option<&'a [Plane; 3]>,
    window: &'a Window,
    origin: [usize; 2],
    scratch: &'a mut Scratch<G>,
}

/// The memory of a task, which the next one uses again.
struct Scratch<const G: usize> {
    tile: Tile,
    guides: [LocalGuide; G],
    values: [Stack<4>; 2],
    differences: [Differences; G],
}

impl<const G: usize> Default for Scratch<G> {
    fn default() -> Self {
        Self {
            tile: Tile::default(),
            guides: std::array::from_fn(|_| LocalGuide::default()),
            values: Default::default(),
            differences: std::array::from_fn(|_| Differences::default()),
        }
    }
}

/// The weighted sums of a tile. An entry holds red, green, blue and weight of the even (or odd) columns in a row of one
/// half.
type Sums = Vec<[f32; 4 * LANES]>;

#[inline(always)]
fn place(half: usize, y: usize, parity: usize) -> usize {
    (half * HEIGHT + y) * 2 + parity
}

impl<const G: usize> WithSimd for TileTask<'_, G> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Sums {
        // Each radius has its own unrolled sums over patches.
        match self.like.patch {
            0 => self.run::<S, 0>(simd),
            1 => self.run::<S, 1>(simd),
            2 => self.run::<S, 2>(simd),
            _ => self.run::<S, 3>(simd),
        }
    }
}

impl<const G: usize> TileTask<'_, G> {
    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) -> Sums {
        let Self { inputs, values, guides, like, sharp, window, origin, scratch } = self;
        scratch.tile.copy(inputs, origin, like, sharp);
        guides.iter().zip(&mut scratch.guides).for_each(|(guide, to)| scratch.tile.copy_guide(guide, to));
        for (h, to) in scratch.values.iter_mut().enumerate() {
            let [r, g, b] = values[h];
            to.copy([r, g, b, &inputs.halves[h].count], inputs.size, origin);
            to.clear_outside(3, inputs.size, origin);
        }
        let mut sums = vec![[0.0; 4 * LANES]; place(2, 0, 0)];
        let side = 2 * window.radius + 1;
        for o in 0..side * side {
            let offset = [o % side, o / side].map(|d| d as isize - window.radius as isize);
            let square = offset.iter().map(|d| d.unsigned_abs().pow(2)).sum::<usize>();
            if window.disc.is_some_and(|most| square > most) {
                continue;
            }
            for (differences, guide) in scratch.differences.iter_mut().zip(&scratch.guides) {
                differences.compare::<S, R>(simd, guide, scratch.tile.extent()[0], offset);
            }
            scratch.gather::<S, R>(simd, like, window, offset, &mut sums);
        }
        divide(&mut sums);
        sums
    }
}

impl<const G: usize> Scratch<G> {
    /// Adds to the sums of each pixel in the tile the pixel at `offset` from it, multiplied by its weight.
    #[inline(always)]
    fn gather<S: Simd, const R: usize>(
        &mut self,
        simd: S,
        like: &Likeness,
        window: &Window,
        offset: [isize; 2],
        sums: &mut Sums,
    ) {
        let Self { tile, values, differences, .. } = self;
        let [dx, dy] = offset.map(|d| d as f32);
        let spatial = exp_minus(window.falloff * (dx * dx + dy * dy));
        let (spatial, cut) = (simd.splat_f32s(spatial), simd.splat_f32s(window.cut));
        let step = stride::<S>();
        let mut weights = [[0.0; LANES]; G];
        for y in 0..tile.extent()[0] {
            for differences in &mut *differences {
                differences.sum_columns::<S, R>(simd, y);
            }
            for parity in 0..2 {
                tile.weights::<S, R, G>(simd, differences, like, [y, parity], offset, &mut weights);
                for half in 0..2 {
                    let here = vectors::<S>(values[half].moved(y, parity, [0, 0]));
                    let there = vectors::<S>(values[half].moved(y, parity, offset));
                    // The weights of the other half, if there are two guides.
                    let weights = vectors::<S>(&weights[(G - 1).saturating_sub(half)]);
                    let sums = S::as_mut_simd_f32s(&mut sums[place(half, y, parity)]).0;
                    for i in 0..LANES / S::F32_LANES {
                        let kept = simd.greater_than_or_equal_f32s(weights[i], cut);
                        let kept = simd.select_f32s(kept, weights[i], simd.splat_f32s(0.0));
                        let count = count_weights(simd, here[3 * step + i], there[3 * step + i]);
                        let weight = simd.mul_f32s(kept, simd.mul_f32s(count, spatial));
                        for c in 0..3 {
                            let sum = &mut sums[c * LANES / S::F32_LANES + i];
                            *sum = simd.add_f32s(*sum, simd.mul_f32s(weight, there[c * step + i]));
                        }
                        let sum = &mut sums[3 * LANES / S::F32_LANES + i];
                        *sum = simd.add_f32s(*sum, weight);
                    }
                }
            }
        }
    }
}

/// Divides the sums of colours by the sums of weights. A pixel becomes black if its window holds no sample.
#[inline(always)]
fn divide(sums: &mut Sums) {
    for row in sums {
        let (colours, weights) = row.split_at_mut(3 * LANES);
        for c in 0..3 {
            for i in 0..LANES {
                let value = &mut colours[c * LANES + i];
                *value = if weights[i] > 0.0 { *value / weights[i] } else { 0.0 };
            }
        }
    }
}

fn assembled([width, height]: [usize; 2], tiles: &[Option<Sums>], own: &[f32], half: usize, c: usize) -> Plane {
    let mut all = vec![0.0; width * height];
    all.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (column, row) in row.chunks_mut(WIDTH).enumerate() {
            let Some(tile) = &tiles[number([column, y / HEIGHT], height)] else {
                row.copy_from_slice(&own[y * width + column * WIDTH..][..row.len()]);
                continue;
            };
            let rows = [0, 1].map(|parity| &tile[place(half, y % HEIGHT, parity)][c * LANES..][..LANES]);
            for (x, value) in row.iter_mut().enumerate() {
                *value = rows[x & 1][x / 2];
            }
        }
    });
    all
}

const _: () = assert!(REACH == 7, "windows wider than that do not fit into a tile's margin");
