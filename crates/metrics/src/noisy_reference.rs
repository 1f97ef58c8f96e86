//! Error metrics against a noisy reference.

use crate::compare::{RELATIVE_EPSILON, check};
use crate::sum::Sum;
use crate::{MetricsError, Pixels};

/// The limit of [`CorrectedError::reference_limited`]: an error below this many times the reference's variance is
/// limited by the reference.
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
    /// The relMSE. Its correction keeps a bias from the noise in the denominator.
    ///
    /// For a relative variance v of the reference and a true relMSE e, the value is too large by a fraction of up to `3
    /// v (1 + 2 v / e)`. This is 3 % for v = 0.005 and e = 0.01, and 0.0003 % for v = 1e-6 and the same e.
    /// (Second-order expansion for normal noise and r^2 far above [`RELATIVE_EPSILON`].)
    pub rel_mse: CorrectedError,
}

/// A squared error, split into the contributions of the image and of the reference's noise.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CorrectedError {
    /// The error as [`compare`](crate::compare) measures it, with the reference's noise.
    pub measured: f64,
    /// The contribution of the reference's noise to `measured`: its mean variance, relative for relMSE.
    pub reference: f64,
    /// `measured - reference`: the estimated error against the noiseless reference. At 0 or below, the reference is too
    /// noisy to measure the image.
    pub error: f64,
}

impl CorrectedError {
    fn new(measured: f64, reference: f64) -> Self {
        Self { measured, reference, error: measured - reference }
    }

    /// Returns `true` if [`error`](Self::error) is below 100 times ([`REFERENCE_LIMIT`]) the reference's variance. The
    /// correction then matters; mark such points in tables and plots.
    pub fn reference_limited(&self) -> bool {
        self.error < REFERENCE_LIMIT * self.reference
    }
}

/// Compares an image with a noisy reference, and subtracts the reference's variance from MSE and relMSE.
///
/// For the noiseless image t and independent image x and reference r, `E(x - r)^2 = E(x - t)^2 + var r`. Two halves a
/// and b of a reference give `var r = E(a - b)^2 / 4`. Non-finite channels of the image count as 0.
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
