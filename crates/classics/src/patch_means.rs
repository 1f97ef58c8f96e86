//! Means over windows, weighted by the similarity of patches, after the program of Rousselle et al. 2012.

use crate::wavelets::mirrored;
use dapple_core::parallel;

/// A plane with a margin that mirrors the image at its border.
pub(crate) struct Mirrored {
    values: Vec<f32>,
    stride: usize,
    margin: usize,
}

impl Mirrored {
    /// Creates a plane of these `values`, row by row, with a margin of this many pixels.
    pub(crate) fn new([width, height]: [usize; 2], margin: usize, values: &[f32]) -> Self {
        let within = |at: usize, length: usize| mirrored(at as i64 - margin as i64, length);
        let stride = width + 2 * margin;
        let columns: Vec<usize> = (0..stride).map(|x| within(x, width)).collect();
        let rows = (0..height + 2 * margin).map(|y| &values[within(y, height) * width..][..width]);
        Self { values: rows.flat_map(|row| columns.iter().map(|&x| row[x])).collect(), stride, margin }
    }

    /// The `width` pixels at the offset (dx, dy) from row `y`.
    #[inline]
    fn row(&self, y: usize, [dx, dy]: [isize; 2], width: usize) -> &[f32] {
        let y = (y + self.margin).wrapping_add_signed(dy);
        &self.values[y * self.stride + self.margin.wrapping_add_signed(dx)..][..width]
    }
}

/// The image by which pixels are compared: three channels and their variances.
pub(crate) struct PatchGuide {
    pub(crate) colour: [Mirrored; 3],
    pub(crate) variance: [Mirrored; 3],
}

/// The parameters by which patches are compared.
#[derive(Clone, Copy)]
pub(crate) struct Patches {
    /// Pixels searched to each side; the margin of the planes is at least as wide.
    pub(crate) window: usize,
    /// Pixels compared to each side.
    pub(crate) patch: usize,
    /// The number of standard deviations in which differences are measured.
    pub(crate) k: f32,
    /// The factor on the noise that is subtracted from squared differences.
    pub(crate) alpha: f32,
}

/// The weight below which a pixel is left out.
const CUT: f32 = 0.05;
/// The number added to the denominator to avoid a division by zero.
const TINY: f32 = 1e-10;
/// The number of rows per task.
const BAND: usize = 32;

/// The weighted means of `values` (N planes) over the window of each pixel. The last plane holds factors on the weights; its
/// result is the sum of all weights.
///
/// Opposite offsets are handled in pairs. If the mean of the two pixels is more similar than either pixel, both get the weight
/// of the mean. Weights are averaged over patches; weights below 0.05 become 0. The centre has weight 1.
pub(crate) fn patch_means<const N: usize>(
    size: [usize; 2],
    guide: &PatchGuide,
    values: &[Mirrored; N],
    like: Patches,
) -> Vec<[f32; N]> {
    let width = size[0];
    let mut sums = vec![[0.0; N]; size[0] * size[1]];
    parallel::chunks(&mut sums, width * BAND, |band, sums| {
        let rows = band * BAND..(band * BAND + BAND).min(size[1]);
        let mut task = Band::new(size, rows, like);
        for (y, sums) in task.rows.clone().zip(sums.chunks_exact_mut(width)) {
            add_row(values.each_ref().map(|plane| plane.row(y, [0, 0], width)), sums, |_| 1.0);
        }
        let reach = like.window as isize;
        for dy in -reach..=0 {
            for dx in -reach..=if dy == 0 { -1 } else { reach } {
                task.compare(guide, [dx, dy]);
                task.weigh();
                task.gather(values, [dx, dy], sums);
            }
        }
        for sum in sums {
            let weight = sum[N - 1];
            sum[..N - 1].iter_mut().for_each(|value| *value = if weight > 0.0 { *value / weight } else { 0.0 });
        }
    });
    sums
}

/// The buffers of a task, for the rows of a band and of the patches around it.
struct Band {
    size: [usize; 2],
    rows: std::ops::Range<usize>,
    like: Patches,
    /// The rows for which differences are computed.
    wide: std::ops::Range<usize>,
    /// The differences from the first pixel of a pair, from the second, and from their mean; later the weights of the two
    /// pixels.
    planes: [Vec<f32>; 3],
    scratch: Vec<f32>,
}

impl Band {
    fn new(size: [usize; 2], rows: std::ops::Range<usize>, like: Patches) -> Self {
        let wide = rows.start.saturating_sub(2 * like.patch)..(rows.end + 2 * like.patch).min(size[1]);
        let plane = || vec![0.0; wide.len() * size[0]];
        Self { size, rows, like, planes: std::array::from_fn(|_| plane()), scratch: plane(), wide }
    }

    /// Writes the differences of each pixel from the pixel at `offset`, from the opposite pixel, and from the mean of both.
    fn compare(&mut self, guide: &PatchGuide, offset: [isize; 2]) {
        let (width, opposite) = (self.size[0], offset.map(|d| -d));
        let Patches { k, alpha, .. } = self.like;
        let square = k * k;
        let [first, second, both] = &mut self.planes;
        for (r, y) in self.wide.clone().enumerate() {
            let at = r * width..(r + 1) * width;
            let (first, second, both) = (&mut first[at.clone()], &mut second[at.clone()], &mut both[at]);
            first.fill(0.0);
            second.fill(0.0);
            both.fill(0.0);
            for (u, v) in guide.colour.iter().zip(&guide.variance) {
                let [p, a, b] = [[0, 0], offset, opposite].map(|offset| u.row(y, offset, width));
                let [vp, va, vb] = [[0, 0], offset, opposite].map(|offset| v.row(y, offset, width));
                for x in 0..width {
                    let [ma, mb] = [va[x].min(vp[x]), vb[x].min(vp[x])];
                    let difference = |other: f32, least: f32, variance: f32| {
                        let d = p[x] - other;
                        (d * d - alpha * (vp[x] + least)) / (TINY + square * (vp[x] + variance))
                    };
                    first[x] += difference(a[x], ma, va[x]);
                    second[x] += difference(b[x], mb, vb[x]);
                    both[x] += difference(0.5 * (a[x] + b[x]), 0.25 * (ma + mb), 0.25 * (va[x] + vb[x]));
                }
            }
        }
    }

    /// Turns differences into weights, averaged over patches.
    fn weigh(&mut self) {
        for plane in 0..3 {
            self.average(plane);
        }
        let [first, second, both] = &mut self.planes;
        for ((first, second), both) in first.iter_mut().zip(second).zip(both) {
            let weight = |sum: f32| exp_minus((sum / 3.0).max(0.0));
            let (a, b, mean) = (weight(*first), weight(*second), weight(*both));
            let share = (mean / (a + b) - 1.0).clamp(0.0, 1.0);
            *first = a + share * (mean - a);
            *second = b + share * (mean - b);
        }
        for plane in 0..2 {
            self.average(plane);
        }
    }

    /// Averages a plane over patches, limited to the image and the computed rows.
    fn average(&mut self, plane: usize) {
        let (width, patch) = (self.size[0], self.like.patch);
        let plane = &mut self.planes[plane];
        for (row, sums) in plane.chunks_exact(width).zip(self.scratch.chunks_exact_mut(width)) {
            sums.copy_from_slice(row);
            for d in 1..=patch.min(width - 1) {
                sums[d..].iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
                sums.iter_mut().zip(&row[d..]).for_each(|(sum, value)| *sum += value);
            }
            // Away from the borders, a patch has all its columns.
            let share = 1.0 / (2 * patch + 1) as f32;
            for (x, sum) in sums.iter_mut().enumerate() {
                let is_inside = x >= patch && x + patch < width;
                *sum *= if is_inside { share } else { 1.0 / (x.min(patch) + (width - 1 - x).min(patch) + 1) as f32 };
            }
        }
        let rows = self.wide.len();
        for (r, sums) in plane.chunks_exact_mut(width).enumerate() {
            sums.fill(0.0);
            let near = r.saturating_sub(patch)..(r + patch + 1).min(rows);
            let share = 1.0 / near.len() as f32;
            for row in self.scratch[near.start * width..near.end * width].chunks_exact(width) {
                sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
            }
            sums.iter_mut().for_each(|sum| *sum *= share);
        }
    }

    /// Adds the pixels at `offset` and at the opposite offset, multiplied by their weights.
    fn gather<const N: usize>(&self, values: &[Mirrored; N], offset: [isize; 2], sums: &mut [[f32; N]]) {
        let (width, from) = (self.size[0], self.rows.start - self.wide.start);
        for (r, (y, sums)) in self.rows.clone().zip(sums.chunks_exact_mut(width)).enumerate() {
            for (plane, offset) in self.planes.iter().zip([offset, offset.map(|d| -d)]) {
                let weights = &plane[(from + r) * width..][..width];
                let kept = |x: usize| if weights[x] < CUT { 0.0 } else { weights[x] };
                add_row(values.each_ref().map(|plane| plane.row(y, offset, width)), sums, kept);
            }
        }
    }
}

/// Adds a row of N planes to the sums, multiplied by the weights and by the last plane.
#[inline]
fn add_row<const N: usize>(rows: [&[f32]; N], sums: &mut [[f32; N]], weight: impl Fn(usize) -> f32) {
    for (x, sum) in sums.iter_mut().enumerate() {
        let weight = weight(x) * rows[N - 1][x];
        for c in 0..N - 1 {
            sum[c] += weight * rows[c][x];
        }
        sum[N - 1] += weight;
    }
}

/// `exp(-x)` for `x >= 0`, bit-identical on every machine, with a relative error below 5e-6 up to 20. Beyond 80 the result
/// stays at about `exp(-80)`.
///
/// The power of two is added to the exponent's bits, and the rest is a Taylor polynomial.
#[inline]
fn exp_minus(x: f32) -> f32 {
    // 1.5 * 2^23. Added to a small number, it leaves the rounded number in the low bits of the sum.
    const ROUND: f32 = 12_582_912.0;
    let t = x.min(80.0) * -std::f32::consts::LOG2_E;
    let rounded = t + ROUND;
    let f = (t - (rounded - ROUND)) * std::f32::consts::LN_2;
    let power = 1.0 + f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f / 120.0))));
    f32::from_bits(power.to_bits().wrapping_add(rounded.to_bits() << 23))
}
