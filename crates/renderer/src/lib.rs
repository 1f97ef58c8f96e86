#![doc = include_str!("../README.md")]
//!
//! [`World::new`] prepares a scene, [`integrator()`] returns the path tracer for it, and [`make_integrator`] makes an
//! integrator by name.

#[cfg(test)]
extern crate self as dapple_renderer;

pub mod blocks;
pub mod camera;
mod integrator;
pub mod light;
mod material;
pub mod medium;
pub mod pixel_filter;
pub mod shading;
mod space;
#[cfg(test)]
#[path = "../tests/renderer/support.rs"]
mod support;
mod texture;
mod world;

pub use integrator::{
    AmbientOcclusion, AmbientOcclusionOptions, FixedSelector, GatherPoint, IntegratorEntry, IntegratorError,
    LearnedSelector, LightSelector, MakeError, MakeIntegrator, NoVertexLight, PathTracer, VertexLight,
    check_among as check_integrator_among, code, integrator, integrator_with, integrators, make as make_integrator,
    make_among as make_integrator_among, path_tracer_with,
};
pub use material::{MaterialError, Surface, without};
pub use space::Space;
pub use texture::{TexturePoint, Textures};
pub use world::{BlockDimensions, Emitter, Interaction, SampleDimensions, SceneError, World, WorldError};
