//! Weights between pixels of a tile and the pixels around them, many at once.
//!
//! A tile's planes are copied with a margin, even and odd columns apart: what belongs to every second pixel then lies
//! side by side, and loops over it become vectors. Nothing here adds up over pixels in an order of the compiler's
//! choice, and nothing is fused, so that every machine gets the same bits.

use crate::planes::{Colours, Features, Inputs, Plane};
use pulp::Simd;

/// Width of a tile in pixels.
pub(crate) const WIDTH: usize = 64;
/// Height of a tile in pixels.
pub(crate) const HEIGHT: usize = 16;
/// Pixels to each side from which windows (7) and the patches in them (3) read; even.
pub(crate) const MARGIN: usize = 10;
/// The largest radius of a window.
pub(crate) const REACH: usize = 7;
/// Columns of one parity in a tile's planes, rounded up to whole vectors.
pub(crate) const COLUMNS: usize = 48;
/// Rows of a tile's planes.
pub(crate) const ROWS: usize = HEIGHT + 2 * MARGIN;
/// Pixels of one parity in a row of a tile.
pub(crate) const LANES: usize = WIDTH / 2;
/// Columns of one parity for which differences are computed: `LANES` and what patches read beside them.
const SPAN: usize = 40;

/// One number for each of a row's pixels of one parity.
pub(crate) type Row = [f32; LANES];

/// One plane of a tile: rows of even columns, then odd ones.
#[derive(Clone, Default)]
pub(crate) struct Local(Vec<f32>);

impl Local {
    /// Copies the surroundings of the tile at `origin`; pixels beyond the frame are `outside`, or the border's if that is
    /// `None`.
    fn new(plane: &[f32], size: [usize; 2], origin: [usize; 2], outside: Option<f32>) -> Self {
        let [width, height] = size;
        let mut values = vec![0.0; ROWS * 2 * COLUMNS];
        let mut padded = [0.0; WIDTH + 2 * MARGIN];
        // Columns beyond the frame on the left, the first one in it, and how many are in it.
        let before = MARGIN.saturating_sub(origin[0]);
        let first = origin[0] + before - MARGIN;
        let within = (padded.len() - before).min(width - first);
        for (r, row) in values.chunks_exact_mut(2 * COLUMNS).enumerate() {
            let y = (origin[1] + r).saturating_sub(MARGIN).min(height - 1);
            let source = &plane[y * width..][..width];
            let (left, middle) = padded.split_at_mut(before);
            let (middle, right) = middle.split_at_mut(within);
            left.fill(outside.unwrap_or(source[0]));
            middle.copy_from_slice(&source[first..][..within]);
            right.fill(outside.unwrap_or(source[width - 1]));
            if let Some(value) = outside.filter(|_| y + MARGIN != origin[1] + r) {
                padded.fill(value);
            }
            let (even, odd) = row.split_at_mut(COLUMNS);
            for ((pair, even), odd) in padded.as_chunks::<2>().0.iter().zip(even).zip(odd) {
                [*even, *odd] = *pair;
            }
        }
        Self(values)
    }

    /// The columns of `parity` in row `y` of the margin's count.
    #[inline(always)]
    pub(crate) fn row(&self, y: usize, parity: usize) -> &[f32; COLUMNS] {
        let (chunks, _) = self.0.as_chunks::<COLUMNS>();
        &chunks[2 * y + parity]
    }

    /// `SPAN` columns of a row and a parity, from a column of that parity on.
    #[inline(always)]
    fn span(&self, [y, parity, start]: [usize; 3]) -> &[f32; SPAN] {
        self.row(y, parity)[start..][..SPAN].try_into().expect("a row long enough")
    }

    /// The pixels of the tile in row `y` whose columns are of `parity`, moved by (dx, dy).
    #[inline(always)]
    pub(crate) fn moved(&self, y: usize, parity: usize, [dx, dy]: [isize; 2]) -> &Row {
        let (parity, shift) = moved(parity, dx);
        let row = self.row((y + MARGIN).wrapping_add_signed(dy), parity);
        row[(MARGIN / 2).wrapping_add_signed(shift)..][..LANES].try_into().expect("a margin wide enough")
    }
}

/// The parity of a column moved by `dx`, and by how many columns of that parity it moves.
#[inline(always)]
fn moved(parity: usize, dx: isize) -> (usize, isize) {
    let column = parity as isize + dx;
    ((column & 1) as usize, column >> 1)
}

/// What pixels' likeness is judged by: a colour and its variance (the sum over the channels, or one each).
pub(crate) struct Guide {
    /// Colour.
    pub(crate) colour: Colours,
    /// One plane: channels are pooled. Three: each is judged by itself [after Rousselle 2012].
    pub(crate) variance: Vec<Plane>,
}

/// A tile's copy of a guide.
pub(crate) struct LocalGuide {
    colour: [Local; 3],
    variance: Vec<Local>,
}

/// A tile's copy of features.
pub(crate) struct LocalFeatures {
    mean: [Local; 7],
    variance: [Local; 3],
    /// One over the scale of squared differences of normal, albedo, depth.
    sharpness: [Local; 3],
}

/// Scales of squared feature differences below which they count for little, whatever their variance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FeatureScales {
    /// The bandwidth: differences are measured in this many standard deviations.
    pub(crate) bandwidth: f32,
    /// Floors under the variances of normal and albedo.
    pub(crate) floors: [f32; 2],
}

/// Which pixels a window compares, and how.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Likeness {
    /// Radius of the patches that are compared.
    pub(crate) patch: usize,
    /// Differences of colours are measured in this many standard deviations.
    pub(crate) colour: f32,
    /// The same of features; `None` for none.
    pub(crate) features: Option<FeatureScales>,
    /// The factor for pixels of another cluster.
    pub(crate) outside: f32,
}

/// One tile: where it is, and its copies of what weights are made of.
pub(crate) struct Tile {
    pub(crate) origin: [usize; 2],
    size: [usize; 2],
    features: Option<LocalFeatures>,
    labels: Option<Local>,
}

impl Tile {
    /// The tile at `origin`.
    pub(crate) fn new(inputs: &Inputs, origin: [usize; 2], like: &Likeness) -> Self {
        let size = inputs.size;
        let features = like.features.map(|scales| local_features(&inputs.features, &scales, size, origin));
        let labels = inputs.labels.as_ref().filter(|_| like.outside < 1.0);
        let labels = labels.map(|labels| Local::new(labels, size, origin, None));
        Self { origin, size, features, labels }
    }

    /// Whether the tile's pixel is one of the frame's.
    #[inline(always)]
    pub(crate) fn is_inside(&self, [x, y]: [usize; 2]) -> bool {
        self.origin[0] + x < self.size[0] && self.origin[1] + y < self.size[1]
    }

    /// Rows and, of either parity, columns of the tile that are in the frame; the latter rounded up.
    #[inline(always)]
    pub(crate) fn extent(&self) -> [usize; 2] {
        let [width, height] = [0, 1].map(|k| self.size[k] - self.origin[k]);
        [height.min(HEIGHT), width.div_ceil(2).min(LANES)]
    }

    /// A plane's copy; pixels beyond the frame are the border's.
    pub(crate) fn copy(&self, plane: &[f32]) -> Local {
        Local::new(plane, self.size, self.origin, None)
    }

    /// A plane's copy; pixels beyond the frame are 0.
    pub(crate) fn copy_or_zero(&self, plane: &[f32]) -> Local {
        Local::new(plane, self.size, self.origin, Some(0.0))
    }

    /// A guide's copy.
    pub(crate) fn guide(&self, guide: &Guide) -> LocalGuide {
        LocalGuide {
            colour: std::array::from_fn(|c| self.copy(&guide.colour[c])),
            variance: guide.variance.iter().map(|v| self.copy(v)).collect(),
        }
    }
}

fn local_features(features: &Features, scales: &FeatureScales, size: [usize; 2], origin: [usize; 2]) -> LocalFeatures {
    let copy = |plane: &Plane| Local::new(plane, size, origin, None);
    let variance = [0, 1, 2].map(|k| copy(&features.variance[k]));
    let slope = copy(&features.slope);
    let square = scales.bandwidth * scales.bandwidth;
    let sharpness = |k: usize| {
        let floor = |slope: f32| if k < 2 { scales.floors[k] } else { (3.0 * slope) * (3.0 * slope) + 1e-4 };
        let sharp = |(v, slope): (&f32, &f32)| 1.0 / (square * v.max(floor(*slope)));
        Local(variance[k].0.iter().zip(&slope.0).map(sharp).collect())
    };
    let sharpness = [0, 1, 2].map(sharpness);
    LocalFeatures { mean: std::array::from_fn(|k| copy(&features.mean[k])), variance, sharpness }
}

impl LocalGuide {
    /// Differences between `SPAN` columns and as many others, each from a row, a parity and a first column on: in units of
    /// their variance, what that alone makes of them taken off.
    #[inline(always)]
    fn differences<S: Simd>(&self, simd: S, here: [usize; 3], there: [usize; 3], out: &mut [f32; SPAN]) {
        let [red, green, blue] = &self.colour;
        let out = S::as_mut_simd_f32s(out).0;
        match &self.variance[..] {
            [r, g, b] => {
                let third = simd.splat_f32s(1.0 / 3.0);
                for (c, (colour, variance)) in [(red, r), (green, g), (blue, b)].into_iter().enumerate() {
                    let (p, q) = (vectors::<S>(colour.span(here)), vectors::<S>(colour.span(there)));
                    let (vp, vq) = (vectors::<S>(variance.span(here)), vectors::<S>(variance.span(there)));
                    for k in 0..SPAN / S::F32_LANES {
                        let d = simd.sub_f32s(p[k], q[k]);
                        let share = simd.mul_f32s(excess(simd, simd.mul_f32s(d, d), vp[k], vq[k]), third);
                        out[k] = if c == 0 { share } else { simd.add_f32s(out[k], share) };
                    }
                }
            }
            pooled => {
                let (pr, pg) = (vectors::<S>(red.span(here)), vectors::<S>(green.span(here)));
                let (qr, qg) = (vectors::<S>(red.span(there)), vectors::<S>(green.span(there)));
                let (pb, qb) = (vectors::<S>(blue.span(here)), vectors::<S>(blue.span(there)));
                let (vp, vq) = (vectors::<S>(pooled[0].span(here)), vectors::<S>(pooled[0].span(there)));
                for k in 0..SPAN / S::F32_LANES {
                    let (r, g) = (simd.sub_f32s(pr[k], qr[k]), simd.sub_f32s(pg[k], qg[k]));
                    let b = simd.sub_f32s(pb[k], qb[k]);
                    let square = simd.add_f32s(simd.mul_f32s(r, r), simd.mul_f32s(g, g));
                    out[k] = excess(simd, simd.add_f32s(square, simd.mul_f32s(b, b)), vp[k], vq[k]);
                }
            }
        }
    }
}

/// A row's vectors.
#[inline(always)]
pub(crate) fn vectors<S: Simd>(row: &[f32]) -> &[S::f32s] {
    S::as_simd_f32s(row).0
}

/// By how much a squared difference exceeds what the variances alone make of it, in units of these.
#[inline(always)]
fn excess<S: Simd>(simd: S, square: S::f32s, vp: S::f32s, vq: S::f32s) -> S::f32s {
    let expected = simd.add_f32s(vp, simd.min_f32s(vp, vq));
    simd.div_f32s(simd.sub_f32s(square, expected), simd.add_f32s(vp, vq))
}

/// Room for the differences of one guide at one offset, and their sums over patches.
pub(crate) struct Differences {
    pointwise: Vec<[f32; COLUMNS]>,
    column_sums: [[f32; COLUMNS]; 2],
}

impl Differences {
    pub(crate) fn new() -> Self {
        Self { pointwise: vec![[0.0; COLUMNS]; 2 * ROWS], column_sums: [[0.0; COLUMNS]; 2] }
    }

    /// Compares the tile's first `rows` rows and those that patches of `radius` reach with what lies `offset` from them.
    #[inline(always)]
    pub(crate) fn compare<S: Simd>(
        &mut self,
        simd: S,
        guide: &LocalGuide,
        rows: usize,
        radius: usize,
        offset: [isize; 2],
    ) {
        for y in MARGIN - radius..MARGIN + rows + radius {
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

    /// Sums the compared columns around row `y` of the tile: before [`Differences::patches`].
    #[inline(always)]
    pub(crate) fn sum_columns<S: Simd>(&mut self, simd: S, y: usize, radius: usize) {
        for parity in 0..2 {
            let first = 2 * (y + MARGIN - radius) + parity;
            let sums = S::as_mut_simd_f32s(&mut self.column_sums[parity]).0;
            sums.copy_from_slice(vectors::<S>(&self.pointwise[first]));
            for k in 1..=2 * radius {
                let row = vectors::<S>(&self.pointwise[first + 2 * k]);
                for i in 0..COLUMNS / S::F32_LANES {
                    sums[i] = simd.add_f32s(sums[i], row[i]);
                }
            }
        }
    }

    /// The sums over patches around the row's pixels of `parity`.
    #[inline(always)]
    pub(crate) fn patches<S: Simd>(&self, simd: S, parity: usize, radius: usize) -> Row {
        let mut row = [0.0; LANES];
        let sums = S::as_mut_simd_f32s(&mut row).0;
        for k in -(radius as isize)..=radius as isize {
            let (other, shift) = moved(parity, k);
            let column: &Row = self.column_sums[other][(MARGIN / 2).wrapping_add_signed(shift)..][..LANES]
                .try_into()
                .expect("columns");
            let column = vectors::<S>(column);
            for i in 0..LANES / S::F32_LANES {
                sums[i] = simd.add_f32s(sums[i], column[i]);
            }
        }
        row
    }
}

impl Tile {
    /// The distances by features between pixels of `parity` in row `y` and those that lie `offset` from them: 0 where they
    /// are alike or there are no features.
    #[inline(always)]
    pub(crate) fn feature_distances<S: Simd>(&self, simd: S, y: usize, parity: usize, offset: [isize; 2]) -> Row {
        let mut row = [0.0; LANES];
        let Some(features) = &self.features else { return row };
        let most = S::as_mut_simd_f32s(&mut row).0;
        for (group, channels) in [(0, 0..3), (1, 3..6), (2, 6..7)] {
            let mut squares = [0.0f32; LANES];
            let square = S::as_mut_simd_f32s(&mut squares).0;
            for channel in channels {
                let p = vectors::<S>(features.mean[channel].moved(y, parity, [0, 0]));
                let q = vectors::<S>(features.mean[channel].moved(y, parity, offset));
                for i in 0..LANES / S::F32_LANES {
                    let d = simd.sub_f32s(p[i], q[i]);
                    square[i] = simd.add_f32s(square[i], simd.mul_f32s(d, d));
                }
            }
            let vp = vectors::<S>(features.variance[group].moved(y, parity, [0, 0]));
            let vq = vectors::<S>(features.variance[group].moved(y, parity, offset));
            let sharp = vectors::<S>(features.sharpness[group].moved(y, parity, [0, 0]));
            for i in 0..LANES / S::F32_LANES {
                let expected = simd.add_f32s(vp[i], simd.min_f32s(vp[i], vq[i]));
                let distance = simd.mul_f32s(simd.sub_f32s(square[i], expected), sharp[i]);
                most[i] = simd.max_f32s(distance, most[i]);
            }
        }
        row
    }

    /// The weights from distances: `patch` over `scale` squared deviations, and by features.
    #[inline(always)]
    pub(crate) fn weights<S: Simd>(
        &self,
        simd: S,
        patch: &Row,
        by_features: &Row,
        like: &Likeness,
        [y, parity]: [usize; 2],
        offset: [isize; 2],
    ) -> Row {
        let side = (2 * like.patch + 1) as f32;
        let share = simd.splat_f32s(1.0 / (side * side * like.colour * like.colour));
        let zero = simd.splat_f32s(0.0);
        let mut row = [0.0; LANES];
        let weights = S::as_mut_simd_f32s(&mut row).0;
        let (patch, by_features) = (vectors::<S>(patch), vectors::<S>(by_features));
        for i in 0..LANES / S::F32_LANES {
            let by_colour = simd.max_f32s(simd.mul_f32s(patch[i], share), zero);
            weights[i] = exp_minus_all(simd, simd.add_f32s(by_colour, by_features[i]));
        }
        if let Some(labels) = &self.labels {
            let p = vectors::<S>(labels.moved(y, parity, [0, 0]));
            let q = vectors::<S>(labels.moved(y, parity, offset));
            let (one, outside) = (simd.splat_f32s(1.0), simd.splat_f32s(like.outside));
            for i in 0..LANES / S::F32_LANES {
                let factor = simd.select_f32s(simd.equal_f32s(p[i], q[i]), one, outside);
                weights[i] = simd.mul_f32s(weights[i], factor);
            }
        }
        row
    }
}

/// [`exp_minus`] of several.
#[inline(always)]
fn exp_minus_all<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
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

/// 1.5 * 2^23: adding it rounds to a whole number in the low bits.
const ROUND: f32 = 12_582_912.0;

/// Taylor coefficients of the exponential function, from the fifth down to the second.
const EXPONENTIAL: [f32; 4] = [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5];

/// `exp(-x)` for `x >= 0` to 3e-6 relative, the same bits everywhere; below `exp(-80)` about that.
///
/// `2^f` by a polynomial of degree 5 for `f` in -1/2 .. 1/2 (its Taylor coefficients; the remainder is below 2.5e-6), the
/// whole part added to the exponent.
#[inline(always)]
pub(crate) fn exp_minus(x: f32) -> f32 {
    let [fifth, fourth, third, second] = EXPONENTIAL;
    let t = x.min(80.0) * -std::f32::consts::LOG2_E;
    let rounded = t + ROUND;
    let f = (t - (rounded - ROUND)) * std::f32::consts::LN_2;
    let power = 1.0 + f * (1.0 + f * (second + f * (third + f * (fourth + f * fifth))));
    f32::from_bits(power.to_bits().wrapping_add(rounded.to_bits() << 23))
}

/// What pixels with `there` samples count for those with `here`: more samples count more, but at most twice what as many
/// count. In proportion to samples, a leak across an edge would go with how unequal they are.
#[inline(always)]
pub(crate) fn count_weights<S: Simd>(simd: S, here: S::f32s, there: S::f32s) -> S::f32s {
    simd.div_f32s(there, simd.max_f32s(simd.add_f32s(here, there), simd.splat_f32s(1.0)))
}

/// The corners of all tiles of a frame, row by row.
pub(crate) fn origins([width, height]: [usize; 2]) -> Vec<[usize; 2]> {
    let rows = (0..height).step_by(HEIGHT);
    rows.flat_map(|y| (0..width).step_by(WIDTH).map(move |x| [x, y])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_exponentials() {
        for k in 0..80_000 {
            let x = k as f32 * 1e-3;
            let (got, wanted) = (f64::from(exp_minus(x)), (-f64::from(x)).exp());
            // Rounding x * log2 e costs another x * 6e-8.
            assert!((got / wanted - 1.0).abs() < 4e-6 + 2e-7 * f64::from(x), "{x}: {got}, not {wanted}");
        }
        assert_eq!(exp_minus(0.0), 1.0);
        assert!(exp_minus(f32::INFINITY) < 1e-34 && exp_minus(1e9) > 0.0);
    }

    #[test]
    fn moved_rows_are_where_they_should_be() {
        let size = [150, 40];
        let plane: Plane = (0..6000).map(|i| i as f32).collect();
        let tile = Local::new(&plane, size, [64, 16], None);
        for (y, parity, dx, dy) in [(0, 0, 0, 0), (3, 1, -7, 7), (15, 0, -7, -7), (8, 1, 7, 0), (8, 0, 6, 1)] {
            let row = tile.moved(y, parity, [dx, dy]);
            for (i, value) in row.iter().enumerate() {
                let x = (64 + 2 * i as isize + parity as isize + dx).clamp(0, 149);
                let y = (16 + y as isize + dy).clamp(0, 39);
                assert_eq!(*value, (y * 150 + x) as f32);
            }
        }
    }
}
