//! How far a rendered image is from its reference, and what may be said after a few seeds.
//!
//! Images are plain data: [`Pixels`] borrows linear RGB, row by row from the top. [`compare`] gives every
//! figure at once; [`block_means`] and [`block_ratios`] show bias where noise hides it in single pixels;
//! [`downsample`] brings an image to the size of its reference. [`flip`] is what an eye sees, and costs more, so
//! that it stands alone; [`compare_corrected`] takes a noisy reference's share out; [`difference`] compares two
//! images of which only noisy renders are known.
//!
//! Figures over seeds and budgets: [`mean_interval`], [`geometric_mean_interval`], [`ratio_interval`],
//! [`log_log_fit`], [`efficiency`].
//!
//! ```
//! use dapple_metrics::{Pixels, compare};
//! let reference = vec![[0.5, 1.0, 0.0]; 12];
//! let mut image = reference.clone();
//! image[5] = [0.75, 1.0, 0.0];
//! let found = compare(Pixels::new([4, 3], &image)?, Pixels::new([4, 3], &reference)?)?;
//! assert_eq!(found.mse, 0.25 * 0.25 / 36.0);
//! assert_eq!(found.rel_mse_trimmed, found.rel_mse, "of 12 pixels, 0.1 % is none");
//! assert_eq!(found.worst_block.position, [0, 0]);
//! # Ok::<(), dapple_metrics::Error>(())
//! ```
//!
//! All sums are compensated and in f64, taken in reading order, so that a figure has the same bits for any
//! number of threads. Which figure to trust for what is in the crate's README.

mod blocks;
mod compare;
mod difference;
mod flip;
mod reference;
mod srgb;
mod statistics;
mod sum;

/// The README's example is tested.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub use blocks::{BlockRatios, Blocks, block_means, block_ratios, downsample};
pub use compare::{Comparison, RELATIVE_EPSILON, TRIMMED_SHARE, WORST_BLOCK_SIZE, WorstBlock, compare};
pub use difference::{Difference, LEAST_RENDERS, Measured, difference};
pub use flip::{Flip, PIXELS_PER_DEGREE, flip};
pub use reference::{Corrected, CorrectedError, NoisyReference, REFERENCE_LIMIT, compare_corrected};
pub use statistics::{
    BOOTSTRAP_MIN_COUNT, BOOTSTRAP_RESAMPLES, Interval, LogLogFit, Method, StatisticsError, efficiency,
    geometric_mean_interval, log_log_fit, mean_interval, ratio_interval, student_t_quantile,
};

/// Why images cannot be compared. Each message says what to do.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// An image without pixels.
    #[error("an image of {}x{} has no pixels: both sides must be at least 1", size[0], size[1])]
    Empty {
        /// Width and height.
        size: [u32; 2],
    },
    /// Pixels and size disagree.
    #[error("an image of {}x{} needs {} pixels, not {found}", size[0], size[1], u64::from(size[0]) * u64::from(size[1]))]
    PixelCount {
        /// Width and height.
        size: [u32; 2],
        /// Pixels given.
        found: usize,
    },
    /// The images differ in size.
    #[error(
        "the image is {}x{} and its reference {}x{}: render at the reference's size, or downsample the larger one",
        image[0], image[1], reference[0], reference[1]
    )]
    Sizes {
        /// Width and height of the image.
        image: [u32; 2],
        /// Width and height of the reference.
        reference: [u32; 2],
    },
    /// A reference that is no number somewhere.
    #[error("the reference is {value:?} at column {}, row {}: a reference must be finite, so mend or replace it", pixel[0], pixel[1])]
    NonFiniteReference {
        /// Column and row of the first such pixel.
        pixel: [u32; 2],
        /// Its value.
        value: [f32; 3],
    },
    /// Too few renders to tell noise from difference.
    #[error("there are {} renders of one image and {} of the other: as many of both are needed, and at least {}", renders[0], renders[1], LEAST_RENDERS)]
    FewRenders {
        /// Of one, and of the other.
        renders: [usize; 2],
    },
    /// A block size that is no use.
    #[error("blocks of {}x{} pixels do not fit an image of {}x{}: use sides from 1 up to the image's", block[0], block[1], size[0], size[1])]
    Block {
        /// Width and height of a block.
        block: [u32; 2],
        /// Width and height of the image.
        size: [u32; 2],
    },
    /// A variance that is none.
    #[error("the variance is {value:?} at column {}, row {}: give finite variances of the reference, 0 or more", pixel[0], pixel[1])]
    Variance {
        /// Column and row of the first such pixel.
        pixel: [u32; 2],
        /// Its value.
        value: [f32; 3],
    },
    /// A way of looking at a display that is none.
    #[error("{value} pixels per degree of visual angle: use from 1 to 1000; 67 is usual")]
    PixelsPerDegree {
        /// Pixels per degree given.
        value: f64,
    },
    /// A target size that is empty or larger than the image.
    #[error("{}x{} cannot be averaged to {}x{}: each side must be from 1 up to the image's", size[0], size[1], target[0], target[1])]
    Target {
        /// Width and height of the image.
        size: [u32; 2],
        /// Width and height asked for.
        target: [u32; 2],
    },
}

/// A borrowed image: linear RGB, row by row from the top.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    size: [u32; 2],
    values: &'a [[f32; 3]],
}

impl<'a> Pixels<'a> {
    /// `size` is width and height; `values` are `size[0] * size[1]` pixels.
    ///
    /// # Errors
    /// [`Error::Empty`] where a side is 0, [`Error::PixelCount`] where the length is another.
    pub fn new(size: [u32; 2], values: &'a [[f32; 3]]) -> Result<Self, Error> {
        if size.contains(&0) {
            return Err(Error::Empty { size });
        }
        if u64::from(size[0]) * u64::from(size[1]) != values.len() as u64 {
            return Err(Error::PixelCount { size, found: values.len() });
        }
        Ok(Self { size, values })
    }

    /// Width and height.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The pixels, top row first.
    pub fn values(&self) -> &'a [[f32; 3]] {
        self.values
    }

    /// Column and row of a pixel.
    fn place(&self, index: usize) -> [u32; 2] {
        let width = self.size[0] as usize;
        [(index % width) as u32, (index / width) as u32]
    }

    /// Rows from the top.
    fn rows(&self) -> impl Iterator<Item = &'a [[f32; 3]]> {
        self.values.chunks_exact(self.size[0] as usize)
    }
}
