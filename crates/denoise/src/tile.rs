//! Weights between the pixels of a tile and the pixels around them, computed with vector instructions.
//!
//! A tile's planes are copied with a margin, even and odd columns separately. Every second pixel is then contiguous in memory,
//! so that loops use vectors.
//!
//! Sums over pixels have a fixed order and no operation is fused, so every machine computes the same bits.

#![expect(clippy::needless_range_loop, reason = "several arrays run along, as in the formulas")]

mod stack;

use crate::features::Features;
use crate::graph::{Graph, Reach, Rows, all};
use crate::inputs::{Guide, Inputs};
use crate::planes::{Plane, map_to_one};
use pulp::Simd;
use stack::moved;
pub(crate) use stack::{COLUMNS, HEIGHT, LANES, MARGIN, Place, ROWS, Stack, WIDTH};
use std::ops::Range;

/// The largest radius of a window in pixels.
pub(crate) const REACH: usize = 7;
/// The number of windows whose predictions are added offset by offset. It is a multiple of every machine's vector width, so
/// that sums have the same order, and the same bits, on all machines.
pub(crate) const GROUP: usize = 16;
/// The number of even (or odd) columns for which differences are computed: `LANES`, plus the columns beside them that patches
/// read.
const SPAN: usize = 48;

/// One value for each even (or odd) pixel in a row of a tile.
pub(crate) type Row = [f32; LANES];

/// The number of vectors from the start of one plane of a [`Stack`] to the start of the next.
#[inline(always)]
pub(crate) const fn stride<S: Simd>() -> usize {
    COLUMNS / S::F32_LANES
}

/// A tile's copy of a guide. Either `pooled` or `each` is used.
#[derive(Default)]
struct LocalGuide {
    /// Red, green, blue and the sum of their variances.
    pooled: Stack<4>,
    /// Red, green, blue and the variance of each.
    each: Stack<6>,
    is_pooled: bool,
}

/// The scales by which squared feature differences are divided.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FeatureScales {
    /// The bandwidth of feature differences in standard deviations.
    pub(crate) bandwidth: f32,
    /// The least variances of normal and of albedo; smaller variances are raised to them.
    pub(crate) floors: [f32; 2],
    /// The least standard deviation of log depth, in units of its slope between neighbouring pixels.
    pub(crate) slope: f32,
}

/// The parameters by which the pixels of a window are compared.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Likeness {
    /// The radius of the compared patches in pixels.
    pub(crate) patch: usize,
    /// The bandwidth of colour differences in standard deviations.
    pub(crate) colour: f32,
    /// The scales of feature differences; `None` to ignore features.
    pub(crate) features: Option<FeatureScales>,
    /// The factor on the weight of a pixel in another cluster.
    pub(crate) outside: f32,
}

/// The images, features and parameters by which the pixels of windows are compared.
pub(crate) struct Comparison<const G: usize> {
    pub(crate) size: [usize; 2],
    pub(crate) inputs: Inputs,
    /// One guide for both halves, or one from each half.
    guides: [Guide; G],
    pub(crate) like: Likeness,
    /// The number of rows above and below a tile that its windows and their patches reach.
    margin: usize,
    /// The planes that [`sharpness`] returns; `None` to ignore features.
    sharp: Option<[Plane; 3]>,
}

impl<const G: usize> Comparison<G> {
    /// Creates the comparison for windows of this `radius`.
    pub(crate) fn new(graph: &Graph<'_>, inputs: &Inputs, guides: [Guide; G], like: Likeness, radius: usize) -> Self {
        let sharp = like.features.map(|scales| sharpness(graph, &inputs.features, scales));
        Self { size: graph.size, inputs: *inputs, guides, like, margin: radius + like.patch, sharp }
    }

    /// Feature means, variances and the reciprocal scales of their squared differences; `None` if features are not compared.
    fn features(&self) -> Option<[Plane; 13]> {
        let ([nx, ny, nz, r, g, b, depth], [vn, va, vd]) = (self.inputs.features.mean, self.inputs.features.variance);
        self.sharp.map(|[sn, sa, sd]| [nx, ny, nz, r, g, b, depth, vn, va, vd, sn, sa, sd])
    }

    /// The clusters, if they affect weights.
    fn labels(&self) -> Option<Plane> {
        self.inputs.labels.filter(|_| self.like.outside < 1.0)
    }

    /// The place of a tile, given its column and row among the tiles.
    pub(crate) fn place(&self, [column, row]: [usize; 2]) -> Place {
        Place { size: self.size, origin: [column * WIDTH, row * HEIGHT], margin: self.margin }
    }

    /// The planes that a tile copies, and `others`, with the rows that are read.
    pub(crate) fn reads(&self, others: impl IntoIterator<Item = Plane>) -> Vec<(Plane, Reach)> {
        let guides = self.guides.iter().flat_map(|guide| guide.colour.iter().chain(&guide.variance).copied());
        let planes = guides.chain(self.features().into_iter().flatten()).chain(self.labels());
        all(planes.chain(others), Reach::from_fine(HEIGHT, self.margin))
    }
}

/// A tile: its place, its copies of the planes that determine weights, and its differences from pixels at one offset. A task
/// copies one tile after another into the same memory.
pub(crate) struct Tile<const G: usize> {
    origin: [usize; 2],
    size: [usize; 2],
    guides: [LocalGuide; G],
    differences: [Differences; G],
    /// Feature means (7 planes), variances of normal, albedo and log depth, and the reciprocal scales of their squared
    /// differences; `None` if features are not compared.
    features: Option<Stack<13>>,
    labels: Option<Stack<1>>,
}

impl<const G: usize> Default for Tile<G> {
    fn default() -> Self {
        Self {
            origin: [0; 2],
            size: [0; 2],
            guides: std::array::from_fn(|_| LocalGuide::default()),
            differences: std::array::from_fn(|_| Differences::default()),
            features: None,
            labels: None,
        }
    }
}

impl<const G: usize> Tile<G> {
    /// Copies the planes of the tile at a place.
    pub(crate) fn copy(&mut self, of: &Comparison<G>, rows: &Rows, place: Place) {
        (self.origin, self.size) = (place.origin, place.size);
        match of.features() {
            Some(planes) => self.features.get_or_insert_default().copy(rows, planes, place),
            None => self.features = None,
        }
        match of.labels() {
            Some(labels) => self.labels.get_or_insert_default().copy(rows, [labels], place),
            None => self.labels = None,
        }
        of.guides.iter().zip(&mut self.guides).for_each(|(guide, to)| to.copy(rows, guide, place));
    }

    /// The number of the tile's rows inside the frame, and half the number of its columns there, rounded up.
    #[inline(always)]
    pub(crate) fn extent(&self) -> [usize; 2] {
        let [width, height] = [0, 1].map(|k| self.size[k] - self.origin[k]);
        [height.min(HEIGHT), width.div_ceil(2).min(LANES)]
    }
}

/// The reciprocal scales of squared differences of normal, albedo and log depth: one over the squared bandwidth times
/// the variance or its floor.
pub(crate) fn sharpness(graph: &Graph<'_>, features: &Features, scales: FeatureScales) -> [Plane; 3] {
    let square = scales.bandwidth * scales.bandwidth;
    std::array::from_fn(|k| {
        map_to_one(graph, [features.variance[k], features.slope], move |[v, slope]| {
            let steep = scales.slope * slope;
            let floor = if k < 2 { scales.floors[k] } else { steep * steep + 1e-4 };
            1.0 / (square * v.max(floor))
        })
    })
}

impl LocalGuide {
    /// Copies the tile of a guide at a place.
    fn copy(&mut self, rows: &Rows, guide: &Guide, place: Place) {
        let [r, g, b] = guide.colour;
        self.is_pooled = guide.variance.len() == 1;
        match guide.variance[..] {
            [vr, vg, vb] => self.each.copy(rows, [r, g, b, vr, vg, vb], place),
            ref pooled => self.pooled.copy(rows, [r, g, b, pooled[0]], place),
        }
    }

    /// Writes the differences between two runs of `SPAN` pixels to `out`. Each run starts at a given row, parity and column. A
    /// difference is squared, reduced by its expectation due to noise, and divided by the variance.
    #[inline(always)]
    fn differences<S: Simd>(&self, simd: S, here: [usize; 3], there: [usize; 3], out: &mut [f32; SPAN]) {
        let out = S::as_mut_simd_f32s(out).0;
        let step = stride::<S>();
        if self.is_pooled {
            let (p, q) = (vectors::<S>(self.pooled.from(here, SPAN)), vectors::<S>(self.pooled.from(there, SPAN)));
            for k in 0..SPAN / S::F32_LANES {
                let r = simd.sub_f32s(p[k], q[k]);
                let g = simd.sub_f32s(p[step + k], q[step + k]);
                let b = simd.sub_f32s(p[2 * step + k], q[2 * step + k]);
                let square = simd.add_f32s(simd.mul_f32s(r, r), simd.mul_f32s(g, g));
                let square = simd.add_f32s(square, simd.mul_f32s(b, b));
                out[k] = excess(simd, square, p[3 * step + k], q[3 * step + k]);
            }
            return;
        }
        let third = simd.splat_f32s(1.0 / 3.0);
        let (p, q) = (vectors::<S>(self.each.from(here, SPAN)), vectors::<S>(self.each.from(there, SPAN)));
        for k in 0..SPAN / S::F32_LANES {
            let mut sum = simd.splat_f32s(0.0);
            for c in 0..3 {
                let d = simd.sub_f32s(p[c * step + k], q[c * step + k]);
                let [vp, vq] = [p[(c + 3) * step + k], q[(c + 3) * step + k]];
                sum = simd.add_f32s(sum, excess(simd, simd.mul_f32s(d, d), vp, vq));
            }
            out[k] = simd.mul_f32s(sum, third);
        }
    }
}

/// A row of numbers as vectors of the machine's width.
#[inline(always)]
pub(crate) fn vectors<S: Simd>(row: &[f32]) -> &[S::f32s] {
    S::as_simd_f32s(row).0
}

/// The excess of a squared difference over its expectation due to noise, divided by the sum of the variances `vp` and
/// `vq`.
#[inline(always)]
pub(crate) fn excess<S: Simd>(simd: S, square: S::f32s, vp: S::f32s, vq: S::f32s) -> S::f32s {
    let expected = simd.add_f32s(vp, simd.min_f32s(vp, vq));
    simd.div_f32s(simd.sub_f32s(square, expected), simd.add_f32s(vp, vq))
}

/// Buffers for the differences of one guide at one offset, and for their sums over patches.
struct Differences {
    pointwise: Vec<[f32; COLUMNS]>,
    column_sums: [[f32; COLUMNS]; 2],
}

impl Default for Differences {
    fn default() -> Self {
        Self { pointwise: vec![[0.0; COLUMNS]; 2 * ROWS], column_sums: [[0.0; COLUMNS]; 2] }
    }
}

impl Differences {
    /// Compares the pixels in the rows `lines` of the copy of a guide with the pixels at `offset` from them.
    #[inline(always)]
    fn compare<S: Simd>(&mut self, simd: S, guide: &LocalGuide, lines: Range<usize>, offset: [isize; 2]) {
        for y in lines {
            for parity in 0..2 {
                let (other, shift) = moved(parity, offset[0]);
                // Patches reach three columns to the left: two even ones, or the odd one before as well.
                let start = MARGIN / 2 - 1 - parity;
                let there = [y.wrapping_add_signed(offset[1]), other, start.wrapping_add_signed(shift)];
                let out = (&mut self.pointwise[2 * y + parity][start..][..SPAN]).try_into().expect("a row long enough");
                guide.differences(simd, [y, parity, start], there, out);
            }
        }
    }

    /// Sums the differences of each column over the `2 radius + 1` rows around row `y` of the tile.
    #[inline(always)]
    fn sum_columns<S: Simd>(&mut self, simd: S, y: usize, radius: usize) {
        for parity in 0..2 {
            let first = 2 * (y + MARGIN - radius) + parity;
            let sums = S::as_mut_simd_f32s(&mut self.column_sums[parity]).0;
            for i in 0..COLUMNS / S::F32_LANES {
                let mut sum = vectors::<S>(&self.pointwise[first])[i];
                for k in 1..=2 * radius {
                    sum = simd.add_f32s(sum, vectors::<S>(&self.pointwise[first + 2 * k])[i]);
                }
                sums[i] = sum;
            }
        }
    }

    /// The column sums that make up the patches around the even (or odd) pixels of a row: one slice per column of a patch.
    #[inline(always)]
    fn columns<S: Simd>(&self, parity: usize, radius: usize) -> [&[S::f32s]; 7] {
        let mut columns: [&[S::f32s]; 7] = [&[]; 7];
        for k in 0..=2 * radius {
            let (other, shift) = moved(parity, k as isize - radius as isize);
            let from = (MARGIN / 2).wrapping_add_signed(shift);
            columns[k] = vectors::<S>(&self.column_sums[other][from..][..LANES]);
        }
        columns
    }
}

impl<const G: usize> Tile<G> {
    /// Compares, for each guide, the pixels of the tile with the pixels at `offset` from them. The rows within `radius` above
    /// and below the tile, which patches reach, are included.
    #[inline(always)]
    pub(crate) fn compare<S: Simd>(&mut self, simd: S, offset: [isize; 2], radius: usize) {
        let [rows, _] = self.extent();
        for g in 0..G {
            let lines = MARGIN - radius..MARGIN + rows + radius;
            self.differences[g].compare(simd, &self.guides[g], lines, offset);
        }
    }

    /// Sums the differences of each column over the `2 radius + 1` rows around row `y` of the tile.
    #[inline(always)]
    pub(crate) fn sum_columns<S: Simd>(&mut self, simd: S, y: usize, radius: usize) {
        for differences in &mut self.differences {
            differences.sum_columns(simd, y, radius);
        }
    }

    /// Computes the weight of the pixel at `offset` from each even (or odd) pixel in row `y`, for each guide. Weights
    /// follow from the differences of patches and features, and from the clusters.
    #[inline(always)]
    pub(crate) fn weights<S: Simd>(
        &self,
        simd: S,
        like: &Likeness,
        [y, parity]: [usize; 2],
        offset: [isize; 2],
        rows: &mut [Row; G],
    ) {
        let radius = like.patch;
        let side = (2 * radius + 1) as f32;
        let share = simd.splat_f32s(1.0 / (side * side * like.colour * like.colour));
        let (zero, one, outside) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0), simd.splat_f32s(like.outside));
        // No closures: their bodies would not be compiled for this machine's vectors.
        let mut features = None;
        if let Some(stack) = &self.features {
            let (here, there) = (stack.moved(y, parity, [0, 0]), stack.moved(y, parity, offset));
            features = Some((vectors::<S>(here), vectors::<S>(there)));
        }
        let mut labels = None;
        if let Some(stack) = &self.labels {
            let (here, there) = (stack.moved(y, parity, [0, 0]), stack.moved(y, parity, offset));
            labels = Some((vectors::<S>(here), vectors::<S>(there)));
        }
        let mut columns: [[&[S::f32s]; 7]; G] = [[&[]; 7]; G];
        for guide in 0..G {
            columns[guide] = self.differences[guide].columns::<S>(parity, radius);
        }
        for i in 0..LANES / S::F32_LANES {
            let mut distance = zero;
            if let Some((p, q)) = features {
                distance = feature_distance(simd, p, q, i);
            }
            let mut factor = one;
            if let Some((p, q)) = labels {
                factor = simd.select_f32s(simd.equal_f32s(p[i], q[i]), one, outside);
            }
            for guide in 0..G {
                let mut patch = zero;
                for k in 0..=2 * radius {
                    patch = simd.add_f32s(patch, columns[guide][k][i]);
                }
                let by_colour = simd.max_f32s(simd.mul_f32s(patch, share), zero);
                let weight = exp_minus_all(simd, simd.add_f32s(by_colour, distance));
                S::as_mut_simd_f32s(&mut rows[guide]).0[i] = simd.mul_f32s(weight, factor);
            }
        }
    }
}

/// The largest of the scaled differences of normal, albedo and log depth between the `i`-th vectors of two rows of features; at
/// least 0.
#[inline(always)]
fn feature_distance<S: Simd>(simd: S, p: &[S::f32s], q: &[S::f32s], i: usize) -> S::f32s {
    let step = stride::<S>();
    let mut most = simd.splat_f32s(0.0);
    for group in 0..3 {
        let first = 3 * group;
        let d = simd.sub_f32s(p[first * step + i], q[first * step + i]);
        let mut square = simd.mul_f32s(d, d);
        if group < 2 {
            for k in first + 1..first + 3 {
                let d = simd.sub_f32s(p[k * step + i], q[k * step + i]);
                square = simd.add_f32s(square, simd.mul_f32s(d, d));
            }
        }
        let (vp, vq) = (p[(7 + group) * step + i], q[(7 + group) * step + i]);
        let expected = simd.add_f32s(vp, simd.min_f32s(vp, vq));
        let distance = simd.mul_f32s(simd.sub_f32s(square, expected), p[(10 + group) * step + i]);
        most = simd.max_f32s(distance, most);
    }
    most
}

/// `exp(-x)` for each `x >= 0` of a vector, with a relative error of 3e-6 and bit-identical on every machine. Beyond 80, the
/// result stays at about `exp(-80)`.
///
/// The power is `2^n 2^f` with an integer `n` and `f` in -1/2 .. 1/2. `2^f` is a Taylor polynomial of degree 5, with a
/// remainder below 2.5e-6. `n` is added to the exponent.
#[inline(always)]
pub(crate) fn exp_minus_all<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let (round, one) = (simd.splat_f32s(ROUND), simd.splat_f32s(1.0));
    let t = simd.mul_f32s(simd.min_f32s(x, simd.splat_f32s(80.0)), simd.splat_f32s(-std::f32::consts::LOG2_E));
    let rounded = simd.add_f32s(t, round);
    let f = simd.mul_f32s(simd.sub_f32s(t, simd.sub_f32s(rounded, round)), simd.splat_f32s(std::f32::consts::LN_2));
    let mut power = simd.splat_f32s(EXPONENTIAL[0]);
    power = simd.add_f32s(simd.mul_f32s(power, f), simd.splat_f32s(EXPONENTIAL[1]));
    power = simd.add_f32s(simd.mul_f32s(power, f), simd.splat_f32s(EXPONENTIAL[2]));
    power = simd.add_f32s(simd.mul_f32s(power, f), simd.splat_f32s(EXPONENTIAL[3]));
    power = simd.add_f32s(simd.mul_f32s(power, f), one);
    power = simd.add_f32s(simd.mul_f32s(power, f), one);
    let bits = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(rounded), simd.splat_u32s(23));
    simd.transmute_f32s_u32s(simd.add_u32s(simd.transmute_u32s_f32s(power), bits))
}

/// 1.5 * 2^23. Adding it to a small number leaves that number, rounded to an integer, in the low bits.
const ROUND: f32 = 12_582_912.0;

/// Taylor coefficients of the exponential function, from the fifth down to the second.
const EXPONENTIAL: [f32; 4] = [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5];

/// [`exp_minus_all`] for one number.
#[inline(always)]
pub(crate) fn exp_minus(x: f32) -> f32 {
    exp_minus_all(pulp::Scalar::new(), x)
}

/// The factor `there / (here + there)` on a pixel's weight, for the sample counts `there` of the pixel and `here` of the
/// filtered pixel. More samples weigh more, but at most twice as much as equal counts. Weights proportional to sample counts
/// would make leaks across edges grow with the ratio of the counts.
#[inline(always)]
pub(crate) fn count_weights<S: Simd>(simd: S, here: S::f32s, there: S::f32s) -> S::f32s {
    simd.div_f32s(there, simd.max_f32s(simd.add_f32s(here, there), simd.splat_f32s(1.0)))
}

/// The numbers of columns and of rows of tiles.
pub(crate) fn tiles([width, height]: [usize; 2]) -> [usize; 2] {
    [width.div_ceil(WIDTH), height.div_ceil(HEIGHT)]
}
