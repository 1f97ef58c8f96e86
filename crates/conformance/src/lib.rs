//! Conformance tests for every Dapple point set, sampler and filter: a dev-dependency of one line.
//!
//! Each function panics if a check fails, with a message that names the broken property, where it fails and by how
//! much. Call it in a `#[test]`. All inputs are fixed, so a test that passes once always passes.
//!
//! ```
//! use dapple_conformance::{filter, point_set, sampler};
//! use dapple_core::samplers::Uniform;
//! use dapple_core::{PointSet, SampleId, Unfiltered};
//!
//! /// Independent random numbers: a hash of the sample's name.
//! struct MyPoints;
//!
//! impl PointSet for MyPoints {
//!     fn describe(&self) -> String {
//!         "mine:seed=1".into()
//!     }
//!
//!     fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
//! #       let mut z = (id.pixel[0] as u64) << 32 ^ id.pixel[1] as u64 ^ (id.stream as u64) << 60;
//! #       for w in [id.index, block as u64, 1, 2] {
//! #           z = (z ^ w ^ z >> 31).wrapping_mul(0xbf58476d1ce4e5b9);
//! #           z = (z ^ z >> 30).wrapping_mul(0x94d049bb133111eb);
//! #       }
//! #       let mut next = || { z = (z ^ z >> 27).wrapping_mul(0x94d049bb133111eb); (z >> 40) as f32 / 16777216.0 };
//! #       /*
//!         // …
//! #       */
//! #       [next(), next(), next(), next()]
//!     }
//!
//!     fn capacity(&self) -> u64 {
//!         u64::MAX
//!     }
//! }
//!
//! // #[test]
//! fn my_points_conform() {
//!     point_set(&MyPoints);
//! }
//!
//! // #[test]
//! fn my_sampler_conforms() {
//!     sampler(|| Box::new(Uniform::new(MyPoints)));
//! }
//!
//! // #[test]
//! fn my_filter_conforms() {
//!     filter(|| Box::new(Unfiltered));
//! }
//! # my_points_conform();
//! # my_filter_conforms();
//! ```
//!
//! [`statistics`] holds tests of claims about images: means, equal images, densities, calibration and bias. [`toys`] has simple
//! point sets, integrators, samplers and filters for tests.
//!
//! # Limits
//!
//! * The tests do not measure how well a point set is stratified, or how much error a sampler or filter saves.
//! * They check properties on synthetic images of at most 20x35 pixels, not on scenes.

mod filter;
mod point_set;
mod sampler;
pub mod statistics;
pub mod toys;

pub use filter::{filter, filter_on_frames, filter_within};
pub use point_set::point_set;
pub use sampler::{Spending, bits, on_threads, sampler, sampler_on_frames, threshold_sampler};

/// The README's example, run as a doctest.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
