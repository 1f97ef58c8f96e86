//! Denoising filters: from per-pixel statistics to an image and its error, correct under unequal sample counts.
//!
//! * [`Gaussian`]: a blur of the pixel means.
//! * [`ClusterGaussian`]: a blur of the pixel means, kept within clusters of similar surfaces.
//! * [`NlMeans`]: non-local means. The weights that filter one half of the samples come from the other half.
//! * [`Bilateral`]: a cross-bilateral filter over features, colours and clusters.
//! * [`ClusterRegression`]: passes of regression on features, selected by estimated error, and a small trained network.
//!
//! Features are normal, albedo, depth and position of the first non-specular surface, seen through mirrors, glass and smooth
//! coats. Clusters are those of the first hit.
//!
//! [`denoise`] and [`denoise_whole`] denoise buffers of any renderer, without a film. [`warnings_of`] lists likely mistakes in
//! a film.
//!
//! [`relative_errors`] turns a filter's error estimate into scores for an adaptive sampler.
//!
//! Each type is a [`Filter`](dapple_core::Filter). It reads a [`Film`](dapple_core::Film) and returns an image.
//! If the film recorded variance, it also returns the remaining error.
//!
//! ```
//! use dapple_core::{Film, Filter, Frame, Needs};
//! use dapple_denoise::{ClusterGaussian, ClusterGaussianOptions, Gaussian};
//!
//! // Dark on the left with four samples a pixel, bright on the right with two.
//! let mut film = Film::new(Frame::new(8, 8)?, Needs::none().with_variance());
//! for i in 0..64 {
//!     let bright = i % 8 >= 4;
//!     for sample in 0..if bright { 2 } else { 4 } {
//!         let noise = 0.25 * (sample % 2) as f32;
//!         film.push(i, 0, if bright { [1.0 + noise; 3] } else { [noise; 3] });
//!     }
//! }
//!
//! let blurred = Gaussian::default().apply(&film)?;
//! assert!(blurred.radiance[27][0] > 0.3, "the edge is soft");
//! let error = blurred.error.expect("the film has the variance");
//! assert!(error[27] < 0.2 * film.moments(27).variance().unwrap()[0] as f32 / 4.0);
//!
//! // The two sides are two clusters.
//! let clusters = (0..64).map(|i| u32::from(i % 8 >= 4)).collect();
//! let hard = ClusterGaussianOptions::default().outside(0.0);
//! let kept = ClusterGaussian::from_map([8, 8], clusters)?.with_options(hard)?.apply(&film)?;
//! assert!((kept.radiance[27][0] - 0.125).abs() < 1e-6, "nothing crosses the edge");
//! # Ok::<(), dapple_core::Error>(())
//! ```
//!
//! # Guarantees
//!
//! * Unequal sample counts do not move edges.
//! * A constant image stays unchanged, also at borders and beside pixels without samples.
//! * The result is bit-identical for any number of threads and on any machine. Each sum is computed by one task in a fixed
//!   order, without fused operations.
//! * Bright light sources seen directly stay in their pixels, if the film recorded their emission. Filters spread emission only
//!   up to a bound: 30 times the image's mean brightness, or more for lights of low contrast.
//! * `NlMeans`, `Bilateral` and `ClusterRegression` also keep radiance above 10^9 times the mean brightness in its pixel, so
//!   that none is lost.
//! * Pixels without samples are filled from their neighbours. If no sample is in reach, they are black with an infinite
//!   error.
//! * `NlMeans`, `Bilateral` and `ClusterRegression` are consistent: their bias vanishes as samples are added
//!   (`tests/denoise/consistency.rs`).
//!
//! # Limits
//!
//! The blur of the two Gaussians is bias, and no number of samples removes it. Their
//! [`Filtered::error`](dapple_core::Filtered::error) is the variance only.
//!
//! The other three filters need two halves of the samples. If all samples of a pixel lie in one half, as with one sample per
//! pixel, the other half is interpolated from the four neighbours. Lights may leak by one pixel there.
//! The difference between the halves shows the whole error, bias included. The estimate is smoothed over 7x7 pixels.

mod averaging;
mod buffers;
mod cells;
mod cluster_gaussian;
mod cluster_regression;
mod error_map;
mod features;
mod fireflies;
mod gaussian;
mod graph;
mod inputs;
mod light;
mod network;
mod normal_equations;
mod one_sample;
mod one_window;
mod planes;
mod regression;
mod tile;
mod wide;

pub use buffers::{Counts, Denoise, SampleBuffers, Variance, Warning, denoise, denoise_whole, warnings_of};
pub use cluster_gaussian::{ClusterGaussian, ClusterGaussianOptions};
pub use cluster_regression::{ClusterRegression, ClusterRegressionOptions};
pub use error_map::relative_errors;
pub use fireflies::FireflyLight;
pub use gaussian::{Gaussian, GaussianOptions};
pub use inputs::ClusterLookup;
pub use light::Layers;
pub use one_window::{Bilateral, BilateralOptions, NlMeans, NlMeansOptions};

/// Runs the README's example as a documentation test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;

#[cfg(test)]
#[path = "../tests/denoise/internals"]
mod internals {
    mod images;
    #[cfg(not(debug_assertions))]
    mod kernels;
    mod network;
    mod parts;
}
