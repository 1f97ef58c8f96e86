//! The renderer of Dapple: scene description, pbrt-v4 reader, camera, lights, materials, effects,
//! integrators, image files, and the registry of everything that can be chosen by name.
//!
//! A [`scene::Scene`] is plain data with the lines it came from; [`Effects::of`] says what it calls for;
//! [`World::new`] makes it ready for rays; [`integrator()`] gives the path tracer specialised for it, and
//! [`dapple_core::render`] does the rest.

/// The README's example is tested.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod blocks;
pub mod bundled;
pub mod camera;
mod clusters;
mod effects;
pub mod files;
pub mod image;
mod integrator;
pub mod light;
mod material;
pub mod medium;
pub mod memory;
pub mod model;
pub mod output;
pub mod pbrt;
pub mod pixel_filter;
pub mod ply;
mod polygon;
pub mod registry;
pub mod scene;
mod scene_file;
pub mod shading;
mod space;
mod texture;
mod world;

pub use clusters::{Stage, WorldClusters, WorldTriangles};
pub use effects::{Called, Effect, Effects, UnknownEffect};
pub use integrator::{
    AmbientOcclusion, FixedSelector, IntegratorEntry, IntegratorError, IntegratorParameters, LearnedSelector,
    LightSelector, PathTracer, code, integrator, integrator_with, integrators, make as make_integrator,
};
pub use material::{MaterialError, Surface};
pub use scene_file::{AnyOptions, read_any, read_any_from};
pub use space::Space;
pub use texture::Textures;
pub use world::{Emitter, Interaction, World, WorldError};
