//! Outliers: bright colours that one half of the samples has and the other lacks, spread over the surface around them.
//!
//! A filter whose windows follow colours keeps such a pixel, or leaves a halo around it. So the part of the colour that
//! exceeds its surroundings is taken out before filtering. Afterwards it is added again to up to some 2,000 pixels of
//! the same surface. The sum over the image stays.

use crate::inputs::Inputs;
use crate::planes::{Colours, Pair, Plane, box_mean, dispatch, first_share, found, map_to_one, parts, raised};
use crate::tile::exp_minus;
use dapple_core::parallel;
use pulp::{Simd, WithSimd};

/// The radius over which surroundings are averaged, in pixels.
const NEAR: usize = 3;
/// The largest radius of the window over which an outlier is spread, in pixels.
const REACH: usize = 40;
/// The width of such a window in pixels.
const SIDE: usize = 2 * REACH + 1;
/// The least and the largest standard deviation of the spread, in pixels.
const WIDTHS: [f32; 2] = [8.0, 18.0];
/// The squared standard deviation for an outlier that exceeds its limit by as much as its surroundings.
const AREA: f32 = 80.0;
/// The brightness below which nothing is an outlier, in units of the image's level.
const DARK: f32 = 1e-3;

/// The part of a pixel's colour in one half that exceeds its surroundings, times the half's share in the pixel's
/// samples.
pub(crate) struct Outlier {
    pixel: usize,
    half: usize,
    /// The light in excess; once it is shared out, its light per weight.
    excess: [f32; 3],
    /// The standard deviation of its spread in pixels.
    width: f32,
}

impl Outlier {
    /// The radius of its window in pixels.
    fn reach(&self) -> usize {
        (2.2 * self.width).ceil() as usize
    }
}

/// Takes outliers out of both halves. Their light is per weight, such that the weights' sum over the window gives the outlier: in
/// the units of its half, or of both halves together. [`spread`] or [`spread_halves`] returns it to the filtered image.
///
/// A pixel of one half is an outlier if it exceeds `ratio` times each of these: the other half in 3x3 pixels, and
/// both halves' means over 7x7 pixels, without the pixel itself.
pub(crate) fn take(inputs: &mut Inputs, ratio: f32, is_of_half: bool) -> Vec<Outlier> {
    let mut found = find(inputs, ratio);
    for outlier in &mut found {
        let share = share(inputs, outlier.half, outlier.pixel);
        let excess = outlier.excess.map(|excess| excess / share);
        for (plane, excess) in inputs.halves[outlier.half].colour.iter_mut().zip(excess) {
            plane[outlier.pixel] -= excess;
        }
        if is_of_half {
            outlier.excess = excess;
        }
    }
    let inputs = &*inputs;
    parallel::parts(found.iter_mut(), |_, outlier| outlier.excess = dispatch(WindowTask { inputs, outlier }));
    found
}

/// The memory of [`spread_halves`] per pixel beyond [`BYTES_PER_PIXEL`]: a second list and the light of the other half.
pub(crate) const BYTES_OF_HALVES: usize = size_of::<Outlier>().div_ceil(3) + 12;

/// The memory of [`take`] and [`spread`] per pixel in bytes at most. At most a third of all pixels exceed 6 times the mean around
/// them.
pub(crate) const BYTES_PER_PIXEL: usize = (size_of::<Outlier>() + size_of::<[f32; 3]>()).div_ceil(3) + 2 * 12;

/// The share of a half in the samples of pixel `i`.
fn share(inputs: &Inputs, half: usize, i: usize) -> f32 {
    let first = first_share(inputs.counts().map(|count| count[i]));
    if half == 0 { first } else { 1.0 - first }
}

fn find(inputs: &Inputs, ratio: f32) -> Vec<Outlier> {
    let [width, height] = inputs.size;
    let grey: [Plane; 2] = [0, 1].map(|h: usize| {
        let [r, g, b] = &inputs.halves[h].colour;
        map_to_one([r, g, b], |[r, g, b]| (r + g + b) / 3.0)
    });
    let near = [0, 1].map(|h: usize| box_mean(&grey[h], inputs.size, NEAR));
    let pixels = ((2 * NEAR + 1) * (2 * NEAR + 1)) as f32;
    // The number of times that a mean counts its own pixel: the border repeats beyond the frame.
    let times = |x: usize, end: usize| 1 + NEAR * (usize::from(x == 0) + usize::from(x + 1 == end));
    let of = |i: usize| -> Option<Outlier> {
        let half = usize::from(grey[1][i] > grey[0][i]);
        let own = grey[half][i];
        let (x, y) = (i % width, i / width);
        let repeated = (times(x, width) * times(y, height)) as f32;
        let without = (pixels * near[half][i] - repeated * own) / (pixels - repeated).max(1.0);
        let mut around = without.max(near[1 - half][i]).max(DARK);
        if own <= ratio * around || inputs.halves.iter().any(|half| half.count[i] == 0.0) {
            return None;
        }
        for row in y.saturating_sub(1)..(y + 2).min(height) {
            let other = &grey[1 - half][row * width..][x.saturating_sub(1)..(x + 2).min(width)];
            around = other.iter().copied().fold(around, f32::max);
        }
        let part = (1.0 - ratio * around / own) * share(inputs, half, i);
        let excess = std::array::from_fn(|c| part * inputs.halves[half].colour[c][i]);
        let width = (AREA * (own / around - ratio).max(0.0)).sqrt().clamp(WIDTHS[0], WIDTHS[1]);
        (part > 0.0).then_some(Outlier { pixel: i, half, excess, width })
    };
    found(inputs.pixels(), of)
}

/// The light of outliers of each half by itself, spread.
pub(crate) fn spread_halves(inputs: &Inputs, found: Vec<Outlier>) -> Pair {
    let (first, second): (Vec<_>, Vec<_>) = found.into_iter().partition(|found| found.half == 0);
    let [[ra, ga, ba], [rb, gb, bb]] = [first, second].map(|found| spread(inputs, &found));
    Pair([ra, ga, ba, rb, gb, bb])
}

/// Spreads each outlier over the pixels around it, in proportion to their likeness and albedo.
pub(crate) fn spread(inputs: &Inputs, found: &[Outlier]) -> Colours {
    let width = inputs.size[0];
    let row = |(): &mut (), y: usize, sums: [&mut [f32]; 3]| {
        let from = found.partition_point(|outlier| outlier.pixel / width + REACH < y);
        let to = found.partition_point(|outlier| outlier.pixel / width <= y + REACH);
        dispatch(RowTask { inputs, found: &found[from..to], y, sums });
    };
    parts(inputs.pixels(), width, || (), row)
}

/// The task of summing the weights in an outlier's window. Its result is the outlier's light per weight.
struct WindowTask<'a> {
    inputs: &'a Inputs,
    outlier: &'a Outlier,
}

impl WithSimd for WindowTask<'_> {
    type Output = [f32; 3];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [f32; 3] {
        let Self { inputs, outlier } = self;
        let (y, reach) = (outlier.pixel / inputs.size[0], outlier.reach());
        // Lane by lane, so that the order of the sums is that of no machine.
        let mut sums = [[0.0; LANES]; 3];
        let mut like = [0.0; SIDE];
        for row in y.saturating_sub(reach)..(y + reach + 1).min(inputs.size[1]) {
            let window = Row::new(inputs, outlier, row);
            window.likeness(&mut like);
            for (sums, albedo) in sums.iter_mut().zip(window.albedo) {
                add_lanes(sums, &like[..window.len], albedo);
            }
        }
        let mut light = outlier.excess;
        for (light, sums) in light.iter_mut().zip(&sums) {
            *light /= sums.iter().fold(0.0, |sum, lane| sum + lane);
        }
        light
    }
}

/// The number of sums that a window's pixels are added to in turns: the lanes of the widest vectors.
const LANES: usize = 16;

/// Adds the products of weights and raised albedos to `LANES` sums in turns.
#[inline(always)]
fn add_lanes(sums: &mut [f32; LANES], like: &[f32], albedo: &[f32]) {
    let ((like, rest), (albedo, albedo_rest)) = (like.as_chunks::<LANES>(), albedo.as_chunks::<LANES>());
    for (like, albedo) in like.iter().zip(albedo) {
        for k in 0..LANES {
            sums[k] += like[k] * raised(albedo[k]);
        }
    }
    for (k, (like, albedo)) in rest.iter().zip(albedo_rest).enumerate() {
        sums[k] += like * raised(*albedo);
    }
}

/// The task of adding the light of outliers to a row of pixels.
struct RowTask<'a> {
    inputs: &'a Inputs,
    found: &'a [Outlier],
    y: usize,
    sums: [&'a mut [f32]; 3],
}

impl WithSimd for RowTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { inputs, found, y, mut sums } = self;
        let width = inputs.size[0];
        let mut like = [0.0; SIDE];
        for outlier in found {
            if (outlier.pixel / width).abs_diff(y) > outlier.reach() {
                continue;
            }
            let window = Row::new(inputs, outlier, y);
            window.likeness(&mut like);
            for (c, sums) in sums.iter_mut().enumerate() {
                let sums = &mut sums[window.column..][..window.len];
                let (like, albedo) = (&like[..window.len], &window.albedo[c][..window.len]);
                for k in 0..window.len {
                    sums[k] += outlier.excess[c] * like[k] * raised(albedo[k]);
                }
            }
        }
    }
}

/// A row of pixels in the window of an outlier.
struct Row<'a> {
    /// The column of the first pixel, and the number of pixels.
    column: usize,
    len: usize,
    /// The planes of normals (3) and positions (3).
    planes: [&'a [f32]; 6],
    albedo: [&'a [f32]; 3],
    /// The normal and the position of the outlier.
    own: [f32; 6],
    /// The offset of the first pixel from the outlier.
    from: [f32; 2],
    /// The reciprocal of the width of 24 pixels at the outlier.
    scale: f32,
    /// The factor on the squared distance in pixels.
    narrow: f32,
}

impl<'a> Row<'a> {
    /// The pixels of row `y` in an outlier's window.
    #[inline(always)]
    fn new(inputs: &'a Inputs, outlier: &Outlier, y: usize) -> Self {
        let (width, at) = (inputs.size[0], outlier.pixel);
        let (x, down) = (at % width, y.abs_diff(at / width));
        // The window is a disc.
        let reach = (outlier.reach().pow(2) - down.pow(2)).isqrt();
        let column = x.saturating_sub(reach);
        let (first, len) = (y * width + column, (x + reach + 1).min(width) - column);
        let features = &inputs.features;
        let [nx, ny, nz, r, g, b, _] = &features.mean;
        let [px, py, pz] = &features.position;
        let all = [nx, ny, nz, px, py, pz];
        Self {
            column,
            len,
            planes: all.map(|plane| &plane[first..][..len]),
            albedo: [r, g, b].map(|plane| &plane[first..][..len]),
            own: all.map(|plane| plane[at]),
            from: [column as f32 - x as f32, (at / width) as f32 - y as f32],
            scale: features.scale[at],
            narrow: 1.0 / (2.0 * outlier.width * outlier.width),
        }
    }

    /// Computes the likeness of the pixels to the outlier.
    ///
    /// It falls with the distance in pixels and in space, with the distance from the plane of the surface, and with the
    /// angle between the normals. The pixel itself has 1.
    ///
    /// A plain loop, which the compiler turns into vectors of the machine: no sum goes over pixels.
    #[inline(always)]
    fn likeness(&self, like: &mut [f32; SIDE]) {
        let Self { planes: [nx, ny, nz, px, py, pz], own: n, from, scale, .. } = self;
        let len = self.len.min(SIDE);
        let (nx, ny, nz, px, py, pz) = (&nx[..len], &ny[..len], &nz[..len], &px[..len], &py[..len], &pz[..len]);
        for k in 0..len {
            let across = from[0] + COLUMNS[k];
            let [x, y, z] = [nx[k] - n[0], ny[k] - n[1], nz[k] - n[2]];
            let turned = x * x + y * y + z * z;
            let apart = [px[k] - n[3], py[k] - n[4], pz[k] - n[5]];
            let [u, v, w] = [bounded(apart[0] * scale), bounded(apart[1] * scale), bounded(apart[2] * scale)];
            let off = n[0] * u + n[1] * v + n[2] * w;
            let far = u * u + v * v + w * w;
            let distance = (across * across + from[1] * from[1]) * self.narrow;
            like[k] = exp_minus(distance + 10.0 * turned + 64.0 * off * off + 0.5 * far);
        }
    }
}

/// A distance of at most 64 times the width of 24 pixels.
#[inline(always)]
fn bounded(distance: f32) -> f32 {
    distance.clamp(-64.0, 64.0)
}

/// 0, 1, 2 and so on: integers of this type are not converted in vectors.
const COLUMNS: [f32; SIDE] = {
    let mut all = [0.0; SIDE];
    let mut k = 0;
    while k < SIDE {
        all[k] = k as f32;
        k += 1;
    }
    all
};
