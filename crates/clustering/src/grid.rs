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
    #[inline]
    pub(crate) fn of([a, b, c]: [[f32; 4]; 3]) -> Self {
        let mut bounds = Self { low: a, high: a };
        bounds.hold(b);
        bounds.hold(c);
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
    /// Vertices.
    pub(crate) positions: &'a [[f32; 3]],
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
        let bounds = match mesh.bounds_of_vertices() {
            Some(bounds) => bounds,
            None => mesh.bounds_of_triangles()?,
        };
        Ok(Self { positions: mesh.positions, indices: mesh.indices, materials: mesh.materials, bounds })
    }

    /// The corners of a triangle, with an idle fourth lane.
    #[inline]
    pub(crate) fn corners(&self, triangle: u32) -> [[f32; 4]; 3] {
        self.indices[triangle as usize].map(|vertex| padded(self.positions[vertex as usize]))
    }

    /// The material of a triangle.
    pub(crate) fn material(&self, triangle: u32) -> u32 {
        self.materials.get(triangle as usize).copied().unwrap_or(0)
    }
}

#[inline]
fn padded([x, y, z]: [f32; 3]) -> [f32; 4] {
    [x, y, z, 0.0]
}

/// The box of some places; none where one of them is not finite.
fn finite_bounds(places: impl Iterator<Item = [f32; 4]>) -> Option<Bounds> {
    let mut bounds = Bounds::NOTHING;
    // Zero times a finite number is zero, times anything else NaN: one sum tells whether all were finite.
    let mut zero = [0.0_f32; 4];
    for place in places {
        bounds.hold(place);
        for lane in 0..4 {
            zero[lane] += place[lane] * 0.0;
        }
    }
    (zero == [0.0; 4]).then_some(bounds)
}

/// Of some indices the largest, and whether each of six vertices is among them.
fn look_up(indices: &[[u32; 3]], vertices: [u32; 6]) -> (u32, [bool; 6]) {
    let (mut largest, mut found) = (0, [0_u32; 6]);
    for &index in indices.as_flattened() {
        largest = largest.max(index);
        for (found, &vertex) in found.iter_mut().zip(&vertices) {
            *found |= u32::from(index == vertex);
        }
    }
    (largest, found.map(|found| found != 0))
}

impl Triangles<'_> {
    /// The box of all triangles without looking at each: that of all vertices, if those on its faces are in use. None if
    /// that cannot be said so simply, or if a triangle is unfit.
    fn bounds_of_vertices(&self) -> Option<Bounds> {
        let chunk_bounds = |places: &[[f32; 3]]| finite_bounds(places.iter().map(|&place| padded(place)));
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
            .map(|chunk| look_up(chunk, extremes))
            .reduce(|| (0, [false; 6]), |a, b| (a.0.max(b.0), std::array::from_fn(|i| a.1[i] | b.1[i])));
        ((largest as usize) < self.positions.len() && found == [true; 6]).then_some(bounds)
    }

    /// The box of all triangles. The first unfit triangle is named.
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
    /// For places.
    whole: Scale,
    /// For thirds of places: sums of three.
    thirds: Scale,
}

/// From places to voxels; the fourth lane is idle.
#[derive(Clone, Copy, Debug, Default)]
struct Scale {
    /// The low corner, less [`FACE_WIDTH`] or a quarter of a voxel.
    low: [f64; 4],
    /// Voxels per unit of length; 0 along an axis without extent.
    density: [f64; 4],
}

impl Grid {
    /// A grid with about `longest` voxels along the box's longest axis, as many per unit of length along the others, and
    /// 1 to `clamp` along each.
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
            // Far from the origin coordinates are coarse; the shift then stays below the voxel.
            let voxel = extent[axis] / f64::from(resolution[axis]);
            let shift = (FACE_WIDTH * low[axis].abs().max(high[axis].abs())).min(0.25 * voxel);
            whole.low[axis] = low[axis] - shift;
        }
        let thirds = Scale { low: whole.low.map(|x| 3.0 * x), density: whole.density.map(|x| x / 3.0) };
        Self { resolution, whole, thirds }
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

    /// The voxel that holds a point of the box, given in some unit. Points on a face belong to the voxel above.
    #[inline]
    fn voxel(&self, place: [f64; 4], scale: &Scale) -> [u32; 3] {
        // Next to 2^32 an f64's last digit is 2^-20, and below the leading one are the digits of what was added: a cast
        // in two instructions. It counts places up to 2^-21 of a voxel below a face as on it.
        const LEADING: f64 = (1_u64 << 32) as f64;
        let voxels: [f64; 4] =
            std::array::from_fn(|lane| (place[lane] - scale.low[lane]) * scale.density[lane] + LEADING);
        std::array::from_fn(|axis| ((voxels[axis].to_bits() >> 20) as u32).min(self.resolution[axis] - 1))
    }

    /// The number of the voxel of a triangle's centroid.
    #[inline]
    pub(crate) fn centroid_voxel(&self, [a, b, c]: [[f32; 4]; 3]) -> u64 {
        let sum = std::array::from_fn(|lane| f64::from(a[lane]) + f64::from(b[lane]) + f64::from(c[lane]));
        self.number(self.voxel(sum, &self.thirds))
    }

    /// First and last voxel that a box overlaps, along each axis.
    pub(crate) fn overlapped(&self, bounds: Bounds) -> [[u32; 3]; 2] {
        [bounds.low, bounds.high].map(|corner| self.voxel(corner.map(f64::from), &self.whole))
    }
}

/// Three times the centroid.
#[inline]
pub(crate) fn centroid_sum([a, b, c]: [[f32; 4]; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| f64::from(a[axis]) + f64::from(b[axis]) + f64::from(c[axis]))
}
