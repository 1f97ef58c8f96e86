//! Scenes as plain data: description, effects, readers, image files and bundled scenes.
//!
//! A reader ([`read_any`], [`pbrt`], [`model`]) turns a file into a [`Scene`]. [`Effects::of`] reports the effects that the
//! scene calls for. Nothing here traces a ray: a renderer builds from the description what it needs.

/// The README's example is tested.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod bundled;
mod description;
mod effects;
pub mod files;
pub mod image;
pub mod model;
pub mod pbrt;
pub mod ply;
mod polygon;
mod scene_file;

pub use description::*;
pub use effects::{Called, Effect, Effects, UnknownEffect};
pub use scene_file::{AnyOptions, read_any, read_any_from};
