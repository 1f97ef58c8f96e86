//! Sums over the pixels around each pixel (convolution with separable kernels, square windows, and patches), and the means,
//! variances and features of pixels.

use dapple_core::{Film, film::Features, parallel};

/// The values of a Gaussian with standard deviation `sigma` at integer pixels, out to `3 sigma`.
///
/// The number of weights is odd, and they sum to 1.
pub(crate) fn gaussian_taps(sigma: f64) -> Vec<f64> {
    let reach = libm::ceil(3.0 * sigma) as i32;
    let mut taps: Vec<f64> = (-reach..=reach).map(|k| libm::exp(-f64::from(k * k) / (2.0 * sigma * sigma))).collect();
    let sum: f64 = taps.iter().sum();
    taps.iter_mut().for_each(|tap| *tap /= sum);
    taps
}

/// Convolves N values per pixel with the product of `taps` along both axes. Pixels outside the image count as zeros.
///
/// `taps` has an odd number of weights. Rows run in parallel, and each sum has a fixed order.
pub(crate) fn convolve<const N: usize>(size: [usize; 2], taps: &[f64], values: &[[f64; N]]) -> Vec<[f64; N]> {
    convolve_read(size, taps, &|i| values[i])
}

/// The sums of `read(i)` over the pixels at most `radius` columns and rows from each pixel. Windows are cut off at the borders.
///
/// No running sum is used, since it would retain the rounding error of a firefly.
pub(crate) fn window_sums<const N: usize>(
    size: [usize; 2],
    radius: usize,
    read: impl Fn(usize) -> [f64; N] + Sync,
) -> Vec<[f64; N]> {
    convolve_read(size, &vec![1.0; 2 * radius + 1], &read)
}

fn convolve_read<const N: usize>(
    [width, height]: [usize; 2],
    taps: &[f64],
    read: &(dyn Fn(usize) -> [f64; N] + Sync),
) -> Vec<[f64; N]> {
    let reach = taps.len() / 2;
    let mut across = vec![[0.0; N]; width * height];
    parallel::chunks(&mut across, width, |y, row| {
        let mut padded = vec![[0.0; N]; width + 2 * reach];
        padded[reach..][..width].iter_mut().enumerate().for_each(|(x, value)| *value = read(y * width + x));
        for (k, tap) in taps.iter().enumerate() {
            add(row.as_flattened_mut(), *tap, padded[k..].as_flattened());
        }
    });
    let mut sums = vec![[0.0; N]; width * height];
    parallel::chunks(&mut sums, width, |y, row| {
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

/// The index of the pixel `offset` columns and rows from pixel `i`; `None` outside the image.
#[inline]
pub(crate) fn beside([width, height]: [usize; 2], i: usize, [dx, dy]: [isize; 2]) -> Option<usize> {
    let (x, y) = ((i % width).wrapping_add_signed(dx), (i / width).wrapping_add_signed(dy));
    (x < width && y < height).then(|| y * width + x)
}

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelTile {
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) size: [usize; 2],
}

impl PixelTile {
    /// The tiles of a band of rows, from left to right; `largest` is the size of tiles away from the borders.
    pub(crate) fn of_band([width, height]: [usize; 2], largest: [usize; 2], band: usize) -> impl Iterator<Item = Self> {
        let top = band * largest[1];
        let rows = largest[1].min(height - top);
        (0..width).step_by(largest[0]).map(move |left| Self { left, top, size: [largest[0].min(width - left), rows] })
    }

    /// The columns and rows of the tile's pixels, row by row.
    pub(crate) fn pixels(self) -> impl Iterator<Item = [usize; 2]> {
        let [width, height] = self.size;
        (0..width * height).map(move |k| [self.left + k % width, self.top + k / width])
    }
}

/// Sums over the square patches around a tile's pixels.
pub(crate) struct PatchSums {
    patch: usize,
    /// One sum per pixel of the tile.
    sums: Vec<f64>,
    /// The sums over the columns of a patch, for the rows of the tile and its margins.
    across: Vec<f64>,
    row: Vec<f64>,
}

impl PatchSums {
    /// Sums over patches of `2 patch + 1` pixels, for tiles up to this size.
    pub(crate) fn new([width, height]: [usize; 2], patch: usize) -> Self {
        let (tall, wide) = (height + 2 * patch, width + 2 * patch);
        Self { patch, sums: vec![0.0; width * height], across: vec![0.0; width * tall], row: vec![0.0; wide] }
    }

    /// Sums `value(x, y)` over the columns and rows of each pixel's patch, which may extend beyond the image.
    pub(crate) fn compute(&mut self, tile: PixelTile, value: impl Fn(isize, isize) -> f64) -> &[f64] {
        let ([width, height], side) = (tile.size, 2 * self.patch + 1);
        let from = |first: usize, k: usize| (first + k) as isize - self.patch as isize;
        for (k, across) in self.across.chunks_mut(width).take(height + side - 1).enumerate() {
            let row = &mut self.row[..width + side - 1];
            row.iter_mut().enumerate().for_each(|(x, to)| *to = value(from(tile.left, x), from(tile.top, k)));
            across.iter_mut().zip(row.windows(side)).for_each(|(sum, window)| *sum = window.iter().sum());
        }
        for (y, sums) in self.sums.chunks_mut(width).take(height).enumerate() {
            sums.fill(0.0);
            for across in self.across.chunks(width).skip(y).take(side) {
                sums.iter_mut().zip(across).for_each(|(sum, value)| *sum += value);
            }
        }
        &self.sums[..width * height]
    }
}

/// The variance of each pixel's mean, averaged over the channels.
///
/// A pixel whose sample variance is 0 or unknown uses the mean sample variance of the 3x3 pixels around it, or else of the
/// image. If no pixel has two samples, the variance between the means of 3x3 pixels is used; it is infinite if only one of them
/// has samples. The variance is 0 in pixels without samples.
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

/// The radius of the window that provides means and variances for pixels without them.
const NEAR: usize = 2;

/// The means of a film's pixels, over all samples or over one half.
pub(crate) struct Means {
    /// The mean radiance; for pixels without samples, the mean of both halves or of 5x5 pixels.
    pub(crate) colour: Vec<[f64; 3]>,
    /// The variance of the mean.
    pub(crate) variance: Vec<[f64; 3]>,
    /// `true` for pixels with samples.
    pub(crate) known: Vec<bool>,
}

impl Means {
    /// The bytes per pixel of the means, and of the sums from which they are computed.
    pub(crate) const BYTES: [usize; 2] = [24 + 24 + 1, 2 * 64];

    pub(crate) fn new(film: &Film, half: Option<usize>) -> Self {
        let size = film.frame().size().map(|n| n as usize);
        let own = |i: usize| match half {
            None => (film.count(i), film.mean(i)),
            Some(half) => film.half(half, i).map_or((0, [0.0; 3]), |moments| (moments.count, moments.mean)),
        };
        // Per pixel: 1 if there are samples, the mean, the degrees of freedom of both halves, and squared deviations.
        let sums = window_sums(size, NEAR, |i| {
            let ((count, [r, g, b]), all) = (own(i), film.moments(i));
            let [vr, vg, vb] = all.m2;
            [f64::from(u8::from(count > 0)), r, g, b, all.count.saturating_sub(1) as f64, vr, vg, vb]
        });
        let near = |i: usize, c: usize| sums[i][c] / sums[i][if c > 4 { 4 } else { 0 }].max(1.0);
        let colour = |i: usize| match own(i) {
            (1.., mean) => mean,
            _ if film.count(i) > 0 => film.mean(i),
            _ => [1, 2, 3].map(|c| near(i, c)),
        };
        let variance = |i: usize| {
            let of_sample = film.moments(i).variance().unwrap_or_else(|| [5, 6, 7].map(|c| near(i, c)));
            of_sample.map(|v| v / own(i).0.max(1) as f64)
        };
        let known = per_pixel(film, |i| own(i).0 > 0);
        Self { colour: per_pixel(film, colour), variance: per_pixel(film, variance), known }
    }
}

/// The number of features: normal (3), albedo (3) and depth.
pub(crate) const FEATURES: usize = 7;

/// The means and sample variances of features. Depths are multiplied by `unit`. Samples without a hit have features 0. Within
/// surfaces, each channel of normals and albedo has a third of the summed variance.
pub(crate) fn feature_moments(f: &Features, unit: f32) -> [[f32; FEATURES]; 2] {
    let ([nx, ny, nz], [r, g, b]) = (f.normal, f.albedo);
    let [normal, albedo, _, depth] = f.variance.unwrap_or_default();
    let [n, a] = [normal / 3.0, albedo / 3.0];
    let mean = [nx, ny, nz, r, g, b, f.depth * unit];
    let variance = [n, n, n, a, a, a, depth * unit * unit];
    let share = f.hits as f32 / f.samples.max(1) as f32;
    let bounded = |x: f32| x.clamp(-1e9, 1e9);
    let spread = |k: usize| bounded(share * variance[k] + share * (1.0 - share) * mean[k] * mean[k]);
    [mean.map(|m| bounded(share * m)), std::array::from_fn(spread)]
}

/// The factor that makes the largest depth of a film 1.
pub(crate) fn unit_of_depth(film: &Film) -> f32 {
    let depths = (0..film.frame().pixels()).filter_map(|i| film.features(i)).map(|f| f.depth);
    let depth = depths.fold(0.0, f32::max);
    if depth > 0.0 { 1.0 / depth } else { 0.0 }
}

/// The mean of every pixel and the variance of that mean. Pixels without samples use Gaussian-weighted neighbours; they are
/// black if no sample is within 27 pixels. Unknown variances are 0.
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

/// A squared error as stored in images: the largest finite number instead of an overflow. An unknown error stays infinite.
pub(crate) fn stored(error: f64) -> f32 {
    if error == f64::INFINITY { f32::INFINITY } else { error.clamp(0.0, f64::from(f32::MAX)) as f32 }
}

/// Computes a value for every pixel, in parallel.
pub(crate) fn per_pixel<T: Send>(film: &Film, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    parallel::map(film.frame().pixels(), f)
}
