//! Errors of [`crate::cluster`].

use crate::params::{MAX_ANGLE, MAX_CLAMP, MAX_K};

/// The reason why triangles cannot be clustered. Each message states the remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// There are no triangles.
    #[error("there are no triangles to cluster: leave the mesh out, or give it at least one triangle")]
    Empty,
    /// There are more triangles than a `u32` can number.
    #[error("{triangles} triangles are more than can be numbered: cluster at most {} at a time", u32::MAX)]
    TooManyTriangles {
        /// The number of triangles passed.
        triangles: usize,
    },
    /// The number of materials is neither 0 nor the number of triangles.
    #[error("{materials} materials do not fit {triangles} triangles: give one each, or none where all are alike")]
    BadMaterials {
        /// The number of materials passed.
        materials: usize,
        /// The number of triangles passed.
        triangles: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error(
        "triangle {triangle} refers to vertex {index} of {vertices}: indices count from 0 and stay below {vertices}"
    )]
    BadIndex {
        /// The index of the triangle with the missing vertex.
        triangle: u32,
        /// The index of the missing vertex.
        index: u32,
        /// The number of vertices passed.
        vertices: usize,
    },
    /// A triangle has a corner with an infinite or NaN coordinate.
    #[error(
        "triangle {triangle} has a corner that is not finite (vertex {vertex}): correct the vertex or drop the triangle"
    )]
    BadPosition {
        /// The index of the triangle with the bad corner.
        triangle: u32,
        /// The index of the vertex at that corner.
        vertex: u32,
    },
    /// The factor K ([`ClusterParams::k`](crate::ClusterParams::k)) is not above 0, or is above 2^20.
    #[error("K = {k} is out of range: give a number above 0 and at most {} (pbrt-v2 has 3)", MAX_K)]
    BadK {
        /// The requested factor K.
        k: f64,
    },
    /// The bound on voxels per axis is 0 or above 2^20.
    #[error("a clamp of {clamp} voxels per axis cannot be used: give 1 to {}", MAX_CLAMP)]
    BadClamp {
        /// The requested bound on voxels per axis.
        clamp: u32,
    },
    /// The angle within which normals are alike is not within 0 to 90 degrees.
    #[error("an angle of {angle} degrees is out of range: give 0 to {} (the thesis has 10)", MAX_ANGLE)]
    BadAngle {
        /// The requested angle in degrees.
        angle: f64,
    },
    /// The requested number of clusters is 0.
    #[error("0 clusters cannot hold triangles: ask for at least 1")]
    BadCount,
    /// The bounding boxes of the triangles overlap too many voxels in all.
    #[error(
        "the triangles' boxes overlap voxels {entries} times, more than the limit of {limit}: lower K or the clamp, or \
         insert by centroid"
    )]
    TooManyEntries {
        /// The number of pairs of a triangle and a voxel that its box overlaps.
        entries: u64,
        /// The largest allowed number of such pairs.
        limit: u64,
    },
}
