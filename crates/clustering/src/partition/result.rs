//! The result: the clusters of all triangles.

use crate::{Cluster, ClusterReport};
use std::sync::Arc;

/// The clusters of a mesh's triangles: the cluster of each triangle, the triangles and properties of each cluster, and
/// a report on the voxel grid.
///
/// Clusters are numbered by voxel (z, then y, then x), within a voxel by material, and within one voxel and material in the
/// order of their first triangles. Clones share the large arrays.
#[derive(Clone, Debug, PartialEq)]
pub struct Clusters {
    pub(crate) labels: Arc<[u32]>,
    pub(crate) clusters: Arc<[Cluster]>,
    pub(crate) members: Vec<u32>,
    pub(crate) starts: Vec<u32>,
    pub(crate) report: ClusterReport,
}

impl Clusters {
    /// The cluster number of each triangle, below [`Clusters::len`].
    pub fn labels(&self) -> &[u32] {
        &self.labels
    }

    /// The number of clusters.
    pub fn len(&self) -> usize {
        self.clusters.len()
    }

    /// Returns `true` if there are no clusters, and so no triangles.
    pub fn is_empty(&self) -> bool {
        self.clusters.is_empty()
    }

    /// The properties of each cluster, in the order of cluster numbers.
    pub fn clusters(&self) -> &[Cluster] {
        &self.clusters
    }

    /// Reference-counted handles to the [labels](Self::labels) and [clusters](Self::clusters), without copying the arrays.
    pub fn shared(&self) -> (Arc<[u32]>, Arc<[Cluster]>) {
        (self.labels.clone(), self.clusters.clone())
    }

    /// The indices of a cluster's triangles, ascending; empty if `cluster` is not below [`Clusters::len`].
    pub fn members(&self, cluster: u32) -> &[u32] {
        match self.starts.get(cluster as usize..) {
            Some(&[start, end, ..]) => &self.members[start as usize..end as usize],
            _ => &[],
        }
    }

    /// The statistics of the voxel grid: its resolution and how triangles are distributed over it.
    pub fn report(&self) -> ClusterReport {
        self.report
    }
}

impl Cluster {
    /// A cluster without triangles.
    pub(crate) const NONE: Self = Self::without_triangles([[0.0; 3]; 2], 0.0, 0, 0);
}
