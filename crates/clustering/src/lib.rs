//! Clusters of a scene's triangles by position, material and normal: plain slices in, clusters out.
//!
//! An image is hard to sample where many small clusters fall into one pixel. Clustering finds such pixels from the geometry
//! before rendering. The crate implements the method of \[Lan 2016\] as published, and an improved form of it.
//!
//! ```
//! use dapple_clustering::{ClusterParams, Triangles, cluster};
//!
//! // A unit square of two triangles on the floor, and a triangle that leans against it.
//! let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 1.0, 1.0]];
//! let indices = [[0, 1, 2], [0, 2, 3], [3, 2, 4]];
//! let triangles = Triangles::new(&positions, &indices);
//!
//! // One voxel for all; by default K N^(1/3) along the longest axis.
//! let clusters = cluster(&triangles, &ClusterParams { clamp: 1, ..ClusterParams::default() })?;
//! assert_eq!(clusters.labels(), [0, 0, 1]);
//! assert_eq!(clusters.members(0), [0, 1]);
//! let floor = clusters.clusters()[0];
//! assert_eq!((floor.area, floor.normal), (1.0, [0.0, 0.0, 1.0]));
//! assert_eq!(clusters.report().occupied, 1);
//! # Ok::<(), dapple_clustering::Error>(())
//! ```
//!
//! # The published method
//!
//! [`ClusterParams::published`] is the method of the thesis, as in its code:
//!
//! 1. A uniform grid over all triangles has K N^(1/3) voxels along its longest axis, at most 32 \[Lan 2016, eq. 3-1,
//!    3-2, fig. 3-11\]. The formula follows pbrt-v2, which has K = 3 and at most 64 voxels.
//! 2. Each triangle goes into every voxel that its box overlaps ([`Insertion::BoundingBox`]).
//! 3. In each voxel, triangles are visited in input order ([`Order::Input`]). A triangle joins the first cluster whose first
//!    triangle has the same material and a normal within A = 10 degrees. If there is none, the triangle starts a new cluster
//!    ([`Grouping::Greedy`]) \[Lan 2016, fig. 3-15\].
//! 4. Each triangle stores one cluster: that of its last voxel.
//!
//! Tests confirm the consequences:
//!
//! * The clamp makes K almost irrelevant ([`ClusterParams::k`]).
//! * Step 4 leaves clusters without triangles ([`ClusterReport::phantoms`]).
//! * A different order of triangles gives different clusters, though the same groups of voxel and material
//!   ([`Cluster::group`]).
//! * A flipped winding splits a surface in two.
//!
//! The published method takes O(n c) time for a voxel with n triangles in c clusters.
//!
//! The thesis leaves two rules open. Here, a triangle without a normal joins the first cluster of its voxel and
//! material (see [`cluster`]). The bounds, area and normal of a cluster are computed from the triangles that keep it.
//!
//! # Improvements
//!
//! [`ClusterParams::default`] puts a triangle only into the voxel of its centroid, visits triangles in the order of their
//! normals ([`Order::Canonical`]) and treats both sides alike. Labels then depend only on the set of triangles: shuffled
//! triangles keep their labels.
//!
//! [`Grouping::Connected`] splits clusters into connected pieces, so that two sheets in one voxel are two clusters. The thesis
//! mentions this improvement in section 3.2.2. Union-find takes near-linear time. All triangles of a piece are within A of one
//! triangle's normal, so the normals of a curved strip cannot drift. Pieces end at voxel faces.
//!
//! [`ClusterParams::for_count`] searches for the grid that gives about a given number of clusters.
//!
//! # Guarantees
//!
//! * The result is bit-identical for any number of threads. It does not depend on hashing order, time or addresses.
//! * Memory is O(triangles + vertices) for any grid: voxels are sorted, not stored.
//! * Positions are finite `f32` of any size. Scaling a scene by a power of two changes no label, unless a coordinate is
//!   rounded.
//! * Other factors round coordinates. Centroids up to four rounding errors below a voxel's face count as on it, so regular
//!   meshes, whose centroids lie on faces, keep their voxels. Triangles exactly at the angle limit may change clusters.
//! * Permuting axes permutes voxels. Clusters of curved surfaces may change, since normals are ordered by z first.

mod clusters;
mod params;
#[cfg(feature = "cluster")]
mod partition;

pub use clusters::{Cluster, ClusterReport};
pub use params::{ClusterParams, Connection, Error, Grouping, Insertion, Order, Sides};
#[cfg(feature = "cluster")]
pub use partition::{Clusters, cluster};

/// The triangles to cluster, as plain slices.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Triangles<'a> {
    /// The positions of the vertices. Unused vertices may have any value.
    pub positions: &'a [[f32; 3]],
    /// For each triangle, the indices of its three vertices in `positions`.
    pub indices: &'a [[u32; 3]],
    /// The material number of each triangle; empty if all triangles have the same material.
    pub materials: &'a [u32],
}

impl<'a> Triangles<'a> {
    /// Creates a set of triangles of one material from vertex positions and three vertex indices per triangle.
    pub const fn new(positions: &'a [[f32; 3]], indices: &'a [[u32; 3]]) -> Self {
        Self { positions, indices, materials: &[] }
    }

    /// Sets the material number of each triangle; with an empty slice, all triangles have the same material.
    pub const fn with_materials(self, materials: &'a [u32]) -> Self {
        Self { materials, ..self }
    }
}

/// Runs the README's example as a documentation test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
