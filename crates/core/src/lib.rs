//! The one plug of Dapple: where samples lie, how many each pixel gets, what one sample is worth,
//! and what becomes of them.
//!
//! Four roles, each a trait with one required idea:
//!
//! * [`PointSet`]: where samples lie, a pure function of (pixel, stream, index, block);
//! * [`Sampler`]: which points, and how many of them each pixel gets, decided between rounds;
//! * [`Integrator`]: estimates a pixel from one sample's coordinates;
//! * [`Filter`]: makes an image from the [`Film`].
//!
//! [`Render`] drives them: round, barrier, round, … until the [`Limits`] are met. This crate knows no
//! geometry, no colour file and no scene; everything public speaks in `[f32; 3]`, slices and ids.
//!
//! # Guarantees
//!
//! * The image does not depend on the number of threads, on tiles, or on how a round was cut.
//! * Sample counts add up to the budget exactly, or an [`Error`] says why they cannot.
//! * A non-finite or negative sample is rejected, counts as zero and in `n`, and can be replayed.
//!
//! # Limits
//!
//! Dapple is not a sampler of arbitrary densities and has no cursor to draw "the next number" from:
//! every use of randomness names its [`Block`].

mod allocate;
mod draws;
mod error;
mod film;
mod filter;
mod frame;
mod integrator;
mod limits;
mod memory;
mod moments;
mod needs;
mod plan;
mod point_set;
mod policy;
mod render;
mod sampler;
pub mod samplers;
mod shard;
mod snapshot;

pub use allocate::{Allocation, allocate, allocate_on_ladder, ladder_floor, ladder_next, share};
pub use draws::{Block, Draws};
pub use error::Error;
pub use film::{Features, Film, Record, Rejected, RejectedReason, RoundRecord, luminance};
pub use filter::{Filter, Filtered, Unfiltered};
pub use frame::Frame;
pub use integrator::{Estimate, FirstHit, Integrator, TrainingData, TrainingLog, TrainingSum};
pub use limits::{Budget, InvalidSample, Limits, Schedule};
pub use memory::{FilterMemory, Memory, SamplerMemory};
pub use moments::{Moments, RgbMoments};
pub use needs::Needs;
pub use plan::{Combine, Plan, Progress, Retention};
pub use point_set::{PointSet, SampleId, streams};
pub use policy::{PilotPolicy, Stopping};
pub use render::{Control, Monitor, NoMonitor, Render, Status};
pub use sampler::{BudgetLeft, Feedback, Sampler};
pub use shard::{Shard, ShardFilm, Sharded, merge};
pub use snapshot::Snapshot;

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
