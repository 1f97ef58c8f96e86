#![doc = include_str!("../README.md")]
//!
//! [`RenderSpec`], [`Job`], [`registry`], [`output`], [`memory`], [`checkpoint`], [`denoise`].

pub mod checkpoint;
mod clusters;
pub mod denoise;
mod error;
mod files;
mod job;
mod load;
pub mod memory;
pub mod output;
mod part;
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
pub use part::PartNumber;
pub use spec::{
    BudgetSpec, CropSpec, DEFAULT_INTEGRATOR, DEFAULT_SPP, ERROR_SPP, ErrorOf, MOST_SECONDS, PixelFilterSpec,
    RenderSpec, SPEC_VERSION, SpecError,
};
pub use warning::{Warning, can_be_replayed, found_by_chance};
