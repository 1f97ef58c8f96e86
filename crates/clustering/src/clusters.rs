//! What becomes of the triangles.

use std::sync::Arc;

/// What became of the triangles: a partition of them, and what is known of each part.
///
/// Clusters are numbered by voxel (z, then y, then x), in a voxel by material, and among those in the order in which they
/// were opened. Clones share what is large.
#[derive(Clone, Debug, PartialEq)]
pub struct Clusters {
    pub(crate) labels: Arc<[u32]>,
    pub(crate) clusters: Arc<[Cluster]>,
    pub(crate) members: Vec<u32>,
    pub(crate) starts: Vec<u32>,
    pub(crate) report: Report,
}

/// One cluster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// Triangles in it.
    pub triangles: u32,
    /// Smallest and largest corner of its axis-aligned box.
    pub bounds: [[f32; 3]; 2],
    /// Sum of its triangles' areas. Triangles without a normal count as without area.
    pub area: f64,
    /// Area-weighted mean normal, unit length; zero where normals cancel, or where no triangle has one.
    ///
    /// Normals follow the winding (counter-clockwise seen from the front) where [`crate::Params::two_sided`] is false.
    /// Where it is true, each is first turned to the side of z > 0 (of y, of x where z is 0) and then to that of the
    /// cluster's first: the line counts, its direction means nothing.
    pub normal: [f32; 3],
    /// Cosine of the largest angle between `normal` and a member's normal; -1 where `normal` is zero. Of two-sided
    /// normals, of the smaller of both angles.
    pub cone: f32,
    /// Its material.
    pub material: u32,
    /// Number of the group of one voxel's triangles that it was cut from: those of its material. Groups are numbered
    /// as clusters are, from 0, those without clusters left out.
    pub group: u32,
}

/// What grid was asked for, and how much of it was used.
///
/// ```
/// # use dapple_clustering::{Params, Triangles, cluster};
/// // A row of 100 small triangles, and one a thousand times as far off as the row is long.
/// let mut positions = Vec::new();
/// for i in 0..101 {
///     let x = if i < 100 { i as f32 } else { 1e5 };
///     positions.extend([[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]]);
/// }
/// let indices: Vec<[u32; 3]> = (0..101).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
/// let triangles = Triangles { positions: &positions, indices: &indices, materials: &[] };
/// let report = cluster(&triangles, &Params::default())?.report();
/// assert_eq!((report.resolution, report.occupied, report.fullest), ([14, 1, 1], 2, 100));
/// assert!(report.is_degenerate());
/// # Ok::<(), dapple_clustering::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// Voxels along each axis.
    pub resolution: [u32; 3],
    /// Voxels with a triangle, of [`Report::requested`].
    pub occupied: u64,
    /// Triangles in the fullest voxel.
    pub fullest: u32,
    /// Triangles in all.
    pub triangles: u32,
    /// Pairs of a triangle and a voxel it was put into: `triangles` for insertion by centroid, more for boxes.
    pub insertions: u64,
    /// Clusters made of triangles that all have their cluster in another voxel; 0 for insertion by centroid.
    pub phantoms: u64,
}

impl Report {
    /// Voxels asked for, occupied or not.
    pub fn requested(&self) -> u64 {
        self.resolution.iter().map(|&n| u64::from(n)).product()
    }

    /// Whether the grid says little about the triangles: of more than eight voxels asked for, one holds most of more
    /// than eight triangles. Something far off then stretches the grid ("the teapot in a stadium"); leave it out, or
    /// cluster it apart.
    pub fn is_degenerate(&self) -> bool {
        self.requested() > 8 && self.triangles > 8 && self.fullest > self.triangles / 2
    }
}

impl Clusters {
    /// The cluster of each triangle, numbers below [`Clusters::len`].
    pub fn labels(&self) -> &[u32] {
        &self.labels
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.clusters.len()
    }

    /// Whether there are none: no triangles.
    pub fn is_empty(&self) -> bool {
        self.clusters.is_empty()
    }

    /// The clusters, by number.
    pub fn clusters(&self) -> &[Cluster] {
        &self.clusters
    }

    /// Labels and clusters for whoever keeps them, without copying.
    pub fn shared(&self) -> (Arc<[u32]>, Arc<[Cluster]>) {
        (self.labels.clone(), self.clusters.clone())
    }

    /// The triangles of a cluster, ascending; none for a number from [`Clusters::len`] on.
    pub fn members(&self, cluster: u32) -> &[u32] {
        let ends = (self.starts.get(cluster as usize), self.starts.get(cluster as usize + 1));
        match ends {
            (Some(&start), Some(&end)) => &self.members[start as usize..end as usize],
            _ => &[],
        }
    }

    /// What grid was asked for, and how much of it was used.
    pub fn report(&self) -> Report {
        self.report
    }
}
