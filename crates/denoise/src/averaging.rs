//! Weighted means over windows of pixels, for both halves of the samples at once. The weights of each half come from a
//! guide: the colours and variances of the other half.
//!
//! The [`prefilter`] of features is such a mean. It removes most of the noise from lens blur, motion blur, subpixel geometry, and
//! surfaces that both reflect and refract.

use crate::inputs::{Guide, Inputs};
use crate::planes::{Colours, Pair, Plane, box_mean, dispatch, parts};
use crate::tile::{
    Comparison, HEIGHT, LANES, Likeness, REACH, Stack, Tile, WIDTH, count_weights, exp_minus, number, origins, stride,
    vectors,
};
use dapple_core::filter::{FilterMemory, ImagePlanes};
use dapple_core::{Frame, parallel};
use pulp::{Simd, WithSimd};

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

/// The weighted means of `values` over a window around each pixel, for both halves. Tiles for whose origin `wanted` returns false
/// keep their values. With two guides, each
/// half takes its weights from the other half's guide. A single guide serves both halves.
pub(crate) fn average<const G: usize>(
    inputs: &Inputs,
    values: [&Colours; 2],
    guides: &[Guide; G],
    like: &Likeness,
    window: &Window,
    wanted: impl Fn([usize; 2]) -> bool + Sync,
) -> Pair {
    let by = &Comparison::new(inputs, guides, like);
    let origins = origins(inputs.size);
    let tiles: Vec<Option<Sums>> = parallel::map_with(origins.len(), Scratch::default, |scratch, tile| {
        let origin = origins[tile];
        wanted(origin).then(|| dispatch(TileTask { by, values, window, origin, scratch }))
    });
    Pair(std::array::from_fn(|k| assembled(inputs.size, &tiles, &values[k / 3][k % 3], [k / 3, k % 3])))
}

/// The memory of a filter that computes one average over [`Inputs`]. `pooled` guides have one plane of variance instead
/// of three.
pub(crate) fn memory(frame: &Frame, labels: bool, like: &Likeness, pooled: bool) -> FilterMemory {
    let [kept, making] = Inputs::bytes_per_pixel(labels);
    let guides = 2 * (3 + if pooled { 1 } else { 3 });
    let sharp = if like.features.is_some() { 3 } else { 0 };
    // The result of both halves stands beside the tiles that it is assembled from.
    let tiles = size_of::<[f32; 4 * LANES]>() * place(2, 0, 0) / (WIDTH * HEIGHT);
    let averaging = kept + 4 * (guides + sharp + 6) + tiles;
    FilterMemory::new(frame, making.max(averaging), ImagePlanes::RadianceAndError)
}

struct TileTask<'a, const G: usize> {
    by: &'a Comparison<'a, G>,
    values: [&'a Colours; 2],
    window: &'a Window,
    origin: [usize; 2],
    scratch: &'a mut Scratch<G>,
}

/// The memory of a task, which the next one uses again.
#[derive(Default)]
struct Scratch<const G: usize> {
    tile: Tile<G>,
    values: [Stack<4>; 2],
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
        let Self { by, values, window, origin, scratch } = self;
        let inputs = by.inputs;
        scratch.tile.copy(by, origin);
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
            scratch.tile.compare(simd, offset, by.like.patch);
            scratch.gather(simd, by.like, window, offset, &mut sums);
        }
        divide(&mut sums);
        sums
    }
}

impl<const G: usize> Scratch<G> {
    /// Adds to the sums of each pixel in the tile the pixel at `offset` from it, multiplied by its weight.
    #[inline(always)]
    fn gather<S: Simd>(&mut self, simd: S, like: &Likeness, window: &Window, offset: [isize; 2], sums: &mut Sums) {
        let Self { tile, values } = self;
        let [dx, dy] = offset.map(|d| d as f32);
        let spatial = exp_minus(window.falloff * (dx * dx + dy * dy));
        let (spatial, cut) = (simd.splat_f32s(spatial), simd.splat_f32s(window.cut));
        let step = stride::<S>();
        let mut weights = [[0.0; LANES]; G];
        for y in 0..tile.extent()[0] {
            tile.sum_columns(simd, y, like.patch);
            for parity in 0..2 {
                tile.weights(simd, like, [y, parity], offset, &mut weights);
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

fn assembled([width, height]: [usize; 2], tiles: &[Option<Sums>], own: &[f32], [half, c]: [usize; 2]) -> Plane {
    let of_row = |(): &mut (), y: usize, [row]: [&mut [f32]; 1]| {
        for (column, row) in row.chunks_mut(WIDTH).enumerate() {
            let Some(tile) = &tiles[number([column, y / HEIGHT], height)] else {
                row.copy_from_slice(&own[y * width + column * WIDTH..][..row.len()]);
                continue;
            };
            let rows = [0, 1].map(|parity| &tile[place(half, y % HEIGHT, parity)][c * LANES..][..LANES]);
            row.iter_mut().enumerate().for_each(|(x, value)| *value = rows[x & 1][x / 2]);
        }
    };
    let [all] = parts(width * height, width, || (), of_row);
    all
}

/// The patches (3x3 pixels) and the bandwidth, chosen by measurements at 8 spp on nine scenes (`docs/results/race.md`).
/// Patches of 1 pixel do not help, 5x5 is no better than 3x3. Bandwidths 0.5 and 1 leave 2 and 4 % more error.
const LIKE: Likeness = Likeness { patch: 1, colour: 0.7, features: None, outside: 1.0 };
/// The window of 9x9 pixels, chosen by the same measurements: 7x7 leaves 1 % more error, 11x11 and 15x15 leave no less.
const WINDOW: Window = Window { radius: 4, disc: None, cut: VANISHING, falloff: 0.0 };
/// The variance of a mean normal, albedo or log depth up to which the feature counts as free of noise.
const QUIET: f32 = 1e-5;

/// Averages normal and albedo, then position and depth, over pixels whose patches differ by no more than their noise.
///
/// The weights come from the features themselves [after Rousselle 2013], but with the variance of each pixel's samples
/// instead of the variance between the halves. Tiles without noise keep their values.
///
/// The stored variances stay unchanged. Reduced variances would make features separate more pixels: at a quarter of the
/// variance, 3 % more error is left.
pub(crate) fn prefilter(inputs: &mut Inputs) {
    let [nx, ny, nz, r, g, b, depth] = std::mem::take(&mut inputs.features.mean);
    let [vn, va, vd] = &inputs.features.variance;
    let surface = [feature_guide(inputs, [r, g, b], va, |_| QUIET), feature_guide(inputs, [nx, ny, nz], vn, |_| QUIET)];
    let noisy = |[n, a]: [f32; 2]| n > QUIET || a > QUIET;
    let wanted = tiles_with(inputs.size, |i| noisy([vn[i], va[i]]));
    // Each value takes its weights from the other guide. Normals are the first value, so their guide is the second.
    let values = [&surface[1].colour, &surface[0].colour];
    let Pair([nx, ny, nz, r, g, b]) = average(inputs, values, &surface, &LIKE, &WINDOW, wanted);
    drop(surface);

    let position = std::mem::take(&mut inputs.features.position);
    let wanted = tiles_with(inputs.size, |i| vd[i] > QUIET);
    // Points closer than the width of a pixel count as one place.
    let width = |i: usize| (1.0 / (24.0 * inputs.features.scale[i])).clamp(1e-15, 1e15).powi(2);
    let places = [feature_guide(inputs, position, &inputs.features.scatter, width)];
    let depths: Colours = [depth.clone(), depth.clone(), depth];
    let values = [&places[0].colour, &depths];
    let Pair([x, y, z, depth, ..]) = average(inputs, values, &places, &LIKE, &WINDOW, wanted);
    inputs.features.mean = [nx, ny, nz, r, g, b, depth];
    inputs.features.position = [x, y, z];
}

/// Makes a guide of features. Its variance is `floor` plus the mean of the pixel's own variance and the variance over
/// 3x3 pixels, since a few samples may be equal by chance.
fn feature_guide(inputs: &Inputs, colour: Colours, variance: &Plane, floor: impl Fn(usize) -> f32) -> Guide {
    let near = box_mean(variance, inputs.size, 1);
    let pooled = |(i, (own, near)): (usize, (&f32, &f32))| 0.5 * (own + near) + floor(i);
    Guide { colour, variance: vec![variance.iter().zip(&near).enumerate().map(pooled).collect()] }
}

/// Returns a test for tiles: true for the origin of a tile if any of its pixels satisfies `is`.
fn tiles_with([width, height]: [usize; 2], is: impl Fn(usize) -> bool + Sync) -> impl Fn([usize; 2]) -> bool + Sync {
    move |[x, y]| {
        let row = |row: usize| (x..(x + WIDTH).min(width)).any(|x| is(row * width + x));
        (y..(y + HEIGHT).min(height)).any(row)
    }
}

const _: () = assert!(REACH == 7, "windows wider than that do not fit into a tile's margin");
