//! Regression in much wider windows: 41x41 pixels around every sixth pixel of every sixth row.
//!
//! Every window uses all of its pixels. If windows used alternate pixels, neighbouring pixels would be predicted by different
//! windows, and a chessboard pattern would show.
//!
//! With few samples, 13x13 pixels cannot average out the noise, and the image of the narrower windows keeps blotches of that
//! size. This pass uses that image as its guide, and its result is blended with it by [`shrink`](crate::error_map::shrink).

#![expect(clippy::needless_range_loop, reason = "several arrays run along, as in the formulas")]

mod stack;

use crate::graph::{Graph, Reach, Rows, all};
use crate::inputs::{Guide, Inputs};
use crate::normal_equations::{Fit, Sums, add_products, solve};
use crate::planes::{Pair, Plane, dispatch, merged};
use crate::regression::NEGLIGIBLE;
use crate::tile::{GROUP, count_weights, excess, exp_minus_all, vectors};
use pulp::{Simd, WithSimd};
use stack::{
    CENTRES, COLOURS, COLUMNS, COUNT, FARTHEST, IN_STACK, IN_SUMS, MEANS, PAD, PATCH, POSITION, Pixels, REACH, STEP,
    Stack, VARIANCE, planes,
};

/// The width of a window in pixels.
const SIDE: usize = 2 * REACH + 1;
/// The number of rows of pixels whose window centres one task processes.
const BAND: usize = 30;
/// The number of rows that the windows of one task cover.
const ROWS: usize = BAND - STEP + 2 * REACH + 1;
/// The number of regressors: normal (3) and position (3). Values are divided by albedo, so albedo would add nothing.
const REGRESSORS: usize = 6;
/// The number of values per pixel: the regressors, and the three colour channels of both halves.
const VALUES: usize = REGRESSORS + 6;
/// The number of pixels of a window whose products are summed together.
const SEGMENT: usize = 14;
/// The distance beyond which a weight is negligible: `exp(-8)` is below [`NEGLIGIBLE`].
const FAR: f32 = 8.0;
/// The bandwidth of colour differences in standard deviations.
const COLOUR: f32 = 1.5;
/// The weight of the fallback image among the predictions. A window's centre has weight 1.
const BESIDE: f32 = 0.5;

/// Filters both halves with windows of 41x41 pixels. `guide` is the image `beside`, divided by its albedo, with its remaining
/// noise.
pub(crate) fn wide(graph: &Graph<'_>, inputs: &Inputs, guide: &Guide, beside: Pair) -> Pair {
    let [width, height] = graph.size;
    let planes = planes(graph, inputs, guide);
    let colour = COLOUR * inputs.part.smoothness();
    let share = 1.0 / (9.0 * colour * colour);
    let reads = all(planes.iter().copied(), Reach::from_fine(BAND, FARTHEST));
    let bands = ([width.div_ceil(STEP * CENTRES), height.div_ceil(BAND)], ROWS * STEP * 8 * COLUMNS);
    let sums = graph.tiles(bands, reads, Stack::default, move |stack, rows, [tile, band]| {
        let first = band * BAND;
        stack.copy(rows, &planes, tile, first.saturating_sub(FARTHEST)..(first + ROWS - REACH + PATCH).min(height));
        let columns = width.div_ceil(STEP) - tile * CENTRES;
        dispatch(BandTask { stack, size: [columns.min(CENTRES), height], first, share })
    });
    let reads = all(sums.iter().copied(), Reach::from_coarse(BAND, REACH));
    let albedo = Some(inputs.features.albedo());
    merged(graph, (beside, BESIDE), albedo, reads, move |rows, row, y| add_bands(rows, row, [y, height], &sums))
}

/// Adds the sums of all tasks that reach row `y` to that row. `tiles` has one plane per column of tasks.
fn add_bands(rows: &Rows, row: &mut [f32], [y, height]: [usize; 2], tiles: &[Plane]) {
    let first = y.saturating_sub(ROWS - REACH - 1).div_ceil(BAND);
    for band in first..(y + REACH).min(height - 1) / BAND + 1 {
        let local = y + REACH - band * BAND;
        let sums = tiles.iter().map(|tile| &rows.row(*tile, band)[local * STEP * 8 * COLUMNS..]);
        sums.enumerate().for_each(|(tile, sums)| add_tile(row, tile, sums));
    }
}

/// Adds the sums of one task for a row of pixels to that row.
fn add_tile(row: &mut [f32], tile: usize, sums: &[f32]) {
    let width = row.len() / 8;
    let pixel = |column: usize, phase: usize| STEP * (tile * CENTRES + column) + phase;
    for phase in 0..STEP {
        let inside = |column: &usize| (STEP * PAD..width + STEP * PAD).contains(&pixel(*column, phase));
        for plane in 0..8 {
            let from = &sums[(phase * 8 + plane) * COLUMNS..][..COLUMNS];
            let to = &mut row[plane * width..][..width];
            for column in (0..COLUMNS).filter(inside) {
                to[pixel(column, phase) - STEP * PAD] += from[column];
            }
        }
    }
}

/// The task of fitting the windows whose centres lie in [`BAND`] rows from row `first`. It returns the sums of weighted
/// predictions and of weights, from [`REACH`] rows above `first`. `size` is the number of columns of centres and of rows of
/// pixels.
struct BandTask<'a> {
    stack: &'a Stack,
    size: [usize; 2],
    first: usize,
    /// The factor on the differences of a patch.
    share: f32,
}

impl WithSimd for BandTask<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let [columns, height] = self.size;
        let mut sums = vec![0.0; ROWS * STEP * 8 * COLUMNS];
        let blocks = GROUP / S::F32_LANES;
        let none = Pixel::<S> { index: 0, sums: 0, offset: 0, weight: simd.splat_f32s(0.0) };
        let mut seen = vec![Seen { count: 0, all: vec![none; SIDE * SIDE] }; blocks];
        let mut windows = Vec::with_capacity(blocks);
        for y in (self.first..(self.first + BAND).min(height)).step_by(STEP) {
            for group in (0..columns).step_by(GROUP) {
                windows.clear();
                for (block, k) in (group..columns.min(group + GROUP)).step_by(S::F32_LANES).enumerate() {
                    let centre = Centre::new(simd, self.stack, [y, k], self.size);
                    weigh(simd, &centre, self.share, self.first, &mut seen[block]);
                    let fits = fit(simd, &centre, &seen[block]);
                    windows.push((centre, fits));
                }
                predict(simd, &windows, &seen, &mut sums);
            }
        }
        sums
    }
}

/// Neighbouring window centres in one row, one per lane.
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
    fn new(simd: S, stack: &'a Stack, [y, k]: [usize; 2], [columns, height]: [usize; 2]) -> Self {
        let mut lanes = [0.0; 64];
        lanes[..(columns - k).min(64)].fill(1.0);
        let own = stack.at::<S>(stack.row(y) + k + IN_STACK[FARTHEST]);
        let mut regressors = [simd.splat_f32s(0.0); REGRESSORS + 1];
        for p in 0..=REGRESSORS {
            regressors[p] = own.get::<S>(plane(p));
        }
        Self { stack, y, k, height, inside: vectors::<S>(&lanes)[0], regressors }
    }
}

impl<S: Simd> Centre<'_, S> {
    /// The indices in the [`Stack`] of the rows of a patch around row `y`, at the first of the centres.
    #[inline(always)]
    fn rows_near(&self, y: usize) -> [usize; 3] {
        let row = |y: usize| self.stack.row(y.min(self.height - 1)) + self.k;
        [row(y.saturating_sub(1)), row(y), row(y + 1)]
    }
}

/// The plane of a regressor, or of the scale of positions, which follows the last one.
#[inline(always)]
const fn plane(regressor: usize) -> usize {
    if regressor < 3 { MEANS + regressor } else { POSITION + regressor - 3 }
}

/// The pixels of the windows that have a weight above 0 in some lane.
#[derive(Clone)]
struct Seen<S: Simd> {
    /// The number of pixels.
    count: usize,
    all: Vec<Pixel<S>>,
}

/// The pixels at the same offset from neighbouring window centres, one per lane.
#[derive(Clone, Copy)]
struct Pixel<S: Simd> {
    /// The index of plane 0 in the [`Stack`].
    index: usize,
    /// The index of plane 0 in the sums of a [`BandTask`].
    sums: usize,
    /// The number of the offset, counted by rows.
    offset: usize,
    weight: S::f32s,
}

/// Lists the pixels of the windows with their weights. The sums of the band begin [`REACH`] rows above row `first`. `share` is
/// the factor on the summed differences of a patch.
#[inline(always)]
fn weigh<S: Simd>(simd: S, centre: &Centre<'_, S>, share: f32, first: usize, seen: &mut Seen<S>) {
    let (stack, zero) = (centre.stack, simd.splat_f32s(0.0));
    let mut patch = [[zero; 4]; 9];
    let near = centre.rows_near(centre.y);
    for o in 0..9 {
        let there = stack.at::<S>(near[o / 3] + IN_STACK[FARTHEST - PATCH + o % 3]);
        for p in 0..4 {
            patch[o][p] = there.get::<S>(p);
        }
    }
    let own = stack.at::<S>(near[PATCH] + IN_STACK[FARTHEST]);
    let mut features = [zero; 13];
    for p in 0..13 {
        features[p] = own.get::<S>(MEANS + p);
    }
    let (share, far) = (simd.splat_f32s(share), simd.splat_f32s(FAR));
    let mut count = 0;
    for y in centre.y.saturating_sub(REACH)..(centre.y + REACH + 1).min(centre.height) {
        let near = centre.rows_near(y);
        let row_of_sums = (y + REACH - first) * STEP * 8 * COLUMNS + centre.k;
        for dx in FARTHEST - REACH..=FARTHEST + REACH {
            let index = near[PATCH] + IN_STACK[dx];
            let distance = feature_distance(simd, &features, stack.at::<S>(index));
            if none_below(simd, distance, far) {
                continue;
            }
            let by_colour = simd.mul_f32s(patch_distance(simd, stack, &patch, &near, dx), share);
            let distance = simd.add_f32s(simd.max_f32s(by_colour, zero), distance);
            if none_below(simd, distance, far) {
                continue;
            }
            let weight = simd.sub_f32s(exp_minus_all(simd, distance), simd.splat_f32s(NEGLIGIBLE));
            let weight = simd.mul_f32s(simd.max_f32s(weight, zero), centre.inside);
            let (sums, offset) = (row_of_sums + IN_SUMS[dx], y * 2 * FARTHEST + dx);
            seen.all[count] = Pixel { index, sums, offset, weight };
            count += 1;
        }
    }
    seen.count = count;
}

/// Returns `true` if no lane of `a` is less than that of `b`.
#[inline(always)]
fn none_below<S: Simd>(simd: S, a: S::f32s, b: S::f32s) -> bool {
    simd.first_true_m32s(simd.less_than_f32s(a, b)) == S::F32_LANES
}

/// The sum of scaled colour differences between the patches around the centres and those around the pixels in column `dx`.
/// `rows` are the rows of the latter patches.
#[inline(always)]
fn patch_distance<S: Simd>(simd: S, stack: &Stack, own: &[[S::f32s; 4]; 9], rows: &[usize; 3], dx: usize) -> S::f32s {
    let mut sum = simd.splat_f32s(0.0);
    for q in 0..9 {
        let (own, there) = (&own[q], stack.at::<S>(rows[q / 3] + IN_STACK[dx + q % 3 - PATCH]));
        let mut square = simd.splat_f32s(0.0);
        for c in 0..3 {
            let d = simd.sub_f32s(own[c], there.get::<S>(c));
            square = simd.add_f32s(square, simd.mul_f32s(d, d));
        }
        sum = simd.add_f32s(sum, excess(simd, square, own[VARIANCE], there.get::<S>(VARIANCE)));
    }
    sum
}

/// The largest scaled difference of normal, albedo and log depth between the centres and other pixels, at least 0.
#[inline(always)]
fn feature_distance<S: Simd>(simd: S, own: &[S::f32s; 13], there: Pixels<'_>) -> S::f32s {
    let mut most = simd.splat_f32s(0.0);
    for group in 0..3 {
        let mut square = simd.splat_f32s(0.0);
        for k in 3 * group..(3 * group + 3).min(7) {
            let d = simd.sub_f32s(own[k], there.get::<S>(MEANS + k));
            square = simd.add_f32s(square, simd.mul_f32s(d, d));
        }
        let (vp, vq) = (own[7 + group], there.get::<S>(MEANS + 7 + group));
        let expected = simd.add_f32s(vp, simd.min_f32s(vp, vq));
        most = simd.max_f32s(simd.mul_f32s(simd.sub_f32s(square, expected), own[10 + group]), most);
    }
    most
}

/// The regressors of pixels relative to the window centres: normal and position.
#[inline(always)]
fn regressors<S: Simd>(simd: S, centre: &Centre<'_, S>, there: Pixels<'_>) -> [S::f32s; REGRESSORS] {
    let (least, most) = (simd.splat_f32s(-16.0), simd.splat_f32s(16.0));
    let own = &centre.regressors;
    let mut apart = [simd.splat_f32s(0.0); REGRESSORS];
    for k in 0..REGRESSORS {
        apart[k] = simd.sub_f32s(there.get::<S>(plane(k)), own[k]);
        if k >= 3 {
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
    fn add_to(&self, simd: S, sums: &mut Sums<S, VALUES, { REGRESSORS + 1 }>) {
        for b in [0, 3] {
            let values = [&self.apart[b], &self.apart[b + 1], &self.apart[b + 2]];
            add_products(simd, &self.weighted, values, sums, [b, b + 3], [0, SEGMENT]);
            let values = [&self.colours[b], &self.colours[b + 1], &self.colours[b + 2]];
            add_products(simd, &self.weighted, values, sums, [REGRESSORS + b, REGRESSORS], [0, SEGMENT]);
        }
    }
}

/// Fits the colours of both halves in the windows.
#[inline(always)]
fn fit<S: Simd>(simd: S, centre: &Centre<'_, S>, seen: &Seen<S>) -> [Fit<S, REGRESSORS>; 2] {
    let (stack, zero) = (centre.stack, simd.splat_f32s(0.0));
    let own = stack.at::<S>(stack.row(centre.y) + centre.k + IN_STACK[FARTHEST]);
    let here = own.get::<S>(COUNT);
    // Bounded, so that subtracting it loses no digits.
    let mut reference = [zero; 3];
    for c in 0..3 {
        reference[c] = simd.min_f32s(own.get::<S>(c), simd.splat_f32s(8.0));
    }
    let mut sums: Sums<S, VALUES, { REGRESSORS + 1 }> = [[zero; VALUES]; REGRESSORS + 1];
    let mut total = zero;
    let mut segment = Segment {
        apart: [[zero; SEGMENT]; REGRESSORS],
        colours: [[zero; SEGMENT]; 6],
        weighted: [[zero; SEGMENT]; REGRESSORS + 1],
    };
    let mut filled = 0;
    for pixel in &seen.all[..seen.count] {
        let there = stack.at::<S>(pixel.index);
        let weight = simd.mul_f32s(pixel.weight, count_weights(simd, here, there.get::<S>(COUNT)));
        total = simd.add_f32s(total, weight);
        let z = regressors(simd, centre, there);
        segment.weighted[0][filled] = weight;
        for k in 0..REGRESSORS {
            segment.apart[k][filled] = z[k];
            segment.weighted[k + 1][filled] = simd.mul_f32s(weight, z[k]);
        }
        for v in 0..6 {
            segment.colours[v][filled] = simd.sub_f32s(there.get::<S>(COLOURS + v), reference[v % 3]);
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

/// Adds the predictions of both halves' windows to the pixels in them. The order is by offset, since a pixel may lie in windows
/// of several vectors.
#[inline(always)]
fn predict<S: Simd>(simd: S, windows: &[(Centre<'_, S>, [Fit<S, REGRESSORS>; 2])], seen: &[Seen<S>], sums: &mut [f32]) {
    let mut next = [0; GROUP];
    loop {
        let mut least = usize::MAX;
        for i in 0..windows.len() {
            if next[i] < seen[i].count {
                least = least.min(seen[i].all[next[i]].offset);
            }
        }
        if least == usize::MAX {
            return;
        }
        for i in 0..windows.len() {
            if next[i] < seen[i].count && seen[i].all[next[i]].offset == least {
                predict_pixel(simd, &windows[i].0, &seen[i].all[next[i]], &windows[i].1, sums);
                next[i] += 1;
            }
        }
    }
}

#[inline(always)]
fn predict_pixel<S: Simd>(
    simd: S,
    centre: &Centre<'_, S>,
    pixel: &Pixel<S>,
    fits: &[Fit<S, REGRESSORS>; 2],
    sums: &mut [f32],
) {
    let z = regressors(simd, centre, centre.stack.at::<S>(pixel.index));
    let sums = &mut sums[pixel.sums..][..7 * COLUMNS + S::F32_LANES];
    for half in 0..2 {
        let fit = &fits[half];
        for c in 0..3 {
            let mut value = fit.intercept[c];
            for k in 0..REGRESSORS {
                value = simd.add_f32s(value, simd.mul_f32s(fit.slopes[k][c], z[k]));
            }
            add(simd, &mut sums[(4 * half + c) * COLUMNS..], simd.mul_f32s(pixel.weight, value));
        }
        add(simd, &mut sums[(4 * half + 3) * COLUMNS..], pixel.weight);
    }
}

/// Adds a vector to the beginning of `sums`.
#[inline(always)]
fn add<S: Simd>(simd: S, sums: &mut [f32], value: S::f32s) {
    let to = &mut S::as_mut_simd_f32s(&mut sums[..S::F32_LANES]).0[0];
    *to = simd.add_f32s(*to, value);
}
