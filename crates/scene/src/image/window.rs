//! Rectangles of pixels in the coordinates of a display.

/// A rectangle of pixels in the coordinates of a display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Window {
    /// Column and row of the first pixel; either may be negative.
    pub origin: [i32; 2],
    /// Width and height in pixels.
    pub size: [u32; 2],
}

impl Window {
    /// Returns the pixels that both windows contain; `None` if there are none.
    pub fn common(self, other: Self) -> Option<Self> {
        let side = |axis: usize| {
            let end = |w: Self| i64::from(w.origin[axis]) + i64::from(w.size[axis]);
            let origin = self.origin[axis].max(other.origin[axis]);
            let size = u32::try_from(end(self).min(end(other)) - i64::from(origin)).ok().filter(|size| *size > 0)?;
            Some((origin, size))
        };
        let ((x, width), (y, height)) = (side(0)?, side(1)?);
        Some(Self { origin: [x, y], size: [width, height] })
    }

    /// Returns the number of pixels.
    pub fn pixels(self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Returns the values of the pixels inside `inner`. `values` has one per pixel of this window, row by row from the top.
    ///
    /// # Panics
    /// If this window has no columns, or `inner` reaches beyond them. Missing rows only shorten the result.
    pub fn cut<T: Copy>(self, values: &[T], inner: Self) -> Vec<T> {
        let offset = |axis: usize| (i64::from(inner.origin[axis]) - i64::from(self.origin[axis])) as usize;
        let rows = values.chunks_exact(self.size[0] as usize).skip(offset(1)).take(inner.size[1] as usize);
        rows.flat_map(|row| &row[offset(0)..][..inner.size[0] as usize]).copied().collect()
    }
}

impl std::fmt::Display for Window {
    /// Formats the corners as OpenEXR states them, the last pixel included: `(0,0)-(39,27)`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let last = |axis: usize| i64::from(self.origin[axis]) + i64::from(self.size[axis]) - 1;
        write!(f, "({},{})-({},{})", self.origin[0], self.origin[1], last(0), last(1))
    }
}
