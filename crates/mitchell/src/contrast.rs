//! The contrast of a pixel's or a window's samples.

/// The contrast per channel of samples between `min` and `max`: `(max - min) / (max + min)`, in `[0, 1]` [after
/// Mitchell 1987].
///
/// Contrast does not change if all samples are multiplied by the same number. Without any light it is 0, not 0/0. A
/// bound that is negative or not finite counts as 0, as rejected samples do in a film.
///
/// ```
/// // {0.2, 0.2, 0.2, 0.8}, {0.5, 0.6} and nothing at all.
/// let [r, g, b] = dapple_mitchell::contrast([[0.2, 0.5, 0.0], [0.8, 0.6, 0.0]]);
/// assert!((r - 0.6).abs() < 1e-6 && (g - 1.0 / 11.0).abs() < 1e-6 && b == 0.0);
/// ```
pub fn contrast([min, max]: [[f32; 3]; 2]) -> [f64; 3] {
    let radiance = |v: f32| if v > 0.0 && v < f32::INFINITY { f64::from(v) } else { 0.0 };
    std::array::from_fn(|c| {
        let (a, b) = (radiance(min[c]), radiance(max[c]));
        if a + b > 0.0 { (b - a).abs() / (a + b) } else { 0.0 }
    })
}

/// The largest deviation of a sample from the mean, relative to the mean: `max_i |Y_i - mean| / mean` [pbrt-v2,
/// `src/samplers/adaptive.cpp`]. The smallest and the largest sample suffice, because no sample between them deviates
/// more.
///
/// The result is 0 if all samples are equal, or if the mean is 0 or NaN. (pbrt-v2 divides by a mean of 0 and compares
/// with NaN, so it does not refine either.)
///
/// ```
/// // {1, 1, 1, 1.9}
/// assert!((dapple_mitchell::deviation([1.0, 1.9], 1.225) - 0.551).abs() < 1e-3);
/// ```
pub fn deviation([min, max]: [f32; 2], mean: f64) -> f64 {
    let (min, max) = (f64::from(min), f64::from(max));
    let usable = mean > 0.0 && mean.is_finite() && min.is_finite() && max.is_finite();
    if usable && min < max { (max - mean).max(mean - min).max(0.0) / mean } else { 0.0 }
}

/// The range of an empty set of samples, `[min, max]` per channel: every other range contains it.
pub(crate) const NOTHING: [[f32; 3]; 2] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// Returns, for each pixel, the smallest and largest values over the window around it. The window is `2 radius + 1`
/// pixels wide and high, cut off at the borders.
pub(crate) fn windowed(ranges: &[[[f32; 3]; 2]], [width, height]: [u32; 2], radius: u32) -> Vec<[[f32; 3]; 2]> {
    let [w, h, radius] = [width, height, radius].map(|n| n as usize);
    let across = |i: usize| {
        let (row, x) = (i / w * w, i % w);
        &ranges[row + x.saturating_sub(radius)..row + (x + radius + 1).min(w)]
    };
    let rows: Vec<_> = (0..ranges.len()).map(|i| across(i).iter().fold(NOTHING, join)).collect();
    let down = |i: usize| {
        let (y, x) = (i / w, i % w);
        (y.saturating_sub(radius)..(y + radius + 1).min(h)).map(move |y| y * w + x)
    };
    (0..ranges.len()).map(|i| down(i).fold(NOTHING, |all, k| join(all, &rows[k]))).collect()
}

fn join([min, max]: [[f32; 3]; 2], other: &[[f32; 3]; 2]) -> [[f32; 3]; 2] {
    [std::array::from_fn(|c| min[c].min(other[0][c])), std::array::from_fn(|c| max[c].max(other[1][c]))]
}
