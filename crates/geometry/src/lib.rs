#![doc = include_str!("../README.md")]

mod build;
mod error;
mod geometry;
mod instance;
mod lanes;
mod leaf;
mod mesh;
mod motion;
mod moving_mesh;
mod pages;
mod prepared_ray;
mod ray;
pub mod safeguards;
mod shape;
mod surface;
mod traverse;
mod tree;
mod triangle;

#[cfg(test)]
mod tests;

pub use build::Preset;
pub use error::Error;
pub use geometry::Geometry;
pub use instance::{Instance, PlacedShape};
pub use mesh::Mesh;
pub use motion::Motion;
pub use moving_mesh::MovingMesh;
pub use ray::{Hit, PrimitiveId, Ray};
pub use shape::{Disk, Shape, Sphere};
pub use surface::{SurfacePoint, offset_origin, spawn_ray, spawn_ray_to, spawn_ray_to_point};
