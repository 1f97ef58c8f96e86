//! Filters from per-pixel statistics to an image.
//!
//! * [`Gaussian`]: a blur, right under unequal sample counts;
//! * [`ClusterGaussian`]: the same, kept within clusters of similar surfaces;
//! * [`NlMeans`]: means of pixels whose surroundings look alike, the weights of each half from the other;
//! * [`Bilateral`]: means of near pixels of a similar surface and colour;
//! * [`ClusterRegression`]: planes fitted over first-hit features, twice, and the best of what it and others make.
//!
//! [`relative_errors`] is what a sampler that follows a filter's own error asks for.
//!
//! Each is a [`Filter`](dapple_core::Filter): it reads a [`Film`](dapple_core::Film) and gives an image and,
//! where the film knows the variance, the variance that is left.
//!
//! ```
//! use dapple_core::{Film, Filter, Frame, Needs};
//! use dapple_denoise::{ClusterGaussian, Gaussian};
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
//! let kept = ClusterGaussian::from_map([8, 8], clusters)?.with_outside(0.0)?.apply(&film)?;
//! assert!((kept.radiance[27][0] - 0.125).abs() < 1e-6, "nothing crosses the edge");
//! # Ok::<(), dapple_core::Error>(())
//! ```
//!
//! # Guarantees
//!
//! * Filters act on per-pixel means: unequal counts do not move edges.
//! * A constant stays that constant, at borders and beside pixels without samples too.
//! * Each sum is taken by one task in a fixed order, and nothing is fused: the same bits for any number of threads, and on
//!   any machine.
//! * Pixels without samples are filled from their neighbours, and black with an infinite error where no
//!   sample is in reach.
//! * `NlMeans`, `Bilateral` and `ClusterRegression` are consistent: their bias vanishes as samples are added
//!   (`tests/reconstruction/consistency.rs`).
//!
//! # Limits
//!
//! What the two Gaussians blur is bias, which stays however many samples are spent, and is not in their
//! [`Filtered::error`](dapple_core::Filtered::error), which is variance only. The other three need two halves, whose
//! difference shows their whole error, bias included; that estimate is smoothed over 15x15 pixels.

// One file per filter; what several of them share is beside them.
mod averaging;
mod bilateral;
mod cluster_gaussian;
mod cluster_regression;
mod error_map;
mod gaussian;
mod membership;
mod nl_means;
mod planes;
mod prefilter;
mod regression;
mod separable;
mod source;
mod tile;
mod weights;

pub use bilateral::Bilateral;
pub use cluster_gaussian::{ClusterGaussian, ClusterLookup};
pub use cluster_regression::{ClusterRegression, Passes};
pub use error_map::relative_errors;
pub use gaussian::Gaussian;
pub use membership::BACKGROUND;
pub use nl_means::NlMeans;

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
