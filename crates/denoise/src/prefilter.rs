//! Prefilter of the features (normal, albedo, depth, position). It removes most of the noise from lens blur, motion blur,
//! subpixel geometry, and surfaces that both reflect and refract.

use crate::averaging::{VANISHING, Window, average_where};
use crate::guide::Guide;
use crate::inputs::Inputs;
use crate::planes::{Colours, Plane, box_mean};
use crate::tile::{HEIGHT, Likeness, WIDTH};

/// The patches (3x3 pixels) and the bandwidth, chosen by measurements at 8 spp on nine scenes (`docs/results/race.md`).
/// Patches of 1 pixel do not help, 5x5 is no better than 3x3. Bandwidths 0.5 and 1 leave 2 and 4 % more error.
const LIKE: Likeness = Likeness { patch: 1, colour: 0.7, features: None, outside: 1.0 };
/// The window of 9x9 pixels, chosen by the same measurements: 7x7 leaves 1 % more error, 11x11 and 15x15 leave no less.
const WINDOW: Window = Window { radius: 4, disc: None, cut: VANISHING, falloff: 0.0 };
/// The variance of a mean normal, albedo or log depth up to which the feature counts as free of noise.
const QUIET: f32 = 1e-5;

/// Averages normal and albedo, then position and depth, over pixels whose patches differ by no more than their noise.
///
/// The weights come from the features themselves [after Rousselle 2013], but with the variance of each pixel's samples
/// instead of the variance between the halves. Tiles without noise keep their values.
///
/// The stored variances stay unchanged. Reduced variances would make features separate more pixels: at a quarter of the
/// variance, 3 % more error is left.
pub(crate) fn prefilter(inputs: &mut Inputs) {
    let [nx, ny, nz, r, g, b, depth] = std::mem::take(&mut inputs.features.mean);
    let [vn, va, vd] = &inputs.features.variance;
    let surface = [guide(inputs, [r, g, b], va, |_| QUIET), guide(inputs, [nx, ny, nz], vn, |_| QUIET)];
    let noisy = |[n, a]: [f32; 2]| n > QUIET || a > QUIET;
    let wanted = tiles_with(inputs.size, |i| noisy([vn[i], va[i]]));
    // Each value takes its weights from the other guide. Normals are the first value, so their guide is the second.
    let values = [&surface[1].colour, &surface[0].colour];
    let [[nx, ny, nz], [r, g, b]] = average_where(inputs, values, &surface, &LIKE, &WINDOW, &wanted);
    drop(surface);

    let position = std::mem::take(&mut inputs.features.position);
    let wanted = tiles_with(inputs.size, |i| vd[i] > QUIET);
    // Points closer than the width of a pixel count as one place.
    let width = |i: usize| (1.0 / (24.0 * inputs.features.scale[i])).clamp(1e-15, 1e15).powi(2);
    let places = [guide(inputs, position, &inputs.features.scatter, width)];
    let depths: Colours = [depth.clone(), depth.clone(), depth];
    let values = [&places[0].colour, &depths];
    let [[x, y, z], [depth, ..]] = average_where(inputs, values, &places, &LIKE, &WINDOW, &wanted);
    inputs.features.mean = [nx, ny, nz, r, g, b, depth];
    inputs.features.position = [x, y, z];
}

/// Makes a guide of features. Its variance is `floor` plus the mean of the pixel's own variance and the variance over
/// 3x3 pixels, since a few samples may be equal by chance.
fn guide(inputs: &Inputs, colour: Colours, variance: &Plane, floor: impl Fn(usize) -> f32) -> Guide {
    let near = box_mean(variance, inputs.size, 1);
    let pooled = |(i, (own, near)): (usize, (&f32, &f32))| 0.5 * (own + near) + floor(i);
    Guide { colour, variance: vec![variance.iter().zip(&near).enumerate().map(pooled).collect()] }
}

/// Returns a test for tiles: true for the origin of a tile if any of its pixels satisfies `is`.
fn tiles_with([width, height]: [usize; 2], is: impl Fn(usize) -> bool + Sync) -> impl Fn([usize; 2]) -> bool + Sync {
    move |[x, y]| {
        let row = |row: usize| (x..(x + WIDTH).min(width)).any(|x| is(row * width + x));
        (y..(y + HEIGHT).min(height)).any(row)
    }
}
