//! Convolution with a separable kernel, in two passes.

use rayon::prelude::*;

/// Convolves the values `read(i)` of a `width` x `height` plane. A pixel at the offset (dx, dy) has the weight
/// `weights[dx + n] weights[dy + n]`.
///
/// `weights` has `2 n + 1` entries. Pixels outside the plane count as zeros. `finish` maps a pixel's index and its
/// weighted sums to the result.
///
/// Rows run in parallel. Each sum is computed by one task in a fixed order.
pub(crate) fn separable<const N: usize, T: Send + Default + Clone>(
    [width, height]: [usize; 2],
    weights: &[f64],
    read: impl Fn(usize) -> [f64; N] + Sync,
    finish: impl Fn(usize, [f64; N]) -> T + Sync,
) -> Vec<T> {
    let n = weights.len() / 2;
    let mut across = vec![[0.0; N]; width * height];
    across.par_chunks_mut(width).enumerate().for_each_init(
        || vec![[0.0; N]; width + 2 * n],
        |padded, (y, row)| {
            for (x, value) in padded[n..n + width].iter_mut().enumerate() {
                *value = read(y * width + x);
            }
            for (sum, window) in row.iter_mut().zip(padded.windows(weights.len())) {
                for (weight, value) in weights.iter().zip(window) {
                    add(sum, *weight, value);
                }
            }
        },
    );
    let mut results = vec![T::default(); width * height];
    results.par_chunks_mut(width).enumerate().for_each_init(
        || vec![[0.0; N]; width],
        |sums, (y, row)| {
            sums.fill([0.0; N]);
            for source in y.saturating_sub(n)..(y + n + 1).min(height) {
                let weight = weights[source + n - y];
                for (sum, value) in sums.iter_mut().zip(&across[source * width..]) {
                    add(sum, weight, value);
                }
            }
            for (x, (result, sum)) in row.iter_mut().zip(&*sums).enumerate() {
                *result = finish(y * width + x, *sum);
            }
        },
    );
    results
}

#[inline]
fn add<const N: usize>(sum: &mut [f64; N], weight: f64, value: &[f64; N]) {
    for (sum, value) in sum.iter_mut().zip(value) {
        *sum += weight * value;
    }
}
