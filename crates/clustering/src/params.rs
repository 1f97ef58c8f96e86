//! How triangles are grouped.

use crate::Error;

/// Largest factor K: any larger one meets the largest clamp with a single triangle.
pub(crate) const MAX_K: f64 = 1_048_576.0;
/// Most voxels along an axis: an `f32` coordinate has 24 bits, so that 2^20 leave 4 for the place in a voxel.
pub(crate) const MAX_CLAMP: u32 = 1 << 20;
/// Widest angle in degrees: beyond a right angle, normals of one cluster could be opposed.
pub(crate) const MAX_ANGLE: f64 = 90.0;
/// Room for the rounding of a product of two `f32` unit vectors: `2 * 2^-24` of their lengths and `3 * 2^-24` of the sum at
/// most. So equal normals are alike at any angle (or a representative would not join its own cluster), and an angle met
/// exactly counts as within.
const COSINE_SLACK: f64 = 1.0 / (1 << 21) as f64;

/// Which voxels a triangle is put into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Insertion {
    /// The one that holds its centroid (ours; \[Lan 2016\] has the other).
    #[default]
    Centroid,
    /// All that its axis-aligned box overlaps, as published: it is clustered in each, and keeps the cluster of the last
    /// one in the order of z, then y, then x. Clusters that keep no triangle are phantoms: they are dropped, and
    /// counted in [`crate::Report::phantoms`].
    BoundingBox,
}

/// What a voxel's triangles of one material are cut into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Grouping {
    /// As published: a triangle joins the first cluster whose representative's normal is within the angle of its own,
    /// or else opens one and represents it.
    #[default]
    Greedy,
    /// Greedy, then each cluster cut into its connected pieces: triangles that share a vertex, directly or through others
    /// of the cluster. The thesis names this as a remedy and does not build it.
    Connected,
}

/// The order in which a voxel's triangles are looked at, and so which of them represent clusters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// By normal: the largest z first, then y, then x. The partition then depends on the set of normals in a voxel only,
    /// not on the order in which triangles come, nor on how finely a flat part is cut up.
    #[default]
    Canonical,
    /// As they come in, as published. Another order of the same triangles gives other clusters.
    Input,
}

/// How triangles are grouped. A plain struct: [`crate::cluster`] checks it.
///
/// ```
/// use dapple_clustering::{Grouping, Params};
/// let params = Params { angle: 5.0, grouping: Grouping::Connected, ..Params::default() };
/// assert_eq!(params.clamp, 64);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// The factor K: the grid has `K N^(1/3)` voxels along its longest axis, N being the number of triangles, and
    /// proportionally many along the others, each rounded \[Lan 2016, eq. 3-1, 3-2\]. Above 0, up to 2^20; 3 by default,
    /// as in pbrt-v2.
    ///
    /// With the thesis' clamp of 32 it means next to nothing: the longest axis is at its 32 voxels from 1158 triangles
    /// on with K = 3, from 43 with K = 9 and from 2 with K = 30. Beyond that, only the shorter axes still react to K, and
    /// voxels stop being cubes. Where K matters, raise `clamp` too.
    pub k: f64,
    /// Most voxels along an axis, 1 to 2^20: 32 in the thesis, 64 in pbrt-v2. They bound the memory of an array of
    /// voxels; here only occupied voxels are stored, so any clamp is affordable. The default is 64 because of what
    /// voxels are for: in an image 1024 pixels wide that shows the whole scene one is then 16 pixels wide, and
    /// smaller clusters tell a sampler little that single pixels don't.
    pub clamp: u32,
    /// The angle A in degrees within which normals are alike, 0 to 90; 10 by default, as in the thesis. It is met to
    /// within `2^-21` in the cosine: 0.0002 degrees at 10, 0.06 at 0.
    pub angle: f64,
    /// Which voxels a triangle is put into.
    pub insertion: Insertion,
    /// What a voxel's triangles of one material are cut into.
    pub grouping: Grouping,
    /// The order in which a voxel's triangles are looked at.
    pub order: Order,
    /// Whether opposite normals are alike (`|n.n'|` instead of `n.n'`). By default they are: a flipped winding, common in
    /// meshes from many hands, would cut a surface in two, and a sampler sees but one side anyway. The thesis tells
    /// them apart.
    pub two_sided: bool,
    /// Whether vertices at exactly one place count as one for [`Grouping::Connected`], whatever their numbers (0.0 and
    /// -0.0 are one place). True by default: meshes cut at texture seams, and triangle soups, are connected by place only.
    pub weld: bool,
    /// How many clusters to aim at. The voxels per axis are then searched for, and `k` and `clamp` not used. See
    /// [`Params::for_count`].
    pub count: Option<u32>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            k: 3.0,
            clamp: 64,
            angle: 10.0,
            insertion: Insertion::Centroid,
            grouping: Grouping::Greedy,
            order: Order::Canonical,
            two_sided: true,
            weld: true,
            count: None,
        }
    }
}

impl Params {
    /// The thesis' method as its code has it: K = 9, at most 32 voxels per axis, triangles in all voxels that their boxes
    /// overlap, signed normals within 10 degrees of the first triangle's, in input order \[Lan 2016, fig. 3-11, 3-15\].
    pub fn published() -> Self {
        Self {
            k: 9.0,
            clamp: 32,
            insertion: Insertion::BoundingBox,
            order: Order::Input,
            two_sided: false,
            ..Self::default()
        }
    }

    /// The default, with a grid whose number of clusters comes close to `count` (at least 1).
    ///
    /// A target, not a promise. Materials and normals keep triangles apart in a single voxel already, triangles in one
    /// place stay together in any grid, and the number of clusters jumps between one grid and the next. What holds:
    /// no cluster is empty, each triangle is in one, and of some dozen grids tried, from 1 to 2^20 voxels along the
    /// longest axis, it is the one whose number of clusters is nearest to `count` by ratio (of equals, the coarsest). The
    /// search ends within 1 %, or where grids differ by 1 %. With boxes, grids that put the average triangle into more
    /// than 32 voxels are not tried.
    pub fn for_count(count: u32) -> Self {
        Self { count: Some(count), ..Self::default() }
    }

    /// Says beforehand what [`crate::cluster`] would refuse of them.
    ///
    /// # Errors
    ///
    /// The first number out of range.
    pub fn check(&self) -> Result<(), Error> {
        if !(self.k > 0.0 && self.k <= MAX_K) {
            return Err(Error::BadK { k: self.k });
        }
        if !(1..=MAX_CLAMP).contains(&self.clamp) {
            return Err(Error::BadClamp { clamp: self.clamp });
        }
        if !(0.0..=MAX_ANGLE).contains(&self.angle) {
            return Err(Error::BadAngle { angle: self.angle });
        }
        if self.count == Some(0) {
            return Err(Error::BadCount);
        }
        Ok(())
    }

    /// Normals are alike where their dot product is at least this.
    pub(crate) fn cosine(&self) -> f32 {
        (self.angle.to_radians().cos() - COSINE_SLACK) as f32
    }
}
