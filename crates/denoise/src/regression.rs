//! Weighted first-order regression on features, in windows around every second pixel of every second row.
//!
//! The predictions of all windows for a pixel are averaged (collaborative regression, after [Bitterli 2016]).

#![expect(clippy::needless_range_loop, reason = "several arrays run along, as in the formulas")]

use crate::graph::{Graph, Reach, Rows, all};
use crate::inputs::{Guide, Inputs};
use crate::normal_equations::{Fit, Sums, add_products, solve};
use crate::planes::{Colours, Pair, Plane, box_mean, combined, dispatch, map_to_one, merged};
use crate::tile::{
    COLUMNS, Comparison, GROUP, HEIGHT, LANES, Likeness, MARGIN, Place, ROWS, Row, Stack, Tile, WIDTH, count_weights,
    stride, tiles, vectors,
};
use pulp::{Simd, WithSimd};

/// The number of regressors: normal (3), albedo (3), position (3).
const REGRESSORS: usize = 9;
/// The number of values per pixel: the regressors, and the three colour channels of both halves.
const VALUES: usize = REGRESSORS + 6;
/// The radius of the compared patches in pixels.
const PATCH: usize = 1;
/// The radius of a window in pixels.
const REACH: usize = 6;
/// The width of a window in pixels.
const SIDE: usize = 2 * REACH + 1;
/// The squared radius of a window, which is a disc. On eighteen scenes at 8 and 32 spp, corners would take a seventh of the
/// time and lower no error. Windows of the wide pass are squares, because discs leave more of a halo at a corner.
const SQUARE: usize = 45;
/// The columns of the disc in each row of a window: the first column, and the one after the last.
const DISC: [[usize; 2]; SIDE] = {
    let mut rows = [[0; 2]; SIDE];
    let mut down = 0;
    while down < SIDE {
        let dx = (SQUARE - down.abs_diff(REACH).pow(2)).isqrt();
        rows[down] = [REACH - dx, REACH + dx + 1];
        down += 1;
    }
    rows
};
/// The number of rows of window centres in a tile.
const CENTRES: usize = HEIGHT / 2;
/// The amount that is subtracted from each weight; smaller weights become 0.
pub(crate) const NEGLIGIBLE: f32 = 1e-3;
/// The width and height in pixels of a tile and the border around it that its windows predict.
const HALO: [usize; 2] = [WIDTH + 2 * REACH, HEIGHT + 2 * REACH];

/// Filters both halves of the samples by regression. The weights for each half come from the other half's guide, or from a
/// single guide for both.
///
/// The fallback image `beside` is averaged with the predictions of the windows. It has the given weight, and a window's centre
/// has weight 1. It thus fills pixels that resemble no window's centre.
pub(crate) fn regress<const G: usize>(
    graph: &Graph<'_>,
    inputs: &Inputs,
    guides: [Guide; G],
    like: Likeness,
    beside: (Pair, f32),
) -> Pair {
    let (Pair(unfiltered), [na, nb]) = (inputs.unfiltered(), inputs.counts());
    let reference: Colours = std::array::from_fn(|c| {
        // Bounded, so that subtracting it loses no digits.
        let mean = map_to_one(graph, [unfiltered[c], unfiltered[3 + c], na, nb], |[a, b, na, nb]| {
            combined([a, b], [na, nb]).min(8.0)
        });
        box_mean(graph, mean, 1)
    });
    let by = Comparison::new(graph, inputs, guides, like, REACH);
    let scratch = || Scratch {
        tile: Tile::default(),
        weights: std::array::from_fn(|_| vec![[[0.0; LANES]; CENTRES]; SIDE * SIDE]),
        data: Data::default(),
        centres: Centres::default(),
        sums: vec![[0.0; 8 * COLUMNS]; 2 * ROWS],
    };
    let copied = data_planes(inputs).into_iter().chain(centre_planes(inputs, reference));
    let sizes = (tiles(graph.size), 8 * HALO[0] * HALO[1]);
    let tiles = graph.tiles(sizes, by.reads(copied), scratch, move |scratch, rows, tile| {
        dispatch(TileTask { by: &by, rows, reference, place: by.place(tile), scratch })
    });
    let reads = all(tiles.iter().copied(), Reach::from_coarse(HEIGHT, REACH));
    let size = graph.size;
    merged(graph, beside, None, reads, move |rows, sums, y| add_tiles(rows, sums, size, y, &tiles))
}

/// The planes that [`Data`] copies.
fn data_planes(inputs: &Inputs) -> [Plane; PLANES] {
    let ([nx, ny, nz, r, g, b, _], [x, y, z]) = (inputs.features.mean, inputs.features.position);
    let (Pair([ra, ga, ba, rb, gb, bb]), [na, nb]) = (inputs.unfiltered(), inputs.counts());
    [nx, ny, nz, r, g, b, x, y, z, ra, ga, ba, rb, gb, bb, na, nb]
}

/// The planes that [`Centres`] copies.
fn centre_planes(inputs: &Inputs, [r, g, b]: Colours) -> [Plane; 4] {
    [inputs.features.scale, r, g, b]
}

/// The task of fitting all windows of one tile. It returns the sums of weighted predictions and of weights for the
/// pixels of the tile and its halo.
struct TileTask<'a, const G: usize> {
    by: &'a Comparison<G>,
    rows: &'a Rows,
    reference: Colours,
    place: Place,
    scratch: &'a mut Scratch<G>,
}

/// Buffers of a task, reused by the next task.
struct Scratch<const G: usize> {
    tile: Tile<G>,
    weights: [Weights; G],
    data: Data,
    centres: Centres,
    sums: Vec<[f32; 8 * COLUMNS]>,
}

/// A tile's copies of the regressors, and of the colours and counts of both halves.
type Data = Stack<PLANES>;
const PLANES: usize = 17;
/// The index in [`Data`] of the first half's red plane. [`COUNTS`] is the index of its sample counts.
const COLOURS: usize = REGRESSORS;
const COUNTS: usize = REGRESSORS + 6;
/// A tile's copies of the planes that are read at window centres: one over the width of 24 pixels, and the reference colour.
type Centres = Stack<4>;

/// The weights from one guide, indexed by the offset in a window and by the row of window centres.
type Weights = Vec<[Row; CENTRES]>;

impl<const G: usize> WithSimd for TileTask<'_, G> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> Vec<f32> {
        self.copy();
        let Scratch { tile, weights, data, centres, sums } = self.scratch;
        weigh(simd, tile, &self.by.like, weights);
        sums.fill([0.0; 8 * COLUMNS]);
        let [rows, columns] = tile.extent();
        let blocks = GROUP / S::F32_LANES;
        let (mut fits, none) = (Vec::with_capacity(blocks), [simd.splat_f32s(0.0); SIDE]);
        let mut row_of_window =
            RowOfWindow { apart: [none; REGRESSORS], colours: [[none; 3]; 2], weighted: [[none; REGRESSORS + 1]; G] };
        for row in 0..rows.div_ceil(2) {
            for group in 0..columns.div_ceil(GROUP) {
                let at = [2 * row, group * blocks];
                fits.clear();
                // No closures: their bodies would not be compiled for this machine's vectors.
                for block in 0..blocks {
                    fits.push(fit(simd, data, centres, weights, [at[0], at[1] + block], &mut row_of_window));
                }
                predict(simd, data, centres, weights, &fits, at, sums);
            }
        }
        cropped(sums)
    }
}

impl<const G: usize> TileTask<'_, G> {
    /// Copies the tile's planes.
    fn copy(&mut self) {
        let (inputs, rows, place) = (&self.by.inputs, self.rows, self.place);
        let Scratch { tile, data, centres, .. } = &mut *self.scratch;
        tile.copy(self.by, rows, place);
        data.copy(rows, data_planes(inputs), place);
        data.clear_outside(COUNTS, place);
        data.clear_outside(COUNTS + 1, place);
        centres.copy(rows, centre_planes(inputs, self.reference), place);
    }
}

/// Returns `true` for the offsets of a window, counted by rows, that lie in the disc.
fn in_disc(offset: &usize) -> bool {
    let [first, end] = DISC[offset / SIDE];
    (first..end).contains(&(offset % SIDE))
}

/// Computes the weights of the pixels in all windows of a tile, for each guide.
#[inline(always)]
fn weigh<S: Simd, const G: usize>(simd: S, tile: &mut Tile<G>, like: &Likeness, weights: &mut [Weights; G]) {
    let [rows, columns] = tile.extent();
    let mut both = [[0.0; LANES]; G];
    let (zero, negligible) = (simd.splat_f32s(0.0), simd.splat_f32s(NEGLIGIBLE));
    for o in (0..SIDE * SIDE).filter(in_disc) {
        let offset = [o % SIDE, o / SIDE].map(|d| d as isize - REACH as isize);
        tile.compare(simd, offset, PATCH);
        for row in 0..rows.div_ceil(2) {
            tile.sum_columns(simd, 2 * row, PATCH);
            tile.weights(simd, like, [2 * row, 0], offset, &mut both);
            for g in 0..G {
                let to = S::as_mut_simd_f32s(&mut weights[g][o][row]).0;
                let from = vectors::<S>(&both[g]);
                for i in 0..LANES / S::F32_LANES {
                    to[i] = simd.max_f32s(simd.sub_f32s(from[i], negligible), zero);
                }
                // Centres beyond the frame have no windows.
                for i in columns..LANES {
                    weights[g][o][row][i] = 0.0;
                }
            }
        }
    }
}

/// The regressors of pixels at some offset from the window centres, minus the regressors of the centres.
#[inline(always)]
fn regressors<S: Simd>(
    simd: S,
    there: &[S::f32s],
    centre: &[S::f32s; REGRESSORS],
    scale: S::f32s,
) -> [S::f32s; REGRESSORS] {
    let (least, most) = (simd.splat_f32s(-16.0), simd.splat_f32s(16.0));
    let mut apart = *centre;
    for k in 0..REGRESSORS {
        apart[k] = simd.sub_f32s(there[k * stride::<S>()], centre[k]);
        if k >= 6 {
            apart[k] = simd.max_f32s(simd.min_f32s(simd.mul_f32s(apart[k], scale), most), least);
        }
    }
    apart
}

/// The regressors at the windows' centres.
#[inline(always)]
fn centre<S: Simd>(simd: S, data: &Data, [y, block]: [usize; 2]) -> [S::f32s; REGRESSORS] {
    let here = at::<S>(data, [y, block], [0, 0]);
    let mut values = [simd.splat_f32s(0.0); REGRESSORS];
    for k in 0..REGRESSORS {
        values[k] = here[k * stride::<S>()];
    }
    values
}

/// The vectors of all planes at an offset from a block of centres, [`stride`] apart. The length is constant, so that bounds are
/// checked once.
#[inline(always)]
fn at<S: Simd>(data: &Data, [y, block]: [usize; 2], offset: [isize; 2]) -> &[S::f32s] {
    &vectors::<S>(data.moved(y, 0, offset))[block..][..PLANES * stride::<S>() - stride::<S>() + 1]
}

/// The pixels in one row of the windows: regressors, colours of both halves, and weighted regressors for each guide. The memory
/// is reused for the next row.
struct RowOfWindow<S: Simd, const G: usize> {
    apart: [[S::f32s; SIDE]; REGRESSORS],
    colours: [[[S::f32s; SIDE]; 3]; 2],
    weighted: [[[S::f32s; SIDE]; REGRESSORS + 1]; G],
}

/// Fits the colours of both halves in a vector of windows.
#[inline(always)]
fn fit<S: Simd, const G: usize>(
    simd: S,
    data: &Data,
    centres: &Centres,
    weights: &[Weights; G],
    [y, block]: [usize; 2],
    row: &mut RowOfWindow<S, G>,
) -> [Fit<S, REGRESSORS>; 2] {
    let zero = simd.splat_f32s(0.0);
    let step = stride::<S>();
    let centre = centre(simd, data, [y, block]);
    let at_centre = vectors::<S>(centres.moved(y, 0, [0, 0]));
    let scale = at_centre[block];
    let reference = [at_centre[step + block], at_centre[2 * step + block], at_centre[3 * step + block]];
    let own: [S::f32s; G] = counts(simd, at::<S>(data, [y, block], [0, 0]));
    let mut sums: [Sums<S, VALUES, { REGRESSORS + 1 }>; G] = [[[zero; VALUES]; REGRESSORS + 1]; G];
    let mut total = [zero; G];
    let RowOfWindow { apart, colours, weighted } = row;
    for down in 0..SIDE {
        let [first, end] = DISC[down];
        for across in first..end {
            let offset = [across, down].map(|d| d as isize - REACH as isize);
            let there = at::<S>(data, [y, block], offset);
            let z = regressors(simd, there, &centre, scale);
            for k in 0..REGRESSORS {
                apart[k][across] = z[k];
            }
            let number: [S::f32s; G] = counts(simd, there);
            for g in 0..G {
                let count = count_weights(simd, own[g], number[g]);
                // With two guides, the weights come from the other half's guide.
                let weight = vectors::<S>(&weights[G - 1 - g][down * SIDE + across][y / 2])[block];
                let weight = simd.mul_f32s(weight, count);
                total[g] = simd.add_f32s(total[g], weight);
                weighted[g][0][across] = weight;
                for k in 0..REGRESSORS {
                    weighted[g][k + 1][across] = simd.mul_f32s(weight, z[k]);
                }
            }
            for half in 0..2 {
                for c in 0..3 {
                    let colour = there[(COLOURS + 3 * half + c) * step];
                    colours[half][c][across] = simd.sub_f32s(colour, reference[c]);
                }
            }
        }
        for g in 0..G {
            accumulate(simd, &weighted[g], apart, &mut sums[g], DISC[down]);
        }
        for half in 0..2 {
            let g = half.min(G - 1);
            let [red, green, blue] = &colours[half];
            let at = [REGRESSORS + 3 * half, REGRESSORS];
            add_products(simd, &weighted[g], [red, green, blue], &mut sums[g], at, DISC[down]);
        }
    }
    let last = G - 1;
    [
        solve(simd, total[0], &sums[0], REGRESSORS, &reference),
        solve(simd, total[last], &sums[last], REGRESSORS + 3, &reference),
    ]
}

/// The sample counts that scale the weights of each guide: the counts of one half with two guides, the sum of both with one.
#[inline(always)]
fn counts<S: Simd, const G: usize>(simd: S, planes: &[S::f32s]) -> [S::f32s; G] {
    let step = stride::<S>();
    let (a, b) = (planes[COUNTS * step], planes[(COUNTS + 1) * step]);
    let mut counts = [a; G];
    if G == 1 {
        counts[0] = simd.add_f32s(a, b);
    } else {
        counts[1] = b;
    }
    counts
}

/// Adds the weighted products of regressors in one row of a window to `sums`.
#[inline(always)]
fn accumulate<S: Simd>(
    simd: S,
    weighted: &[[S::f32s; SIDE]; REGRESSORS + 1],
    apart: &[[S::f32s; SIDE]; REGRESSORS],
    sums: &mut Sums<S, VALUES, { REGRESSORS + 1 }>,
    of: [usize; 2],
) {
    for b in [0, 3, 6] {
        // Some sums left of the diagonal are computed but not read. Skipping them would cost more.
        add_products(simd, weighted, [&apart[b], &apart[b + 1], &apart[b + 2]], sums, [b, b + 3], of);
    }
}

/// Adds the predictions of both halves' windows to the sums of the pixels in them. A row of `sums` holds red, green, blue and
/// weight of the first half, then of the second.
#[inline(always)]
fn predict<S: Simd, const G: usize>(
    simd: S,
    data: &Data,
    centres: &Centres,
    weights: &[Weights; G],
    fits: &[[Fit<S, REGRESSORS>; 2]],
    [y, first]: [usize; 2],
    sums: &mut [[f32; 8 * COLUMNS]],
) {
    let step = stride::<S>();
    let scales = vectors::<S>(centres.moved(y, 0, [0, 0]));
    for o in (0..SIDE * SIDE).filter(in_disc) {
        let offset = [o % SIDE, o / SIDE].map(|d| d as isize - REACH as isize);
        let row = (y + MARGIN).wrapping_add_signed(offset[1]);
        let (parity, shift) = ((offset[0] & 1) as usize, offset[0] >> 1);
        let column = (MARGIN / 2).wrapping_add_signed(shift);
        let to = &mut sums[2 * row + parity][column..][..7 * COLUMNS + LANES];
        let to = S::as_mut_simd_f32s(to).0;
        for (i, fits) in fits.iter().enumerate() {
            let block = first + i;
            let there = at::<S>(data, [y, block], offset);
            let z = regressors(simd, there, &centre(simd, data, [y, block]), scales[block]);
            let to = &mut to[block..][..7 * step + 1];
            for half in 0..2 {
                let fit = &fits[half];
                let weight = vectors::<S>(&weights[if G == 2 { 1 - half } else { 0 }][o][y / 2])[block];
                for c in 0..3 {
                    let mut value = fit.intercept[c];
                    for k in 0..REGRESSORS {
                        value = simd.add_f32s(value, simd.mul_f32s(fit.slopes[k][c], z[k]));
                    }
                    let sum = &mut to[(4 * half + c) * step];
                    *sum = simd.add_f32s(*sum, simd.mul_f32s(weight, value));
                }
                let sum = &mut to[(4 * half + 3) * step];
                *sum = simd.add_f32s(*sum, weight);
            }
        }
    }
}

/// Rearranges the sums of a tile and its halo to eight planes: red, green, blue and weight of each half.
fn cropped(sums: &[[f32; 8 * COLUMNS]]) -> Vec<f32> {
    let [width, height] = HALO;
    let skip = MARGIN - REACH;
    let mut all = vec![0.0; 8 * width * height];
    for (at, to) in all.chunks_exact_mut(width).enumerate() {
        let (plane, y) = (at / height, skip + at % height);
        let rows = [0, 1].map(|parity| &sums[2 * y + parity][plane * COLUMNS..][..COLUMNS]);
        for (x, to) in to.iter_mut().enumerate() {
            *to = rows[(x + skip) & 1][(x + skip) / 2];
        }
    }
    all
}

/// Adds the sums of all tiles that reach row `y` to the planes of that row.
fn add_tiles(rows: &Rows, sums: &mut [f32], [width, height]: [usize; 2], y: usize, tiles: &[Plane]) {
    let first = (y.saturating_sub(REACH + HEIGHT - 1)).div_ceil(HEIGHT);
    for tile_row in first..=((y + REACH).min(height - 1) / HEIGHT) {
        let local_y = y + REACH - tile_row * HEIGHT;
        for (column, tile) in tiles.iter().enumerate() {
            let tile = rows.row(*tile, tile_row);
            let start = (column * WIDTH).saturating_sub(REACH);
            let end = (column * WIDTH + WIDTH + REACH).min(width);
            let skip = start + REACH - column * WIDTH;
            for plane in 0..8 {
                let from = &tile[(plane * HALO[1] + local_y) * HALO[0] + skip..][..end - start];
                let to = &mut sums[plane * width + start..][..end - start];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
            }
        }
    }
}
