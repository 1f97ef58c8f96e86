//! The renderer of Dapple: scene description, pbrt-v4 reader, camera, lights, materials, effects,
//! integrators, image files.
//!
//! A [`dapple_scene::Scene`] is plain data with the lines it came from; [`Effects::of`](dapple_scene::Effects::of) says what it calls for;
//! [`World::new`] makes it ready for rays; [`integrator()`] gives the path tracer specialised for it, and
//! [`dapple_core::render`] does the rest.

/// The README's example is tested.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod blocks;
pub mod camera;
mod integrator;
pub mod light;
mod material;
pub mod medium;
pub mod pixel_filter;
pub mod shading;
mod space;
mod texture;
mod without;
mod world;

pub use integrator::{PathTracer, code, integrator, integrator_with};
pub use material::{MaterialError, Surface};
pub use space::Space;
pub use texture::Textures;
pub use without::without;
pub use world::{Emitter, World, WorldError};
