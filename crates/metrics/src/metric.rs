//! The error metrics, each declared once.
//!
//! Studies record, compare and export all metrics in this order; `dapple compare` prints them in the same order.

mod means;

use crate::{
    Comparison, Corrected, MetricsError, NoisyReference, PIXELS_PER_DEGREE, Pixels, compare, compare_corrected, flip,
};

/// An error metric of an image against its reference.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Metric {
    /// The name in JSON and CSV, such as `relmse`.
    pub name: &'static str,
    /// The name in tables for readers, such as `relMSE`.
    pub label: &'static str,
    /// The definition, in a few words.
    pub doc: &'static str,
    /// The values that are better: lower, higher, or near 1.
    pub better: Better,
    /// The function that computes the metric.
    pub of: Of,
}

/// The values of a metric that are better: lower, higher, or near 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// Lower values: the metric is an error, 0 for equal images. The ratio of two methods' errors is meaningful.
    Lower,
    /// Higher values: the metric is a quality, such as PSNR in decibels.
    Higher,
    /// Values near 1: the metric is a ratio of the image to the reference.
    NearOne,
}

/// All metrics.
pub const METRICS: &[Metric] = &[
    metric(Better::Lower, ["mse", "MSE", "mean squared error"], |m| {
        Ok(m.noise.map_or(m.comparison.mse, |noise| noise.corrected.mse.error))
    }),
    metric(Better::Lower, ["relmse", "relMSE", "squared error over squared reference + 0.01"], |m| {
        Ok(m.noise.map_or(m.comparison.rel_mse, |noise| noise.corrected.rel_mse.error))
    }),
    metric(Better::Lower, ["relmse_trimmed", "trimmed relMSE", "relMSE without the worst 0.1 % of the pixels"], |m| {
        Ok(m.comparison.rel_mse_trimmed)
    }),
    metric(Better::Lower, ["smape", "SMAPE", "symmetric relative error, 0 to 2"], |m| Ok(m.comparison.smape)),
    metric(Better::Higher, ["psnr", "PSNR", "in dB, of sRGB values; 200 for equal images"], |m| Ok(m.comparison.psnr)),
    metric(Better::Lower, ["srgb8_mse", "sRGB MSE", "mean squared error of sRGB values, 0 to 255"], |m| {
        Ok(m.comparison.srgb8_mse - m.noise.map_or(0.0, |noise| noise.srgb8_mse))
    }),
    metric(Better::Lower, ["srgb8_mse4", "sRGB MSE of 4x4", "sRGB MSE of the means of 4x4 pixels"], means::of),
    metric(Better::Lower, ["flip", "FLIP", "visible difference, 0 to 1, at 67 pixels per degree"], |m| {
        Ok(flip(m.image, m.reference, PIXELS_PER_DEGREE)?.mean)
    }),
    metric(Better::NearOne, ["mean_ratio", "ratio of means", "mean of the image over that of the reference"], |m| {
        Ok(m.comparison.mean_ratio)
    }),
];

/// The function that computes a metric.
type Of = fn(&Measurement<'_>) -> Result<f64, MetricsError>;

/// Creates an entry of the table from the metric's name, its label and its definition.
const fn metric(better: Better, [name, label, doc]: [&'static str; 3], of: Of) -> Metric {
    Metric { name, label, doc, better, of }
}

impl Metric {
    /// Finds a metric by its name; `None` if there is no such metric.
    pub fn find(name: &str) -> Option<&'static Self> {
        METRICS.iter().find(|metric| metric.name == name)
    }
}

/// An image and its reference, compared once for all metrics.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Measurement<'a> {
    /// The image.
    pub image: Pixels<'a>,
    /// The reference, of the same size.
    pub reference: Pixels<'a>,
    /// The errors from [`compare`], which include the reference's noise.
    pub comparison: Comparison,
    /// The variance of the reference's pixel means, per pixel and channel, in squared radiance; `None` if it is unknown.
    pub variance: Option<Pixels<'a>>,
    /// The influence of the reference's own noise; `None` if its variance is unknown.
    pub noise: Option<ReferenceNoise>,
}

/// The influence of the reference's own noise on the errors of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ReferenceNoise {
    /// MSE and relMSE without the noise.
    pub corrected: Corrected,
    /// The sRGB MSE (0 to 255) that the noise causes: a quarter of the sRGB MSE between two halves of the reference. In each
    /// pixel and channel, the halves have the values `mean + s` and `mean - s`, where `s^2` is the variance of the mean.
    pub srgb8_mse: f64,
}

impl<'a> Measurement<'a> {
    /// Compares an image with its reference. `variance` is the variance of the reference's pixel means, per pixel and
    /// channel, in squared radiance. It determines [`noise`](Self::noise).
    ///
    /// # Errors
    /// The errors of [`compare`] and [`compare_corrected`].
    pub fn new(image: Pixels<'a>, reference: Pixels<'a>, variance: Option<Pixels<'a>>) -> Result<Self, MetricsError> {
        let noise = variance.map(|variance| -> Result<ReferenceNoise, MetricsError> {
            let corrected = compare_corrected(image, NoisyReference::Variance { mean: reference, variance })?;
            let [a, b] = means::halves(reference.values, variance.values);
            let halves = compare(Pixels::new(reference.size, &a)?, Pixels::new(reference.size, &b)?)?;
            Ok(ReferenceNoise { corrected, srgb8_mse: 0.25 * halves.srgb8_mse })
        });
        let comparison = compare(image, reference)?;
        Ok(Self { image, reference, comparison, variance, noise: noise.transpose()? })
    }

    /// Returns `true` if the reference's noise is known and limits the precision of MSE or relMSE.
    pub fn reference_limited(&self) -> bool {
        self.noise.is_some_and(|ReferenceNoise { corrected, .. }| {
            corrected.mse.reference_limited() || corrected.rel_mse.reference_limited()
        })
    }
}
