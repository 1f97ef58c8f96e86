#![doc = include_str!("../README.md")]

mod build;
mod error;
mod frame;
mod geometry;
mod lanes;
mod mesh;
mod ray;
mod shape;
mod surface;
mod traverse;
mod triangle;

#[cfg(test)]
mod tests;

pub use build::Preset;
pub use error::Error;
pub use geometry::Geometry;
pub use mesh::Mesh;
pub use ray::{Hit, PrimitiveId, Ray};
pub use shape::{Disk, Shape, Sphere};
pub use surface::{SurfacePoint, offset_origin, spawn_ray, spawn_ray_to, spawn_ray_to_point};
