//! Triangle meshes, at rest and with moving vertices.

use crate::Error;
use glam::Vec3;

/// The largest allowed magnitude of a coordinate, 2^59. Products of two coordinate differences then stay finite in
/// f32.
pub(crate) const LARGEST: f32 = (1u64 << 59) as f32;
/// The smallest allowed magnitude of a shape's largest coordinate, 2^-60, unless all coordinates are 0.
pub(crate) const SMALLEST: f32 = 1.0 / (1u64 << 60) as f32;
/// A triangle counts as having no area if the sine of the angle at its first corner is at most this. The f64 cross product of
/// exact f32 corners cannot distinguish smaller sines from 0.
const SINE_OF_NOTHING: f64 = 1.0 / (1u64 << 48) as f64;

/// An indexed triangle mesh whose indices and coordinates passed all checks.
///
/// A triangle faces the side from which its corners appear counter-clockwise. Triangles without area keep their indices but are
/// never hit; [`degenerate`](Self::degenerate) counts them.
///
/// ```
/// use dapple_geometry::{Error, Mesh};
///
/// let mesh = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2], [0, 0, 1]])?;
/// assert_eq!((mesh.triangles().len(), mesh.degenerate()), (2, 1));
/// let error = Mesh::new(vec![[0.0; 3]], vec![[0, 0, 7]]).unwrap_err();
/// assert!(matches!(error, Error::IndexOutOfRange { triangle: 0, vertex: 7, .. }));
/// # Ok::<(), Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Mesh {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    /// The unit normal of each triangle; the zero vector for a triangle without area.
    normals: Vec<Vec3>,
    degenerate: usize,
    /// The bounding box of all triangles, including those without area; empty without triangles.
    pub(crate) around: [Vec3; 2],
    /// A bound on the rounding error of a point computed in f64 from three corners, in scene units, for coordinates as large
    /// as the mesh's largest.
    lost: f32,
}

impl Mesh {
    /// Makes a mesh from vertex positions and from triangles (three vertex indices each), and checks both. Unused
    /// vertices are not checked.
    ///
    /// # Errors
    /// * [`Error::IndexOutOfRange`] if a triangle refers to a missing vertex.
    /// * [`Error::NonFinite`] if a triangle's vertex has a NaN or infinite coordinate.
    /// * [`Error::ScaleOutOfRange`] if the largest magnitude of a used coordinate is above 2^59 (5.8e17), or below 2^-60
    ///   (8.7e-19) but not 0.
    /// * [`Error::TooMany`] if there are 2^32 - 1 triangles or more.
    pub fn new(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, Error> {
        Error::too_many("triangles of a mesh", triangles.len(), u32::MAX as usize)?;
        let [mut low, mut high] = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        for (number, corners) in triangles.iter().enumerate() {
            for &vertex in corners {
                let corner = checked(&positions, number as u32, vertex)?;
                (low, high) = (low.min(corner), high.max(corner));
            }
        }
        let largest = low.abs().max(high.abs()).max_element();
        let largest = if triangles.is_empty() { 0.0 } else { largest };
        let least = if largest > 0.0 { SMALLEST } else { 0.0 };
        Error::out_of_range("a mesh's largest coordinate", largest.into(), least)?;
        let mut mesh =
            Self { positions, triangles, normals: Vec::new(), degenerate: 0, around: [low, high], lost: 0.0 };
        mesh.lost = (3.0 * f64::from(largest) * LOST_IN_F64) as f32;
        let normal = |number: usize| {
            let corners = mesh.corners(number as u32);
            let [a, b, c] = corners.map(Vec3::as_dvec3);
            if has_no_area(corners) { Vec3::ZERO } else { (b - a).cross(c - a).normalize_or_zero().as_vec3() }
        };
        mesh.normals = (0..mesh.triangles.len()).map(normal).collect();
        mesh.degenerate = mesh.normals.iter().filter(|&&normal| normal == Vec3::ZERO).count();
        Ok(mesh)
    }

    /// The positions of all vertices, in the order given to [`new`](Self::new).
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// The three vertex indices of each triangle, including triangles without area.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The number of triangles without area, which are never hit.
    pub fn degenerate(&self) -> usize {
        self.degenerate
    }

    /// Returns true if the triangle has no area. The index must be below `triangles().len()`.
    pub fn is_degenerate(&self, triangle: u32) -> bool {
        self.normals[triangle as usize] == Vec3::ZERO
    }

    /// Returns the positions of a triangle's three corners. The index must be below `triangles().len()`.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        // Written out: compilers don't inline `map` everywhere.
        let [a, b, c] = self.triangles[triangle as usize];
        [self.position(a), self.position(b), self.position(c)]
    }

    #[inline(always)]
    fn position(&self, vertex: u32) -> Vec3 {
        Vec3::from_array(self.positions[vertex as usize])
    }

    /// Returns a point of a triangle, a bound on its distance from the exact triangle per axis, and the unit normal.
    /// `barycentrics` are the weights of the second and third corner.
    ///
    /// The weights are treated as exact, and the sum is computed in f64. The bound is twice the rounding error to f32 plus the
    /// rounding error of the f64 sum. It is smaller than pbrt's for a sum in f32 [Pharr 2023, eq. 6.26].
    #[inline(always)]
    pub fn point(&self, triangle: u32, barycentrics: [f32; 2]) -> (Vec3, Vec3, Vec3) {
        let [a, b, c] = self.corners(triangle).map(Vec3::as_dvec3);
        let [second, third] = barycentrics.map(f64::from);
        let exact = a + (b - a) * second + (c - a) * third;
        let position = exact.as_vec3();
        let error = position.abs() * ROUNDING as f32 + Vec3::splat(self.lost);
        (position, error, self.normals[triangle as usize])
    }
}

/// The relative size of one ulp of f32, 2^-23: twice the largest relative rounding error.
pub(crate) const ROUNDING: f64 = 1.0 / (1u64 << 23) as f64;
/// A bound on the rounding error of a short f64 sum, relative to the magnitudes in it: sixteen ulps of f64.
pub(crate) const LOST_IN_F64: f64 = 16.0 * f64::EPSILON;

/// Returns true if two corners coincide or the sine of the angle at the first corner is at most `SINE_OF_NOTHING`.
pub(crate) fn has_no_area(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let (ab, ac) = (b - a, c - a);
    let area = ab.cross(ac).length();
    area <= SINE_OF_NOTHING * ab.length() * ac.length() || a == b || a == c || b == c
}

/// Returns the position of a triangle's vertex. Returns an error if the vertex is missing or not finite.
fn checked(positions: &[[f32; 3]], triangle: u32, vertex: u32) -> Result<Vec3, Error> {
    let vertices = positions.len();
    let &position = positions.get(vertex as usize).ok_or(Error::IndexOutOfRange { triangle, vertex, vertices })?;
    let position = Vec3::from_array(position);
    if position.is_finite() { Ok(position) } else { Err(Error::NonFinite { triangle, vertex }) }
}

/// An indexed triangle mesh with moving vertices. Each vertex moves in a straight line from its position at time 0 to
/// its position at time 1, and is at rest before and after.
///
/// At every time, the corners are rounded to f32 in the same way for all triangles that share a vertex, so the mesh is
/// watertight. Triangles without area at times 0, 1/2 and 1 have no area at any time and are never hit.
///
/// ```
/// use dapple_geometry::MovingMesh;
///
/// let start = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let end = start.iter().map(|[x, y, z]| [x + 2.0, *y, *z]).collect();
/// let mesh = MovingMesh::new(start, end, vec![[0, 1, 2]])?;
/// assert_eq!(mesh.corners(0, 0.5)[0].to_array(), [1.0, 0.0, 0.0]);
/// # Ok::<(), dapple_geometry::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct MovingMesh {
    start: Mesh,
    ends: Vec<[f32; 3]>,
    degenerate: usize,
    lost: f32,
}

impl MovingMesh {
    /// Makes a mesh from vertex positions at times 0 and 1 and from triangles (three vertex indices each), and checks
    /// them.
    ///
    /// # Errors
    /// The errors of [`Mesh::new`] for the positions at either time. [`Error::BadParameter`] if the numbers of
    /// positions differ.
    pub fn new(starts: Vec<[f32; 3]>, ends: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, Error> {
        let expected = "give as many vertices at time 1 as at time 0";
        let (same, count) = (starts.len() == ends.len(), ends.len() as f64);
        Error::unless(same, "the number of a moving mesh's vertices at time 1", count, expected)?;
        let end = Mesh::new(ends, triangles.clone())?;
        let start = Mesh::new(starts, triangles)?;
        let largest = |mesh: &Mesh| mesh.positions().iter().flatten().fold(0.0_f32, |most, x| most.max(x.abs()));
        let lost = (3.0 * f64::from(largest(&start).max(largest(&end))) * LOST_IN_F64) as f32;
        let mut mesh = Self { start, ends: end.positions().to_vec(), degenerate: 0, lost };
        mesh.degenerate = (0..mesh.start.triangles().len() as u32).filter(|&n| mesh.is_degenerate(n)).count();
        Ok(mesh)
    }

    /// The triangle mesh with the vertices' positions at time 0.
    pub fn start(&self) -> &Mesh {
        &self.start
    }

    /// The positions of the vertices at time 1.
    pub fn ends(&self) -> &[[f32; 3]] {
        &self.ends
    }

    /// The number of triangles that have no area at any time in `[0, 1]`, which are never hit.
    pub fn degenerate(&self) -> usize {
        self.degenerate
    }

    /// Returns true if the triangle has no area at any time in `[0, 1]`. The area vector is quadratic in time, so it is tested
    /// at three times. The index must be below the number of triangles.
    pub fn is_degenerate(&self, triangle: u32) -> bool {
        [0.0, 0.5, 1.0].into_iter().all(|time| has_no_area(self.corners(triangle, time)))
    }

    /// Returns the three corners of a triangle at a time, clamped to `[0, 1]`. The index must be below the number of
    /// triangles.
    #[inline]
    pub fn corners(&self, triangle: u32, time: f32) -> [Vec3; 3] {
        let time = time.clamp(0.0, 1.0);
        self.start.triangles()[triangle as usize].map(|vertex| {
            let [from, to] =
                [&self.start.positions()[vertex as usize], &self.ends[vertex as usize]].map(|p| Vec3::from_array(*p));
            Vec3::new(between(from.x, to.x, time), between(from.y, to.y, time), between(from.z, to.z, time))
        })
    }

    /// Returns a triangle's exact corners at time 1. [`corners`](Self::corners) at time 1 may differ from them by
    /// rounding.
    pub(crate) fn ends_of(&self, triangle: u32) -> [Vec3; 3] {
        self.start.triangles()[triangle as usize].map(|vertex| Vec3::from_array(self.ends[vertex as usize]))
    }

    /// Returns a point of a triangle at a time, a bound on its distance from the triangle of [`corners`](Self::corners) per
    /// axis, and the unit normal. `barycentrics` are the weights of the second and third corner.
    pub fn point(&self, triangle: u32, barycentrics: [f32; 2], time: f32) -> (Vec3, Vec3, Vec3) {
        let [a, b, c] = self.corners(triangle, time).map(Vec3::as_dvec3);
        let [second, third] = barycentrics.map(f64::from);
        let position = (a + (b - a) * second + (c - a) * third).as_vec3();
        let error = position.abs() * ROUNDING as f32 + Vec3::splat(self.lost);
        (position, error, (b - a).cross(c - a).normalize_or_zero().as_vec3())
    }
}

/// Returns a coordinate interpolated linearly at a time in `[0, 1]`. Traversal and surface points both use it, so that they
/// are bit-identical.
#[inline(always)]
pub(crate) fn between(from: f32, to: f32, time: f32) -> f32 {
    from + (to - from) * time
}
