//! One render, from its description to its image.
//!
//! * [`registry`]: samplers, point sets and filters by name.
//! * [`WorldClusters`]: the clusters of a world, for samplers and filters that use them.
//! * [`output`]: the layers of an OpenEXR file, and maps.
//! * [`memory`]: estimates of the memory of scenes and worlds.
//! * [`checkpoint`]: files that survive a crash.

/// Runs the examples of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod checkpoint;
mod clusters;
pub mod memory;
pub mod output;
pub mod registry;

pub use clusters::{Stage, WorldClusters, WorldTriangles};
