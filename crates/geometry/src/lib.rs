#![doc = include_str!("../README.md")]

mod build;
mod bvh;
mod error;
mod geometry;
mod huge_pages;
mod instance;
mod lanes;
mod leaf;
mod mesh;
mod motion;
mod ray;
mod shape;
mod surface;
mod traverse;
mod triangle;

#[cfg(test)]
mod tests;

pub use error::Error;
pub use geometry::Geometry;
pub use instance::{Instance, PlacedShape};
pub use mesh::{Mesh, MovingMesh};
pub use motion::Motion;
pub use ray::{Hit, PrimitiveId, Ray};
pub use shape::{Disk, Shape, Sphere};
pub use surface::{SurfacePoint, offset_origin, spawn_ray, spawn_ray_to, spawn_ray_to_point};
