//! Copies of a tile's planes, even and odd columns separately.

use crate::graph::{Plane, Rows};

/// Width of a tile in pixels.
pub(crate) const WIDTH: usize = 64;
/// Height of a tile in pixels.
pub(crate) const HEIGHT: usize = 16;
/// The margin around a tile in pixels, an even number. Windows reach 7 pixels beyond the tile, and their patches 3
/// more.
pub(crate) const MARGIN: usize = 10;
/// The number of even (or odd) columns in a tile's planes, margin included, rounded up to whole vectors.
pub(crate) const COLUMNS: usize = 64;
/// The number of rows in a tile's planes, margin included.
pub(crate) const ROWS: usize = HEIGHT + 2 * MARGIN;
/// The number of even (or odd) pixels in a row of a tile.
pub(crate) const LANES: usize = WIDTH / 2;

/// The place of a tile in a frame, by its upper left pixel.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    pub(crate) size: [usize; 2],
    pub(crate) origin: [usize; 2],
    /// The number of rows that are read above and below the tile, at most [`MARGIN`].
    pub(crate) margin: usize,
}

/// Copies of P planes of a tile and its margin. Each row holds the even columns of all planes, one plane after another, then
/// the odd columns. A single index thus locates a pixel in all planes. Empty before the first copy.
#[derive(Default)]
pub(crate) struct Stack<const P: usize>(pub(crate) Vec<f32>);

impl<const P: usize> Stack<P> {
    /// Copies the tile at a place with its margin from each plane, replacing the previous tile. Pixels beyond the frame repeat
    /// the border.
    pub(crate) fn copy(&mut self, rows: &Rows, planes: [Plane; P], Place { size, origin, margin }: Place) {
        let [width, height] = size;
        let used = MARGIN - margin..MARGIN + HEIGHT + margin;
        self.0.resize(2 * ROWS * P * COLUMNS, 0.0);
        let mut padded = [0.0; WIDTH + 2 * MARGIN];
        // Columns beyond the frame on the left, the first one inside, and the number inside.
        let before = MARGIN.saturating_sub(origin[0]);
        let first = origin[0] + before - MARGIN;
        let within = (padded.len() - before).min(width - first);
        for (k, plane) in planes.into_iter().enumerate() {
            let all = self.0.chunks_exact_mut(2 * P * COLUMNS).enumerate();
            for (r, row) in all.take(used.end).skip(used.start) {
                let y = (origin[1] + r).saturating_sub(MARGIN).min(height - 1);
                let ahead = (y + AHEAD).min(origin[1] + HEIGHT + margin - 1).min(height - 1);
                request(&rows.row(plane, ahead)[first..][..within]);
                let source = &rows.row(plane, y)[..width];
                padded[..before].fill(source[0]);
                padded[before..][..within].copy_from_slice(&source[first..][..within]);
                padded[before + within..].fill(source[width - 1]);
                let (even, odd) = row.split_at_mut(P * COLUMNS);
                let (even, odd) = (&mut even[k * COLUMNS..][..COLUMNS], &mut odd[k * COLUMNS..][..COLUMNS]);
                for (i, pair) in padded.as_chunks::<2>().0.iter().enumerate() {
                    [even[i], odd[i]] = *pair;
                }
            }
        }
    }

    /// Sets plane `k` to 0 beyond the frame.
    pub(crate) fn clear_outside(&mut self, k: usize, Place { size: [width, height], origin, .. }: Place) {
        let [first, end] = [MARGIN.saturating_sub(origin[0]), MARGIN + width - origin[0]];
        for (r, row) in self.0.chunks_exact_mut(2 * P * COLUMNS).enumerate() {
            let row_inside = (MARGIN..MARGIN + height).contains(&(origin[1] + r));
            for parity in 0..2 {
                let row = &mut row[(parity * P + k) * COLUMNS..][..COLUMNS];
                // Of columns `2 i + parity`, those from `first` on and before `end` lie inside.
                let inside = [first, end].map(|column| (column - parity.min(column)).div_ceil(2).min(COLUMNS));
                let inside = if row_inside { inside } else { [0; 2] };
                row[..inside[0]].fill(0.0);
                row[inside[1]..].fill(0.0);
            }
        }
    }

    /// A slice with `count` columns of each plane, which starts at a given row, parity and column. These indices
    /// include the margin. Plane `k` begins at `k * COLUMNS` of the slice.
    #[inline(always)]
    pub(super) fn from(&self, [y, parity, start]: [usize; 3], count: usize) -> &[f32] {
        &self.0[(2 * y + parity) * P * COLUMNS + start..][..(P - 1) * COLUMNS + count]
    }

    /// The pixels at the offset (dx, dy) from the even (or odd) pixels in row `y` of the tile.
    #[inline(always)]
    pub(crate) fn moved(&self, y: usize, parity: usize, [dx, dy]: [isize; 2]) -> &[f32] {
        let (parity, shift) = moved(parity, dx);
        let y = (y + MARGIN).wrapping_add_signed(dy);
        self.from([y, parity, (MARGIN / 2).wrapping_add_signed(shift)], LANES)
    }
}

/// The number of rows between prefetching a row of a plane and using it.
const AHEAD: usize = 8;

/// Prefetches the cache lines of pixels, on processors for which safe Rust can.
#[inline(always)]
fn request(pixels: &[f32]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(sse) = pulp::core_arch::x86::Sse::try_new() {
        const LINE: usize = 64 / size_of::<f32>();
        pixels.chunks(LINE).for_each(|line| sse._mm_prefetch::<3>(line.as_ptr().cast()));
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = pixels;
}

/// The parity of a column moved by `dx`, and the shift in columns of that parity.
#[inline(always)]
pub(super) fn moved(parity: usize, dx: isize) -> (usize, isize) {
    let column = parity as isize + dx;
    ((column & 1) as usize, column >> 1)
}
