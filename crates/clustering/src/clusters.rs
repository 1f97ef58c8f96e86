//! The properties of a cluster, and the statistics of the voxel grid.

/// The properties of one cluster of triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// The number of triangles in the cluster.
    pub triangles: u32,
    /// The smallest and largest corner of the cluster's axis-aligned bounding box.
    pub bounds: [[f32; 3]; 2],
    /// The sum of the areas of the cluster's triangles, in squared units of the positions.
    pub area: f64,
    /// The area-weighted mean normal, of unit length. It is zero if the normals cancel or no triangle has one.
    ///
    /// With [`Sides::Signed`](crate::Sides::Signed), normals follow the winding (counter-clockwise seen from the front). With
    /// [`Sides::Either`](crate::Sides::Either), the sign of the normal has no meaning. Each triangle's normal is first flipped
    /// to z > 0 (to y > 0 if z is 0, to x > 0 if both are 0), then to the side of the cluster's first normal.
    pub normal: [f32; 3],
    /// The cosine of the largest angle between `normal` and the normal of a triangle in the cluster; -1 if `normal` is zero.
    /// With [`Sides::Either`](crate::Sides::Either), absolute values of the cosines are used.
    pub cone: f32,
    /// The material number of the cluster's triangles.
    pub material: u32,
    /// The number of the cluster's group. A group is the triangles of one material in one voxel. Groups are numbered from 0 in
    /// the order of their clusters; groups without clusters have no number.
    pub group: u32,
}

/// Statistics of the voxel grid: its resolution, and how triangles are distributed over it.
///
/// ```
/// # use dapple_clustering::{ClusterParams, Triangles, cluster};
/// // A row of 100 small triangles, and one triangle 1000 row lengths away.
/// let mut positions = Vec::new();
/// for i in 0..101 {
///     let x = if i < 100 { i as f32 } else { 1e5 };
///     positions.extend([[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]]);
/// }
/// let indices: Vec<[u32; 3]> = (0..101).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
/// let report = cluster(&Triangles::new(&positions, &indices), &ClusterParams::default())?.report();
/// assert_eq!((report.resolution, report.occupied, report.fullest), ([14, 1, 1], 2, 100));
/// assert!(report.is_degenerate());
/// # Ok::<(), dapple_clustering::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ClusterReport {
    /// The number of voxels along each axis.
    pub resolution: [u32; 3],
    /// The number of voxels that hold at least one triangle, out of [`ClusterReport::requested`].
    pub occupied: u64,
    /// The number of triangles in the fullest voxel.
    pub fullest: u32,
    /// The number of triangles in the whole mesh.
    pub triangles: u32,
    /// The number of pairs of a triangle and a voxel into which it is put. Equal to `triangles` with
    /// [`Insertion::Centroid`](crate::Insertion::Centroid).
    pub insertions: u64,
    /// The number of clusters dropped because they kept no triangle: a triangle put into several voxels stays only in the
    /// cluster of the last voxel. 0 with [`Insertion::Centroid`](crate::Insertion::Centroid).
    pub phantoms: u64,
}

impl Cluster {
    /// Creates a cluster without triangles and without a normal, for a shape such as a sphere.
    ///
    /// `bounds` are the smallest and largest corner of the shape's bounding box, and `area` is its surface area. `group` is a
    /// number that no group of triangles has.
    pub const fn without_triangles(bounds: [[f32; 3]; 2], area: f64, material: u32, group: u32) -> Self {
        Self { triangles: 0, bounds, area, normal: [0.0; 3], cone: -1.0, material, group }
    }
}

impl ClusterReport {
    /// The number of voxels in the grid, occupied or not.
    pub fn requested(&self) -> u64 {
        self.resolution.iter().map(|&n| u64::from(n)).product()
    }

    /// Returns `true` if the grid hardly separates the triangles: one voxel holds more than half of them. Grids of up to eight
    /// voxels and meshes of up to eight triangles never count as degenerate.
    ///
    /// The usual cause is a distant object that stretches the grid ("the teapot in a stadium"). Leave it out, or cluster it
    /// separately.
    pub fn is_degenerate(&self) -> bool {
        self.requested() > 8 && self.triangles > 8 && self.fullest > self.triangles / 2
    }
}
