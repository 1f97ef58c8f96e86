use crate::mesh::{LOST_IN_F64, ROUNDING, has_no_area};
use crate::{Error, Mesh};
use glam::Vec3;

/// An indexed triangle mesh with moving vertices. Each vertex moves in a straight line from its position at time 0 to
/// its position at time 1, and is at rest before and after.
///
/// The corners at a time are rounded to f32 in the same way for all triangles that share a vertex, so the mesh is
/// watertight at every time. Triangles without area at times 0, 1/2 and 1 have none at any time and are never hit.
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
        if starts.len() != ends.len() {
            let expected = "there must be as many vertices at time 1 as at time 0";
            return Err(Error::BadParameter {
                what: "a moving mesh's vertices at time 1",
                value: ends.len() as f64,
                expected,
            });
        }
        let end = Mesh::new(ends, triangles.clone())?;
        let start = Mesh::new(starts, triangles)?;
        let largest = |mesh: &Mesh| mesh.positions().iter().flatten().fold(0.0_f32, |most, x| most.max(x.abs()));
        let lost = (3.0 * f64::from(largest(&start).max(largest(&end))) * LOST_IN_F64) as f32;
        let mut mesh = Self { start, ends: end.positions().to_vec(), degenerate: 0, lost };
        mesh.degenerate = (0..mesh.start.triangles().len() as u32).filter(|&n| mesh.is_degenerate(n)).count();
        Ok(mesh)
    }

    /// The triangle mesh with the vertices' positions at time 0.
    #[must_use]
    pub fn start(&self) -> &Mesh {
        &self.start
    }

    /// The positions of the vertices at time 1.
    #[must_use]
    pub fn ends(&self) -> &[[f32; 3]] {
        &self.ends
    }

    /// The number of triangles that have no area at any time in `[0, 1]`, which are never hit.
    #[must_use]
    pub fn degenerate(&self) -> usize {
        self.degenerate
    }

    /// Returns true if the triangle has no area at any time in `[0, 1]`. The vector of its area is quadratic in time,
    /// so three times decide. The index must be below the number of triangles.
    #[must_use]
    pub fn is_degenerate(&self, triangle: u32) -> bool {
        [0.0, 0.5, 1.0].into_iter().all(|time| has_no_area(self.corners(triangle, time)))
    }

    /// Returns the three corners of a triangle at a time, clamped to `[0, 1]`. The index must be below the number of
    /// triangles.
    #[inline]
    #[must_use]
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

    /// Returns a point of a triangle at a time, a bound on the point's error per axis, and the unit normal.
    /// `barycentrics` are the weights of the second and third corner. The error is the distance to the triangle of
    /// [`corners`](Self::corners).
    #[must_use]
    pub fn point(&self, triangle: u32, barycentrics: [f32; 2], time: f32) -> (Vec3, Vec3, Vec3) {
        let [a, b, c] = self.corners(triangle, time).map(Vec3::as_dvec3);
        let [second, third] = barycentrics.map(f64::from);
        let position = (a + (b - a) * second + (c - a) * third).as_vec3();
        let error = position.abs() * ROUNDING as f32 + Vec3::splat(self.lost);
        (position, error, (b - a).cross(c - a).normalize_or_zero().as_vec3())
    }
}

/// Returns a coordinate interpolated linearly at a time in `[0, 1]`. Traversal and surface points both call it, so
/// that they agree to the last bit.
#[inline(always)]
pub(crate) fn between(from: f32, to: f32, time: f32) -> f32 {
    from + (to - from) * time
}
