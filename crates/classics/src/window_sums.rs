//! Sums over square windows of pixels.

use rayon::prelude::*;

/// The sums of `read(i)` over the pixels at most `radius` columns and rows from each pixel. Windows are cut off at the
/// borders.
///
/// Each sum is taken by one task: over columns, then over rows, in their order. A running sum would keep the rounding
/// error of a firefly.
pub(crate) fn window_sums<const N: usize>(
    [width, height]: [usize; 2],
    radius: usize,
    read: impl Fn(usize) -> [f64; N] + Sync,
) -> Vec<[f64; N]> {
    let near = |at: usize, end: usize| at.saturating_sub(radius)..(at + radius + 1).min(end);
    let mut across = vec![[0.0; N]; width * height];
    across.par_chunks_mut(width).enumerate().for_each_init(
        || vec![[0.0; N]; width],
        |row, (y, sums)| {
            row.iter_mut().enumerate().for_each(|(x, value)| *value = read(y * width + x));
            for (x, sum) in sums.iter_mut().enumerate() {
                row[near(x, width)].iter().for_each(|value| add(sum, value));
            }
        },
    );
    let mut all = vec![[0.0; N]; width * height];
    all.par_chunks_mut(width).enumerate().for_each(|(y, sums)| {
        for row in near(y, height) {
            sums.iter_mut().zip(&across[row * width..]).for_each(|(sum, value)| add(sum, value));
        }
    });
    all
}

fn add<const N: usize>(sum: &mut [f64; N], value: &[f64; N]) {
    sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += value);
}

#[cfg(test)]
mod tests {
    use super::*;

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
