//! The uniform grid: how many voxels, and which one a place is in.
//!
//! All in f64, where sums and products of `f32` neither overflow nor vanish, and where scaling by a power of two changes
//! no digit.

use crate::{Error, Triangles};
use rayon::prelude::*;

/// Triangles handled by one task; fixed, so that the number of threads changes nothing.
pub(crate) const CHUNK: usize = 1 << 15;

/// Centroids this little below a face, relative to the largest coordinate of the axis, count as on it, and so belong to
/// the voxel above. It is four times the rounding error of an `f32`: regular meshes have centroids exactly on faces, and
/// scaling, say by 1000, would otherwise throw them to either side.
const FACE_WIDTH: f64 = 1.0 / (1 << 22) as f64;
/// The same for the numbers of voxels, which are rounded at halves.
const HALF_WIDTH: f64 = 1.0 / (1 << 20) as f64;

/// Smallest and largest corner of a box. The fourth lane is idle: with it, one instruction does for a corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    low: [f32; 4],
    high: [f32; 4],
}

impl Bounds {
    /// The box of nothing.
    pub(crate) const NOTHING: Self = Self { low: [f32::INFINITY; 4], high: [f32::NEG_INFINITY; 4] };

    /// Widens the box to hold a point.
    #[inline]
    pub(crate) fn hold(&mut self, place: [f32; 4]) {
        self.unite(Self { low: place, high: place });
    }

    /// Widens the box to hold another.
    #[inline]
    pub(crate) fn unite(&mut self, other: Self) {
        for lane in 0..4 {
            self.low[lane] = if other.low[lane] < self.low[lane] { other.low[lane] } else { self.low[lane] };
            self.high[lane] = if other.high[lane] > self.high[lane] { other.high[lane] } else { self.high[lane] };
        }
    }

    /// The box of some points.
    pub(crate) fn of(points: [[f32; 4]; 3]) -> Self {
        let mut bounds = Self::NOTHING;
        for point in points {
            bounds.hold(point);
        }
        bounds
    }

    /// Smallest and largest corner.
    pub(crate) fn corners(&self) -> [[f32; 3]; 2] {
        [self.low, self.high].map(|[x, y, z, _]| [x, y, z])
    }
}

/// Triangles found fit for use.
#[derive(Debug)]
pub(crate) struct Mesh<'a> {
    /// Vertices, with an idle fourth lane.
    pub(crate) places: Vec<[f32; 4]>,
    pub(crate) indices: &'a [[u32; 3]],
    pub(crate) materials: &'a [u32],
    /// The box of all triangles.
    pub(crate) bounds: Bounds,
}

impl<'a> Mesh<'a> {
    /// The first unfit triangle is named.
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
        let places: Vec<[f32; 4]> =
            mesh.positions.par_iter().with_min_len(CHUNK).map(|&[x, y, z]| [x, y, z, 0.0]).collect();
        let chunks: Vec<_> = mesh.indices.par_chunks(CHUNK).map(|chunk| chunk_bounds(&places, chunk)).collect();
        let mut bounds = Bounds::NOTHING;
        for (number, chunk) in chunks.into_iter().enumerate() {
            match chunk {
                Some(part) => bounds.unite(part),
                None => return Err(mesh.first_fault(number * CHUNK)),
            }
        }
        Ok(Self { places, indices: mesh.indices, materials: mesh.materials, bounds })
    }

    /// The corners of a triangle.
    #[inline]
    pub(crate) fn corners(&self, triangle: u32) -> [[f32; 4]; 3] {
        self.indices[triangle as usize].map(|vertex| self.places[vertex as usize])
    }

    /// The material of a triangle.
    pub(crate) fn material(&self, triangle: u32) -> u32 {
        self.materials.get(triangle as usize).copied().unwrap_or(0)
    }
}

/// The box of some triangles; none where one of them is unfit.
fn chunk_bounds(places: &[[f32; 4]], chunk: &[[u32; 3]]) -> Option<Bounds> {
    let mut bounds = Bounds::NOTHING;
    // Zero times a finite number is zero, times anything else NaN: one sum tells whether all were finite.
    let mut zero = [0.0_f32; 4];
    for indices in chunk {
        for &vertex in indices {
            let place = *places.get(vertex as usize)?;
            bounds.hold(place);
            for lane in 0..4 {
                zero[lane] += place[lane] * 0.0;
            }
        }
    }
    (zero == [0.0; 4]).then_some(bounds)
}

impl Triangles<'_> {
    /// What is wrong with the first unfit triangle from `start` on.
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

/// A grid over a box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    /// Voxels along each axis.
    pub(crate) resolution: [u32; 3],
    /// The low corner, less [`FACE_WIDTH`] or a quarter of a voxel.
    low: [f64; 3],
    /// Voxels per unit of length; 0 along an axis without extent.
    density: [f64; 3],
}

impl Grid {
    /// A grid with about `longest` voxels along the box's longest axis, as many per unit of length along the others, and
    /// 1 to `clamp` along each.
    pub(crate) fn new(bounds: Bounds, longest: f64, clamp: u32) -> Self {
        let [low, high] = bounds.corners().map(|corner| corner.map(f64::from));
        let extent: [f64; 3] = std::array::from_fn(|axis| high[axis] - low[axis]);
        let length = extent[0].max(extent[1]).max(extent[2]);
        let mut grid = Self { resolution: [1; 3], low: [0.0; 3], density: [0.0; 3] };
        for axis in 0..3 {
            if extent[axis] > 0.0 {
                let voxels = longest * (extent[axis] / length) * (1.0 + HALF_WIDTH);
                grid.resolution[axis] = (voxels.round() as u32).clamp(1, clamp);
                grid.density[axis] = f64::from(grid.resolution[axis]) / extent[axis];
            }
            // Far from the origin coordinates are coarse; the shift then stays below the voxel.
            let voxel = extent[axis] / f64::from(grid.resolution[axis]);
            let shift = (FACE_WIDTH * low[axis].abs().max(high[axis].abs())).min(0.25 * voxel);
            grid.low[axis] = low[axis] - shift;
        }
        grid
    }

    /// Voxels along the longest axis of a box for K, before the clamp.
    pub(crate) fn longest(k: f64, triangles: usize) -> f64 {
        k * (triangles as f64).cbrt()
    }

    /// Voxels in all, occupied or not.
    pub(crate) fn voxels(&self) -> u64 {
        self.resolution.iter().map(|&n| u64::from(n)).product()
    }

    /// The voxel's number: x runs fastest, z slowest.
    #[inline]
    pub(crate) fn number(&self, [x, y, z]: [u32; 3]) -> u64 {
        let [nx, ny, _] = self.resolution.map(u64::from);
        (u64::from(z) * ny + u64::from(y)) * nx + u64::from(x)
    }

    /// The voxel that holds a point of the box. Points on a face belong to the voxel above.
    #[inline]
    fn voxel(&self, place: [f64; 3]) -> [u32; 3] {
        // Next to 2^32 an f64's last digit is 2^-20, and below the leading one are the digits of what was added: a cast
        // in two instructions. It counts places up to 2^-21 of a voxel below a face as on it.
        const LEADING: f64 = (1_u64 << 32) as f64;
        std::array::from_fn(|axis| {
            let voxels = (place[axis] - self.low[axis]) * self.density[axis];
            let voxel = ((voxels + LEADING).to_bits() >> 20) as u32;
            voxel.min(self.resolution[axis] - 1)
        })
    }

    /// The number of the voxel of a triangle's centroid.
    #[inline]
    pub(crate) fn centroid_voxel(&self, corners: [[f32; 4]; 3]) -> u64 {
        self.number(self.voxel(centroid_sum(corners).map(|x| x * (1.0 / 3.0))))
    }

    /// First and last voxel that a box overlaps, along each axis.
    pub(crate) fn overlapped(&self, bounds: Bounds) -> [[u32; 3]; 2] {
        bounds.corners().map(|corner| self.voxel(corner.map(f64::from)))
    }
}

/// Three times the centroid.
#[inline]
pub(crate) fn centroid_sum([a, b, c]: [[f32; 4]; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| f64::from(a[axis]) + f64::from(b[axis]) + f64::from(c[axis]))
}
