#![doc = include_str!("../README.md")]
//!
//! A reader ([`read_any`], [`pbrt`], [`model`]) turns a file into a [`Scene`]. [`Effects::of`] lists its effects.

pub mod bundled;
mod colorimetry;
mod description;
mod effects;
pub mod files;
mod gltf;
pub mod image;
pub mod model;
pub mod pbrt;
mod polygon;
mod readers;
mod scene_reader;
pub mod text;

pub use description::*;
pub use effects::{Albedo, CalledEffect, Effect, Effects, UnknownEffect, WithoutError};
pub use readers::{READERS, read_any, read_any_from};
pub use scene_reader::{AnyOptions, Problem, ProblemKind, ReadError, SceneReader};
