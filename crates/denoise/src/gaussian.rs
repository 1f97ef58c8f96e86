//! The Gaussian filter.

use crate::inputs::{Levels, describe};
use crate::light::Light;
use crate::planes::per_pixel;
use dapple_core::filter::{FilterMemory, ImagePlanes};
use dapple_core::options::Options as _;
use dapple_core::{Error, Film, Filter, Filtered, Frame, Needs, parallel};
use std::f64::consts::PI;

dapple_core::options! {
    /// The parameters of [`Gaussian`].
    pub struct GaussianOptions {
        /// Falloff of the kernel, exp(-alpha r^2) - exp(-alpha radius^2) along each axis, with r in pixels.
        ///
        /// The standard deviation is `sqrt(0.5 / alpha)` pixels.
        pub alpha: f64 = 0.5, |alpha| alpha > 0.0 && alpha.is_finite(), "a finite number above 0; 0.5 is usual";
        /// Kernel radius in pixels.
        pub radius: f64 = 4.0 => "4",
            |radius| radius > 0.0 && radius <= 64.0, "above 0 and at most 64 pixels, from the centre to the edge";
    }
}

/// A Gaussian blur of the pixel means, with weights integrated over each pixel.
///
/// ```
/// use dapple_core::{Film, Filter, Frame, Needs};
/// use dapple_denoise::Gaussian;
///
/// let filter = Gaussian::new(0.5, 4.0)?; // the default
/// let mut film = Film::new(Frame::new(9, 9)?, Needs::none());
/// film.push(40, 0, [1.0; 3]); // the only sample of the image
/// let image = filter.apply(&film)?;
/// assert_eq!(image.radiance[0], [1.0; 3], "empty pixels are filled");
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// # Kernel
///
/// Along each axis the kernel is `max(0, exp(-alpha x^2) - exp(-alpha radius^2))` with `x` in pixels. This is the form of
/// pbrt's Gaussian filter [after Pharr and Humphreys 2010, chapter 7]. In two dimensions it is the product over both axes.
///
/// The weight of pixel `j` for pixel `i` is the integral over the square of `j` of the kernel centred on `i`. Weights are
/// normalised over the pixels that exist and have samples.
///
/// The result equals splatting infinitely many samples, spread evenly over every pixel.
/// Sample counts affect only the noise of the result: an edge stays in place even if its two sides have different counts.
/// Splatting the actual samples, `sum(w f) / sum(w)`, would move the edge.
///
/// # Default
///
/// `alpha` is 0.5 and `radius` is 4 pixels. The cluster-adaptive thesis states "kernel 0.5, width 8 px". Here, 8 pixels are the
/// full width; as a half-width, like `xwidth` in pbrt-v2, they would be the radius. The kernels of radius 4 and 8 are nearly
/// the same:
///
/// * No weight differs by more than 0.0003; the largest weight is 0.147.
/// * The wider kernel's weights beyond 4.5 pixels add up to 7e-6 per axis.
/// * The remaining noise variance differs by 0.3 %.
/// * The narrower kernel has 9 weights per axis, the wider one 17.
///
/// # Light sources
///
/// If the film records emission, bright light sources seen directly stay in their pixels. Without [`Needs::emission`] they are
/// blurred, as in the published filter.
///
/// # Pixels without samples
///
/// Pixels without samples are filled from their neighbours. If no pixel in reach has samples, they are black with an infinite
/// error.
///
/// # Error
///
/// [`Filtered::error`] is the sum of squared normalised weights times the variances of the pixel means.
/// The variances come from the film's halves, or else from its sample variance. The error is `None` if the film has
/// neither.
///
/// **The bias of blurred edges is not included.** The noise of different pixels is assumed to be independent. The error is
/// infinite where a pixel in reach has samples but an unknown variance.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian {
    options: GaussianOptions,
    weights: Vec<f64>,
}

impl Default for Gaussian {
    fn default() -> Self {
        Self::of(GaussianOptions::default())
    }
}

impl Gaussian {
    /// A Gaussian with the falloff `alpha` per square pixel, cut off `radius` pixels from the centre along each axis.
    ///
    /// # Errors
    ///
    /// The errors of [`Gaussian::with_options`].
    pub fn new(alpha: f64, radius: f64) -> Result<Self, Error> {
        Self::with_options(GaussianOptions { alpha, radius })
    }

    /// A Gaussian with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `alpha` is finite and positive and `radius` in `(0, 64]`.
    pub fn with_options(options: GaussianOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self::of(options))
    }

    fn of(options: GaussianOptions) -> Self {
        Self { options, weights: gaussian_weights(options.alpha, options.radius) }
    }

    /// The parameters.
    pub fn options(&self) -> GaussianOptions {
        self.options
    }

    /// The weights along one axis, positive, symmetric and of sum 1; their number is odd. With `n` as the middle index, the
    /// pixel at the offset `(dx, dy)` has the weight `weights[n + dx] * weights[n + dy]`.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

impl Filter for Gaussian {
    fn name(&self) -> &str {
        "gaussian"
    }

    fn describe(&self) -> String {
        describe(self.name(), &self.options, "")
    }

    fn needs(&self) -> Needs {
        Needs::none().with_emission()
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        // Four sums along rows, and four along columns.
        memory(frame, needs, 2 * size_of::<[f64; 4]>())
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        let size = film.frame().size();
        let plane = size.map(|n| n as usize);
        let emission = emission(film);
        let emission = emission.as_deref();
        let sums = separable(plane, &self.weights, |i| mean_and_presence(film, emission, i), |_, sum| sum);
        let error = variances(film).map(|variances| {
            let squares: Vec<f64> = self.weights.iter().map(|w| w * w).collect();
            separable(plane, &squares, |i| [variances[i]], |i, [sum]| squared_error(sum, sums[i][3]))
        });
        let radiance = per_pixel(film.frame().pixels(), |i| normalised(sums[i], emission, i));
        Ok(Filtered::new(size, radiance).with_error(error))
    }
}

/// The memory of a blur that uses `bytes` per pixel besides emission.
pub(crate) fn memory(frame: &Frame, needs: &Needs, bytes: usize) -> FilterMemory {
    let known = needs.variance || needs.halves;
    let image = if known { ImagePlanes::RadianceAndError } else { ImagePlanes::Radiance };
    FilterMemory::new(frame, bytes + if needs.emission { 24 } else { 0 }, image)
}

/// The emission of each pixel that is not blurred; `None` if the film recorded no emission.
pub(crate) fn emission(film: &Film) -> Option<Vec<[f64; 3]>> {
    film.needs().emission.then(|| {
        let light = Light::all(film);
        let bounds = Levels::of(light).bounds;
        per_pixel(film.frame().pixels(), |i| bounds.withheld_emission(light, i))
    })
}

/// The mean of pixel `i` without its unblurred `emission`, followed by 1; zeros if the pixel has no samples. Weighted sums of
/// these values are the numerator and denominator of a mean over the pixels with samples.
#[inline]
pub(crate) fn mean_and_presence(film: &Film, emission: Option<&[[f64; 3]]>, i: usize) -> [f64; 4] {
    if film.count(i) == 0 {
        return [0.0; 4];
    }
    let [r, g, b] = film.refined_mean(i);
    let [er, eg, eb] = emission.map_or([0.0; 3], |emission| emission[i]);
    [r - er, g - eg, b - eb, 1.0]
}

/// The estimated variance of each pixel's mean, averaged over the channels; `None` if the film recorded none.
///
/// The estimate comes from the halves if the film has them, since only halves are valid for low-discrepancy samples. Otherwise
/// it comes from the sample variance. It is infinite where unknown, and 0 in pixels without samples, which no sum includes.
pub(crate) fn variances(film: &Film) -> Option<Vec<f64>> {
    let needs = film.needs();
    if !needs.halves && !needs.variance {
        return None;
    }
    let variance = |i| {
        if film.count(i) == 0 {
            return 0.0;
        }
        let known = if needs.halves {
            film.squared_error(i)
        } else {
            let moments = film.moments(i);
            moments.variance().map(|v| v.map(|v| v / moments.count as f64))
        };
        known.map_or(f64::INFINITY, |[r, g, b]| (r + g + b) / 3.0)
    };
    Some(per_pixel(film.frame().pixels(), variance))
}

/// The weighted mean from a weighted sum of [`mean_and_presence`], plus the `emission` of pixel `i`; black if no sample is in
/// reach.
#[inline]
pub(crate) fn normalised(sum: [f64; 4], emission: Option<&[[f64; 3]]>, i: usize) -> [f32; 3] {
    let emission = emission.map_or([0.0; 3], |emission| emission[i]);
    if sum[3] > 0.0 { std::array::from_fn(|c| (sum[c] / sum[3] + emission[c]) as f32) } else { [0.0; 3] }
}

/// The squared error of a weighted mean, from the sum of squared weights times variances and the sum of weights.
/// Infinite if no sample is in reach.
#[inline]
pub(crate) fn squared_error(sum: f64, weight: f64) -> f32 {
    if weight > 0.0 { (sum / (weight * weight)) as f32 } else { f32::INFINITY }
}

/// Convolves the values `read(i)` of a `width` x `height` plane with a separable kernel, in two passes. A pixel at the offset
/// (dx, dy) has the weight `weights[dx + n] weights[dy + n]`.
///
/// `weights` has `2 n + 1` entries. Pixels outside the plane count as zeros. `finish` maps a pixel's index and its
/// weighted sums to the result.
///
/// Rows run in parallel. Each sum is computed by one task in a fixed order.
fn separable<const N: usize, T: Send + Default + Clone>(
    [width, height]: [usize; 2],
    weights: &[f64],
    read: impl Fn(usize) -> [f64; N] + Sync,
    finish: impl Fn(usize, [f64; N]) -> T + Sync,
) -> Vec<T> {
    let n = weights.len() / 2;
    let mut across = vec![[0.0; N]; width * height];
    parallel::chunks(&mut across, width, |y, row| {
        let mut padded = vec![[0.0; N]; width + 2 * n];
        for (x, value) in padded[n..n + width].iter_mut().enumerate() {
            *value = read(y * width + x);
        }
        for (sum, window) in row.iter_mut().zip(padded.windows(weights.len())) {
            for (weight, value) in weights.iter().zip(window) {
                add(sum, *weight, value);
            }
        }
    });
    let mut results = vec![T::default(); width * height];
    parallel::chunks(&mut results, width, |y, row| {
        let mut sums = vec![[0.0; N]; width];
        for source in y.saturating_sub(n)..(y + n + 1).min(height) {
            let weight = weights[source + n - y];
            for (sum, value) in sums.iter_mut().zip(&across[source * width..]) {
                add(sum, weight, value);
            }
        }
        for (x, (result, sum)) in row.iter_mut().zip(&sums).enumerate() {
            *result = finish(y * width + x, *sum);
        }
    });
    results
}

#[inline]
fn add<const N: usize>(sum: &mut [f64; N], weight: f64, value: &[f64; N]) {
    for (sum, value) in sum.iter_mut().zip(value) {
        *sum += weight * value;
    }
}

/// The fraction of the total weight below which a weight is dropped. Such a weight would change no `f64` sum. Its square could
/// underflow to zero, and zero times an infinite variance is NaN.
pub(crate) const NEGLIGIBLE: f64 = 1e-18;

/// The weights of the pixels `k = -n ..= n` along one axis: the integrals of `max(0, exp(-alpha x^2) - exp(-alpha
/// radius^2))` over `k - 1/2 .. k + 1/2`, divided by their sum.
///
/// The result is exactly symmetric. It has at least one entry, none of them zero.
/// `alpha` and `radius` must be finite and positive.
pub(crate) fn gaussian_weights(alpha: f64, radius: f64) -> Vec<f64> {
    let reach = (radius + 0.5).ceil() as usize - 1;
    let mut half: Vec<f64> = (0..=reach)
        .map(|k| {
            let start = (k as f64 - 0.5).max(0.0);
            let end = (k as f64 + 0.5).min(radius);
            let mass = mass(alpha, radius, start, end).max(0.0);
            if k == 0 { 2.0 * mass } else { mass }
        })
        .collect();
    let total = half[0] + 2.0 * half[1..].iter().sum::<f64>();
    half.iter_mut().for_each(|w| *w /= total);
    let kept = half.iter().rposition(|w| *w >= NEGLIGIBLE).unwrap_or(0);
    half.truncate(kept + 1);
    half[1..].iter().rev().chain(&half).copied().collect()
}

/// The integral of the kernel `exp(-alpha x^2) - exp(-alpha radius^2)` over `start .. end`, `0 <= start <= end <=
/// radius`, up to a factor that depends only on `alpha` and `radius`.
fn mass(alpha: f64, radius: f64, start: f64, end: f64) -> f64 {
    let root = alpha.sqrt();
    let drop = (root * radius) * (root * radius);
    if drop < 1.0 {
        // The Gaussian is nearly flat, so differences of erf would cancel. With u = x / radius the kernel is
        // exp(-drop) drop (exp(drop (1 - u^2)) - 1) / drop. The last factor tends to 1 - u^2 and equals it to
        // all digits long before drop reaches 1e-30.
        let drop = drop.max(1e-30);
        gauss_legendre(start / radius, end / radius, |u| (drop * (1.0 - u * u)).exp_m1() / drop)
    } else {
        let gaussian = (erfc(root * start) - erfc(root * end)) * (0.5 * PI.sqrt() / root);
        gaussian - (-drop).exp() * (end - start)
    }
}

/// Eight-point Gauss-Legendre quadrature, exact for polynomials of degree 15. Nodes and weights after [Abramowitz and
/// Stegun 1964, table 25.4].
fn gauss_legendre(start: f64, end: f64, f: impl Fn(f64) -> f64) -> f64 {
    const NODES: [[f64; 2]; 4] = [
        [0.183_434_642_495_649_8, 0.362_683_783_378_362],
        [0.525_532_409_916_329, 0.313_706_645_877_887_3],
        [0.796_666_477_413_626_7, 0.222_381_034_453_374_48],
        [0.960_289_856_497_536_3, 0.101_228_536_290_376_26],
    ];
    let (middle, half) = (0.5 * (start + end), 0.5 * (end - start));
    half * NODES.iter().map(|[x, w]| w * (f(middle - half * x) + f(middle + half * x))).sum::<f64>()
}

/// The complementary error function of `x >= 0`. Its error is about 1e-15 absolute and, where the value is small, 1e-13
/// relative.
pub(crate) fn erfc(x: f64) -> f64 {
    let gaussian = (-x * x).exp();
    if x < 3.0 {
        // After [Abramowitz and Stegun 1964, eq. 7.1.6]: all terms are positive, so nothing cancels.
        let (mut term, mut sum, mut n) = (x, x, 0.0);
        while term > sum * 1e-17 {
            n += 1.0;
            term *= 2.0 * x * x / (2.0 * n + 1.0);
            sum += term;
        }
        1.0 - 2.0 / PI.sqrt() * gaussian * sum
    } else {
        // After [Abramowitz and Stegun 1964, eq. 7.1.14], from the inside out. 40 levels reach the last digit at 3;
        // larger x need fewer.
        let tail = (1..=40).rev().fold(x, |tail, k| x + 0.5 * f64::from(k) / tail);
        gaussian / (PI.sqrt() * tail)
    }
}
