//! Sums over the pixels around each pixel: convolution with separable kernels, and square windows.

use rayon::prelude::*;

/// Samples of a Gaussian with standard deviation `sigma` at whole pixels, out to `3 sigma`.
///
/// There is an odd number of weights, and they sum to 1.
pub(crate) fn gaussian_taps(sigma: f64) -> Vec<f64> {
    let reach = libm::ceil(3.0 * sigma) as i32;
    let mut taps: Vec<f64> = (-reach..=reach).map(|k| libm::exp(-f64::from(k * k) / (2.0 * sigma * sigma))).collect();
    let sum: f64 = taps.iter().sum();
    taps.iter_mut().for_each(|tap| *tap /= sum);
    taps
}

/// The squares of `taps`: the weights by which variances of independent pixels add up.
pub(crate) fn squared(taps: &[f64]) -> Vec<f64> {
    taps.iter().map(|tap| tap * tap).collect()
}

/// Convolves N values per pixel with the product of `taps` along both axes. Pixels outside the image count as zeros.
///
/// `taps` has an odd number of weights. Rows run in parallel, and each sum has a fixed order.
pub(crate) fn convolve<const N: usize>(size: [usize; 2], taps: &[f64], values: &[[f64; N]]) -> Vec<[f64; N]> {
    convolve_read(size, taps, |i| values[i])
}

/// The sums of `read(i)` over the pixels at most `radius` columns and rows from each pixel. Windows are cut off at the
/// borders.
///
/// A running sum would keep the rounding error of a firefly.
pub(crate) fn window_sums<const N: usize>(
    size: [usize; 2],
    radius: usize,
    read: impl Fn(usize) -> [f64; N] + Sync,
) -> Vec<[f64; N]> {
    convolve_read(size, &vec![1.0; 2 * radius + 1], read)
}

fn convolve_read<const N: usize>(
    [width, height]: [usize; 2],
    taps: &[f64],
    read: impl Fn(usize) -> [f64; N] + Sync,
) -> Vec<[f64; N]> {
    let reach = taps.len() / 2;
    let mut across = vec![[0.0; N]; width * height];
    across.par_chunks_mut(width).enumerate().for_each_init(
        || vec![[0.0; N]; width + 2 * reach],
        |padded, (y, row)| {
            padded[reach..][..width].iter_mut().enumerate().for_each(|(x, value)| *value = read(y * width + x));
            for (k, tap) in taps.iter().enumerate() {
                add(row.as_flattened_mut(), *tap, padded[k..].as_flattened());
            }
        },
    );
    let mut sums = vec![[0.0; N]; width * height];
    sums.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for from in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            add(row.as_flattened_mut(), taps[from + reach - y], across[from * width..][..width].as_flattened());
        }
    });
    sums
}

#[inline]
fn add(sums: &mut [f64], tap: f64, values: &[f64]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += tap * value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn convolution_agrees_with_the_double_sum() {
        let (size, taps) = ([5, 4], [0.2, 0.5, 0.3, 0.7, 0.1]);
        let values: Vec<[f64; 2]> = (0..20).map(|i| [f64::from(i * i % 7), f64::from(i % 3)]).collect();
        let got = convolve(size, &taps, &values);
        for (i, got) in got.iter().enumerate() {
            let mut wanted = [0.0; 2];
            for (j, value) in values.iter().enumerate() {
                let at = [j % 5 + 2, j / 5 + 2].into_iter().zip([i % 5, i / 5]);
                let weight: f64 = at.map(|(j, i)| taps.get(j.wrapping_sub(i)).copied().unwrap_or(0.0)).product();
                (0..2).for_each(|c| wanted[c] += weight * value[c]);
            }
            (0..2).for_each(|c| assert!((got[c] - wanted[c]).abs() < 1e-12, "{i}: {got:?}, not {wanted:?}"));
        }
    }

    #[test]
    fn gaussians_have_their_deviation() {
        for sigma in [1.0, 2.0, 8.0] {
            let taps = gaussian_taps(sigma);
            let reach = (taps.len() / 2) as f64;
            let variance: f64 = taps.iter().enumerate().map(|(k, tap)| tap * (k as f64 - reach).powi(2)).sum();
            // The cut at 3 standard deviations leaves out up to 2.7 % of the variance.
            assert!((0.97..1.0).contains(&(variance / (sigma * sigma))), "{sigma}: {variance}");
            assert!((taps.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn window_sums_match_brute_force() {
        for ([w, h], radius) in [([5, 4], 1), ([5, 4], 7), ([1, 1], 2), ([9, 1], 3)] {
            let value = |i: usize| [(i * i % 17) as f64, 1.0];
            let sums = window_sums([w, h], radius, value);
            for (i, sum) in sums.iter().enumerate() {
                let inside = (0..w * h)
                    .filter(|k| (k % w).abs_diff(i % w) <= radius && (k / w).abs_diff(i / w) <= radius)
                    .map(value);
                let expected = inside.fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
                assert_eq!(*sum, expected, "{w}x{h}, radius {radius}, pixel {i}");
            }
        }
    }
}
