//! A second, much wider window of regression: 41x41 pixels around every fourth pixel of every fourth row.
//!
//! If few samples leave more noise than 13x13 pixels can average, the image of narrower windows keeps blotches of
//! their size. This pass takes that image as its guide, and its result is blended with it by [`shrink`](crate::shrink).

#![expect(clippy::needless_range_loop, reason = "several arrays run along, as in the formulas")]

use crate::error_map::Pair;
use crate::planes::{Colours, Inputs, Plane};
use crate::regression::{Fit, NEGLIGIBLE, REGRESSORS, Sums, VALUES, add_products, solve};
use crate::tile::{FeatureScales, Guide, count_weights, excess, exp_minus_all, sharpness, vectors};
use dapple_core::Frame;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// The radius of a window in pixels.
const REACH: usize = 20;
/// The width of a window in pixels.
const SIDE: usize = 2 * REACH + 1;
/// The distance between window centres in pixels, along both axes.
const STEP: usize = 4;
/// The number of rows of pixels whose centres one task takes.
const BAND: usize = 32;
/// The number of rows that the windows of a task reach.
const ROWS: usize = BAND - STEP + 2 * REACH + 1;
/// The columns of one phase (column modulo [`STEP`]) beside the frame on either side. Windows reach 5 of them, patches
/// one more.
const PAD: usize = 6;
/// The number of offsets of a window row whose products are summed together.
const SEGMENT: usize = 14;
/// The bandwidth of colour differences in standard deviations.
const COLOUR: f32 = 1.5;
/// The scales of feature differences.
const FEATURES: FeatureScales = FeatureScales { bandwidth: 5.0, floors: [1e-2, 5e-2], slope: 15.0 };
/// The radius of the compared patches.
const PATCH: isize = 1;
/// The weight of the image beside the predictions, relative to 1 for a window's centre.
const BESIDE: f32 = 0.5;

/// The copied planes: guide colours (3) and variance (1), features (7) and their variances (3), the scales of feature
/// differences (3), positions (3) with the reciprocal width of 24 pixels (1), counts of both halves (2), and colours
/// without albedo (6).
const PLANES: usize = 29;
const VARIANCE: usize = 3;
const MEANS: usize = 4;

const POSITION: usize = 17;

const COUNTS: usize = 21;
const COLOURS: usize = 23;

/// Filters both halves with windows of 41x41 pixels, compared by `guide`: the image `beside` without its albedo, and
/// its remaining noise.
pub(crate) fn wide(inputs: &Inputs, guide: &Guide, beside: &Pair) -> Pair {
    let [width, height] = inputs.size;
    let stack = Stack::new(inputs, guide);
    let arch = Arch::new();
    let bands: Vec<Vec<f32>> = (0..height.div_ceil(BAND))
        .into_par_iter()
        .map(|band| arch.dispatch(BandTask { stack: &stack, size: inputs.size, first: band * BAND }))
        .collect();
    let row = |y: usize| -> Vec<f32> {
        let mut sums = vec![0.0f32; 8 * width];
        for (half, own) in beside.0.iter().enumerate() {
            for (c, own) in own.iter().enumerate() {
                for x in 0..width {
                    let i = y * width + x;
                    sums[(4 * half + c) * width + x] = BESIDE * own[i] / inputs.divisor(c, i);
                }
            }
            sums[(4 * half + 3) * width..][..width].fill(BESIDE);
        }
        let first = y.saturating_sub(REACH + BAND - 1).div_ceil(BAND);
        for (band, tile) in bands.iter().enumerate().skip(first) {
            let Some(local) = (y + REACH).checked_sub(band * BAND) else { break };
            if local >= ROWS {
                continue;
            }
            for plane in 0..8 {
                let to = &mut sums[plane * width..][..width];
                for (x, to) in to.iter_mut().enumerate() {
                    *to += tile[stack.place(local, plane, x)];
                }
            }
        }
        sums
    };
    let rows: Vec<Vec<f32>> = (0..height).into_par_iter().map(row).collect();
    let of = |half: usize, c: usize| -> Plane {
        let finish = |(y, row): (usize, &Vec<f32>)| -> Vec<f32> {
            let [values, weights] = [c, 3].map(|plane| &row[(4 * half + plane) * width..][..width]);
            let one = |x: usize| (values[x] / weights[x]).max(0.0) * inputs.divisor(c, y * width + x);
            (0..width).map(one).collect()
        };
        rows.iter().enumerate().flat_map(finish).collect()
    };
    Pair([0, 1].map(|half| std::array::from_fn(|c| of(half, c))))
}

/// The memory of [`wide`] in bytes at most, the guide and the result included.
pub(crate) fn bytes(frame: &Frame) -> u64 {
    let [width, height] = frame.size().map(u64::from);
    let columns = (width.div_ceil(STEP as u64) + 2 * PAD as u64 + 32) * STEP as u64;
    let stack = 4 * PLANES as u64 * columns * height;
    let bands = height.div_ceil(BAND as u64) * 4 * 8 * ROWS as u64 * columns;
    // The guide, feature scales, and the sums by rows beside the result.
    frame.bytes(4 * (4 + 3 + 8 + 6)).saturating_add(stack).saturating_add(bands)
}

/// Copies of the planes, with columns of equal remainder modulo [`STEP`] side by side. Each row holds for each of these
/// phases all planes, one after the other. Columns beyond the frame repeat the border.
struct Stack {
    data: Vec<f32>,
    /// The columns of one phase, padding included.
    columns: usize,
}

impl Stack {
    fn new(inputs: &Inputs, guide: &Guide) -> Self {
        let [width, height] = inputs.size;
        // A vector may begin at the last centre.
        let columns = (width.div_ceil(STEP) + 2 * PAD).next_multiple_of(16) + 16;
        let sharp = sharpness(&inputs.features, &FEATURES);
        let colours: [Colours; 2] = [0, 1].map(|half: usize| {
            std::array::from_fn(|c| {
                let own = inputs.halves[half].colour[c].iter().enumerate();
                own.map(|(i, value)| value / inputs.divisor(c, i)).collect()
            })
        });
        let mut planes: Vec<&[f32]> = Vec::with_capacity(PLANES);
        planes.extend(guide.colour.iter().chain(&guide.variance).map(|p| &p[..]));
        planes.extend(inputs.features.mean.iter().chain(&inputs.features.variance).chain(&sharp).map(|p| &p[..]));
        planes.extend(inputs.features.position.iter().map(|p| &p[..]));
        planes.push(&inputs.features.scale);
        planes.extend(inputs.halves.iter().map(|half| &half.count[..]));
        planes.extend(colours.iter().flatten().map(|p| &p[..]));
        let mut stack = Self { data: vec![0.0; height * STEP * PLANES * columns], columns };
        let (columns, row_length) = (stack.columns, STEP * PLANES * columns);
        stack.data.par_chunks_mut(row_length).enumerate().for_each(|(y, row)| {
            for (k, plane) in planes.iter().enumerate() {
                let source = &plane[y * width..][..width];
                for phase in 0..STEP {
                    let to = &mut row[(phase * PLANES + k) * columns..][..columns];
                    for (column, to) in to.iter_mut().enumerate() {
                        let x = (STEP * column + phase) as isize - (STEP * PAD) as isize;
                        let outside = x < 0 || x >= width as isize;
                        let is_count = (COUNTS..COUNTS + 2).contains(&k);
                        *to = if outside && is_count { 0.0 } else { source[x.clamp(0, width as isize - 1) as usize] };
                    }
                }
            }
        });
        stack
    }

    /// All planes of the pixels in row `y` at the offset `dx` from the window centres that begin with number `k`. Plane
    /// `p` begins at `p` times [`Stack::columns`].
    #[inline(always)]
    fn at(&self, y: usize, dx: isize, k: usize) -> &[f32] {
        let (phase, shift) = (dx.rem_euclid(STEP as isize) as usize, dx.div_euclid(STEP as isize));
        let start = (y * STEP + phase) * PLANES * self.columns + (PAD + k).wrapping_add_signed(shift);
        &self.data[start..]
    }

    /// The index of pixel column `x` in one of the eight planes of a band's sums.
    #[inline(always)]
    fn place(&self, row: usize, plane: usize, x: usize) -> usize {
        ((row * STEP + x % STEP) * 8 + plane) * self.columns + PAD + x / STEP
    }
}

/// The windows whose centres lie in [`BAND`] rows from row `first`. Its result is the sums of weighted predictions and
/// of weights, from [`REACH`] rows above.
struct BandTask<'a> {
    stack: &'a Stack,
    size: [usize; 2],
    first: usize,
}

impl WithSimd for BandTask<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let [width, height] = self.size;
        let mut sums = vec![0.0; ROWS * STEP * 8 * self.stack.columns];
        let mut weights = vec![0.0; SIDE * SIDE * S::F32_LANES];
        for y in (self.first..(self.first + BAND).min(height)).step_by(STEP) {
            for k in (0..width.div_ceil(STEP)).step_by(S::F32_LANES) {
                let centre = Centre::new(self.stack, [y, k], width);
                let weights = S::as_mut_simd_f32s(&mut weights).0;
                weigh(simd, &centre, height, weights);
                let fits = fit(simd, &centre, height, weights);
                predict(simd, &centre, height, weights, &fits, self.first, &mut sums);
            }
        }
        sums
    }
}

/// As many window centres as there are lanes, in one row.
struct Centre<'a> {
    stack: &'a Stack,
    y: usize,
    k: usize,
    /// The number of centres inside the frame.
    inside: usize,
}

impl<'a> Centre<'a> {
    fn new(stack: &'a Stack, [y, k]: [usize; 2], width: usize) -> Self {
        Self { stack, y, k, inside: width.div_ceil(STEP) - k }
    }

    /// The first vector of plane `p` at the offset `dx` in row `y`.
    #[inline(always)]
    fn get<S: Simd>(&self, y: usize, dx: isize, p: usize) -> S::f32s {
        vectors::<S>(&self.stack.at(y, dx, self.k)[p * self.stack.columns..][..S::F32_LANES])[0]
    }

    /// The row at the offset `dy`; `None` outside the frame.
    #[inline(always)]
    fn row(&self, dy: isize, height: usize) -> Option<usize> {
        self.y.checked_add_signed(dy).filter(|y| *y < height)
    }
}

/// Writes the weights of all pixels of the windows, by offset.
#[inline(always)]
fn weigh<S: Simd>(simd: S, centre: &Centre<'_>, height: usize, weights: &mut [S::f32s]) {
    let zero = simd.splat_f32s(0.0);
    let mut own = [[zero; 4]; 9];
    for o in 0..9 {
        let (dx, dy) = (o as isize % 3 - PATCH, o as isize / 3 - PATCH);
        let y = (centre.y.saturating_add_signed(dy)).min(height - 1);
        for p in 0..4 {
            own[o][p] = centre.get::<S>(y, dx, p);
        }
    }
    let mut features = [zero; 13];
    for p in 0..13 {
        features[p] = centre.get::<S>(centre.y, 0, MEANS + p);
    }
    let mut lanes = [0.0; 64];
    lanes[..centre.inside.min(64)].fill(1.0);
    let inside = vectors::<S>(&lanes)[0];
    let share = simd.splat_f32s(1.0 / (9.0 * COLOUR * COLOUR));
    for o in 0..SIDE * SIDE {
        let [dx, dy] = [o % SIDE, o / SIDE].map(|d| d as isize - REACH as isize);
        let Some(y) = centre.row(dy, height) else {
            weights[o] = zero;
            continue;
        };
        let mut patch = zero;
        for (q, own) in own.iter().enumerate() {
            let (px, py) = (q as isize % 3 - PATCH, q as isize / 3 - PATCH);
            let row = (y.saturating_add_signed(py)).min(height - 1);
            let mut square = zero;
            for c in 0..3 {
                let d = simd.sub_f32s(own[c], centre.get::<S>(row, dx + px, c));
                square = simd.add_f32s(square, simd.mul_f32s(d, d));
            }
            patch = simd.add_f32s(patch, excess(simd, square, own[VARIANCE], centre.get::<S>(row, dx + px, VARIANCE)));
        }
        let by_colour = simd.max_f32s(simd.mul_f32s(patch, share), zero);
        let distance = simd.add_f32s(by_colour, feature_distance(simd, centre, &features, y, dx));
        let weight = simd.sub_f32s(exp_minus_all(simd, distance), simd.splat_f32s(NEGLIGIBLE));
        weights[o] = simd.mul_f32s(simd.max_f32s(weight, zero), inside);
    }
}

/// The largest scaled difference of normal, albedo and log depth between the centres and the pixels at the offset `dx`
/// in row `y`, at least 0.
#[inline(always)]
fn feature_distance<S: Simd>(simd: S, centre: &Centre<'_>, own: &[S::f32s; 13], y: usize, dx: isize) -> S::f32s {
    let mut most = simd.splat_f32s(0.0);
    for group in 0..3 {
        let mut square = simd.splat_f32s(0.0);
        for k in 3 * group..(3 * group + 3).min(7) {
            let d = simd.sub_f32s(own[k], centre.get::<S>(y, dx, MEANS + k));
            square = simd.add_f32s(square, simd.mul_f32s(d, d));
        }
        let (vp, vq) = (own[7 + group], centre.get::<S>(y, dx, MEANS + 7 + group));
        let expected = simd.add_f32s(vp, simd.min_f32s(vp, vq));
        most = simd.max_f32s(simd.mul_f32s(simd.sub_f32s(square, expected), own[10 + group]), most);
    }
    most
}

/// The regressors of the pixels at the offset `dx` in row `y`, relative to the window centres: normal, albedo,
/// position.
#[inline(always)]
fn regressors<S: Simd>(
    simd: S,
    centre: &Centre<'_>,
    own: &[S::f32s; REGRESSORS + 1],
    y: usize,
    dx: isize,
) -> [S::f32s; REGRESSORS] {
    let (least, most) = (simd.splat_f32s(-16.0), simd.splat_f32s(16.0));
    let mut apart = [simd.splat_f32s(0.0); REGRESSORS];
    for k in 0..REGRESSORS {
        let plane = if k < 6 { MEANS + k } else { POSITION + k - 6 };
        apart[k] = simd.sub_f32s(centre.get::<S>(y, dx, plane), own[k]);
        if k >= 6 {
            apart[k] = simd.max_f32s(simd.min_f32s(simd.mul_f32s(apart[k], own[REGRESSORS]), most), least);
        }
    }
    apart
}

/// The regressors at the centres, then the scale of positions.
#[inline(always)]
fn at_centre<S: Simd>(simd: S, centre: &Centre<'_>) -> [S::f32s; REGRESSORS + 1] {
    let mut own = [simd.splat_f32s(0.0); REGRESSORS + 1];
    for k in 0..=REGRESSORS {
        let plane = if k < 6 { MEANS + k } else { POSITION + k - 6 };
        own[k] = centre.get::<S>(centre.y, 0, plane);
    }
    own
}

/// Fits the colours of both halves in the windows.
#[inline(always)]
fn fit<S: Simd>(simd: S, centre: &Centre<'_>, height: usize, weights: &[S::f32s]) -> [Fit<S>; 2] {
    let zero = simd.splat_f32s(0.0);
    let own = at_centre(simd, centre);
    let count = |y: usize, dx: isize| simd.add_f32s(centre.get::<S>(y, dx, COUNTS), centre.get::<S>(y, dx, COUNTS + 1));
    let here = count(centre.y, 0);
    // Bounded, so that subtracting it loses no digits.
    let mut reference = [zero; 3];
    for c in 0..3 {
        reference[c] = simd.min_f32s(centre.get::<S>(centre.y, 0, c), simd.splat_f32s(8.0));
    }
    let mut sums: Sums<S> = [[zero; VALUES]; REGRESSORS + 1];
    let mut total = zero;
    for down in 0..SIDE {
        let Some(y) = centre.row(down as isize - REACH as isize, height) else { continue };
        for first in (0..SIDE).step_by(SEGMENT) {
            let mut apart = [[zero; SEGMENT]; REGRESSORS];
            let mut colours = [[zero; SEGMENT]; 6];
            let mut weighted = [[zero; SEGMENT]; REGRESSORS + 1];
            for at in 0..SEGMENT.min(SIDE - first) {
                let dx = (first + at) as isize - REACH as isize;
                let weight = simd.mul_f32s(weights[down * SIDE + first + at], count_weights(simd, here, count(y, dx)));
                total = simd.add_f32s(total, weight);
                weighted[0][at] = weight;
                let z = regressors(simd, centre, &own, y, dx);
                for k in 0..REGRESSORS {
                    apart[k][at] = z[k];
                    weighted[k + 1][at] = simd.mul_f32s(weight, z[k]);
                }
                for v in 0..6 {
                    colours[v][at] = simd.sub_f32s(centre.get::<S>(y, dx, COLOURS + v), reference[v % 3]);
                }
            }
            for a in 0..=REGRESSORS {
                for b in [0, 3, 6] {
                    if a <= b + 3 {
                        let values = [&apart[b], &apart[b + 1], &apart[b + 2]];
                        add_products(simd, &weighted[a], values, &mut sums[a], b);
                    }
                }
                for b in [0, 3] {
                    let values = [&colours[b], &colours[b + 1], &colours[b + 2]];
                    add_products(simd, &weighted[a], values, &mut sums[a], REGRESSORS + b);
                }
            }
        }
    }
    [solve(simd, total, &sums, REGRESSORS, &reference), solve(simd, total, &sums, REGRESSORS + 3, &reference)]
}

/// Adds the predictions of both halves' windows to the pixels in them.
#[inline(always)]
fn predict<S: Simd>(
    simd: S,
    centre: &Centre<'_>,
    height: usize,
    weights: &[S::f32s],
    fits: &[Fit<S>; 2],
    first: usize,
    sums: &mut [f32],
) {
    let own = at_centre(simd, centre);
    let columns = centre.stack.columns;
    for o in 0..SIDE * SIDE {
        let [dx, dy] = [o % SIDE, o / SIDE].map(|d| d as isize - REACH as isize);
        let Some(y) = centre.row(dy, height) else { continue };
        let z = regressors(simd, centre, &own, y, dx);
        let (phase, shift) = (dx.rem_euclid(STEP as isize) as usize, dx.div_euclid(STEP as isize));
        let row = y + REACH - first;
        let start = (row * STEP + phase) * 8 * columns + (PAD + centre.k).wrapping_add_signed(shift);
        for half in 0..2 {
            let fit = &fits[half];
            for c in 0..3 {
                let mut value = fit.intercept[c];
                for k in 0..REGRESSORS {
                    value = simd.add_f32s(value, simd.mul_f32s(fit.slopes[k][c], z[k]));
                }
                let to = &mut sums[start + (4 * half + c) * columns..][..S::F32_LANES];
                let sum = &mut S::as_mut_simd_f32s(to).0[0];
                *sum = simd.add_f32s(*sum, simd.mul_f32s(weights[o], value));
            }
            let to = &mut sums[start + (4 * half + 3) * columns..][..S::F32_LANES];
            let sum = &mut S::as_mut_simd_f32s(to).0[0];
            *sum = simd.add_f32s(*sum, weights[o]);
        }
    }
}
