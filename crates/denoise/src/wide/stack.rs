//! Copies of the planes that the wide pass reads, arranged so that a vector holds pixels at the same offset from neighbouring
//! window centres.

use crate::graph::{Graph, Rows};
use crate::inputs::{Guide, Inputs};
use crate::planes::{Plane, map_to_one, raised};
use crate::tile::{FeatureScales, sharpness, vectors};
use pulp::Simd;
use std::ops::Range;

/// The radius of a window in pixels.
pub(super) const REACH: usize = 20;
/// The distance between window centres in pixels, along both axes. Distances of 4 to 6 leave equal errors, 8 leaves 1 %
/// more.
pub(super) const STEP: usize = 6;
/// The number of columns of window centres that one task processes.
pub(super) const CENTRES: usize = 32;
/// The columns of one phase (column modulo [`STEP`]) on either side of the centres that windows and patches reach.
pub(super) const PAD: usize = 4;
/// The columns of one phase that a task reads. The number is constant, so that bounds are checked once per pixel of a window.
pub(super) const COLUMNS: usize = CENTRES + 2 * PAD;
/// The scales of feature differences.
const FEATURES: FeatureScales = FeatureScales { bandwidth: 7.0, floors: [1e-2, 5e-2], slope: 15.0 };
/// The radius of the compared patches.
pub(super) const PATCH: usize = 1;

/// The copied planes: guide colours (3) and variance (1), features (7) and their variances (3), the scales of feature
/// differences (3), positions (3) with one over the width of 24 pixels (1), samples of both halves (1), and colours divided by
/// albedo (6).
pub(super) const PLANES: usize = 28;
pub(super) const VARIANCE: usize = 3;
pub(super) const MEANS: usize = 4;

pub(super) const POSITION: usize = 17;

pub(super) const COUNT: usize = 21;
pub(super) const COLOURS: usize = 22;

/// Copies of rows of the planes for [`CENTRES`] columns of window centres. Columns with equal remainder modulo [`STEP`] (a
/// phase) are side by side. Each row holds, for each phase, all planes one after another. Columns beyond the frame repeat the
/// border.
#[derive(Default)]
pub(super) struct Stack {
    /// The number of the first row.
    first: usize,
    values: Vec<f32>,
}

/// The planes that are copied, in their order.
pub(super) fn planes(graph: &Graph<'_>, inputs: &Inputs, guide: &Guide) -> Vec<Plane> {
    let f = &inputs.features;
    let sharp = sharpness(graph, f, FEATURES);
    let colours = inputs.unfiltered().0.into_iter().enumerate();
    let colours = colours.map(|(k, plane)| map_to_one(graph, [plane, f.albedo()[k % 3]], |[v, a]| v / raised(a)));
    let count = map_to_one(graph, inputs.counts(), |[a, b]| a + b);
    let features = f.mean.iter().chain(&f.variance).chain(&sharp).chain(&f.position).chain([&f.scale, &count]);
    guide.colour.iter().chain(&guide.variance).chain(features).copied().chain(colours).collect()
}

impl Stack {
    /// Copies the rows `copied` of a tile of centres from each plane, replacing the previous rows.
    pub(super) fn copy(&mut self, rows: &Rows, planes: &[Plane], tile: usize, copied: Range<usize>) {
        self.first = copied.start;
        self.values.resize(copied.len() * ROW, 0.0);
        let mut padded = [0.0; STEP * COLUMNS];
        // Column `x` of the frame is column `x - before` of the tile. Columns `first` to `end` of the tile lie in the frame.
        let before = STEP as isize * ((tile * CENTRES) as isize - PAD as isize);
        let first = (-before).max(0) as usize;
        for (row, y) in self.values.chunks_exact_mut(ROW).zip(copied) {
            for (k, plane) in planes.iter().enumerate() {
                let source = rows.row(*plane, y);
                let width = source.len();
                let end = (width as isize - before).min((STEP * COLUMNS) as isize) as usize;
                let [left, right] = if k == COUNT { [0.0; 2] } else { [source[0], source[width - 1]] };
                padded[..first].fill(left);
                padded[first..end].copy_from_slice(&source[first.wrapping_add_signed(before)..][..end - first]);
                padded[end..].fill(right);
                for (column, values) in padded.as_chunks::<STEP>().0.iter().enumerate() {
                    for (phase, value) in values.iter().enumerate() {
                        row[(phase * PLANES + k) * COLUMNS + column] = *value;
                    }
                }
            }
        }
    }

    /// The index of plane 0 in the first column of row `y`.
    #[inline(always)]
    pub(super) fn row(&self, y: usize) -> usize {
        (y - self.first) * ROW
    }
}

/// The number of values between two rows of a [`Stack`].
const ROW: usize = STEP * PLANES * COLUMNS;
/// The largest distance of a compared pixel from a window centre, in columns of pixels.
pub(super) const FARTHEST: usize = REACH + PATCH;

/// The index of the pixel at the offset `dx - FARTHEST` columns from a window centre, within a row that holds `planes` planes
/// for each phase. The centre's number is added to it.
const fn columns(planes: usize) -> [usize; 2 * FARTHEST + 1] {
    let mut all = [0; 2 * FARTHEST + 1];
    let mut dx = 0;
    while dx < all.len() {
        let column = dx + STEP * PAD - FARTHEST;
        all[dx] = (column % STEP) * planes * COLUMNS + column / STEP;
        dx += 1;
    }
    all
}

/// The result of [`columns`] for a [`Stack`]; [`IN_SUMS`] is the result for a task's sums.
pub(super) const IN_STACK: [usize; 2 * FARTHEST + 1] = columns(PLANES);
pub(super) const IN_SUMS: [usize; 2 * FARTHEST + 1] = columns(8);

impl Stack {
    /// All planes of neighbouring pixels of a phase, one per lane. `index` locates the first pixel in plane 0.
    #[inline(always)]
    pub(super) fn at<S: Simd>(&self, index: usize) -> Pixels<'_> {
        Pixels(&self.values[index..][..(PLANES - 1) * COLUMNS + S::F32_LANES])
    }
}

/// The planes of pixels that lie [`STEP`] apart in a row, one per lane.
#[derive(Clone, Copy)]
pub(super) struct Pixels<'a>(&'a [f32]);

impl Pixels<'_> {
    /// The vector of plane `p`.
    #[inline(always)]
    pub(super) fn get<S: Simd>(self, p: usize) -> S::f32s {
        vectors::<S>(&self.0[p * COLUMNS..][..S::F32_LANES])[0]
    }
}
