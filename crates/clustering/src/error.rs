//! Errors of [`crate::cluster`].

use crate::params::{MAX_ANGLE, MAX_CLAMP, MAX_K};

/// The reason why triangles cannot be clustered. Each message tells what to do.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// There are no triangles.
    #[error("there are no triangles to cluster: leave the mesh out, or give it at least one triangle")]
    Empty,
    /// There are more triangles than a `u32` can number.
    #[error("{triangles} triangles are more than can be numbered: cluster at most {} at a time", u32::MAX)]
    TooManyTriangles {
        /// The number of triangles.
        triangles: usize,
    },
    /// The number of materials is neither 0 nor that of the triangles.
    #[error("{materials} materials do not fit {triangles} triangles: give one each, or none where all are alike")]
    BadMaterials {
        /// The number of materials.
        materials: usize,
        /// The number of triangles.
        triangles: usize,
    },
    /// A corner is not a vertex.
    #[error(
        "triangle {triangle} refers to vertex {index} of {vertices}: indices count from 0 and stay below {vertices}"
    )]
    BadIndex {
        /// The index of the triangle.
        triangle: u32,
        /// The index of the missing vertex.
        index: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// A corner is infinite or NaN.
    #[error(
        "triangle {triangle} has a corner that is not finite (vertex {vertex}): correct the vertex or drop the triangle"
    )]
    BadPosition {
        /// The index of the triangle.
        triangle: u32,
        /// The index of the vertex.
        vertex: u32,
    },
    /// The factor K is out of range.
    #[error("K = {k} is out of range: give a number above 0 and at most {MAX_K} (pbrt-v2 has 3)")]
    BadK {
        /// The requested factor.
        k: f64,
    },
    /// The bound on voxels per axis is out of range.
    #[error("a clamp of {clamp} voxels per axis cannot be used: give 1 to {MAX_CLAMP}")]
    BadClamp {
        /// The requested bound.
        clamp: u32,
    },
    /// The angle is out of range.
    #[error("an angle of {angle} degrees is out of range: give 0 to {MAX_ANGLE} (the thesis has 10)")]
    BadAngle {
        /// The requested angle in degrees.
        angle: f64,
    },
    /// The requested number of clusters is 0.
    #[error("0 clusters cannot hold triangles: ask for at least 1")]
    BadCount,
    /// The boxes of the triangles overlap too many voxels.
    #[error(
        "the triangles' boxes overlap voxels {entries} times, more than the limit of {limit}: lower K or the clamp, or insert by centroid"
    )]
    TooManyEntries {
        /// The number of pairs of a triangle and a voxel that its box overlaps.
        entries: u64,
        /// The allowed number of pairs.
        limit: u64,
    },
}
