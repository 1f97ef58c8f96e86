//! Error metrics against a noisy reference, and the difference between two images, estimated from noisy renders.

use crate::compare::{RELATIVE_EPSILON, check};
use crate::sum::Sum;
use crate::{MetricsError, Pixels};

/// The multiple of the reference's variance below which an error is
/// [limited by the reference](CorrectedError::reference_limited).
pub const REFERENCE_LIMIT: f64 = 100.0;

/// A reference image and its noise. The reference's samples must be independent of the compared image's: use another
/// seed, preferably another point set.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum NoisyReference<'a> {
    /// Two independent images with equal numbers of samples; the reference is their mean.
    Halves([Pixels<'a>; 2]),
    /// A reference and its variance in each pixel and channel.
    Variance {
        /// The reference image, a mean over samples.
        mean: Pixels<'a>,
        /// The variance of `mean` (not of one sample) per pixel and channel, in squared radiance; of the same size as
        /// `mean`.
        variance: Pixels<'a>,
    },
}

/// Errors of an image without the contribution of the reference's noise, from [`compare_corrected`].
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corrected {
    /// The MSE, in squared radiance. Its correction is unbiased.
    pub mse: CorrectedError,
    /// The relMSE. It is slightly too large, because its denominator is noisy.
    ///
    /// For a relative variance v of the reference and a true relMSE e, the bias is at most a fraction `3 v (1 + 2 v / e)` of
    /// e. For e = 0.01, this is 3 % with v = 0.005, and 0.0003 % with v = 1e-6. (Second-order expansion for normal noise
    /// and r^2 far above [`RELATIVE_EPSILON`].)
    pub rel_mse: CorrectedError,
}

/// A squared error, split into the contributions of the image and of the reference's noise.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CorrectedError {
    /// The error as [`compare`](crate::compare) measures it, with the reference's noise.
    pub measured: f64,
    /// The part of `measured` caused by noise in the reference: the reference's variance, averaged over the image. For
    /// relMSE, each variance is first divided by `r^2 + 0.01`.
    pub reference: f64,
    /// `measured - reference`: the estimated error against the noiseless reference. At 0 or below, the reference is too
    /// noisy to measure the image.
    pub error: f64,
}

impl CorrectedError {
    fn new(measured: f64, reference: f64) -> Self {
        Self { measured, reference, error: measured - reference }
    }

    /// Returns `true` if `error < REFERENCE_LIMIT * reference`, with a [`REFERENCE_LIMIT`] of 100. Mark such errors in
    /// tables and plots, because the noise of the reference limits their precision.
    pub fn reference_limited(&self) -> bool {
        self.error < REFERENCE_LIMIT * self.reference
    }
}

/// Compares an image with a noisy reference, and subtracts the reference's variance from MSE and relMSE.
///
/// Let t be the noiseless reference, r the noisy one, and x an image independent of r. Then
/// `E[(x - r)^2] = E[(x - t)^2] + var r`. Two halves a and b of r give `var r = E[(a - b)^2] / 4`.
/// Non-finite values of the image are replaced by 0.
///
/// ```
/// # use dapple_metrics::{NoisyReference, Pixels, compare_corrected};
/// let (image, a, b) = ([[0.5; 3]], [[1.0; 3]], [[2.0; 3]]);
/// let [image, a, b] = [&image, &a, &b].map(|values| Pixels::new([1, 1], values).expect("one pixel"));
/// let corrected = compare_corrected(image, NoisyReference::Halves([a, b]))?;
/// assert_eq!((corrected.mse.measured, corrected.mse.error), (1.0, 0.75));
/// assert!(corrected.mse.reference_limited());
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::Sizes`] if sizes differ. [`MetricsError::NonFiniteReference`] for NaN or infinity in the reference
/// or a half. [`MetricsError::Variance`] for a variance that is negative or not finite.
pub fn compare_corrected(image: Pixels<'_>, reference: NoisyReference<'_>) -> Result<Corrected, MetricsError> {
    // Maps two channels to the reference's value and variance.
    let (first, second, known): (_, _, fn(f64, f64) -> [f64; 2]) = match reference {
        NoisyReference::Halves([a, b]) => {
            check(image, b)?;
            (a, b, |a, b| [0.5 * (a + b), 0.25 * (a - b) * (a - b)])
        }
        NoisyReference::Variance { mean, variance } => {
            check_variance(image, variance)?;
            (mean, variance, |mean, variance| [mean, variance])
        }
    };
    check(image, first)?;
    let mut sums = [Sum::default(); 4];
    for ((x, first), second) in channels(image).zip(channels(first)).zip(channels(second)) {
        let [r, variance] = known(first, second);
        let x = if x.is_finite() { x } else { 0.0 };
        let squared = (x - r) * (x - r);
        let scale = r * r + RELATIVE_EPSILON;
        let terms = [squared, variance, squared / scale, variance / scale];
        sums.iter_mut().zip(terms).for_each(|(sum, term)| sum.add(term));
    }
    let count = 3.0 * image.values.len() as f64;
    let [mse, variance, rel_mse, relative_variance] = sums.map(|sum| sum.value() / count);
    Ok(Corrected { mse: CorrectedError::new(mse, variance), rel_mse: CorrectedError::new(rel_mse, relative_variance) })
}

fn check_variance(image: Pixels<'_>, variance: Pixels<'_>) -> Result<(), MetricsError> {
    if image.size != variance.size {
        return Err(MetricsError::Sizes { image: image.size, reference: variance.size });
    }
    let good = |v: &f32| *v >= 0.0 && v.is_finite();
    match variance.values.iter().position(|v| !v.iter().all(good)) {
        None => Ok(()),
        Some(at) => Err(MetricsError::Variance { pixel: variance.place(at), value: variance.values[at] }),
    }
}

fn channels(image: Pixels<'_>) -> impl Iterator<Item = f64> {
    image.values.as_flattened().iter().map(|&v| f64::from(v))
}

/// The fewest renders of each image that [`difference`] accepts.
pub const LEAST_RENDERS: usize = 4;

/// An estimate from independent renders, with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredValue {
    /// The estimated value.
    pub value: f64,
    /// The standard error of `value` by the jackknife over n renders, with n - 1 degrees of freedom [after Tukey 1958].
    pub standard_error: f64,
}

/// The difference of two images without the noise of their renders, from [`difference`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Difference {
    /// Mean of `(b - a)^2 / (a^2 + 0.01)` over pixels and channels: relMSE of the noiseless `b` against the noiseless
    /// `a`. The numerator is unbiased, so the estimate can be below 0 if the images hardly differ.
    pub rel_mse: MeasuredValue,
    /// The fraction of the mean radiance of `a`, over all channels, that is missing in `b`; below 0 if `b` is brighter.
    pub mean_lost: MeasuredValue,
}

/// Estimates the difference of images `a` and `b` from independent renders of each.
///
/// Renders `a[i]` and `b[i]` may share a seed, which reduces the noise of their difference. `a[i]` and `a[j]` must not.
///
/// [`Difference::rel_mse`] is the mean of `(b[s] - a[s]) (b[t] - a[t]) / (m^2 + 0.01)` over all pairs of different renders s
/// and t, where `m` is the mean of all other `a[i]`. Independent noise of the two factors cancels. Numerator and
/// denominator share no noise. The nonlinear denominator leaves a bias: if `m` has the relative standard deviation `d`,
/// the value is too large by a fraction of about `3 d^2`. Non-finite values are replaced by 0.
///
/// ```
/// # use dapple_metrics::{Pixels, difference};
/// let noisy = |value: f32| [-0.01, 0.01, 0.02, -0.02].map(|noise| vec![[value + noise; 3]; 16]);
/// let [a, b] = [noisy(0.5), noisy(0.4)];
/// # fn pixels(renders: &[Vec<[f32; 3]>]) -> Result<Vec<Pixels<'_>>, dapple_metrics::MetricsError> {
/// #     renders.iter().map(|render| Pixels::new([4, 4], render)).collect()
/// # }
/// let found = difference(&pixels(&a)?, &pixels(&b)?)?;
/// assert!((found.mean_lost.value - 0.2).abs() < 1e-6);
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::FewRenders`] below [`LEAST_RENDERS`] or for different numbers of renders; [`MetricsError::Sizes`] if
/// any two renders differ in size.
pub fn difference(a: &[Pixels<'_>], b: &[Pixels<'_>]) -> Result<Difference, MetricsError> {
    let n = a.len();
    if n < LEAST_RENDERS || b.len() != n {
        return Err(MetricsError::FewRenders([n, b.len()]));
    }
    if let Some(other) = a.iter().chain(b).find(|p| p.size != a[0].size) {
        return Err(MetricsError::Sizes { image: other.size, reference: a[0].size });
    }
    let channels = 3 * a[0].values.len();
    let mut products = vec![Sum::default(); n * n];
    let (mut means_a, mut means_b) = (vec![Sum::default(); n], vec![Sum::default(); n]);
    let (mut known, mut apart) = (vec![0.0; n], vec![0.0; n]);
    for i in 0..channels {
        let value = |p: &Pixels<'_>| {
            let x = p.values[i / 3][i % 3];
            if x.is_finite() { f64::from(x) } else { 0.0 }
        };
        for k in 0..n {
            let (x, y) = (value(&a[k]), value(&b[k]));
            means_a[k].add(x);
            means_b[k].add(y);
            (known[k], apart[k]) = (x, y - x);
        }
        let sum: f64 = known.iter().sum();
        for (s, t) in pairs(n, n) {
            let mean = (sum - known[s] - known[t]) / (n - 2) as f64;
            products[s * n + t].add(apart[s] * apart[t] / (mean * mean + RELATIVE_EPSILON));
        }
    }
    let products: Vec<f64> = products.into_iter().map(|s| s.value() / channels as f64).collect();
    let rel_mse = |skip: usize| {
        let of: Vec<f64> = pairs(n, skip).map(|(s, t)| products[s * n + t]).collect();
        of.iter().sum::<f64>() / of.len() as f64
    };
    let rel_mse: Vec<f64> = (0..=n).map(rel_mse).collect();
    let [a, b] = [means_a, means_b].map(|means| means.into_iter().map(Sum::value).collect::<Vec<_>>());
    let lost = |skip: usize| {
        let of = |sums: &[f64]| sums.iter().enumerate().filter(|(k, _)| *k != skip).map(|(_, s)| s).sum::<f64>();
        let (a, b) = (of(&a), of(&b));
        if a == b { 0.0 } else { (a - b) / a.abs().max(1e-20) }
    };
    let mean_lost: Vec<f64> = (0..=n).map(lost).collect();
    Ok(Difference { rel_mse: jackknife(&rel_mse), mean_lost: jackknife(&mean_lost) })
}

/// All pairs of different numbers in `0..n` without `skip`, each pair once.
fn pairs(n: usize, skip: usize) -> impl Iterator<Item = (usize, usize)> {
    let kept = move |k: &usize| *k != skip;
    (0..n).filter(kept).flat_map(move |s| (s + 1..n).filter(kept).map(move |t| (s, t)))
}

/// The jackknife estimate and its standard error [after Tukey 1958]. The last of `estimates` uses all renders; each of
/// the others leaves out one render.
fn jackknife(estimates: &[f64]) -> MeasuredValue {
    let (without, all) = (&estimates[..estimates.len() - 1], estimates[estimates.len() - 1]);
    let n = without.len() as f64;
    let mean = without.iter().sum::<f64>() / n;
    let squares: f64 = without.iter().map(|x| (x - mean).powi(2)).sum();
    MeasuredValue { value: all, standard_error: ((n - 1.0) / n * squares).sqrt() }
}
