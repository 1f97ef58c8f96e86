//! Groups a scene's triangles by place, material and normal: plain slices in, clusters out.

/// The triangles to group, as plain slices.
#[derive(Clone, Copy, Debug)]
pub struct Triangles<'a> {
    /// Vertices.
    pub positions: &'a [[f32; 3]],
    /// Three vertices each.
    pub indices: &'a [[u32; 3]],
    /// A material each; empty where all are of one.
    pub materials: &'a [u32],
}

/// What became of the triangles: a partition of them, and what is known of each part.
#[derive(Clone, Debug, PartialEq)]
pub struct Clusters {
    labels: Vec<u32>,
    clusters: Vec<Cluster>,
}

/// One cluster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// Triangles in it.
    pub triangles: u32,
    /// Smallest and largest corner of its axis-aligned box.
    pub bounds: [[f32; 3]; 2],
    /// Sum of its triangles' areas.
    pub area: f64,
    /// Area-weighted mean normal, unit length; zero where normals cancel.
    pub normal: [f32; 3],
    /// Cosine of the largest angle between `normal` and a member's normal.
    pub cone: f32,
    /// Its material.
    pub material: u32,
    /// Number of the group of one voxel's triangles that it was cut from.
    pub group: u32,
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
}
