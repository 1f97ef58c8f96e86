//! Reference images, and errors of images against them.

use crate::{ImageErrors, StudyError};
use dapple_job::ContentHash;
use dapple_metrics::{
    NoisyReference, PIXELS_PER_DEGREE, Pixels, RELATIVE_EPSILON, compare, compare_corrected, downsample, flip,
};
use dapple_scene::image::{Channels, Encoding, Plane, read_attributes, read_channels, read_image};
use std::path::Path;

/// A reference image, with its variance if that is known.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ReferenceImage {
    pub(crate) size: [u32; 2],
    pub(crate) mean: Vec<[f32; 3]>,
    /// The variance of the reference image, per pixel and channel, in squared radiance; `None` if unknown.
    pub(crate) variance: Option<Vec<[f32; 3]>>,
}

/// The attributes in the header of an image file, and the hash of the file.
pub(crate) struct FileHeader {
    pub(crate) attributes: Vec<(String, String)>,
    pub(crate) digest: ContentHash,
}

impl FileHeader {
    /// The value of the attribute `dapple:KEY`; `None` if the header has none.
    pub(crate) fn attribute(&self, key: &str) -> Option<&str> {
        let known = |name: &str| name.strip_prefix("dapple:") == Some(key);
        self.attributes.iter().find(|(name, _)| known(name)).map(|(_, text)| text.as_str())
    }
}

/// The errors of an image against a reference, and the influence of the reference's own variance on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MeasuredErrors {
    pub(crate) errors: ImageErrors,
    pub(crate) corrected: bool,
    pub(crate) reference_limited: bool,
}

impl ReferenceImage {
    /// Averages two independent halves to a reference, whose variance is estimated from their difference.
    pub(crate) fn of_halves(size: [u32; 2], [a, b]: [&[[f32; 3]]; 2]) -> Self {
        let both = |of: fn(f32, f32) -> f32| {
            a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|c| of(a[c], b[c]))).collect::<Vec<[f32; 3]>>()
        };
        let mean = both(|a, b| 0.5 * (a + b));
        Self { size, mean, variance: Some(both(|a, b| 0.25 * (a - b) * (a - b))) }
    }

    /// Reads a reference from an image file. Its `variance` layer is used only if a study wrote the file; in other
    /// files, this layer has the variance of single samples.
    pub(crate) fn read(path: &Path) -> Result<(Self, FileHeader), StudyError> {
        let bytes = std::fs::read(path).map_err(|e| StudyError::file(path, "read the reference", e))?;
        let name = path.display().to_string();
        let image = read_image(&bytes, &name, Encoding::Auto)?;
        // Formats other than OpenEXR have no attributes.
        let attributes = read_attributes(&bytes, &name).unwrap_or_default();
        let about = FileHeader { attributes, digest: ContentHash::of(&bytes) };
        let variance = match about.attribute("study-key") {
            Some(_) => variance(&read_channels(&bytes, &name)?),
            None => None,
        };
        Ok((Self { size: image.size, mean: image.pixels, variance }, about))
    }

    /// Averages pixels to reduce the image to `size`; `None` unless the image's sides are multiples of those of `size`.
    pub(crate) fn averaged_to(self, size: [u32; 2]) -> Option<Self> {
        if self.size == size {
            return Some(self);
        }
        if size.contains(&0) || !(0..2).all(|axis| self.size[axis].is_multiple_of(size[axis])) {
            return None;
        }
        let averaged = |values: &[[f32; 3]]| downsample(Pixels::new(self.size, values).ok()?, size).ok();
        let mean = averaged(&self.mean)?;
        let variance = match &self.variance {
            None => None,
            // The variance of the mean of independent pixels.
            Some(variance) => {
                let pixels = (self.size[0] / size[0] * (self.size[1] / size[1])) as f32;
                Some(averaged(variance)?.into_iter().map(|v| v.map(|v| v / pixels)).collect())
            }
        };
        Some(Self { size, mean, variance })
    }

    /// The part of the MSE in sRGB values (0 to 255) that is due to the reference's own variance. It is a quarter of
    /// the squared difference of the reference's two halves, which follow from its mean and variance up to their order.
    fn own_srgb8(&self, variance: &[[f32; 3]]) -> Result<f64, dapple_metrics::MetricsError> {
        let half = |sign: f32| -> Vec<[f32; 3]> {
            let values = self.mean.iter().zip(variance);
            values.map(|(r, v)| std::array::from_fn(|c| r[c] + sign * v[c].sqrt())).collect()
        };
        let [a, b] = [half(-1.0), half(1.0)];
        Ok(0.25 * compare(Pixels::new(self.size, &a)?, Pixels::new(self.size, &b)?)?.srgb8_mse)
    }

    /// The relMSE that the reference's own variance causes; `None` if the variance is unknown.
    pub(crate) fn own_relmse(&self) -> Option<f64> {
        let variance = self.variance.as_ref()?;
        let values = self.mean.as_flattened().iter().zip(variance.as_flattened());
        let sum: f64 = values.map(|(r, v)| f64::from(*v) / (f64::from(*r) * f64::from(*r) + RELATIVE_EPSILON)).sum();
        Some(sum / (3 * self.mean.len()) as f64)
    }

    /// The errors of `image` against this reference. The reference's own variance, if known, is subtracted from MSE,
    /// relMSE and sRGB MSE.
    pub(crate) fn measure(&self, image: &[[f32; 3]]) -> Result<MeasuredErrors, dapple_metrics::MetricsError> {
        let (x, r) = (Pixels::new(self.size, image)?, Pixels::new(self.size, &self.mean)?);
        let found = compare(x, r)?;
        let seen = flip(x, r, PIXELS_PER_DEGREE)?.mean;
        let mut errors = ImageErrors {
            mse: found.mse,
            relmse: found.rel_mse,
            relmse_trimmed: found.rel_mse_trimmed,
            smape: found.smape,
            psnr: found.psnr,
            srgb8_mse: found.srgb8_mse,
            flip: seen,
            // JSON cannot hold the infinite ratio to a black reference.
            mean_ratio: match found.mean_ratio {
                ratio if ratio.is_finite() => ratio,
                ratio if ratio.is_nan() => 1.0,
                _ => f64::MAX,
            },
        };
        let Some(variance) = &self.variance else {
            return Ok(MeasuredErrors { errors, corrected: false, reference_limited: false });
        };
        let noisy = NoisyReference::Variance { mean: r, variance: Pixels::new(self.size, variance)? };
        let without = compare_corrected(x, noisy)?;
        (errors.mse, errors.relmse) = (without.mse.error, without.rel_mse.error);
        errors.srgb8_mse -= self.own_srgb8(variance)?;
        let reference_limited = without.mse.reference_limited() || without.rel_mse.reference_limited();
        Ok(MeasuredErrors { errors, corrected: true, reference_limited })
    }
}

fn variance(channels: &Channels) -> Option<Vec<[f32; 3]>> {
    let plane = |name: &str| match channels.plane(name)? {
        Plane::F32(values) => Some(values.clone()),
        _ => None,
    };
    let [r, g, b] = [plane("variance.R")?, plane("variance.G")?, plane("variance.B")?];
    Some(r.iter().zip(g.iter()).zip(b.iter()).map(|((r, g), b)| [*r, *g, *b]).collect())
}
