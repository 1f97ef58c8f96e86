//! Weights between pixels of a tile and the pixels around them, many at once.
//!
//! A tile's planes are copied with a margin, even and odd columns apart: what belongs to every second pixel then lies
//! side by side, and loops over it become vectors. Nothing here adds up over pixels in an order of the compiler's
//! choice, and nothing is fused, so that every machine gets the same bits.

use crate::planes::{Colours, Features, Inputs, Plane};

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
    fn differences(&self, here: [usize; 3], there: [usize; 3]) -> [f32; SPAN] {
        // Of its own, so that the compiler knows that it overlaps with nothing.
        let mut out = [0.0; SPAN];
        let [red, green, blue] = &self.colour;
        match &self.variance[..] {
            [r, g, b] => {
                for (colour, variance) in [(red, r), (green, g), (blue, b)] {
                    let (p, q) = (colour.span(here), colour.span(there));
                    let (vp, vq) = (variance.span(here), variance.span(there));
                    for i in 0..SPAN {
                        let d = p[i] - q[i];
                        out[i] += (d * d - (vp[i] + vp[i].min(vq[i]))) / (vp[i] + vq[i]) * (1.0 / 3.0);
                    }
                }
            }
            pooled => {
                let (pr, pg, pb) = (red.span(here), green.span(here), blue.span(here));
                let (qr, qg, qb) = (red.span(there), green.span(there), blue.span(there));
                let (vp, vq) = (pooled[0].span(here), pooled[0].span(there));
                for i in 0..SPAN {
                    let (r, g, b) = (pr[i] - qr[i], pg[i] - qg[i], pb[i] - qb[i]);
                    let square = r * r + g * g + b * b;
                    out[i] = (square - (vp[i] + vp[i].min(vq[i]))) / (vp[i] + vq[i]);
                }
            }
        }
        out
    }
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
    pub(crate) fn compare(&mut self, guide: &LocalGuide, rows: usize, radius: usize, offset: [isize; 2]) {
        for y in MARGIN - radius..MARGIN + rows + radius {
            for parity in 0..2 {
                let (other, shift) = moved(parity, offset[0]);
                // Patches reach three columns to the left: two even ones, or the odd one before as well.
                let start = MARGIN / 2 - 1 - parity;
                let there = [y.wrapping_add_signed(offset[1]), other, start.wrapping_add_signed(shift)];
                let differences = guide.differences([y, parity, start], there);
                self.pointwise[2 * y + parity][start..][..SPAN].copy_from_slice(&differences);
            }
        }
    }

    /// Sums the compared columns around row `y` of the tile: before [`Differences::patches`].
    #[inline(always)]
    pub(crate) fn sum_columns(&mut self, y: usize, radius: usize) {
        for parity in 0..2 {
            let sums = &mut self.column_sums[parity];
            let first = 2 * (y + MARGIN - radius) + parity;
            *sums = self.pointwise[first];
            for k in 1..=2 * radius {
                let row = &self.pointwise[first + 2 * k];
                for i in 0..COLUMNS {
                    sums[i] += row[i];
                }
            }
        }
    }

    /// The sums over patches around the row's pixels of `parity`.
    #[inline(always)]
    pub(crate) fn patches(&self, parity: usize, radius: usize) -> Row {
        let mut sums = [0.0; LANES];
        for k in -(radius as isize)..=radius as isize {
            let (other, shift) = moved(parity, k);
            let column: &Row = self.column_sums[other][(MARGIN / 2).wrapping_add_signed(shift)..][..LANES]
                .try_into()
                .expect("columns");
            for i in 0..LANES {
                sums[i] += column[i];
            }
        }
        sums
    }
}

impl Tile {
    /// The distances by features between pixels of `parity` in row `y` and those that lie `offset` from them: 0 where they
    /// are alike or there are no features.
    #[inline(always)]
    pub(crate) fn feature_distances(&self, y: usize, parity: usize, offset: [isize; 2]) -> Row {
        let mut most = [0.0; LANES];
        let Some(features) = &self.features else { return most };
        for (group, channels) in [(0, 0..3), (1, 3..6), (2, 6..7)] {
            let mut square = [0.0f32; LANES];
            for channel in channels {
                let p = features.mean[channel].moved(y, parity, [0, 0]);
                let q = features.mean[channel].moved(y, parity, offset);
                for i in 0..LANES {
                    let d = p[i] - q[i];
                    square[i] += d * d;
                }
            }
            let vp = features.variance[group].moved(y, parity, [0, 0]);
            let vq = features.variance[group].moved(y, parity, offset);
            let sharp = features.sharpness[group].moved(y, parity, [0, 0]);
            for i in 0..LANES {
                let distance: f32 = (square[i] - (vp[i] + vp[i].min(vq[i]))) * sharp[i];
                most[i] = distance.max(most[i]);
            }
        }
        most
    }

    /// The weights from distances: `patch` over `scale` squared deviations, and by features.
    #[inline(always)]
    pub(crate) fn weights(
        &self,
        patch: &Row,
        by_features: &Row,
        like: &Likeness,
        [y, parity]: [usize; 2],
        offset: [isize; 2],
    ) -> Row {
        let side = (2 * like.patch + 1) as f32;
        let share = 1.0 / (side * side * like.colour * like.colour);
        let mut weights = [0.0; LANES];
        for i in 0..LANES {
            weights[i] = exp_minus((patch[i] * share).max(0.0) + by_features[i]);
        }
        if let Some(labels) = &self.labels {
            let (p, q) = (labels.moved(y, parity, [0, 0]), labels.moved(y, parity, offset));
            for i in 0..LANES {
                weights[i] *= if p[i] == q[i] { 1.0 } else { like.outside };
            }
        }
        weights
    }
}

/// `exp(-x)` for `x >= 0` to 3e-6 relative, the same bits everywhere; below `exp(-80)` about that.
///
/// `2^f` by a polynomial of degree 5 for `f` in -1/2 .. 1/2 (its Taylor coefficients; the remainder is below 2.5e-6), the
/// whole part added to the exponent.
#[inline(always)]
pub(crate) fn exp_minus(x: f32) -> f32 {
    /// 1.5 * 2^23: adding it rounds to a whole number in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let t = x.min(80.0) * -std::f32::consts::LOG2_E;
    let rounded = t + ROUND;
    let f = (t - (rounded - ROUND)) * std::f32::consts::LN_2;
    let power = 1.0 + f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f * (1.0 / 120.0)))));
    f32::from_bits(power.to_bits().wrapping_add(rounded.to_bits() << 23))
}

/// What pixels with `there` samples count for those with `here`: more samples count more, but at most twice what as many
/// count. In proportion to samples, a leak across an edge would go with how unequal they are.
#[inline(always)]
pub(crate) fn count_weights(here: &Row, there: &Row) -> Row {
    let mut weights = [0.0; LANES];
    for i in 0..LANES {
        weights[i] = there[i] / (here[i] + there[i]).max(1.0);
    }
    weights
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
