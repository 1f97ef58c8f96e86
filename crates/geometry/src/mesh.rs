use crate::Error;
use glam::{DVec3, Vec3};

/// The largest allowed magnitude of a coordinate. Products of two differences stay finite in f32.
pub(crate) const LARGEST: f32 = (1u64 << 59) as f32;
/// The smallest allowed magnitude of a shape's largest coordinate, unless that is 0.
pub(crate) const SMALLEST: f32 = 1.0 / (1u64 << 60) as f32;
/// A triangle has no area if the sine of its angle at the first corner is below this. The f64 cross product of exact
/// f32 corners cannot tell it from 0.
const SINE_OF_NOTHING: f64 = 1.0 / (1u64 << 48) as f64;

/// Indexed triangles that passed all checks.
///
/// A triangle faces the side from which its corners run counter-clockwise. Triangles without area keep their indices,
/// are never hit and are counted by [`degenerate`](Self::degenerate).
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
    /// The unit normal of each triangle; zero without area.
    normals: Vec<Vec3>,
    degenerate: usize,
    /// The rounding error of an f64 sum of corners, bounded by the largest coordinate; stored so that hits need not
    /// compute it.
    lost: f32,
}

impl Mesh {
    /// Checks vertices and triangles (three vertex indices each). Unused vertices are not checked.
    ///
    /// # Errors
    /// * [`Error::IndexOutOfRange`] or [`Error::NonFinite`] for a bad vertex.
    /// * [`Error::ScaleOutOfRange`] if a coordinate exceeds 2^59 (5.8e17), or if all are below 2^-60 (8.7e-19) but not
    ///   0.
    /// * [`Error::TooMany`] for 2^32 triangles.
    pub fn new(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, Error> {
        let limit = u32::MAX as usize;
        if triangles.len() >= limit {
            return Err(Error::TooMany { what: "triangles of a mesh", count: triangles.len(), limit });
        }
        let mut largest = 0.0_f32;
        for (number, corners) in triangles.iter().enumerate() {
            for &vertex in corners {
                largest = largest.max(magnitude(&positions, number as u32, vertex)?);
            }
        }
        if largest > LARGEST || (largest > 0.0 && largest < SMALLEST) {
            return Err(Error::ScaleOutOfRange { what: "a mesh's largest coordinate", value: largest.into() });
        }
        let mut mesh = Self { positions, triangles, normals: Vec::new(), degenerate: 0, lost: 0.0 };
        mesh.lost = (3.0 * f64::from(largest) * LOST_IN_F64) as f32;
        let normal = |number: usize| {
            let [a, b, c] = mesh.corners(number as u32).map(Vec3::as_dvec3);
            unit_normal(a, b, c)
        };
        mesh.normals = (0..mesh.triangles.len()).map(normal).collect();
        mesh.degenerate = (0..mesh.triangles.len()).filter(|&number| mesh.is_degenerate(number as u32)).count();
        Ok(mesh)
    }

    /// The positions of the vertices.
    #[must_use]
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// The three vertex indices of each triangle.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The number of triangles without area. They are never hit.
    #[must_use]
    pub fn degenerate(&self) -> usize {
        self.degenerate
    }

    /// Returns true if the triangle has no area. The index must be below `triangles().len()`.
    #[must_use]
    pub fn is_degenerate(&self, triangle: u32) -> bool {
        has_no_area(self.corners(triangle))
    }

    /// The three corners of a triangle. The index must be below `triangles().len()`.
    #[inline]
    #[must_use]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|vertex| Vec3::from_array(self.positions[vertex as usize]))
    }

    /// A point of a triangle, the bound on its distance from the exact triangle per axis, and the unit normal.
    /// `barycentrics` are the weights of the second and third corner.
    ///
    /// The weights are taken as exact and the sum is formed in f64. The bound is therefore the last rounding to f32
    /// (half an ulp, doubled for slack) plus the error of f64. In f32, pbrt's bound is `gamma_7` times the sum of
    /// magnitudes [Pharr 2023, eq. 6.26].
    #[inline(always)]
    #[must_use]
    pub fn point(&self, triangle: u32, barycentrics: [f32; 2]) -> (Vec3, Vec3, Vec3) {
        let [a, b, c] = self.corners(triangle).map(Vec3::as_dvec3);
        let [second, third] = barycentrics.map(f64::from);
        let exact = a + (b - a) * second + (c - a) * third;
        let position = exact.as_vec3();
        let error = position.abs() * ROUNDING as f32 + Vec3::splat(self.lost);
        (position, error, self.normals[triangle as usize])
    }
}

/// One ulp of f32 relative to the value: twice the largest relative rounding error.
pub(crate) const ROUNDING: f64 = 1.0 / (1u64 << 23) as f64;
/// Sixteen ulps of f64: a bound on the rounding error of a short f64 sum, relative to the magnitudes in it.
pub(crate) const LOST_IN_F64: f64 = 16.0 * f64::EPSILON;

/// Returns true if a triangle has no area.
pub(crate) fn has_no_area(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let (ab, ac) = (b - a, c - a);
    let area = ab.cross(ac).length();
    area <= SINE_OF_NOTHING * ab.length() * ac.length() || a == b || a == c || b == c
}

/// The largest magnitude among a vertex's coordinates.
fn magnitude(positions: &[[f32; 3]], triangle: u32, vertex: u32) -> Result<f32, Error> {
    let vertices = positions.len();
    let position = positions.get(vertex as usize).ok_or(Error::IndexOutOfRange { triangle, vertex, vertices })?;
    if position.iter().any(|x| !x.is_finite()) {
        return Err(Error::NonFinite { triangle, vertex });
    }
    Ok(position.iter().fold(0.0, |largest, x| largest.max(x.abs())))
}

/// The unit normal of the side from which `a`, `b`, `c` run counter-clockwise.
fn unit_normal(a: DVec3, b: DVec3, c: DVec3) -> Vec3 {
    (b - a).cross(c - a).normalize_or_zero().as_vec3()
}
