//! Error metrics for rendered images, and confidence intervals over seeds.
//!
//! Images are plain data: [`Pixels`] borrows linear RGB, row by row from the top.
//!
//! | function | result |
//! |---|---|
//! | [`METRICS`] | all metrics of one image, by name; [`Measurement`] holds their input |
//! | [`compare`] | MSE, relMSE, SMAPE, PSNR, sRGB MSE and ratios of means |
//! | [`compare_corrected`] | MSE and relMSE without the noise of the reference |
//! | [`flip`] | the visible difference, LDR-FLIP |
//! | [`block_means`], [`block_ratios`] | bias that the noise of single pixels hides |
//! | [`difference`] | the difference between two images, estimated from noisy renders |
//! | [`downsample`] | an image averaged to a smaller size |
//! | [`mean_interval`], [`geometric_mean_interval`], [`ratio_interval`] | confidence intervals over seeds |
//! | [`image_spectrum`], [`point_spectrum`] | radial power spectra of noise and of sample points |
//! | [`log_log_fit`], [`efficiency`], [`student_t_quantile`], [`student_t_tail`] | slopes, efficiency, quantiles, tails |
//!
//! ```
//! use dapple_metrics::{Pixels, compare, ratio_interval};
//! let reference = vec![[0.5, 1.0, 0.0]; 12];
//! let mut image = reference.clone();
//! image[5] = [0.75, 1.0, 0.0];
//! let errors = compare(Pixels::new([4, 3], &image)?, Pixels::new([4, 3], &reference)?)?;
//! assert_eq!(errors.mse, 0.25 * 0.25 / 36.0);
//! assert_eq!(errors.rel_mse_trimmed, errors.rel_mse, "0.1 % of 12 pixels is none");
//! assert_eq!(errors.worst_block.position, [0, 0]);
//! // Errors of two methods for the same three seeds.
//! let ratio = ratio_interval(&[2.1e-3, 1.9e-3, 2.4e-3], &[4.0e-3, 3.9e-3, 4.9e-3], 0.95)?;
//! assert!(ratio.high < 1.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! All sums are compensated f64 sums in reading order: the same input gives the same bits for any number of threads.
//! The crate's README lists the definition and the purpose of each metric.

mod blocks;
mod compare;
mod discrepancy;
mod flip;
mod metric;
mod noise;
mod spectrum;
mod statistics;
mod sum;

/// Runs the README's example as a documentation test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub use blocks::{BlockRatios, Blocks, block_means, block_ratios, downsample};
pub use compare::{Comparison, RELATIVE_EPSILON, TRIMMED_SHARE, WORST_BLOCK_SIZE, WorstBlock, compare};
pub use discrepancy::{l2_star_discrepancy, star_discrepancy};
pub use flip::{Flip, PIXELS_PER_DEGREE, flip};
pub use metric::{Better, METRICS, Measurement, Metric, ReferenceNoise};
pub use noise::{
    Corrected, CorrectedError, Difference, LEAST_RENDERS, MeasuredValue, NoisyReference, REFERENCE_LIMIT,
    compare_corrected, difference,
};
pub use spectrum::{SpectrumRing, image_spectrum, point_spectrum};
pub use statistics::{
    BOOTSTRAP_MIN_COUNT, BOOTSTRAP_RESAMPLES, Interval, IntervalMethod, LogLogFit, StatisticsError, efficiency,
    geometric_mean_interval, log_log_fit, mean_interval, ratio_interval, student_t_quantile, student_t_tail,
};

/// The reason why an image metric cannot be computed. Each message names the remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MetricsError {
    /// An image without pixels, of this width and height.
    #[error("an image of {}x{} has no pixels; both sides must be at least 1", .0[0], .0[1])]
    Empty([u32; 2]),
    /// A slice of pixels whose length does not match the image size.
    #[error("an image of {}x{} has {} pixels, but {found} are given; pass width times height pixels", size[0], size[1], u64::from(size[0]) * u64::from(size[1]))]
    PixelCount {
        /// Width and height of the image.
        size: [u32; 2],
        /// The number of pixels in the slice.
        found: usize,
    },
    /// The images differ in size.
    #[error(
        "the image is {}x{} and its reference {}x{}; render at the reference's size, or downsample the larger one",
        image[0], image[1], reference[0], reference[1]
    )]
    Sizes {
        /// Width and height of the image.
        image: [u32; 2],
        /// Width and height of the reference.
        reference: [u32; 2],
    },
    /// A reference with NaN or infinity.
    #[error("the reference has the value {value:?} at column {}, row {}; use a reference without NaN and infinity", pixel[0], pixel[1])]
    NonFiniteReference {
        /// Column and row, from 0, of the first pixel with NaN or infinity.
        pixel: [u32; 2],
        /// The linear RGB value of that pixel.
        value: [f32; 3],
    },
    /// Too few renders of the first and of the second image to separate the difference from noise.
    #[error("there are {} renders of the first image and {} of the second; use equally many of each, at least {}", .0[0], .0[1], LEAST_RENDERS)]
    FewRenders([usize; 2]),
    /// A block that is empty or larger than the image.
    #[error("blocks of {}x{} pixels do not fit an image of {}x{}; choose a block size from 1x1 up to the size of the image", block[0], block[1], size[0], size[1])]
    Block {
        /// Width and height of a block.
        block: [u32; 2],
        /// Width and height of the image.
        size: [u32; 2],
    },
    /// A reference variance that is negative, NaN or infinite.
    #[error("the reference's variance is {value:?} at column {}, row {}; pass finite variances of at least 0", pixel[0], pixel[1])]
    Variance {
        /// Column and row, from 0, of the first pixel with such a variance.
        pixel: [u32; 2],
        /// The variance of that pixel in each channel.
        value: [f32; 3],
    },
    /// A number of pixels per degree of visual angle outside 1..=1000, passed to [`flip`].
    #[error("{0} pixels per degree of visual angle are out of range; use 1 to 1000 (67 is usual)")]
    PixelsPerDegree(f64),
    /// A target size for [`downsample`] that is empty or larger than the image.
    #[error("an image of {}x{} cannot be averaged to {}x{}; choose a size from 1x1 up to the size of the image", size[0], size[1], target[0], target[1])]
    Target {
        /// Width and height of the image.
        size: [u32; 2],
        /// The requested width and height.
        target: [u32; 2],
    },
}

/// A borrowed image: linear RGB, row by row from the top.
///
/// ```
/// # use dapple_metrics::Pixels;
/// let values = vec![[0.0, 0.5, 1.0]; 4 * 3];
/// assert_eq!(Pixels::new([4, 3], &values)?.size(), [4, 3]);
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    size: [u32; 2],
    values: &'a [[f32; 3]],
}

impl<'a> Pixels<'a> {
    /// Borrows `size[0] * size[1]` pixels as an image of `size` (width and height).
    ///
    /// # Errors
    /// [`MetricsError::Empty`] if a side is 0; [`MetricsError::PixelCount`] if `values` has another length.
    pub fn new(size: [u32; 2], values: &'a [[f32; 3]]) -> Result<Self, MetricsError> {
        check_count(size, values.len())?;
        Ok(Self { size, values })
    }

    /// The width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The pixels in linear RGB, row by row from the top.
    pub fn values(&self) -> &'a [[f32; 3]] {
        self.values
    }

    /// Column and row of the pixel at `index` of the slice.
    fn place(&self, index: usize) -> [u32; 2] {
        let width = self.size[0] as usize;
        [(index % width) as u32, (index / width) as u32]
    }

    /// The rows of pixels, from the top.
    fn rows(&self) -> impl Iterator<Item = &'a [[f32; 3]]> {
        self.values.chunks_exact(self.size[0] as usize)
    }
}

/// Checks that `found` is the number of pixels in an image of `size`, and that this number is not 0.
fn check_count(size: [u32; 2], found: usize) -> Result<(), MetricsError> {
    if size.contains(&0) {
        return Err(MetricsError::Empty(size));
    }
    if u64::from(size[0]) * u64::from(size[1]) != found as u64 {
        return Err(MetricsError::PixelCount { size, found });
    }
    Ok(())
}
