//! Scenes as plain data: description, effects, readers, image files and bundled scenes.
//!
//! A reader ([`read_any`], [`pbrt`], [`model`]) turns a file into a [`Scene`]. [`Effects::of`] reports the effects that
//! the scene calls for. This crate traces no rays: a renderer builds its world from the description.

/// The README, so that its example runs as a doc test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod bundled;
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
pub use effects::{Albedo, Called, Effect, Effects, UnknownEffect, WithoutError};
pub use readers::{READERS, read_any, read_any_from};
pub use scene_reader::{AnyOptions, Problem, ProblemKind, ReadError, SceneReader};
