//! What every Dapple point set, sampler and filter must pass: a dev-dependency of one line.
//!
//! Each function panics with a message that says which promise was broken, where, and by how much; put
//! it into a `#[test]`. All inputs are fixed, so a check that passes once passes always.
//!
//! ```
//! # use dapple_core::{PointSet, SampleId};
//! # struct MyPoints;
//! # impl PointSet for MyPoints {
//! #     fn describe(&self) -> String { "mine:seed=1".into() }
//! #     fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
//! #         let mut z = (id.pixel[0] as u64) << 32 ^ id.pixel[1] as u64 ^ (id.stream as u64) << 60;
//! #         for w in [id.index, block as u64, 1, 2] {
//! #             z = (z ^ w ^ z >> 31).wrapping_mul(0xbf58476d1ce4e5b9);
//! #             z = (z ^ z >> 30).wrapping_mul(0x94d049bb133111eb);
//! #         }
//! #         let mut next = || { z = (z ^ z >> 27).wrapping_mul(0x94d049bb133111eb); (z >> 40) as f32 / 16777216.0 };
//! #         [next(), next(), next(), next()]
//! #     }
//! #     fn capacity(&self) -> u64 { u64::MAX }
//! # }
//! // #[test]
//! fn conforms() {
//!     dapple_conformance::point_set(&MyPoints);
//! }
//! # conforms();
//! ```

mod filter;
mod point_set;
mod sampler;
pub mod statistics;

pub use filter::{filter, filter_on_frames};
pub use point_set::point_set;
pub use sampler::{Spending, bits, sampler, sampler_on_frames, threshold_sampler};
