//! Prefilter of the first-hit features. It removes most of the noise of lens, shutter and subpixel geometry.

use crate::averaging::{VANISHING, Window, average_where};
use crate::planes::{Colours, Inputs, Plane, box_mean};
use crate::tile::{Guide, HEIGHT, Likeness, WIDTH};

/// Patches and bandwidths, measured at 8 spp on nine scenes (`docs/results/race.md`). Patches of 1 pixel do not help,
/// 5x5 is no better than 3x3. Bandwidths 0.5 and 1 leave 2 and 4 % more error.
const LIKE: Likeness = Likeness { patch: 1, colour: 0.7, features: None, outside: 1.0 };
/// The window, measured like [`LIKE`]: 7x7 leaves 1 % more error, 11x11 and 15x15 no less.
const WINDOW: Window = Window { radius: 4, cut: VANISHING, falloff: 0.0 };
/// Variances of the mean normal, albedo and log depth below this are not noise.
const QUIET: f32 = 1e-5;

/// Averages normal and albedo, then position and depth, over pixels whose patches differ by no more than their
/// variance.
///
/// The features are filtered by themselves, after [Rousselle 2013], but with the pixels' own variance instead of the
/// halves'.
/// Tiles without noise keep their values.
///
/// The stored variances stay unchanged. Reduced variances would make features separate more pixels, which is worse (by
/// 3 % for a quarter).
pub(crate) fn prefilter(inputs: &mut Inputs) {
    let [nx, ny, nz, r, g, b, depth] = std::mem::take(&mut inputs.features.mean);
    let [vn, va, vd] = &inputs.features.variance;
    let surface = [guide(inputs, [r, g, b], va, |_| QUIET), guide(inputs, [nx, ny, nz], vn, |_| QUIET)];
    let noisy = |[n, a]: [f32; 2]| n > QUIET || a > QUIET;
    let wanted = tiles_with(inputs.size, |i| noisy([vn[i], va[i]]));
    // The other half's guide judges a half. Normals are the first value, so the second guide judges them.
    let values = [&surface[1].colour, &surface[0].colour];
    let [[nx, ny, nz], [r, g, b]] = average_where(inputs, values, &surface, &LIKE, &WINDOW, &wanted);
    drop(surface);

    let position = std::mem::take(&mut inputs.features.position);
    let wanted = tiles_with(inputs.size, |i| vd[i] > QUIET);
    // Points closer than the width of a pixel count as one place.
    let width = |i: usize| (1.0 / (24.0 * inputs.features.scale[i])).clamp(1e-15, 1e15).powi(2);
    let place = [guide(inputs, position, &inputs.features.scatter, width)];
    let depths: Colours = [depth.clone(), depth.clone(), depth];
    let values = [&place[0].colour, &depths];
    let [position, [depth, ..]] = average_where(inputs, values, &place, &LIKE, &WINDOW, &wanted);
    inputs.features.position = position;
    inputs.features.mean = [nx, ny, nz, r, g, b, depth];
}

/// Features with a floored variance: the mean of the pixel's own and that of 3x3 pixels, since few samples may see
/// none.
fn guide(inputs: &Inputs, colour: Colours, variance: &Plane, floor: impl Fn(usize) -> f32) -> Guide {
    let near = box_mean(variance, inputs.size, 1);
    let pooled = |(i, (own, near)): (usize, (&f32, &f32))| 0.5 * (own + near) + floor(i);
    Guide { colour, variance: vec![variance.iter().zip(&near).enumerate().map(pooled).collect()] }
}

/// A test of a tile, by its origin: true if any of its pixels satisfies `is`.
fn tiles_with([width, height]: [usize; 2], is: impl Fn(usize) -> bool + Sync) -> impl Fn([usize; 2]) -> bool + Sync {
    move |[x, y]| {
        let row = |row: usize| (x..(x + WIDTH).min(width)).any(|x| is(row * width + x));
        (y..(y + HEIGHT).min(height)).any(row)
    }
}
