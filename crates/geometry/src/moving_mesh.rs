use crate::mesh::{LOST_IN_F64, ROUNDING, has_no_area};
use crate::{Error, Mesh};
use glam::Vec3;

/// Triangles whose vertices move: each in a straight line, from where it is at time 0 to where it is at time 1. Before
/// and after it stands still.
///
/// Corners at a time are rounded to f32, the same for all triangles at a vertex: so the mesh is watertight at each time.
/// Triangles that have no area at times 0, 1/2 and 1 have none at any time, and are never hit.
#[derive(Clone, Debug)]
pub struct MovingMesh {
    start: Mesh,
    ends: Vec<[f32; 3]>,
    degenerate: usize,
    lost: f32,
}

impl MovingMesh {
    /// Checks and takes over the vertices at both times, and the triangles (three vertex numbers each).
    ///
    /// # Errors
    /// As [`Mesh::new`], for either time; [`Error::BadParameter`] if there are not as many vertices at both.
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

    /// The mesh as it stands at time 0.
    #[must_use]
    pub fn start(&self) -> &Mesh {
        &self.start
    }

    /// The vertices at time 1.
    #[must_use]
    pub fn ends(&self) -> &[[f32; 3]] {
        &self.ends
    }

    /// How many triangles have no area at any time and are therefore never hit.
    #[must_use]
    pub fn degenerate(&self) -> usize {
        self.degenerate
    }

    /// Whether this triangle has no area at any time: the area is quadratic in time, so three times tell. The number
    /// must be below that of the triangles.
    #[must_use]
    pub fn is_degenerate(&self, triangle: u32) -> bool {
        [0.0, 0.5, 1.0].into_iter().all(|time| has_no_area(self.corners(triangle, time)))
    }

    /// The three corners of a triangle at a time. The number must be below that of the triangles.
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

    /// The corners at time 1 themselves, which rounding may keep [`corners`](Self::corners) from reaching.
    pub(crate) fn ends_of(&self, triangle: u32) -> [Vec3; 3] {
        self.start.triangles()[triangle as usize].map(|vertex| Vec3::from_array(self.ends[vertex as usize]))
    }

    /// A point of a triangle at a time from the weights of its second and third corner, with a bound on its distance from
    /// the triangle of [`corners`](Self::corners) per axis, and the unit normal; see [`Mesh::point`].
    #[must_use]
    pub fn point(&self, triangle: u32, barycentrics: [f32; 2], time: f32) -> (Vec3, Vec3, Vec3) {
        let [a, b, c] = self.corners(triangle, time).map(Vec3::as_dvec3);
        let [second, third] = barycentrics.map(f64::from);
        let position = (a + (b - a) * second + (c - a) * third).as_vec3();
        let error = position.abs() * ROUNDING as f32 + Vec3::splat(self.lost);
        (position, error, (b - a).cross(c - a).normalize_or_zero().as_vec3())
    }
}

/// A coordinate on its way, to the bit as the walk computes it.
#[inline(always)]
pub(crate) fn between(from: f32, to: f32, time: f32) -> f32 {
    from + (to - from) * time
}
