//! Groups a scene's triangles by place, material and normal: plain slices in, clusters out.
//!
//! A sampler that wants to know before rendering where an image is hard can look at geometry alone: where many small
//! clusters crowd a pixel, it is. The method is that of \[Lan 2016\], and this crate has it as published and mended.
//!
//! ```
//! use dapple_clustering::{Params, Triangles, cluster};
//!
//! // A unit square of two triangles on the floor, and one that leans against it.
//! let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 1.0, 1.0]];
//! let indices = [[0, 1, 2], [0, 2, 3], [3, 2, 4]];
//! let triangles = Triangles { positions: &positions, indices: &indices, materials: &[] };
//!
//! // One voxel for all; by default K N^(1/3) along the longest axis.
//! let clusters = cluster(&triangles, &Params { clamp: 1, ..Params::default() })?;
//! assert_eq!(clusters.labels(), [0, 0, 1]);
//! assert_eq!(clusters.members(0), [0, 1]);
//! let floor = clusters.clusters()[0];
//! assert_eq!((floor.area, floor.normal), (1.0, [0.0, 0.0, 1.0]));
//! assert_eq!(clusters.report().occupied, 1);
//! # Ok::<(), dapple_clustering::Error>(())
//! ```
//!
//! # What was published
//!
//! [`Params::published`] is the thesis' method as its code has it:
//!
//! 1. A uniform grid over all triangles, K N^(1/3) voxels along its longest axis, at most 32 \[Lan 2016, eq. 3-1, 3-2,
//!    fig. 3-11\], after pbrt-v2's, which has K = 3 and at most 64.
//! 2. Each triangle goes into every voxel that its box overlaps ([`Insertion::BoundingBox`]).
//! 3. In each voxel, in input order ([`Order::Input`]), a triangle joins the first cluster whose first triangle has the same
//!    material and a normal within A = 10 degrees, or else opens one ([`Grouping::Greedy`]) \[Lan 2016, fig. 3-15\].
//! 4. A triangle stores one cluster, and so keeps that of the last voxel it was put into.
//!
//! What follows from that is tested: the clamp makes K almost meaningless ([`Params::k`]); step 4 leaves clusters without
//! triangles ([`Report::phantoms`]); another order of triangles makes other clusters, though the same groups of voxel and
//! material ([`Cluster::group`]); a flipped winding cuts a surface in two. Published clusters take O(n c) time for n
//! triangles of a voxel in c clusters.
//!
//! Ours are the rules the thesis leaves open: triangles without a normal (see [`cluster`]), and that bounds, area and normal
//! are those of the triangles that keep a cluster.
//!
//! # What is ours
//!
//! [`Params::default`] puts a triangle into the voxel of its centroid only, looks at triangles in an order of their normals,
//! not of the file ([`Order::Canonical`]), and does not ask which side is the front. Labels are then a function of the set of
//! triangles: shuffle them, and each keeps its label.
//!
//! [`Grouping::Connected`] cuts clusters into connected pieces, so that two sheets that cross one voxel are two clusters. It
//! is the remedy that the thesis names in its section 3.2.2, with union-find instead of rescans: near-linear. All members of
//! a piece are within A of one triangle's normal, so a curved strip cannot drift. Pieces end at voxel faces.
//!
//! [`Params::for_count`] searches for the grid that makes about as many clusters as asked for.
//!
//! # What can be relied on
//!
//! * The same bits for any number of threads. Nothing depends on hashing order, time or addresses.
//! * Memory O(triangles + vertices), whatever grid is asked for: voxels are sorted, not stored.
//! * Positions are finite `f32`, of any size. Scaling a scene by a power of two changes no label, as long as no coordinate
//!   is rounded. Other factors round coordinates: those within four roundings below a voxel's face still count as on it,
//!   so that regular meshes, whose centroids lie on faces, keep their voxels; triangles exactly at the angle may move.
//! * Permuting axes permutes voxels. Clusters of curved surfaces may differ, since the order of normals begins with z.

mod clusters;
mod connected;
mod error;
mod few;
mod greedy;
mod grid;
mod group;
mod params;
mod partition;
mod surface;
mod voxels;

pub use clusters::{Cluster, Clusters, Report};
pub use error::Error;
pub use params::{Grouping, Insertion, Order, Params};
pub use partition::cluster;

/// The triangles to group, as plain slices.
#[derive(Clone, Copy, Debug)]
pub struct Triangles<'a> {
    /// Vertices. Those that no triangle uses may be anything.
    pub positions: &'a [[f32; 3]],
    /// Three vertices each.
    pub indices: &'a [[u32; 3]],
    /// A material each; empty where all are of one.
    pub materials: &'a [u32],
}
