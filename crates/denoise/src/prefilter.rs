//! First-hit features without most of the noise that lens, shutter and geometry finer than pixels leave in them.

use crate::averaging::{VANISHING, Window, average_where};
use crate::planes::{Colours, Inputs, Plane, box_mean};
use crate::tile::{Guide, HEIGHT, Likeness, WIDTH};

/// Measured on nine scenes at 8 spp (`docs/results/beyond.md`): patches of one pixel are of no use, of 5x5 no better; bandwidths .5
/// and 1 leave 2 and 4 % more error.
const LIKE: Likeness = Likeness { patch: 1, colour: 0.7, features: None, outside: 1.0 };
/// As above: 7x7 leaves 1 % more error, 11x11 and 15x15 no less.
const WINDOW: Window = Window { radius: 4, cut: VANISHING, falloff: 0.0 };
/// Variances of the means of normal, albedo and logarithm of depth below this are no noise.
const QUIET: f32 = 1e-5;

/// Averages normal and albedo, position and depth where patches of them are alike but for their variance: each by itself, after
/// the features of [Rousselle 2013], with the pixels' own variance instead of halves'. Tiles without noise keep what they have.
///
/// Variances stay what they were: reduced to what is left of them, they would have features tell more pixels apart, which
/// measured worse (by 3 % for a quarter).
pub(crate) fn prefilter(inputs: &mut Inputs) {
    let [nx, ny, nz, r, g, b, depth] = std::mem::take(&mut inputs.features.mean);
    let [vn, va, vd] = &inputs.features.variance;
    let surface = [guide(inputs, [r, g, b], va, |_| QUIET), guide(inputs, [nx, ny, nz], vn, |_| QUIET)];
    let noisy = |[n, a]: [f32; 2]| n > QUIET || a > QUIET;
    let wanted = tiles_with(inputs.size, |i| noisy([vn[i], va[i]]));
    // A half is judged by the other's guide: normals, which are given first, by the second.
    let values = [&surface[1].colour, &surface[0].colour];
    let [[nx, ny, nz], [r, g, b]] = average_where(inputs, values, &surface, &LIKE, &WINDOW, &wanted);
    drop(surface);

    let position = std::mem::take(&mut inputs.features.position);
    let wanted = tiles_with(inputs.size, |i| vd[i] > QUIET);
    // Nearer than a pixel is wide is the same place.
    let width = |i: usize| (1.0 / (24.0 * inputs.features.scale[i])).clamp(1e-15, 1e15).powi(2);
    let place = [guide(inputs, position, &inputs.features.scatter, width)];
    let depths: Colours = [depth.clone(), depth.clone(), depth];
    let values = [&place[0].colour, &depths];
    let [position, [depth, ..]] = average_where(inputs, values, &place, &LIKE, &WINDOW, &wanted);
    inputs.features.position = position;
    inputs.features.mean = [nx, ny, nz, r, g, b, depth];
}

/// Features judged by their own variance, half of it that of 3x3 pixels (few samples may see none), and a floor.
fn guide(inputs: &Inputs, colour: Colours, variance: &Plane, floor: impl Fn(usize) -> f32) -> Guide {
    let near = box_mean(variance, inputs.size, 1);
    let pooled = |(i, (own, near)): (usize, (&f32, &f32))| 0.5 * (own + near) + floor(i);
    Guide { colour, variance: vec![variance.iter().zip(&near).enumerate().map(pooled).collect()] }
}

/// Whether the tile at an origin has a pixel that is so.
fn tiles_with([width, height]: [usize; 2], is: impl Fn(usize) -> bool + Sync) -> impl Fn([usize; 2]) -> bool + Sync {
    move |[x, y]| {
        let row = |row: usize| (x..(x + WIDTH).min(width)).any(|x| is(row * width + x));
        (y..(y + HEIGHT).min(height)).any(row)
    }
}
