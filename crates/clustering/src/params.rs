//! Parameters of clustering, and the errors of [`crate::cluster`].

/// The largest allowed factor K. Even a single triangle then gets the largest number of voxels along an axis.
const MAX_K: f64 = 1_048_576.0;
/// The largest allowed number of voxels along an axis. An `f32` coordinate has 24 bits, so 2^20 voxels leave 4 bits for
/// the position in a voxel.
pub(crate) const MAX_CLAMP: u32 = 1 << 20;
/// The widest allowed angle in degrees. Beyond a right angle, a cluster could contain opposite normals.
const MAX_ANGLE: f64 = 90.0;
/// The voxels into which a triangle is put.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Insertion {
    /// The voxel that contains the triangle's centroid. \[Lan 2016\] uses [`Insertion::BoundingBox`].
    #[default]
    Centroid,
    /// All voxels that the triangle's axis-aligned box overlaps, as in \[Lan 2016\].
    ///
    /// The triangle is clustered in each of them and keeps the cluster of the last voxel in the order of z, then y, then x.
    /// Clusters that keep no triangle are phantoms: they are dropped and counted in [`crate::ClusterReport::phantoms`].
    BoundingBox,
}

/// The method that divides the triangles of one voxel and one material into clusters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Grouping {
    /// A triangle joins the first cluster whose representative's normal differs from its own by at most the threshold angle. If
    /// there is none, the triangle becomes the representative of a new cluster \[Lan 2016\].
    #[default]
    Greedy,
    /// [`Grouping::Greedy`], after which each cluster is split into connected pieces. Triangles are connected if they share a
    /// vertex, directly or through other triangles of the cluster. \[Lan 2016\] suggests this but does not implement it.
    Connected,
}

/// The order in which a voxel's triangles are visited. It determines which of them represent clusters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Order {
    /// By normal: the largest z first, then y, then x. The partition depends only on the set of normals in a voxel, not on the
    /// order of triangles or the subdivision of flat surfaces.
    #[default]
    Canonical,
    /// The input order, as in \[Lan 2016\]. A different order of the same triangles gives different clusters.
    Input,
}

/// The rule by which opposite normals are equal or different.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Sides {
    /// Opposite normals are equal: normals are compared by `|n.n'|`. A flipped winding, common in meshes from several sources,
    /// then does not split a surface. A sampler sees only one side anyway.
    #[default]
    Either,
    /// Opposite normals differ: normals are compared by `n.n'`, as in \[Lan 2016\].
    Signed,
}

/// The rule by which two triangles are connected: vertices at the same position, or vertices with the same index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Connection {
    /// Vertices at exactly the same position (0.0 and -0.0 are equal). Meshes split at texture seams and triangle soups are
    /// connected only by position.
    #[default]
    Place,
    /// Vertices with the same index. Different vertices at the same position do not connect triangles.
    Vertex,
}

/// The parameters of clustering. [`crate::cluster`] checks them.
///
/// ```
/// use dapple_clustering::{ClusterParams, Grouping};
///
/// let params = ClusterParams { angle: 5.0, grouping: Grouping::Connected, ..ClusterParams::default() };
/// assert_eq!(params.clamp, 64);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClusterParams {
    /// The factor K, above 0 and at most 2^20; 3 by default, as in pbrt-v2.
    ///
    /// The grid has `K N^(1/3)` voxels along its longest axis for N triangles, and proportionally many along the
    /// others, each rounded \[Lan 2016, eq. 3-1, 3-2\].
    ///
    /// With the thesis' clamp of 32, K hardly matters. The longest axis reaches 32 voxels at 1158 triangles for K = 3, at 43
    /// for K = 9 and at 2 for K = 30. With more triangles, K changes only the shorter axes, and voxels are no longer cubes.
    /// Raise `clamp` if K should matter.
    pub k: f64,
    /// The largest number of voxels along an axis, 1 to 2^20: 32 in the thesis, 64 in pbrt-v2 and by default.
    ///
    /// In pbrt-v2 and the thesis, the clamp limits the memory of an array of voxels. Here only occupied voxels are stored, so
    /// any clamp is affordable. At 64, if an image shows the whole scene in 1024 columns, a voxel is 16 pixels wide.
    /// Smaller clusters give a sampler little more information than single pixels.
    pub clamp: u32,
    /// The angle within which normals are similar, 0 to 90 degrees; 10 by default, as in the thesis. Its cosine has a tolerance
    /// of `2^-21`: an angle of 10 degrees accepts up to 10.0002 degrees, and an angle of 0 accepts up to 0.06 degrees.
    pub angle: f64,
    /// The voxels into which a triangle is put.
    pub insertion: Insertion,
    /// The method that divides the triangles of one voxel and one material into clusters.
    pub grouping: Grouping,
    /// The order in which a voxel's triangles are visited.
    pub order: Order,
    /// The rule by which opposite normals are equal or different.
    pub sides: Sides,
    /// The rule by which two triangles are connected, for [`Grouping::Connected`].
    pub connection: Connection,
    /// The desired number of clusters. If set, the grid is found by a search, and `k` and `clamp` are ignored (see
    /// [`ClusterParams::for_count`]). `None` sizes the grid by `k` and `clamp`.
    pub count: Option<u32>,
}

impl Default for ClusterParams {
    fn default() -> Self {
        Self {
            k: 3.0,
            clamp: 64,
            angle: 10.0,
            insertion: Insertion::Centroid,
            grouping: Grouping::Greedy,
            order: Order::Canonical,
            sides: Sides::Either,
            connection: Connection::Place,
            count: None,
        }
    }
}

impl ClusterParams {
    /// The parameters of the thesis and its code \[Lan 2016, fig. 3-11, 3-15\]: `k` 9, `clamp` 32, `angle` 10,
    /// [`Insertion::BoundingBox`], [`Grouping::Greedy`], [`Order::Input`] and [`Sides::Signed`].
    pub fn published() -> Self {
        Self {
            k: 9.0,
            clamp: 32,
            insertion: Insertion::BoundingBox,
            order: Order::Input,
            sides: Sides::Signed,
            ..Self::default()
        }
    }

    /// The default parameters, with a grid whose number of clusters is close to `count` (at least 1).
    ///
    /// The count is only a target. Materials and normals separate triangles even in a single voxel, triangles at one position
    /// stay together in any grid, and a slightly finer grid may give many more clusters.
    ///
    /// The search tries a few dozen grids, from 1 to 2^20 voxels along the longest axis, and returns the grid whose number of
    /// clusters is nearest to `count` by ratio (among equals, the coarsest). It ends within 1 % of `count`, or when a grid with
    /// too few clusters and one with too many differ in resolution by at most 1 %. With [`Insertion::BoundingBox`], a grid is
    /// too fine if the boxes of N triangles overlap more than `max(32 N, 2^16)` voxels in total.
    pub fn for_count(count: u32) -> Self {
        Self { count: Some(count), ..Self::default() }
    }

    /// Checks that all parameters are in range, as [`crate::cluster`] does.
    ///
    /// # Errors
    ///
    /// The error of the first parameter out of range.
    pub fn check(&self) -> Result<(), Error> {
        match *self {
            Self { k, .. } if !(k > 0.0 && k <= MAX_K) => Err(Error::BadK { k }),
            Self { clamp, .. } if !(1..=MAX_CLAMP).contains(&clamp) => Err(Error::BadClamp { clamp }),
            Self { angle, .. } if !(0.0..=MAX_ANGLE).contains(&angle) => Err(Error::BadAngle { angle }),
            Self { count: Some(0), .. } => Err(Error::BadCount),
            _ => Ok(()),
        }
    }
}

/// The reason why triangles cannot be clustered. Each message states the remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// There are no triangles.
    #[error("there are no triangles to cluster; remove the mesh, or add at least one triangle")]
    Empty,
    /// There are more triangles than `u32` can index.
    #[error("{triangles} triangles are too many to cluster; cluster at most {} triangles at a time", u32::MAX)]
    TooManyTriangles {
        /// The number of triangles passed.
        triangles: usize,
    },
    /// The number of materials is neither 0 nor the number of triangles.
    #[error(
        "the numbers of materials ({materials}) and triangles ({triangles}) differ; give one material per triangle, or none if all triangles share one"
    )]
    BadMaterials {
        /// The number of materials passed.
        materials: usize,
        /// The number of triangles passed.
        triangles: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error(
        "triangle {triangle} refers to vertex {index}, but vertex indices must be below {vertices}; correct the index"
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
    #[error("vertex {vertex} of triangle {triangle} is not finite; correct the vertex, or remove the triangle")]
    BadPosition {
        /// The index of the triangle with the bad corner.
        triangle: u32,
        /// The index of the vertex at that corner.
        vertex: u32,
    },
    /// The factor K ([`ClusterParams::k`](ClusterParams::k)) is not positive, or is above 2^20.
    #[error("the clustering grid's factor K is {k}; use a number above 0 and at most {} (pbrt-v2 uses 3)", MAX_K)]
    BadK {
        /// The requested factor K.
        k: f64,
    },
    /// The bound on voxels per axis is 0 or above 2^20.
    #[error("the clustering grid's clamp is {clamp} voxels per axis; use 1 to {}", MAX_CLAMP)]
    BadClamp {
        /// The requested bound on voxels per axis.
        clamp: u32,
    },
    /// The angle within which normals are similar is not within 0 to 90 degrees.
    #[error("an angle of {angle} degrees between similar normals is out of range; use 0 to {}", MAX_ANGLE)]
    BadAngle {
        /// The requested angle in degrees.
        angle: f64,
    },
    /// The requested number of clusters is 0.
    #[error("0 clusters cannot hold triangles; request at least 1 cluster")]
    BadCount,
    /// The bounding boxes of the triangles overlap too many voxels in total.
    #[error(
        "the triangles' bounding boxes overlap {entries} voxels of the clustering grid in total, more than the limit of \
         {limit}; lower the parameter k or clamp, or set insertion to centroid"
    )]
    TooManyEntries {
        /// The number of triangle-voxel pairs, where the triangle's box overlaps the voxel.
        entries: u64,
        /// The largest allowed number of such pairs.
        limit: u64,
    },
}
