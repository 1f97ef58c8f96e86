//! One render, from its description to its image and files.
//!
//! * [`registry`]: samplers, point sets and filters by name, made for a world.
//! * [`WorldClusters`]: the clusters (groups of neighbouring triangles) of a world (a scene built for tracing), for
//!   samplers and filters that use clusters.
//! * [`output`]: the layers of an OpenEXR file, and maps.
//! * [`memory`]: estimates of the memory of scenes, worlds and renders.
//! * [`checkpoint`]: files that stay complete in a crash.
//! * [`denoise`]: images of any renderer, from OpenEXR files.

/// Runs the README's examples as documentation tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod checkpoint;
mod clusters;
pub mod denoise;
mod error;
mod files;
mod job;
mod load;
pub mod memory;
pub mod output;
pub mod registry;
mod spec;
mod warning;

pub use clusters::{WorldClusters, WorldTriangles};
pub use dapple_registry::{DEFAULT_FILTER, DEFAULT_POINTS, DEFAULT_SAMPLER};
pub use error::JobError;
pub use files::{ContentHash, read_text};
pub use job::{
    CheckpointOptions, Checkpoints, Job, JobMonitor, PhaseSeconds, PlanFile, RenderMonitor, RenderedImage, RowsFiles,
    Traced, pixel_filter,
};
pub use load::{LoadOptions, LoadedScene, PreparedScene, check_integrator};
pub use output::OutputFiles;
pub use spec::{
    BudgetSpec, CropSpec, DEFAULT_INTEGRATOR, DEFAULT_SPP, ERROR_SPP, ErrorOf, MOST_SECONDS, PixelFilterSpec,
    RenderSpec, SPEC_VERSION, Shard, SpecError,
};
pub use warning::{Warning, can_be_replayed, found_by_chance};
