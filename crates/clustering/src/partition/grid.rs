//! The uniform grid: its resolution, and the voxel that contains a point.
//!
//! All arithmetic is in f64. Sums and products of `f32` then neither overflow nor underflow, and scaling by a power of two
//! changes no digit.

use crate::{Error, Triangles};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// The number of triangles per parallel task. It is fixed, so that the number of threads has no effect.
pub(crate) const CHUNK: usize = 1 << 15;

/// The tolerance at the faces of voxels, as a fraction of the axis's largest absolute coordinate. Points within this distance
/// below a face count as on it and belong to the voxel above.
///
/// The tolerance is four times the rounding error of an `f32`. Regular meshes have centroids exactly on faces, and scaling by
/// 1000, for example, would move these to either side.
const FACE_WIDTH: f64 = 1.0 / (1 << 22) as f64;
/// The relative increase of a number of voxels before rounding, so that numbers just below one half round up.
const HALF_WIDTH: f64 = 1.0 / (1 << 20) as f64;

/// An axis-aligned box, stored as its smallest and largest corner. The fourth lane is unused, so that one instruction processes
/// a corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    low: [f32; 4],
    high: [f32; 4],
}

impl Bounds {
    /// The empty box.
    pub(crate) const NOTHING: Self = Self { low: [f32::INFINITY; 4], high: [f32::NEG_INFINITY; 4] };

    /// Widens the box to contain a point.
    #[inline(always)]
    pub(crate) fn hold(&mut self, place: [f32; 4]) {
        self.unite(Self { low: place, high: place });
    }

    /// Widens the box to contain another box.
    #[inline(always)]
    pub(crate) fn unite(&mut self, other: Self) {
        for lane in 0..4 {
            self.low[lane] = if other.low[lane] < self.low[lane] { other.low[lane] } else { self.low[lane] };
            self.high[lane] = if other.high[lane] > self.high[lane] { other.high[lane] } else { self.high[lane] };
        }
    }

    /// The bounding box of three points.
    #[inline(always)]
    pub(crate) fn of([a, b, c]: [[f32; 4]; 3]) -> Self {
        let mut bounds = Self { low: a, high: a };
        bounds.hold(b);
        bounds.hold(c);
        bounds
    }

    /// The smallest and largest corner of the box.
    pub(crate) fn corners(&self) -> [[f32; 3]; 2] {
        [self.low, self.high].map(|[x, y, z, _]| [x, y, z])
    }
}

/// The triangles to cluster, after all checks have passed.
#[derive(Debug)]
pub(crate) struct Mesh<'a> {
    /// The positions of the vertices.
    pub(crate) positions: &'a [[f32; 3]],
    pub(crate) indices: &'a [[u32; 3]],
    pub(crate) materials: &'a [u32],
    /// The bounding box of all triangles.
    pub(crate) bounds: Bounds,
}

impl<'a> Mesh<'a> {
    /// Checks triangles; the error identifies the first invalid one.
    pub(crate) fn new(mesh: &Triangles<'a>) -> Result<Self, Error> {
        let triangles = mesh.indices.len();
        if triangles == 0 {
            return Err(Error::Empty);
        }
        if u32::try_from(triangles).is_err() {
            return Err(Error::TooManyTriangles { triangles });
        }
        if !mesh.materials.is_empty() && mesh.materials.len() != triangles {
            return Err(Error::BadMaterials { materials: mesh.materials.len(), triangles });
        }
        let bounds = mesh.bounds_of_vertices().map_or_else(|| mesh.bounds_of_triangles(), Ok)?;
        Ok(Self { positions: mesh.positions, indices: mesh.indices, materials: mesh.materials, bounds })
    }

    /// The positions of a triangle's corners, with an unused fourth coordinate.
    #[inline(always)]
    pub(crate) fn corners(&self, triangle: u32) -> [[f32; 4]; 3] {
        self.indices[triangle as usize].map(|vertex| padded(self.positions[vertex as usize]))
    }

    /// The material number of a triangle; 0 if the mesh has no materials.
    pub(crate) fn material(&self, triangle: u32) -> u32 {
        self.materials.get(triangle as usize).copied().unwrap_or(0)
    }
}

#[inline(always)]
fn padded([x, y, z]: [f32; 3]) -> [f32; 4] {
    [x, y, z, 0.0]
}

/// The bounding box of some points, or `None` if one of them is not finite.
#[inline(always)]
fn finite_bounds(places: impl Iterator<Item = [f32; 4]>) -> Option<Bounds> {
    let mut bounds = Bounds::NOTHING;
    // A finite number times zero is zero; any other is NaN. So one sum checks all numbers.
    let mut zero = [0.0_f32; 4];
    for place in places {
        bounds.hold(place);
        for lane in 0..4 {
            zero[lane] += place[lane] * 0.0;
        }
    }
    (zero == [0.0; 4]).then_some(bounds)
}

/// The number of floats in eight points. With this number, each lane has the same axis in every group.
const GROUP: usize = 24;

/// The bounding box of all points of a chunk, or `None` if a point is not finite. pulp compiles it for each width of vector
/// registers.
struct PointBounds<'a> {
    points: &'a [[f32; 3]],
}

impl NullaryFnOnce for PointBounds<'_> {
    type Output = Option<Bounds>;

    #[inline(always)]
    fn call(self) -> Option<Bounds> {
        let (groups, rest) = self.points.as_flattened().as_chunks::<GROUP>();
        let (mut low, mut high, mut zero) = ([f32::INFINITY; GROUP], [f32::NEG_INFINITY; GROUP], [0.0_f32; GROUP]);
        for group in groups {
            for lane in 0..GROUP {
                let x = group[lane];
                low[lane] = if x < low[lane] { x } else { low[lane] };
                high[lane] = if x > high[lane] { x } else { high[lane] };
                zero[lane] += x * 0.0;
            }
        }
        let mut bounds = finite_bounds(rest.as_chunks::<3>().0.iter().map(|&place| padded(place)))?;
        for lane in (0..GROUP).step_by(3) {
            let corner = |of: &[f32; GROUP]| padded([of[lane], of[lane + 1], of[lane + 2]]);
            bounds.unite(Bounds { low: corner(&low), high: corner(&high) });
        }
        (zero == [0.0; GROUP]).then_some(bounds)
    }
}

/// A pass over indices that finds the largest index, and which of six vertices triangles use. pulp compiles it for each width
/// of vector registers.
struct LookUp<'a> {
    indices: &'a [[u32; 3]],
    vertices: [u32; 6],
}

impl NullaryFnOnce for LookUp<'_> {
    type Output = (u32, [bool; 6]);

    #[inline(always)]
    fn call(self) -> (u32, [bool; 6]) {
        const LANES: usize = 8;
        let (groups, rest) = self.indices.as_flattened().as_chunks::<LANES>();
        let (mut largest, mut found) = ([0; LANES], [[0_u32; LANES]; 6]);
        let mut see = |lane: usize, index: u32| {
            largest[lane] = if index > largest[lane] { index } else { largest[lane] };
            for (found, &vertex) in found.iter_mut().zip(&self.vertices) {
                found[lane] |= u32::from(index == vertex);
            }
        };
        for group in groups {
            group.iter().enumerate().for_each(|(lane, &index)| see(lane, index));
        }
        rest.iter().for_each(|&index| see(0, index));
        (largest.into_iter().fold(0, u32::max), found.map(|found| found != [0; LANES]))
    }
}

impl Triangles<'_> {
    /// The bounding box of all vertices if triangles use the vertices on its faces. `None` otherwise, or if an index or a
    /// position is invalid. This is faster than visiting the corners of each triangle.
    fn bounds_of_vertices(&self) -> Option<Bounds> {
        let chunk_bounds = |points| Arch::new().dispatch(PointBounds { points });
        let unite = |mut a: Bounds, b| {
            a.unite(b);
            Some(a)
        };
        let chunks = self.positions.par_chunks(CHUNK).map(chunk_bounds);
        let bounds = chunks.try_reduce(|| Bounds::NOTHING, unite)?;
        let mut extremes = [0; 6];
        for (number, corner) in bounds.corners().into_iter().enumerate() {
            for axis in 0..3 {
                let vertex = self.positions.iter().position(|place| place[axis] == corner[axis])?;
                extremes[3 * number + axis] = u32::try_from(vertex).ok()?;
            }
        }
        let (largest, found) = self
            .indices
            .par_chunks(CHUNK)
            .map(|indices| Arch::new().dispatch(LookUp { indices, vertices: extremes }))
            .reduce(|| (0, [false; 6]), |a, b| (a.0.max(b.0), std::array::from_fn(|i| a.1[i] | b.1[i])));
        ((largest as usize) < self.positions.len() && found == [true; 6]).then_some(bounds)
    }

    /// The bounding box of all triangles. The error identifies the first invalid triangle.
    fn bounds_of_triangles(&self) -> Result<Bounds, Error> {
        let chunk_bounds = |chunk: &[[u32; 3]]| {
            let vertices = self.positions.len();
            if chunk.as_flattened().iter().any(|&vertex| vertex as usize >= vertices) {
                return None;
            }
            finite_bounds(chunk.as_flattened().iter().map(|&vertex| padded(self.positions[vertex as usize])))
        };
        let chunks: Vec<_> = self.indices.par_chunks(CHUNK).map(chunk_bounds).collect();
        let mut bounds = Bounds::NOTHING;
        for (number, chunk) in chunks.into_iter().enumerate() {
            match chunk {
                Some(part) => bounds.unite(part),
                None => return Err(self.first_fault(number * CHUNK)),
            }
        }
        Ok(bounds)
    }

    /// The error of the first invalid triangle from `start` on.
    fn first_fault(&self, start: usize) -> Error {
        for (triangle, indices) in self.indices.iter().enumerate().skip(start) {
            let triangle = triangle as u32;
            for &index in indices {
                match self.positions.get(index as usize) {
                    None => return Error::BadIndex { triangle, index, vertices: self.positions.len() },
                    Some(place) if !place.iter().all(|x| x.is_finite()) => {
                        return Error::BadPosition { triangle, vertex: index };
                    }
                    Some(_) => {}
                }
            }
        }
        Error::Empty
    }
}

/// A uniform voxel grid over a box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    /// The number of voxels along each axis.
    pub(crate) resolution: [u32; 3],
    /// The map from points to voxels.
    whole: Scale,
    /// The map from sums of three points (three times a centroid) to voxels.
    thirds: Scale,
}

/// A linear map from points to voxel coordinates: `(point - low) * density`. The fourth lane is unused.
#[derive(Clone, Copy, Debug, Default)]
struct Scale {
    /// The lower corner of the box, lowered by the tolerance at faces, which is at most a quarter of a voxel.
    low: [f64; 4],
    /// The number of voxels per unit of length; 0 along an axis with zero extent.
    density: [f64; 4],
}

impl Grid {
    /// Creates a grid with about `longest` voxels along the box's longest axis, the same density along the other axes, and 1 to
    /// `clamp` voxels along each.
    pub(crate) fn new(bounds: Bounds, longest: f64, clamp: u32) -> Self {
        let [low, high] = bounds.corners().map(|corner| corner.map(f64::from));
        let extent: [f64; 3] = std::array::from_fn(|axis| high[axis] - low[axis]);
        let length = extent[0].max(extent[1]).max(extent[2]);
        let (mut resolution, mut whole) = ([1; 3], Scale::default());
        for axis in 0..3 {
            if extent[axis] > 0.0 {
                let voxels = longest * (extent[axis] / length) * (1.0 + HALF_WIDTH);
                resolution[axis] = (voxels.round() as u32).clamp(1, clamp);
                whole.density[axis] = f64::from(resolution[axis]) / extent[axis];
            }
            // Far from the origin, coordinates are coarse. The shift stays below a voxel there.
            let voxel = extent[axis] / f64::from(resolution[axis]);
            let shift = (FACE_WIDTH * low[axis].abs().max(high[axis].abs())).min(0.25 * voxel);
            whole.low[axis] = low[axis] - shift;
        }
        let thirds = Scale { low: whole.low.map(|x| 3.0 * x), density: whole.density.map(|x| x / 3.0) };
        Self { resolution, whole, thirds }
    }

    /// The number of voxels along the longest axis for the factor K, before clamping.
    pub(crate) fn longest(k: f64, triangles: usize) -> f64 {
        k * (triangles as f64).cbrt()
    }

    /// The number of voxels in the grid, occupied or not.
    pub(crate) fn voxels(&self) -> u64 {
        self.resolution.iter().map(|&n| u64::from(n)).product()
    }

    /// The index of a voxel in the grid: x runs fastest, z slowest.
    #[inline(always)]
    pub(crate) fn number(&self, [x, y, z]: [u32; 3]) -> u64 {
        let [nx, ny, _] = self.resolution.map(u64::from);
        (u64::from(z) * ny + u64::from(y)) * nx + u64::from(x)
    }

    /// The voxel that contains a point, along each axis. Points on a face belong to the voxel above.
    #[inline(always)]
    fn voxel(&self, place: [f64; 4], scale: &Scale) -> [u32; 3] {
        // Next to 2^32 the last digit of an f64 is 2^-20, and the digits below the leading one are those of the addend. This
        // converts to an integer in two instructions. Points up to 2^-21 of a voxel below a face count as on it.
        const LEADING: f64 = (1_u64 << 32) as f64;
        let voxels: [f64; 4] =
            std::array::from_fn(|lane| (place[lane] - scale.low[lane]) * scale.density[lane] + LEADING);
        std::array::from_fn(|axis| ((voxels[axis].to_bits() >> 20) as u32).min(self.resolution[axis] - 1))
    }

    /// The index of the voxel that contains a triangle's centroid.
    #[inline(always)]
    pub(crate) fn centroid_voxel(&self, [a, b, c]: [[f32; 4]; 3]) -> u64 {
        let sum = std::array::from_fn(|lane| f64::from(a[lane]) + f64::from(b[lane]) + f64::from(c[lane]));
        self.number(self.voxel(sum, &self.thirds))
    }

    /// The first and last voxel that a box overlaps, along each axis.
    pub(crate) fn overlapped(&self, bounds: Bounds) -> [[u32; 3]; 2] {
        [bounds.low, bounds.high].map(|corner| self.voxel(corner.map(f64::from), &self.whole))
    }
}

/// The sum of a triangle's corners, three times its centroid.
#[inline]
pub(crate) fn centroid_sum([a, b, c]: [[f32; 4]; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| f64::from(a[axis]) + f64::from(b[axis]) + f64::from(c[axis]))
}
