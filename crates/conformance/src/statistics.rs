//! Statistical tests of claims about images, in one place for all crates.
//!
//! | claim | test |
//! |---|---|
//! | a mean has its expectation | [`Mean::against`], [`Mean::against_estimate`] |
//! | two images have the same expectation | [`images`], [`image`] |
//! | samples follow their density | [`chi_square`], [`integrate`] |
//! | a mean is *proven* close to a value | [`Mean::equals`], [`decide`], [`samples_needed`] |
//! | one of two methods has less error at equal budget | `ratio_interval` and `log_log_fit` of dapple-metrics |
//! | spreads are equal, error estimates are calibrated | [`brown_forsythe`], [`Calibration`] |
//! | adaptive counts do not bias the image | [`kept`], [`refined`], [`Bernoulli`], [`Naive`], [`count_trend`] |
//! | two images are the same bits | [`bits`](crate::bits), and the checks of samplers and filters |
//!
//! Seeds are fixed. A family of tests raises a false alarm with probability [`FAMILY`] at most: each test runs at the
//! level [`sidak`], or p-values are [`adjusted`]. [`power`] computes the probability that a test detects a given fault.
//! Assert it, since a test that cannot fail proves nothing.
//!
//! Compute variances *between* replicates that have seeds of their own. Samples within one low-discrepancy or adaptive
//! image are not independent.
//!
//! ```
//! use dapple_conformance::statistics::{FAMILY, Mean, sidak};
//!
//! // 32 replicates of an estimate whose expectation is 1/2.
//! let replicates: Mean = (0..32).map(|i| 0.5 + 0.01 * f64::from(i % 8 - 4) + 0.005).collect();
//! let test = replicates.against(0.5);
//! assert!(test.p() > sidak(FAMILY, 100));
//! ```
//!
//! # Panics
//!
//! All functions panic on invalid input, such as lengths that differ or fewer than two replicates.

mod adaptive;
mod chi_square;
mod image;
mod levels;
mod mean;
mod spread;

pub use adaptive::{Bernoulli, Naive, Pixels, count_trend, image_mean, kept, refined};
pub use chi_square::{chi_square, integrate};
pub use image::{ImageTest, image, images};
pub use levels::{FAMILY, adjusted, critical, normal_tail, power, sidak, student_tail, two_sided};
pub use mean::{Decided, Mean, MeanTest, Verdict, decide, samples_needed};
pub use spread::{Calibration, brown_forsythe};
