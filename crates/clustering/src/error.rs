//! What [`crate::cluster`] refuses.

use crate::params::{MAX_ANGLE, MAX_CLAMP, MAX_K};

/// Why triangles cannot be clustered. Each message says what to do.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// No triangles at all.
    #[error("there are no triangles to cluster: leave the mesh out, or give it at least one triangle")]
    Empty,
    /// More triangles than a `u32` can number.
    #[error("{triangles} triangles are more than can be numbered: cluster at most {} at a time", u32::MAX)]
    TooManyTriangles {
        /// Triangles given.
        triangles: usize,
    },
    /// Materials for some of the triangles only, or for more than there are.
    #[error("{materials} materials do not fit {triangles} triangles: give one each, or none where all are alike")]
    BadMaterials {
        /// Materials given.
        materials: usize,
        /// Triangles given.
        triangles: usize,
    },
    /// A corner that is no vertex.
    #[error(
        "triangle {triangle} asks for vertex {index} of {vertices}: indices count from 0 and stay below {vertices}"
    )]
    BadIndex {
        /// Number of the triangle.
        triangle: u32,
        /// The vertex it asks for.
        index: u32,
        /// Vertices given.
        vertices: usize,
    },
    /// A corner at infinity or nowhere.
    #[error(
        "triangle {triangle} has a corner that is not finite (vertex {vertex}): mend the vertex or drop the triangle"
    )]
    BadPosition {
        /// Number of the triangle.
        triangle: u32,
        /// Number of the vertex.
        vertex: u32,
    },
    /// A factor K that asks for no voxels, or for far too many.
    #[error("K = {k} cannot be used: give a number above 0 and up to {MAX_K} (pbrt-v2 has 3)")]
    BadK {
        /// Factor asked for.
        k: f64,
    },
    /// A bound on voxels per axis that leaves none, or more than `f32` positions can tell apart.
    #[error("a clamp of {clamp} voxels per axis cannot be used: give 1 to {MAX_CLAMP}")]
    BadClamp {
        /// Bound asked for.
        clamp: u32,
    },
    /// An angle that is none between directions of one side.
    #[error("an angle of {angle} degrees cannot be used: give 0 to {MAX_ANGLE} (the thesis has 10)")]
    BadAngle {
        /// Angle asked for, in degrees.
        angle: f64,
    },
    /// No clusters asked for.
    #[error("0 clusters cannot hold triangles: ask for at least 1")]
    BadCount,
    /// Boxes that overlap too many voxels.
    #[error(
        "the triangles' boxes overlap voxels {entries} times, at most {limit} fit: lower K or the clamp, or insert by centroid"
    )]
    TooManyEntries {
        /// Pairs of a triangle and a voxel its box overlaps.
        entries: u64,
        /// Pairs allowed.
        limit: u64,
    },
}
