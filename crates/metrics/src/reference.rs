//! Errors against a reference that is noisy itself.

use crate::compare::{RELATIVE_EPSILON, check};
use crate::sum::Sum;
use crate::{Error, Pixels};

/// An error below so many times the reference's own is [limited](CorrectedError::reference_limited) by the
/// reference.
pub const REFERENCE_LIMIT: f64 = 100.0;

/// A reference, and what is known of its noise. Its samples must be independent of the image's: another seed and,
/// better, another point set.
#[derive(Clone, Copy, Debug)]
pub enum NoisyReference<'a> {
    /// Two independent images of equally many samples; the reference is their mean.
    Halves([Pixels<'a>; 2]),
    /// The reference and the variance of each of its channels (of the mean, not of a sample), in squared radiance.
    Variance {
        /// The reference.
        mean: Pixels<'a>,
        /// Its variance, of the same size.
        variance: Pixels<'a>,
    },
}

/// Errors without the reference's share.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corrected {
    /// MSE: unbiased.
    pub mse: CorrectedError,
    /// relMSE: too large by a share of up to `3 v (1 + 2 v / e)`, v being the reference's relative variance and e
    /// the error, as the noise is in the denominator too (second-order expansion, normal noise, r^2 far above
    /// [`RELATIVE_EPSILON`]): 3 % for v = .005 and e = .01, but .0003 % for v a millionth of 1 and the same e.
    pub rel_mse: CorrectedError,
}

/// A squared error, and what of it is the reference's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorrectedError {
    /// As [`compare`](crate::compare) measures it.
    pub measured: f64,
    /// Mean variance of the reference, in the same measure.
    pub reference: f64,
    /// `measured - reference`, the estimate of the error against the truth. Noise can bring it to 0 or below, where
    /// the reference says nothing about the image.
    pub error: f64,
}

impl CorrectedError {
    fn new(measured: f64, reference: f64) -> Self {
        Self { measured, reference, error: measured - reference }
    }

    /// Whether [`error`](Self::error) is below 100 times ([`REFERENCE_LIMIT`]) the reference's: the correction then
    /// counts, and figures and plots should mark the point.
    pub fn reference_limited(&self) -> bool {
        self.error < REFERENCE_LIMIT * self.reference
    }
}

/// Compares an image with a noisy reference and takes the noise's share out: `E(x - r)^2 = E(x - t)^2 + var r` for
/// the truth t, as long as x and r are independent. Halves a and b have `var r = E(a - b)^2 / 4`.
///
/// Non-finite channels of the image count as 0.
///
/// # Errors
/// [`Error::Sizes`], [`Error::NonFiniteReference`] (of a half too), [`Error::Variance`] where a variance is negative
/// or not finite.
pub fn compare_corrected(image: Pixels<'_>, reference: NoisyReference<'_>) -> Result<Corrected, Error> {
    // Of each channel the reference's value and variance.
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

fn check_variance(image: Pixels<'_>, variance: Pixels<'_>) -> Result<(), Error> {
    if image.size != variance.size {
        return Err(Error::Sizes { image: image.size, reference: variance.size });
    }
    let good = |v: &f32| *v >= 0.0 && v.is_finite();
    match variance.values.iter().position(|v| !v.iter().all(good)) {
        None => Ok(()),
        Some(at) => Err(Error::Variance { pixel: variance.place(at), value: variance.values[at] }),
    }
}

fn channels(image: Pixels<'_>) -> impl Iterator<Item = f64> {
    image.values.as_flattened().iter().map(|&v| f64::from(v))
}
