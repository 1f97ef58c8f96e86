//! Sums over cells of pixels, and a wide blur of these sums.

use crate::planes::per_pixel;

/// The side of a cell in pixels.
pub(crate) const CELL: usize = 8;
/// The radius in cells of each of three box filters, which blur with a standard deviation of 84 pixels. With 20 pixels, a room
/// lit through a gap has 1.1 times the error, due to the noise of the samples' mean.
const RADIUS: isize = 10;
/// The number of pixels that share the light of one pixel: the area of the blur.
pub(crate) const PIXELS: f64 = 44_000.0;

/// Blurs `cells` by three box filters of [`RADIUS`] cells along both axes. Beyond the frame, cells are mirrored.
pub(crate) fn blurred(cells: Vec<f64>, [width, height]: [usize; 2]) -> Vec<f64> {
    let mirrored = |k: isize, n: usize| {
        let k = k.rem_euclid(2 * n as isize) as usize;
        k.min(2 * n - 1 - k)
    };
    let mut from = cells;
    for is_row in [true, true, true, false, false, false] {
        from = per_pixel(from.len(), |i| {
            let (x, y) = (i % width, i / width);
            let at = |k: isize| match is_row {
                true => from[y * width + mirrored(x as isize + k, width)],
                false => from[mirrored(y as isize + k, height) * width + x],
            };
            (-RADIUS..=RADIUS).map(at).sum::<f64>() / (2 * RADIUS + 1) as f64
        });
    }
    from
}
