//! Weighted means over windows of pixels, for both halves of the samples at once. The weights for one half come from a guide:
//! the colours and variances of the other half.
//!
//! The [`prefilter`] of features is such a mean. It removes most of the noise that lens blur, motion blur, subpixel geometry
//! and partly refracting surfaces cause in features.

use crate::features::Features;
use crate::graph::{Graph, Reach, Rows, all};
use crate::inputs::{Guide, Inputs};
use crate::planes::{Colours, Pair, Plane, box_mean, dispatch, map_to_one};
use crate::tile::{
    Comparison, HEIGHT, LANES, Likeness, Place, REACH, Stack, Tile, WIDTH, count_weights, exp_minus, stride, tiles,
    vectors,
};
use pulp::{Simd, WithSimd};

/// A window around a pixel, and its spatial weights.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// The radius in pixels, at most [`REACH`].
    pub(crate) radius: usize,
    /// The largest squared distance from the centre in a disc-shaped window; `None` for a square window.
    pub(crate) disc: Option<usize>,
    /// The threshold below which a weight is replaced by 0.
    pub(crate) cut: f32,
    /// The falloff of the spatial weight `exp(-falloff r^2)`, with `r` in pixels.
    pub(crate) falloff: f32,
}

/// The weight below which a pixel is left out. Smaller weights change no sum, but their products are subnormal numbers, which
/// are slow. Leaving such pixels out saves a third of the time of `cluster-regression` (docs/results/filters.md).
pub(crate) const VANISHING: f32 = 1e-20;

/// Returns the weighted means of `values` over a window around each pixel, for both halves. With two guides, each half uses
/// weights from the other half's guide; a single guide serves both halves. A tile whose `variances` are all at most [`QUIET`]
/// keeps its values. If `variances` is empty, all tiles are averaged.
pub(crate) fn average<const G: usize>(
    graph: &Graph<'_>,
    inputs: &Inputs,
    values: [Colours; 2],
    guides: [Guide; G],
    (like, window): (Likeness, Window),
    variances: Vec<Plane>,
) -> Pair {
    let by = Comparison::new(graph, inputs, guides, like, window.radius);
    let reads = by.reads(values.into_iter().flatten().chain(inputs.counts()).chain(variances.iter().copied()));
    let sizes = (tiles(graph.size), row_of(2, 0, 0));
    let tiles = graph.tiles(sizes, reads, Scratch::default, move |scratch, rows, tile| {
        let place = by.place(tile);
        let is_wanted = variances.is_empty() || variances.iter().any(|plane| is_noisy(rows, *plane, place));
        if is_wanted {
            dispatch(TileTask { by: &by, rows, values, window: &window, place, scratch })
        } else {
            Vec::new()
        }
    });
    let mut reads = all(tiles.iter().copied(), Reach::from_coarse(HEIGHT, 0));
    reads.extend(all(values.into_iter().flatten(), Reach::rows(0)));
    Pair(graph.rows(reads, move |rows, y, to: [&mut [f32]; 6]| {
        for (k, to) in to.into_iter().enumerate() {
            let (half, c) = (k / 3, k % 3);
            for ((row, own), tile) in to.chunks_mut(WIDTH).zip(rows.row(values[half][c], y).chunks(WIDTH)).zip(&tiles) {
                let tile = rows.row(*tile, y / HEIGHT);
                if tile.is_empty() {
                    row.copy_from_slice(own);
                    continue;
                }
                let parities = [0, 1].map(|parity| &tile[row_of(half, y % HEIGHT, parity) + c * LANES..][..LANES]);
                row.iter_mut().enumerate().for_each(|(x, value)| *value = parities[x & 1][x / 2]);
            }
        }
    }))
}

/// Returns `true` if a pixel of a tile has a variance above [`QUIET`].
fn is_noisy(rows: &Rows, variance: Plane, place: Place) -> bool {
    let ([width, height], [x, y]) = (place.size, place.origin);
    let row = |y: usize| rows.row(variance, y)[x..(x + WIDTH).min(width)].iter().any(|v| *v > QUIET);
    (y..(y + HEIGHT).min(height)).any(row)
}

struct TileTask<'a, const G: usize> {
    by: &'a Comparison<G>,
    rows: &'a Rows,
    values: [Colours; 2],
    window: &'a Window,
    place: Place,
    scratch: &'a mut Scratch<G>,
}

/// Buffers of a task, reused by the next task.
#[derive(Default)]
struct Scratch<const G: usize> {
    tile: Tile<G>,
    values: [Stack<4>; 2],
}

/// The offset of the even (or odd) columns of row `y` of a half in the weighted sums of a tile: red, green, blue and weight.
#[inline(always)]
const fn row_of(half: usize, y: usize, parity: usize) -> usize {
    ((half * HEIGHT + y) * 2 + parity) * 4 * LANES
}

impl<const G: usize> WithSimd for TileTask<'_, G> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let Self { by, rows, values, window, place, scratch } = self;
        scratch.tile.copy(by, rows, place);
        for (h, to) in scratch.values.iter_mut().enumerate() {
            let [r, g, b] = values[h];
            to.copy(rows, [r, g, b, by.inputs.halves[h].count], place);
            to.clear_outside(3, place);
        }
        let mut sums = vec![0.0; row_of(2, 0, 0)];
        let side = 2 * window.radius + 1;
        for o in 0..side * side {
            let offset = [o % side, o / side].map(|d| d as isize - window.radius as isize);
            let square = offset.iter().map(|d| d.unsigned_abs().pow(2)).sum::<usize>();
            if window.disc.is_some_and(|most| square > most) {
                continue;
            }
            scratch.tile.compare(simd, offset, by.like.patch);
            scratch.gather(simd, &by.like, window, offset, &mut sums);
        }
        divide(&mut sums);
        sums
    }
}

impl<const G: usize> Scratch<G> {
    /// For each pixel of the tile, adds the weighted pixel at `offset` from it to its sums.
    #[inline(always)]
    fn gather<S: Simd>(&mut self, simd: S, like: &Likeness, window: &Window, offset: [isize; 2], sums: &mut [f32]) {
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
                    // With two guides, the weights come from the other half's guide.
                    let weights = vectors::<S>(&weights[(G - 1).saturating_sub(half)]);
                    let sums = S::as_mut_simd_f32s(&mut sums[row_of(half, y, parity)..][..4 * LANES]).0;
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

/// Divides the sums of colours by the sums of weights. A pixel whose window holds no sample becomes black.
#[inline(always)]
fn divide(sums: &mut [f32]) {
    for row in sums.chunks_exact_mut(4 * LANES) {
        let (colours, weights) = row.split_at_mut(3 * LANES);
        for c in 0..3 {
            for i in 0..LANES {
                let value = &mut colours[c * LANES + i];
                *value = if weights[i] > 0.0 { *value / weights[i] } else { 0.0 };
            }
        }
    }
}

/// Patches of 3x3 pixels and a bandwidth of 0.7, the best at 8 spp on nine scenes (`docs/results/race.md`). Comparing single
/// pixels does not help, and 5x5 is no better than 3x3. Bandwidths 0.5 and 1 leave 2 and 4 % more error.
const LIKE: Likeness = Likeness { patch: 1, colour: 0.7, features: None, outside: 1.0 };
/// The window of 9x9 pixels, the best on the same scenes: 7x7 leaves 1 % more error, 11x11 and 15x15 no less.
const WINDOW: Window = Window { radius: 4, disc: None, cut: VANISHING, falloff: 0.0 };
/// The variance of a mean normal, albedo or log depth up to which the feature counts as free of noise.
const QUIET: f32 = 1e-5;

/// Averages normal and albedo, then position and depth, over pixels whose patches differ by no more than their noise.
///
/// The weights come from the features themselves [after Rousselle 2013], but with the variance of each pixel's samples
/// instead of the variance between the halves. Tiles without noise keep their values.
///
/// The stored variances stay unchanged. With a quarter of the variance, small differences of features would separate more
/// pixels and leave 3 % more error.
pub(crate) fn prefilter(graph: &Graph<'_>, inputs: &mut Inputs) {
    let Features { mean, variance: [vn, va, vd], scatter, position, scale, .. } = inputs.features;
    let [nx, ny, nz, r, g, b, depth] = mean;
    let quiet = |_: f32| QUIET;
    let surface = [([r, g, b], va), ([nx, ny, nz], vn)].map(|of| feature_guide(graph, of, scale, quiet));
    // `average` weighs value 0 by guide 1 and value 1 by guide 0, so the guides are in reverse order.
    let values = [[nx, ny, nz], [r, g, b]];
    let Pair([nx, ny, nz, r, g, b]) = average(graph, inputs, values, surface, (LIKE, WINDOW), vec![vn, va]);

    // Points closer than the width of a pixel count as the same point.
    let width = |scale: f32| (1.0 / (24.0 * scale)).clamp(1e-15, 1e15).powi(2);
    let places = [feature_guide(graph, (position, scatter), scale, width)];
    let values = [position, [depth; 3]];
    let Pair([x, y, z, depth, ..]) = average(graph, inputs, values, places, (LIKE, WINDOW), vec![vd]);
    inputs.features.mean = [nx, ny, nz, r, g, b, depth];
    inputs.features.position = [x, y, z];
}

/// Returns a guide made of features and their variance. The guide's variance is `floor` at the [`Features::scale`], plus the
/// mean of two variances: the pixel's own, and the average over 3x3 pixels. A few samples may be equal by chance, so the
/// pixel's own variance alone is unreliable.
fn feature_guide(
    graph: &Graph<'_>,
    (colour, variance): (Colours, Plane),
    scale: Plane,
    floor: impl Fn(f32) -> f32 + Sync + 'static,
) -> Guide {
    let near = box_mean(graph, variance, 1);
    let pooled =
        map_to_one(graph, [variance, near, scale], move |[own, near, scale]| 0.5 * (own + near) + floor(scale));
    Guide { colour, variance: vec![pooled] }
}

const _: () = assert!(REACH == 7, "windows wider than that do not fit into a tile's margin");
