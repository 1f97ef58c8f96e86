//! Weighted first-order regression on features, in windows around every second pixel of every second row; what each
//! window predicts for its pixels is averaged (collaborative, after [Bitterli 2016]).

#![expect(clippy::needless_range_loop, reason = "several arrays run along, as in the formulas")]

use crate::error_map::Pair;
use crate::planes::{Colours, Inputs, Plane, box_mean};
use crate::tile::{
    COLUMNS, Differences, Guide, HEIGHT, LANES, Likeness, Local, LocalGuide, MARGIN, REACH, ROWS, Row, Tile, WIDTH,
    origins,
};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// What is regressed on: normal (3), albedo (3), position (3).
const REGRESSORS: usize = 9;
/// These and three colour channels.
const VALUES: usize = REGRESSORS + 3;
/// Pixels along a window.
const SIDE: usize = 2 * REACH + 1;
/// Rows of a tile that have windows' centres.
const CENTRES: usize = HEIGHT / 2;
/// Weights below this count for nothing.
const NEGLIGIBLE: f32 = 1e-3;
/// A share of the weights' sum on the diagonal of the normal equations (FEASIBILITY 4, step 6).
const RIDGE: f32 = 1e-3;
/// Least pivot, relative to its diagonal: directions of which rounding leaves less are dropped.
const PIVOT: f32 = 1e-5;
/// What windows give away to either side of a tile.
const HALO: [usize; 2] = [WIDTH + 2 * REACH, HEIGHT + 2 * REACH];

/// Both halves filtered: the weights of each come from the other half's guide. Where no window's centre is like a pixel
/// (every second one is none), the picture `beside` stands in, with the weight `share`; a pixel at its window's centre
/// has 1.
pub(crate) fn regress(
    inputs: &Inputs,
    guides: &[Guide; 2],
    like: &Likeness,
    beside: &Pair,
    share: f32,
) -> [Colours; 2] {
    let reference: Colours = std::array::from_fn(|c| {
        let of = |i: usize| {
            let share = inputs.first_share(i);
            let [a, b] = [0, 1].map(|h| inputs.halves[h].colour[c][i]);
            // Not so far from everything else that subtracting it loses digits.
            (b + share * (a - b)).min(8.0)
        };
        box_mean(&(0..inputs.pixels()).map(of).collect::<Plane>(), inputs.size, 1)
    });
    let arch = Arch::new();
    let origins = origins(inputs.size);
    let tiles: Vec<Vec<f32>> = origins
        .par_iter()
        .map(|&origin| arch.dispatch(TileTask { inputs, guides, like, reference: &reference, origin }))
        .collect();
    merge(inputs.size, &tiles, beside, share)
}

/// One tile's windows; gives sums of weighted predictions and of weights, for a tile and its halo.
struct TileTask<'a> {
    inputs: &'a Inputs,
    guides: &'a [Guide; 2],
    like: &'a Likeness,
    reference: &'a Colours,
    origin: [usize; 2],
}

/// A tile's copies of what is regressed.
struct Data {
    regressors: [Local; REGRESSORS],
    scale: Local,
    reference: [Local; 3],
    colour: [[Local; 3]; 2],
    count: [Local; 2],
}

/// Weights of one half: by offset, then row of centres.
type Weights = Vec<[Row; CENTRES]>;

impl WithSimd for TileTask<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let tile = Tile::new(self.inputs, self.origin, self.like);
        let guides = [0, 1].map(|h| tile.guide(&self.guides[h]));
        let weights = weigh(simd, &tile, &guides, self.like);
        let data = self.copies(&tile);
        let mut sums = vec![[0.0; COLUMNS]; 8 * 2 * ROWS];
        let [rows, columns] = tile.extent();
        for row in 0..rows.div_ceil(2) {
            for block in 0..columns.div_ceil(S::F32_LANES) {
                let at = [2 * row, block * S::F32_LANES];
                // No closures: what they hold would not be compiled for this machine's vectors.
                let fits = [fit(simd, &data, &weights[1], 0, at), fit(simd, &data, &weights[0], 1, at)];
                predict(simd, &data, &weights, &fits, at, &mut sums);
            }
        }
        cropped(&sums)
    }
}

impl TileTask<'_> {
    fn copies(&self, tile: &Tile) -> Data {
        let features = &self.inputs.features;
        let halves = &self.inputs.halves;
        Data {
            regressors: std::array::from_fn(|k| {
                tile.copy(if k < 6 { &features.mean[k] } else { &features.position[k - 6] })
            }),
            scale: tile.copy(&features.scale),
            reference: std::array::from_fn(|c| tile.copy(&self.reference[c])),
            colour: [0, 1].map(|h| std::array::from_fn(|c| tile.copy(&halves[h].colour[c]))),
            count: [0, 1].map(|h| tile.copy_or_zero(&halves[h].count)),
        }
    }
}

/// The weights of all windows of a tile, by each half's guide.
#[inline(always)]
fn weigh<S: Simd>(simd: S, tile: &Tile, guides: &[LocalGuide; 2], like: &Likeness) -> [Weights; 2] {
    let mut weights = [(); 2].map(|()| vec![[[0.0; LANES]; CENTRES]; SIDE * SIDE]);
    let mut differences = [Differences::new(), Differences::new()];
    let [rows, columns] = tile.extent();
    let (zero, negligible) = (simd.splat_f32s(0.0), simd.splat_f32s(NEGLIGIBLE));
    for o in 0..SIDE * SIDE {
        let offset = [o % SIDE, o / SIDE].map(|d| d as isize - REACH as isize);
        for (differences, guide) in differences.iter_mut().zip(guides) {
            differences.compare(simd, guide, rows, like.patch, offset);
        }
        for row in 0..rows.div_ceil(2) {
            let by_features = tile.feature_distances(simd, 2 * row, 0, offset);
            for (differences, weights) in differences.iter_mut().zip(&mut weights) {
                differences.sum_columns(simd, 2 * row, like.patch);
                let patch = differences.patches(simd, 0, like.patch);
                let mut w = tile.weights(simd, &patch, &by_features, like, [2 * row, 0], offset);
                for w in &mut *S::as_mut_simd_f32s(&mut w).0 {
                    *w = simd.max_f32s(simd.sub_f32s(*w, negligible), zero);
                }
                // Centres beyond the frame have no windows.
                w[columns..].fill(0.0);
                weights[o][row] = w;
            }
        }
    }
    weights
}

/// A window's plane: the intercept at its centre and the slopes of each channel.
struct Fit<S: Simd> {
    intercept: [S::f32s; 3],
    slopes: [[S::f32s; 3]; REGRESSORS],
}

#[inline(always)]
fn load<S: Simd>(row: &[f32], at: usize) -> S::f32s {
    S::as_simd_f32s(&row[at..at + S::F32_LANES]).0[0]
}

/// Several planes' values at centres.
#[inline(always)]
fn load_all<S: Simd, const N: usize>(simd: S, planes: &[Local; N], [y, x]: [usize; 2]) -> [S::f32s; N] {
    let mut values = [simd.splat_f32s(0.0); N];
    for (value, plane) in values.iter_mut().zip(planes) {
        *value = load::<S>(plane.moved(y, 0, [0, 0]), x);
    }
    values
}

/// The regressors at the pixels that lie `offset` from the centres, relative to these.
#[inline(always)]
fn regressors<S: Simd>(
    simd: S,
    data: &Data,
    centre: &[S::f32s; REGRESSORS],
    scale: S::f32s,
    [y, x]: [usize; 2],
    offset: [isize; 2],
) -> [S::f32s; REGRESSORS] {
    let (least, most) = (simd.splat_f32s(-16.0), simd.splat_f32s(16.0));
    let mut apart = *centre;
    for k in 0..REGRESSORS {
        let there = load::<S>(data.regressors[k].moved(y, 0, offset), x);
        apart[k] = simd.sub_f32s(there, centre[k]);
        if k >= 6 {
            apart[k] = simd.max_f32s(simd.min_f32s(simd.mul_f32s(apart[k], scale), most), least);
        }
    }
    apart
}

/// The sums that make the normal equations: `[a][b]` of regressor `a - 1` (1 for `a` 0) times value `b`.
type Sums<S> = [[<S as Simd>::f32s; VALUES]; REGRESSORS + 1];

/// Fits one half's colours in the windows of as many centres as there are lanes.
#[inline(always)]
fn fit<S: Simd>(simd: S, data: &Data, weights: &Weights, half: usize, [y, x]: [usize; 2]) -> Fit<S> {
    let zero = simd.splat_f32s(0.0);
    let here = [0, 0];
    let centre = load_all::<S, REGRESSORS>(simd, &data.regressors, [y, x]);
    let reference = load_all::<S, 3>(simd, &data.reference, [y, x]);
    let scale = load::<S>(data.scale.moved(y, 0, here), x);
    let mut sums: Sums<S> = [[zero; VALUES]; REGRESSORS + 1];
    let mut total = zero;
    let one = simd.splat_f32s(1.0);
    let own = load::<S>(data.count[half].moved(y, 0, here), x);
    let mut values = [[zero; SIDE]; VALUES];
    let mut weighted = [[zero; SIDE]; REGRESSORS + 1];
    for down in 0..SIDE {
        for across in 0..SIDE {
            let offset = [across, down].map(|d| d as isize - REACH as isize);
            let count = load::<S>(data.count[half].moved(y, 0, offset), x);
            // As `count_weights` has it.
            let count = simd.div_f32s(count, simd.max_f32s(simd.add_f32s(own, count), one));
            let weight = simd.mul_f32s(load::<S>(&weights[down * SIDE + across][y / 2], x), count);
            total = simd.add_f32s(total, weight);
            weighted[0][across] = weight;
            let z = regressors(simd, data, &centre, scale, [y, x], offset);
            for k in 0..REGRESSORS {
                values[k][across] = z[k];
                weighted[k + 1][across] = simd.mul_f32s(weight, z[k]);
            }
            for c in 0..3 {
                let colour = load::<S>(data.colour[half][c].moved(y, 0, offset), x);
                values[REGRESSORS + c][across] = simd.sub_f32s(colour, reference[c]);
            }
        }
        accumulate(simd, &weighted, &values, &mut sums);
    }
    solve(simd, total, &sums, &reference)
}

/// Adds the products of one row of a window, four sums at a time.
#[inline(always)]
fn accumulate<S: Simd>(
    simd: S,
    weighted: &[[S::f32s; SIDE]; REGRESSORS + 1],
    values: &[[S::f32s; SIDE]; VALUES],
    sums: &mut Sums<S>,
) {
    for a in 0..=REGRESSORS {
        // Sums left of the diagonal are not read; where groups of four begin there, they cost less than their absence.
        let first = a.saturating_sub(1) / 4;
        for group in first..VALUES / 4 {
            let b = 4 * group;
            let mut four: [S::f32s; 4] = [sums[a][b], sums[a][b + 1], sums[a][b + 2], sums[a][b + 3]];
            for k in 0..SIDE {
                for (j, sum) in four.iter_mut().enumerate() {
                    *sum = simd.add_f32s(*sum, simd.mul_f32s(weighted[a][k], values[b + j][k]));
                }
            }
            sums[a][b..b + 4].copy_from_slice(&four);
        }
    }
}

/// The weighted covariance of regressor `a` and value `b`.
#[inline(always)]
fn covariance<S: Simd>(
    simd: S,
    sums: &Sums<S>,
    mean: &[S::f32s; VALUES],
    share: S::f32s,
    a: usize,
    b: usize,
) -> S::f32s {
    simd.sub_f32s(simd.mul_f32s(sums[a + 1][b], share), simd.mul_f32s(mean[a], mean[b]))
}

/// Solves the normal equations, centred at the weighted means, by `L D L^T`.
#[inline(always)]
fn solve<S: Simd>(simd: S, total: S::f32s, sums: &Sums<S>, reference: &[S::f32s; 3]) -> Fit<S> {
    let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
    let share = simd.div_f32s(one, simd.max_f32s(total, simd.splat_f32s(1e-20)));
    let mut mean = sums[0];
    for value in &mut mean {
        *value = simd.mul_f32s(*value, share);
    }
    // `lower[i][j]`, j < i; `right` is the right-hand side, then the solution.
    let mut lower = [[zero; REGRESSORS]; REGRESSORS];
    let mut pivots = [zero; REGRESSORS];
    let mut right = [[zero; 3]; REGRESSORS];
    for j in 0..REGRESSORS {
        for i in j..REGRESSORS {
            let mut entry = covariance(simd, sums, &mean, share, j, i);
            let diagonal = simd.add_f32s(simd.max_f32s(entry, zero), simd.splat_f32s(RIDGE));
            if i == j {
                entry = diagonal;
            }
            for k in 0..j {
                let product = simd.mul_f32s(lower[i][k], lower[j][k]);
                entry = simd.sub_f32s(entry, simd.mul_f32s(product, pivots[k]));
            }
            if i == j {
                pivots[j] = simd.max_f32s(entry, simd.mul_f32s(diagonal, simd.splat_f32s(PIVOT)));
            } else {
                lower[i][j] = simd.div_f32s(entry, pivots[j]);
            }
        }
        for c in 0..3 {
            let mut value = covariance(simd, sums, &mean, share, j, REGRESSORS + c);
            for k in 0..j {
                value = simd.sub_f32s(value, simd.mul_f32s(lower[j][k], right[k][c]));
            }
            right[j][c] = value;
        }
    }
    let mut intercept = *reference;
    for c in 0..3 {
        intercept[c] = simd.add_f32s(intercept[c], mean[REGRESSORS + c]);
        for j in (0..REGRESSORS).rev() {
            let mut value = simd.div_f32s(right[j][c], pivots[j]);
            for i in j + 1..REGRESSORS {
                value = simd.sub_f32s(value, simd.mul_f32s(lower[i][j], right[i][c]));
            }
            right[j][c] = value;
            intercept[c] = simd.sub_f32s(intercept[c], simd.mul_f32s(value, mean[j]));
        }
    }
    Fit { intercept, slopes: right }
}

/// Gives what both halves' windows predict to the pixels in them.
#[inline(always)]
fn predict<S: Simd>(
    simd: S,
    data: &Data,
    weights: &[Weights; 2],
    fits: &[Fit<S>; 2],
    [y, x]: [usize; 2],
    sums: &mut [[f32; COLUMNS]],
) {
    let centre = load_all::<S, REGRESSORS>(simd, &data.regressors, [y, x]);
    let scale = load::<S>(data.scale.moved(y, 0, [0, 0]), x);
    for o in 0..SIDE * SIDE {
        let offset = [o % SIDE, o / SIDE].map(|d| d as isize - REACH as isize);
        let z = regressors(simd, data, &centre, scale, [y, x], offset);
        let row = (y + MARGIN).wrapping_add_signed(offset[1]);
        let (parity, shift) = ((offset[0] & 1) as usize, offset[0] >> 1);
        let column = (x + MARGIN / 2).wrapping_add_signed(shift);
        for (half, fit) in fits.iter().enumerate() {
            let weight = load::<S>(&weights[1 - half][o][y / 2], x);
            for c in 0..4 {
                let value = if c == 3 {
                    weight
                } else {
                    let mut value = fit.intercept[c];
                    for k in 0..REGRESSORS {
                        value = simd.add_f32s(value, simd.mul_f32s(fit.slopes[k][c], z[k]));
                    }
                    simd.mul_f32s(weight, value)
                };
                let plane = &mut sums[(4 * half + c) * 2 * ROWS + 2 * row + parity];
                let sum = &mut S::as_mut_simd_f32s(&mut plane[column..column + S::F32_LANES]).0[0];
                *sum = simd.add_f32s(*sum, value);
            }
        }
    }
}

/// The sums of a tile and its halo, eight a pixel.
fn cropped(sums: &[[f32; COLUMNS]]) -> Vec<f32> {
    let [width, height] = HALO;
    let skip = MARGIN - REACH;
    let mut all = Vec::with_capacity(8 * width * height);
    for plane in 0..8 {
        for y in skip..skip + height {
            all.extend((skip..skip + width).map(|c| sums[plane * 2 * ROWS + 2 * y + (c & 1)][c / 2]));
        }
    }
    all
}

/// Adds the tiles up, in their order, and divides.
fn merge([width, height]: [usize; 2], tiles: &[Vec<f32>], beside: &Pair, share: f32) -> [Colours; 2] {
    let columns = width.div_ceil(WIDTH);
    let row = |y: usize| -> Vec<f32> {
        let mut sums = vec![0.0f32; 8 * width];
        for (half, own) in beside.0.iter().enumerate() {
            for (c, own) in own.iter().enumerate() {
                let to = &mut sums[(4 * half + c) * width..][..width];
                to.iter_mut().zip(&own[y * width..]).for_each(|(to, own)| *to = share * own);
            }
            sums[(4 * half + 3) * width..][..width].fill(share);
        }
        let first = (y.saturating_sub(REACH + HEIGHT - 1)).div_ceil(HEIGHT);
        for tile_row in first..=((y + REACH).min(height - 1) / HEIGHT) {
            let local_y = y + REACH - tile_row * HEIGHT;
            for column in 0..columns {
                let tile = &tiles[tile_row * columns + column];
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
        sums
    };
    let rows: Vec<Vec<f32>> = (0..height).into_par_iter().map(row).collect();
    [0, 1].map(|half| {
        std::array::from_fn(|c| {
            let finish = |row: &Vec<f32>| -> Vec<f32> {
                let [values, weights] = [c, 3].map(|plane| &row[(4 * half + plane) * width..][..width]);
                // Without a weight there is no sample in reach.
                let mean = |(v, w): (&f32, &f32)| if *w > 0.0 { (v / w).max(0.0) } else { 0.0 };
                values.iter().zip(weights).map(mean).collect()
            };
            rows.iter().flat_map(finish).collect()
        })
    })
}
