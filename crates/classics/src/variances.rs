//! Variances of pixel means, and means of pixels without samples.

use crate::windows::{convolve, gaussian_taps};
use dapple_core::Film;
use rayon::prelude::*;

/// The variance of each pixel's mean, averaged over the channels.
///
/// A pixel whose sample variance is 0 or unknown takes the mean sample variance of the 3x3 pixels around it. If none of
/// these has two samples, it takes that of the image. If no pixel has two samples, the variance is that of the means of 3x3
/// pixels, and infinite where only one of these has samples. It is 0 in pixels without samples.
pub(crate) fn variances_of_means(film: &Film) -> Vec<f64> {
    let size = film.frame().size().map(|n| n as usize);
    let own = per_pixel(film, |i| film.moments(i).variance().map(|[r, g, b]| (r + g + b) / 3.0));
    let (sum, known) = sum_and_number(own.iter().flatten().copied());
    if known == 0.0 {
        return per_pixel(film, |i| if film.count(i) == 0 { 0.0 } else { variance_around(film, size, i) });
    }
    let everywhere = sum / known;
    let of = |i: usize| {
        let n = film.count(i);
        if n == 0 {
            return 0.0;
        }
        if let Some(v) = own[i].filter(|v| *v > 0.0) {
            return v / n as f64;
        }
        let (sum, known) = sum_and_number(around(size, i).filter_map(|i| own[i]));
        if known > 0.0 { sum / (known * n as f64) } else { everywhere / n as f64 }
    };
    per_pixel(film, of)
}

/// The indices of the 3x3 pixels around pixel `i`.
pub(crate) fn around([width, height]: [usize; 2], i: usize) -> impl Iterator<Item = usize> + Clone {
    let (x, y) = (i % width, i / width);
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    rows.flat_map(move |y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x))
}

/// The variance of the means of the 3x3 pixels around pixel `i`, averaged over the channels.
fn variance_around(film: &Film, size: [usize; 2], i: usize) -> f64 {
    let of_channel = |c: usize| {
        let near = around(size, i).filter(|&i| film.count(i) > 0).map(|i| film.mean(i)[c]);
        let (sum, number) = sum_and_number(near.clone());
        let (squares, _) = sum_and_number(near.map(|x| (x - sum / number) * (x - sum / number)));
        if number > 1.0 { squares / (number - 1.0) } else { f64::INFINITY }
    };
    (0..3).map(of_channel).sum::<f64>() / 3.0
}

fn sum_and_number(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((0.0, 0.0), |(sum, number), value| (sum + value, number + 1.0))
}

/// The mean and the variance of the mean of every pixel. Pixels without samples take those of Gaussians around them; they
/// are black if no sample is within 27 pixels. Unknown variances are 0.
pub(crate) fn filled_means(film: &Film) -> (Vec<[f64; 3]>, Vec<f64>) {
    let size = film.frame().size().map(|n| n as usize);
    let variances = variances_of_means(film);
    let of = |i: usize| {
        let [r, g, b] = film.mean(i);
        let variance = if variances[i].is_finite() { variances[i] } else { 0.0 };
        if film.count(i) > 0 { [r, g, b, variance, 1.0] } else { [0.0; 5] }
    };
    let mut known = per_pixel(film, of);
    for sigma in [1.0, 3.0, 9.0] {
        if known.iter().all(|values| values[4] > 0.0) {
            break;
        }
        let sums = convolve(size, &gaussian_taps(sigma), &known);
        for (values, sum) in known.iter_mut().zip(sums) {
            if values[4] == 0.0 && sum[4] > 0.0 {
                *values = sum.map(|value| value / sum[4]);
            }
        }
    }
    known.into_iter().map(|[r, g, b, variance, _]| ([r, g, b], variance)).unzip()
}

/// Computes a value for every pixel, in parallel.
pub(crate) fn per_pixel<T: Send>(film: &Film, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..film.frame().pixels()).into_par_iter().with_min_len(1024).map(f).collect()
}
