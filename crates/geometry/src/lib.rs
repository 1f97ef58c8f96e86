#![doc = include_str!("../README.md")]

mod build;
mod bvh;
mod geometry;
mod huge_pages;
mod instance;
mod lanes;
mod leaf;
mod mesh;
mod motion;
mod ray;
mod shape;
mod traverse;
mod triangle;

#[cfg(test)]
mod tests;

pub use geometry::Geometry;
pub use instance::{Instance, PlacedShape};
pub use mesh::{Mesh, MovingMesh};
pub use motion::Motion;
pub use ray::{Hit, PrimitiveId, Ray, SurfacePoint, offset_origin, spawn_ray, spawn_ray_to, spawn_ray_to_point};
pub use shape::{Disk, Shape, Sphere};

/// The reason why shapes, motions or instances were rejected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A corner of a triangle is NaN or infinite.
    #[error("vertex {vertex} of triangle {triangle} is not finite; correct the vertex, or remove the triangle")]
    NonFinite {
        /// The triangle's index in its mesh.
        triangle: u32,
        /// The vertex's index in its mesh.
        vertex: u32,
    },
    /// A coordinate or a whole shape is too large or too small for exact ray intersections.
    #[error("{what} is {value:e}, outside of the range from 1e-18 to 5e17; scale the scene by a power of two")]
    ScaleOutOfRange {
        /// The name of the quantity that is out of range, such as "a mesh's largest coordinate".
        what: &'static str,
        /// The value of the quantity, in scene units.
        value: f64,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error(
        "triangle {triangle} refers to vertex {vertex}, but vertex indices must be below {vertices}; correct the index"
    )]
    IndexOutOfRange {
        /// The triangle's index in its mesh.
        triangle: u32,
        /// The index of the missing vertex.
        vertex: u32,
        /// The number of vertices of the mesh. Indices must be below it.
        vertices: usize,
    },
    /// A parameter of a shape, a motion or an instance is invalid.
    #[error("{what} is {value}; {expected}")]
    BadParameter {
        /// The name of the parameter, such as "a sphere's radius".
        what: &'static str,
        /// The invalid value of the parameter.
        value: f64,
        /// The requirement on the parameter, as a clause for the error message.
        expected: &'static str,
    },
    /// There are more triangles, shapes, primitives or instances than can be numbered.
    #[error("{count} {what} are too many; use fewer than {limit}, or split the scene")]
    TooMany {
        /// The name of the things counted, such as "shapes".
        what: &'static str,
        /// The number of things given.
        count: usize,
        /// The limit: the number of things must be below it.
        limit: usize,
    },
    /// An instance refers to an object that does not exist.
    #[error(
        "instance {instance} refers to object {object}, but object indices must be below {objects}; correct the index"
    )]
    NoSuchObject {
        /// The index of the instance in the list of instances.
        instance: u32,
        /// The index of the missing object in the list of objects.
        object: u32,
        /// The number of objects. Indices must be below it.
        objects: usize,
    },
    /// An object of an instance contains instances itself, which is not supported.
    #[error("object {object} contains instances, but instances cannot be nested; put them into the scene")]
    Nested {
        /// The index of the object in the list of objects.
        object: u32,
    },
}

impl Error {
    /// Returns [`Error::BadParameter`] unless a parameter meets its requirement.
    pub(crate) fn unless(met: bool, what: &'static str, value: f64, expected: &'static str) -> Result<(), Self> {
        if met { Ok(()) } else { Err(Self::BadParameter { what, value, expected }) }
    }

    /// Returns [`Error::TooMany`] unless `count` is below `limit`.
    pub(crate) fn too_many(what: &'static str, count: usize, limit: usize) -> Result<(), Self> {
        if count < limit { Ok(()) } else { Err(Self::TooMany { what, count, limit }) }
    }

    /// Returns [`Error::ScaleOutOfRange`] unless a magnitude is between `least` and the largest one allowed.
    pub(crate) fn out_of_range(what: &'static str, value: f64, least: f32) -> Result<(), Self> {
        let range = f64::from(least)..=f64::from(mesh::LARGEST);
        if range.contains(&value) { Ok(()) } else { Err(Self::ScaleOutOfRange { what, value }) }
    }
}
