//! The example renderer of Dapple: cameras, lights, materials, media and integrators.
//!
//! [`World::new`] prepares a [`dapple_scene::Scene`] for ray tracing and records its
//! [`Effects`](dapple_scene::Effects). [`integrator()`] returns the path tracer compiled for these effects, and
//! [`make_integrator`] makes any integrator by name. [`dapple_core::Render`] renders images with an integrator.

/// The README, whose example is compiled and run as a test.
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
mod scene_error;
pub mod shading;
mod space;
mod texture;
mod without;
mod world;

pub use integrator::{
    AmbientOcclusion, AmbientOcclusionOptions, CERTAIN_LOBE, FixedSelector, GatherPoint, IntegratorEntry,
    IntegratorError, LearnedSelector, LightSelector, MakeError, MakeIntegrator, NoVertexLight, PathTracer, RARE_LOBE,
    VertexLight, check as check_integrator, check_among as check_integrator_among, code, integrator, integrator_with,
    integrators, make as make_integrator, make_among as make_integrator_among, path_tracer_with,
};
pub use material::{MaterialError, Surface};
pub use scene_error::SceneError;
pub use space::Space;
pub use texture::Textures;
pub use without::without;
pub use world::{Emitter, Interaction, Lanes, SampleDimensions, World, WorldError};
