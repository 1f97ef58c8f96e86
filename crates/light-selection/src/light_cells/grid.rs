//! The grid of cells: voxels in space, and orientations of the surface normal.

use crate::Error;

/// A grid of cubic voxels over a box. Each voxel has six cells, one per orientation of the surface normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    corner: [f32; 3],
    /// The upper corner of the grid, at the end of the last voxel along each axis.
    end: [f32; 3],
    edge: f32,
    per_unit: f32,
    counts: [u32; 3],
}

/// The number of orientations of a normal: three nearest axes with two signs.
const AXES: u32 = 6;

impl Grid {
    /// Makes a grid of at most `resolution` voxels along the longest side, and fewer if there would be more than
    /// `most` cells.
    pub(super) fn new([low, high]: [[f32; 3]; 2], resolution: u32, most: usize) -> Result<Self, Error> {
        let sides: [f32; 3] = std::array::from_fn(|a| high[a] - low[a]);
        let longest = sides[0].max(sides[1]).max(sides[2]);
        if !sides.iter().all(|s| *s >= 0.0) || !longest.is_finite() || !low.iter().all(|x| x.is_finite()) {
            return Err(Error::range("bounds", format!("{low:?}, {high:?}"), "finite corners, the lower one first"));
        }
        let longest = if longest > 0.0 { longest } else { 1.0 };
        let of = |n: u32| {
            let edge = longest / n as f32;
            (edge, sides.map(|s| ((s / edge).round() as u32).clamp(1, n)))
        };
        let cells = |n: u32| of(n).1.iter().map(|c| *c as usize).product::<usize>() * AXES as usize;
        let n = (1..=resolution).rev().find(|&n| cells(n) <= most).unwrap_or(1);
        let (edge, counts) = of(n);
        let end = std::array::from_fn(|a| low[a] + counts[a] as f32 * edge);
        Ok(Self { corner: low, end, edge, per_unit: 1.0 / edge, counts })
    }

    /// Returns a grid over the same box whose voxels are `times` as wide. The last voxels are cut off at the box.
    pub(super) fn coarser(&self, times: u32) -> Self {
        let (edge, per_unit) = (self.edge * times as f32, self.per_unit / times as f32);
        Self { edge, per_unit, counts: self.counts.map(|n| n.div_ceil(times)), ..*self }
    }

    pub(super) fn cells(&self) -> usize {
        self.counts.iter().map(|c| *c as usize).product::<usize>() * AXES as usize
    }

    #[inline]
    pub(super) fn cell(&self, position: [f32; 3], normal: [f32; 3]) -> u32 {
        // The conversion maps negative numbers and NaN to 0.
        let at = |a: usize| (((position[a] - self.corner[a]) * self.per_unit) as u32).min(self.counts[a] - 1);
        let [x, y, z] = normal.map(f32::abs);
        let axis = if x >= y && x >= z { 0 } else { 1 + usize::from(y < z) };
        let negative = u32::from(normal[axis] < 0.0);
        let voxel = (at(2) * self.counts[1] + at(1)) * self.counts[0] + at(0);
        voxel * AXES + 2 * axis as u32 + negative
    }

    /// Returns the centre of a cell's voxel, half the diagonal of a full voxel, and the unit axis of the cell's
    /// orientation.
    pub(super) fn cell_at(&self, cell: u32) -> ([f32; 3], f32, [f32; 3]) {
        let (voxel, side) = (cell / AXES, cell % AXES);
        let [nx, ny, _] = self.counts;
        let at = [voxel % nx, voxel / nx % ny, voxel / nx / ny];
        let middle = std::array::from_fn(|a| {
            let begin = self.corner[a] + at[a] as f32 * self.edge;
            0.5 * (begin + (begin + self.edge).min(self.end[a]))
        });
        let mut axis = [0.0; 3];
        axis[side as usize / 2] = if side % 2 == 0 { 1.0 } else { -1.0 };
        // Half the root of 3.
        (middle, 0.866_025_4 * self.edge, axis)
    }
}
