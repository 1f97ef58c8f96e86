//! Normals, areas and boxes of triangles, a block at a time.
//!
//! Blocks have one array per coordinate, so that one instruction of any width processes several triangles.

use crate::Cluster;
use crate::partition::grid::{Bounds, Mesh};

/// The sine of the angle between two edges up to which a triangle is flat, that is, without a normal. For three `f32` points on
/// a line, rounding in f64 gives a sine of about `2^-52`.
const FLAT: f64 = 1.0 / (1_u64 << 46) as f64;
/// The number of triangles per block: enough to fill the widest registers, few enough for the nearest cache.
const BLOCK: usize = 16;
/// The number of triangles between prefetching corners and using them.
const AHEAD: usize = 2 * BLOCK;

/// The largest number of triangles in a group that is clustered in vector lanes. Each class of similar normals needs a pass
/// over all lanes, and larger groups tend to have more classes.
pub(crate) const MAX_SMALL: usize = 256;
/// One value for each triangle of a block.
type Lanes<T> = [T; BLOCK];

/// The area, normal and bounding box of a triangle, or their sum over the triangles of a cluster.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    /// The unit normal times twice the area (three values), and twice the area; all zero for a triangle without a
    /// normal.
    pub(crate) weighted: [f64; 4],
    /// The bounding box of the triangle or triangles.
    pub(crate) bounds: Bounds,
}

impl Surface {
    /// The sum over no triangles.
    pub(crate) const NOTHING: Self = Self { weighted: [0.0; 4], bounds: Bounds::NOTHING };

    /// Adds a triangle, whose normal must already be on the side of the sum. Takes `self` by value, so that the compiler knows
    /// that the two do not overlap.
    #[inline(always)]
    pub(crate) fn and(mut self, other: Self) -> Self {
        for lane in 0..4 {
            self.weighted[lane] += other.weighted[lane];
        }
        self.bounds.unite(other.bounds);
        self
    }

    /// Returns the surface, with its normal negated if `turned`.
    #[inline(always)]
    pub(crate) fn turned(&self, turned: bool) -> Self {
        let side = if turned { -1.0 } else { 1.0 };
        let [x, y, z, weight] = self.weighted;
        Self { weighted: [side * x, side * y, side * z, weight], bounds: self.bounds }
    }

    /// The area-weighted mean normal, of unit length; zero if normals cancel up to rounding.
    #[inline(always)]
    pub(crate) fn normal(&self) -> [f32; 3] {
        let [x, y, z, weight] = self.weighted;
        let length = (x * x + y * y + z * z).sqrt();
        // Normals have an error of about 2^-24.
        const CANCELLED: f64 = 1e-6;
        if length <= CANCELLED * weight {
            return [0.0; 3];
        }
        let inverse = 1.0 / length;
        [x, y, z].map(|x| (x * inverse) as f32)
    }

    /// Returns `common` with the box and the area set.
    #[inline(always)]
    pub(crate) fn cluster(&self, common: Cluster) -> Cluster {
        Cluster { bounds: self.bounds.corners(), area: 0.5 * self.weighted[3], ..common }
    }
}

/// The unit normals of consecutive triangles, one slice per axis. A flat triangle has normal zero and `flat` 1; others have
/// `flat` 0. The last entries may belong to other groups or be unused.
#[derive(Clone, Copy)]
pub(crate) struct Normals<'a> {
    axes: [&'a [f32]; 3],
    pub(crate) flat: &'a [f32],
}

impl<'a> Normals<'a> {
    #[inline(always)]
    pub(crate) fn of(&self, i: usize) -> [f32; 3] {
        self.axes.map(|axis| axis[i])
    }

    /// Returns `true` if a triangle has no normal.
    #[inline(always)]
    pub(crate) fn is_flat(&self, i: usize) -> bool {
        self.flat[i] != 0.0
    }

    /// The cosine between a triangle's normal and a unit vector; 0 without a normal.
    #[inline(always)]
    pub(crate) fn dot(&self, i: usize, other: [f32; 3]) -> f32 {
        let own = self.of(i);
        own[0] * other[0] + own[1] * other[1] + own[2] * other[2]
    }

    /// The cosine between a triangle's normal and a unit vector; 1 for a triangle without a normal, which cannot deviate.
    #[inline(always)]
    pub(crate) fn cosine(&self, i: usize, other: [f32; 3]) -> f32 {
        self.dot(i, other) + self.flat[i]
    }

    /// The x, y and z of the first N normals; `None` if fewer are stored.
    #[inline(always)]
    pub(crate) fn first<const N: usize>(&self) -> Option<[&'a [f32; N]; 3]> {
        let [x, y, z] = self.axes.map(<[f32]>::first_chunk);
        Some([x?, y?, z?])
    }
}

/// The surfaces and normals of triangles, in the same order.
#[derive(Default)]
pub(crate) struct Surfaces {
    pub(crate) surfaces: Vec<Surface>,
    axes: [Vec<f32>; 3],
    flat: Vec<f32>,
    prefetch: Prefetch,
}

impl Surfaces {
    /// The normals of the triangles from index `start` on.
    pub(crate) fn normals(&self, start: usize) -> Normals<'_> {
        Normals { axes: self.axes.each_ref().map(|axis| &axis[start..]), flat: &self.flat[start..] }
    }

    /// Replaces the contents by the surfaces and normals of `triangles`. If `two_sided`, normals are flipped upwards.
    #[inline(always)]
    pub(crate) fn load(&mut self, mesh: &Mesh<'_>, triangles: &[u32], two_sided: bool) {
        self.surfaces.clear();
        // Old values do not matter, and neither do those after the last triangle.
        let room = triangles.len().next_multiple_of(BLOCK) + MAX_SMALL;
        for lanes in self.axes.iter_mut().chain([&mut self.flat]) {
            lanes.resize(room, 0.0);
        }
        let mut corners = Corners::default();
        let mut bounds = [Bounds::NOTHING; BLOCK];
        for (number, block) in triangles.chunks(BLOCK).enumerate() {
            self.request(mesh, triangles, number * BLOCK);
            // At most the length of the arrays, so that the compiler omits bounds checks.
            let count = block.len().min(BLOCK);
            for lane in 0..count {
                let own = mesh.corners(block[lane]);
                bounds[lane] = Bounds::of(own);
                corners.put(lane, own);
            }
            let found = Crosses::of(&corners, two_sided);
            self.surfaces.extend((0..count).map(|lane| Surface {
                weighted: [found.cross[0][lane], found.cross[1][lane], found.cross[2][lane], found.doubled[lane]],
                bounds: bounds[lane],
            }));
            let lanes = number * BLOCK..number * BLOCK + BLOCK;
            for (axis, unit) in self.axes.iter_mut().zip(&found.unit) {
                axis[lanes.clone()].copy_from_slice(unit);
            }
            self.flat[lanes].copy_from_slice(&found.flat);
        }
    }
}

impl Surfaces {
    /// Prefetches the indices and corners of a block of `triangles` that is processed soon after the block at `start`.
    #[inline(always)]
    fn request(&self, mesh: &Mesh<'_>, triangles: &[u32], start: usize) {
        for &triangle in triangles.iter().skip(start + 2 * AHEAD).take(BLOCK) {
            self.prefetch.request(mesh.indices, triangle as usize);
        }
        for &triangle in triangles.iter().skip(start + AHEAD).take(BLOCK) {
            for vertex in mesh.indices[triangle as usize] {
                self.prefetch.request(mesh.positions, vertex as usize);
            }
        }
    }
}

/// The corners of the triangles of a block, by corner and axis.
#[derive(Default)]
struct Corners {
    corners: [[Lanes<f32>; 3]; 3],
}

impl Corners {
    #[inline(always)]
    fn put(&mut self, lane: usize, corners: [[f32; 4]; 3]) {
        for (lanes, corner) in self.corners.iter_mut().zip(corners) {
            for axis in 0..3 {
                lanes[axis][lane] = corner[axis];
            }
        }
    }
}

/// The cross products of the edges of a block's triangles, with doubled areas and unit normals computed from them.
struct Crosses {
    cross: [Lanes<f64>; 3],
    doubled: Lanes<f64>,
    unit: [Lanes<f32>; 3],
    /// For each triangle, 1 if it has no normal, else 0.
    flat: Lanes<f32>,
}

impl Crosses {
    #[inline(always)]
    fn of(corners: &Corners, two_sided: bool) -> Self {
        let mut found =
            Self { cross: [[0.0; BLOCK]; 3], doubled: [0.0; BLOCK], unit: [[0.0; BLOCK]; 3], flat: [0.0; BLOCK] };
        for lane in 0..BLOCK {
            let [a, b, c] = corners
                .corners
                .each_ref()
                .map(|corner| [f64::from(corner[0][lane]), f64::from(corner[1][lane]), f64::from(corner[2][lane])]);
            let u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
            let v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
            let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            let square = |a: [f64; 3]| a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
            let squared = square(n);
            let flat = squared <= FLAT * FLAT * (square(u) * square(v));
            let length = squared.sqrt();
            let inverse = if flat { 0.0 } else { 1.0 / length };
            found.doubled[lane] = if flat { 0.0 } else { length };
            found.flat[lane] = if flat { 1.0 } else { 0.0 };
            for (axis, n) in n.into_iter().enumerate() {
                found.cross[axis][lane] = if flat { 0.0 } else { n };
                found.unit[axis][lane] = (n * inverse) as f32;
            }
        }
        if two_sided {
            found.turn_up();
        }
        found
    }

    /// Flips each normal to z > 0 (to y > 0 if z is 0, to x > 0 if both are 0).
    #[inline(always)]
    fn turn_up(&mut self) {
        for lane in 0..BLOCK {
            let n = [self.unit[0][lane], self.unit[1][lane], self.unit[2][lane]];
            // Without branches, since half the normals of a closed surface point either way.
            let negative = (n[2] < 0.0) | ((n[2] == 0.0) & ((n[1] < 0.0) | ((n[1] == 0.0) & (n[0] < 0.0))));
            let sign = if negative { -1.0_f32 } else { 1.0 };
            for axis in 0..3 {
                self.unit[axis][lane] *= sign;
                self.cross[axis][lane] *= f64::from(sign);
            }
        }
    }
}

/// The triangles of one material in a voxel, ascending by index, with their surfaces and normals.
#[derive(Clone, Copy)]
pub(crate) struct Members<'a> {
    pub(crate) triangles: &'a [u32],
    pub(crate) surfaces: &'a [Surface],
    pub(crate) normals: Normals<'a>,
}

/// Prefetches cache lines, on processors for which safe Rust can.
#[derive(Clone, Copy, Debug)]
struct Prefetch {
    #[cfg(target_arch = "x86_64")]
    sse: Option<pulp::core_arch::x86::Sse>,
}

impl Default for Prefetch {
    fn default() -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            sse: pulp::core_arch::x86::Sse::try_new(),
        }
    }
}

impl Prefetch {
    /// Prefetches the cache line of an array's element. An index past the end is harmless.
    #[inline(always)]
    fn request<T>(self, array: &[T], index: usize) {
        #[cfg(target_arch = "x86_64")]
        if let Some(sse) = self.sse {
            /// The first level of the cache.
            const NEAREST: i32 = 3;
            sse._mm_prefetch::<NEAREST>(array.as_ptr().wrapping_add(index).cast());
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = (array, index);
    }
}
