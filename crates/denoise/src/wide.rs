//! A second, much wider window of regression: 41x41 pixels around every fourth pixel of every fourth row.
//!
//! Every window sees all of its pixels. Windows of every second pixel, in turns, would take less time, but neighbouring
//! pixels would then get the predictions of different windows: a visible chessboard.
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
/// The number of pixels of a window whose products are summed together.
const SEGMENT: usize = 14;
/// The largest distance that is not negligible: `exp(-8)` is below [`NEGLIGIBLE`].
const FAR: f32 = 8.0;
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

    /// The index of plane 0 of the pixel in row `y` at the offset `dx` from the window centre number `k`. Plane `p` lies
    /// `p` times [`Stack::columns`] further on.
    #[inline(always)]
    fn index(&self, y: usize, dx: isize, k: usize) -> usize {
        let (phase, shift) = (dx.rem_euclid(STEP as isize) as usize, dx.div_euclid(STEP as isize));
        (y * STEP + phase) * PLANES * self.columns + (PAD + k).wrapping_add_signed(shift)
    }

    /// The vector of plane `p` at an index from [`Stack::index`].
    #[inline(always)]
    fn get<S: Simd>(&self, index: usize, p: usize) -> S::f32s {
        vectors::<S>(&self.data[index + p * self.columns..][..S::F32_LANES])[0]
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
        let mut seen = Seen::<S>::new(simd);
        for y in (self.first..(self.first + BAND).min(height)).step_by(STEP) {
            for k in (0..width.div_ceil(STEP)).step_by(S::F32_LANES) {
                let centre = Centre::new(simd, self.stack, [y, k], self.size);
                weigh(simd, &centre, self.first, &mut seen);
                let fits = fit(simd, &centre, &seen);
                predict(simd, &centre, &seen, &fits, &mut sums);
            }
        }
        sums
    }
}

/// As many window centres as there are lanes, in one row.
struct Centre<'a, S: Simd> {
    stack: &'a Stack,
    y: usize,
    k: usize,
    height: usize,
    /// 1 for centres inside the frame, 0 for others.
    inside: S::f32s,
    /// The regressors at the centres, then the scale of positions.
    regressors: [S::f32s; REGRESSORS + 1],
}

impl<'a, S: Simd> Centre<'a, S> {
    #[inline(always)]
    fn new(simd: S, stack: &'a Stack, [y, k]: [usize; 2], [width, height]: [usize; 2]) -> Self {
        let mut lanes = [0.0; 64];
        lanes[..(width.div_ceil(STEP) - k).min(64)].fill(1.0);
        let at = stack.index(y, 0, k);
        let mut regressors = [simd.splat_f32s(0.0); REGRESSORS + 1];
        for p in 0..=REGRESSORS {
            regressors[p] = stack.get::<S>(at, plane(p));
        }
        Self { stack, y, k, height, inside: vectors::<S>(&lanes)[0], regressors }
    }
}

/// The plane of a regressor, or of the scale of positions, which follows the last one.
#[inline(always)]
const fn plane(regressor: usize) -> usize {
    if regressor < 6 { MEANS + regressor } else { POSITION + regressor - 6 }
}

/// The pixels of the windows whose weights are not all 0.
struct Seen<S: Simd> {
    /// The number of pixels.
    count: usize,
    /// The index in the [`Stack`], and that in the sums of a [`BandTask`].
    places: Vec<[usize; 2]>,
    weights: Vec<S::f32s>,
}

impl<S: Simd> Seen<S> {
    fn new(simd: S) -> Self {
        Self { count: 0, places: vec![[0; 2]; SIDE * SIDE], weights: vec![simd.splat_f32s(0.0); SIDE * SIDE] }
    }
}

/// Lists the pixels of the windows with their weights. The sums of the band begin [`REACH`] rows above row `first`.
#[inline(always)]
fn weigh<S: Simd>(simd: S, centre: &Centre<'_, S>, first: usize, seen: &mut Seen<S>) {
    let (stack, zero) = (centre.stack, simd.splat_f32s(0.0));
    let mut patch = [[zero; 4]; 9];
    for o in 0..9 {
        let (dx, dy) = (o as isize % 3 - PATCH, o as isize / 3 - PATCH);
        let at = stack.index(centre.y.saturating_add_signed(dy).min(centre.height - 1), dx, centre.k);
        for p in 0..4 {
            patch[o][p] = stack.get::<S>(at, p);
        }
    }
    let mut features = [zero; 13];
    for p in 0..13 {
        features[p] = stack.get::<S>(stack.index(centre.y, 0, centre.k), MEANS + p);
    }
    let (share, far) = (simd.splat_f32s(1.0 / (9.0 * COLOUR * COLOUR)), simd.splat_f32s(FAR));
    seen.count = 0;
    for dy in -(REACH as isize)..=REACH as isize {
        let Some(y) = centre.y.checked_add_signed(dy).filter(|y| *y < centre.height) else { continue };
        for dx in -(REACH as isize)..=REACH as isize {
            let index = stack.index(y, dx, centre.k);
            let distance = feature_distance(simd, stack, &features, index);
            if none_below(simd, distance, far) {
                continue;
            }
            let by_colour = simd.mul_f32s(patch_distance(simd, centre, &patch, y, dx), share);
            let distance = simd.add_f32s(simd.max_f32s(by_colour, zero), distance);
            if none_below(simd, distance, far) {
                continue;
            }
            let weight = simd.sub_f32s(exp_minus_all(simd, distance), simd.splat_f32s(NEGLIGIBLE));
            seen.weights[seen.count] = simd.mul_f32s(simd.max_f32s(weight, zero), centre.inside);
            let sums = stack.place(y + REACH - first, 0, 0) + centre.k;
            let (phase, shift) = (dx.rem_euclid(STEP as isize) as usize, dx.div_euclid(STEP as isize));
            let sums = (sums + phase * 8 * stack.columns).wrapping_add_signed(shift);
            seen.places[seen.count] = [index, sums];
            seen.count += 1;
        }
    }
}

/// Returns `true` if no lane of `a` is less than that of `b`.
#[inline(always)]
fn none_below<S: Simd>(simd: S, a: S::f32s, b: S::f32s) -> bool {
    simd.first_true_m32s(simd.less_than_f32s(a, b)) == S::F32_LANES
}

/// The sum of scaled differences of colour between the patches around the centres and those around the pixels at the
/// offset `dx` in row `y`.
#[inline(always)]
fn patch_distance<S: Simd>(simd: S, centre: &Centre<'_, S>, own: &[[S::f32s; 4]; 9], y: usize, dx: isize) -> S::f32s {
    let stack = centre.stack;
    let mut sum = simd.splat_f32s(0.0);
    for (q, own) in own.iter().enumerate() {
        let (px, py) = (q as isize % 3 - PATCH, q as isize / 3 - PATCH);
        let at = stack.index(y.saturating_add_signed(py).min(centre.height - 1), dx + px, centre.k);
        let mut square = simd.splat_f32s(0.0);
        for c in 0..3 {
            let d = simd.sub_f32s(own[c], stack.get::<S>(at, c));
            square = simd.add_f32s(square, simd.mul_f32s(d, d));
        }
        sum = simd.add_f32s(sum, excess(simd, square, own[VARIANCE], stack.get::<S>(at, VARIANCE)));
    }
    sum
}

/// The largest scaled difference of normal, albedo and log depth between the centres and the pixels at an index, at
/// least 0.
#[inline(always)]
fn feature_distance<S: Simd>(simd: S, stack: &Stack, own: &[S::f32s; 13], index: usize) -> S::f32s {
    let mut most = simd.splat_f32s(0.0);
    for group in 0..3 {
        let mut square = simd.splat_f32s(0.0);
        for k in 3 * group..(3 * group + 3).min(7) {
            let d = simd.sub_f32s(own[k], stack.get::<S>(index, MEANS + k));
            square = simd.add_f32s(square, simd.mul_f32s(d, d));
        }
        let (vp, vq) = (own[7 + group], stack.get::<S>(index, MEANS + 7 + group));
        let expected = simd.add_f32s(vp, simd.min_f32s(vp, vq));
        most = simd.max_f32s(simd.mul_f32s(simd.sub_f32s(square, expected), own[10 + group]), most);
    }
    most
}

/// The regressors of the pixels at an index, relative to the window centres: normal, albedo, position.
#[inline(always)]
fn regressors<S: Simd>(simd: S, centre: &Centre<'_, S>, index: usize) -> [S::f32s; REGRESSORS] {
    let (least, most) = (simd.splat_f32s(-16.0), simd.splat_f32s(16.0));
    let own = &centre.regressors;
    let mut apart = [simd.splat_f32s(0.0); REGRESSORS];
    for k in 0..REGRESSORS {
        apart[k] = simd.sub_f32s(centre.stack.get::<S>(index, plane(k)), own[k]);
        if k >= 6 {
            apart[k] = simd.max_f32s(simd.min_f32s(simd.mul_f32s(apart[k], own[REGRESSORS]), most), least);
        }
    }
    apart
}

/// Regressors, colours and weighted regressors of some pixels, whose products are summed together.
struct Segment<S: Simd> {
    apart: [[S::f32s; SEGMENT]; REGRESSORS],
    colours: [[S::f32s; SEGMENT]; 6],
    weighted: [[S::f32s; SEGMENT]; REGRESSORS + 1],
}

impl<S: Simd> Segment<S> {
    /// Adds the products of all pixels to `sums`.
    #[inline(always)]
    fn add_to(&self, simd: S, sums: &mut Sums<S>) {
        for a in 0..=REGRESSORS {
            for b in [0, 3, 6] {
                if a <= b + 3 {
                    let values = [&self.apart[b], &self.apart[b + 1], &self.apart[b + 2]];
                    add_products(simd, &self.weighted[a], values, &mut sums[a], b);
                }
            }
            for b in [0, 3] {
                let values = [&self.colours[b], &self.colours[b + 1], &self.colours[b + 2]];
                add_products(simd, &self.weighted[a], values, &mut sums[a], REGRESSORS + b);
            }
        }
    }
}

/// The number of samples of both halves in the pixels at an index.
#[inline(always)]
fn samples<S: Simd>(simd: S, stack: &Stack, index: usize) -> S::f32s {
    simd.add_f32s(stack.get::<S>(index, COUNTS), stack.get::<S>(index, COUNTS + 1))
}

/// Fits the colours of both halves in the windows.
#[inline(always)]
fn fit<S: Simd>(simd: S, centre: &Centre<'_, S>, seen: &Seen<S>) -> [Fit<S>; 2] {
    let (stack, zero) = (centre.stack, simd.splat_f32s(0.0));
    let at = stack.index(centre.y, 0, centre.k);
    let here = samples(simd, stack, at);
    // Bounded, so that subtracting it loses no digits.
    let mut reference = [zero; 3];
    for c in 0..3 {
        reference[c] = simd.min_f32s(stack.get::<S>(at, c), simd.splat_f32s(8.0));
    }
    let mut sums: Sums<S> = [[zero; VALUES]; REGRESSORS + 1];
    let mut total = zero;
    let mut segment = Segment {
        apart: [[zero; SEGMENT]; REGRESSORS],
        colours: [[zero; SEGMENT]; 6],
        weighted: [[zero; SEGMENT]; REGRESSORS + 1],
    };
    let mut filled = 0;
    for o in 0..seen.count {
        let index = seen.places[o][0];
        let weight = simd.mul_f32s(seen.weights[o], count_weights(simd, here, samples(simd, stack, index)));
        total = simd.add_f32s(total, weight);
        let z = regressors(simd, centre, index);
        segment.weighted[0][filled] = weight;
        for k in 0..REGRESSORS {
            segment.apart[k][filled] = z[k];
            segment.weighted[k + 1][filled] = simd.mul_f32s(weight, z[k]);
        }
        for v in 0..6 {
            segment.colours[v][filled] = simd.sub_f32s(stack.get::<S>(index, COLOURS + v), reference[v % 3]);
        }
        filled += 1;
        if filled == SEGMENT {
            segment.add_to(simd, &mut sums);
            filled = 0;
        }
    }
    for weighted in &mut segment.weighted {
        weighted[filled..].fill(zero);
    }
    segment.add_to(simd, &mut sums);
    [solve(simd, total, &sums, REGRESSORS, &reference), solve(simd, total, &sums, REGRESSORS + 3, &reference)]
}

/// Adds the predictions of both halves' windows to the pixels in them.
#[inline(always)]
fn predict<S: Simd>(simd: S, centre: &Centre<'_, S>, seen: &Seen<S>, fits: &[Fit<S>; 2], sums: &mut [f32]) {
    let columns = centre.stack.columns;
    for o in 0..seen.count {
        let ([index, start], weight) = (seen.places[o], seen.weights[o]);
        let z = regressors(simd, centre, index);
        for half in 0..2 {
            let fit = &fits[half];
            for c in 0..3 {
                let mut value = fit.intercept[c];
                for k in 0..REGRESSORS {
                    value = simd.add_f32s(value, simd.mul_f32s(fit.slopes[k][c], z[k]));
                }
                add(simd, &mut sums[start + (4 * half + c) * columns..], simd.mul_f32s(weight, value));
            }
            add(simd, &mut sums[start + (4 * half + 3) * columns..], weight);
        }
    }
}

/// Adds a vector to the beginning of `sums`.
#[inline(always)]
fn add<S: Simd>(simd: S, sums: &mut [f32], value: S::f32s) {
    let to = &mut S::as_mut_simd_f32s(&mut sums[..S::F32_LANES]).0[0];
    *to = simd.add_f32s(*to, value);
}
