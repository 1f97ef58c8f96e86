//! Compact copies of images with few distinct channel values.

use dapple_scene::image::Image;
use glam::Vec3;

/// The largest number of distinct values: the number of indices in a byte.
const MOST: usize = 256;
/// The number of pixels along the side of a tile.
const SIDE: usize = 4;

/// An image with at most 256 distinct channel values, such as one from an 8-bit file, stored exactly in one byte per
/// channel. Scattered look-ups in a large image are limited by memory latency. This form takes a third of the memory
/// of three floats, and four neighbouring pixels mostly share a cache line.
#[derive(Clone, Debug)]
pub(super) struct Coded {
    tiles: Vec<Tile>,
    /// The number of tiles per row of tiles.
    across: usize,
    values: Box<[f32; MOST]>,
}

/// The value indices of 4 x 4 pixels, row by row, in one cache line. The fourth byte of each pixel is unused.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Tile([[u8; 4]; SIDE * SIDE]);

impl Coded {
    /// Makes the compact copy of an image. Returns `None` if the image has more than 256 distinct values.
    pub(super) fn new(image: &Image) -> Option<Self> {
        let [width, height] = [image.width(), image.height()];
        let across = width.div_ceil(SIDE);
        let mut coder = Coder::default();
        let mut tiles = vec![Tile([[0; 4]; SIDE * SIDE]); across * height.div_ceil(SIDE)];
        for y in 0..height {
            for (x, [r, g, b]) in image.row(y).iter().enumerate() {
                let (tile, place) = locate(across, x, y);
                tiles[tile].0[place] = [coder.code(*r)?, coder.code(*g)?, coder.code(*b)?, 0];
            }
        }
        Some(Self { tiles, across, values: Box::new(coder.values) })
    }

    /// Returns the linear RGB pixel at a column and a row, which must be inside the image.
    #[inline]
    pub(super) fn pixel(&self, column: usize, row: usize) -> Vec3 {
        let (tile, place) = locate(self.across, column, row);
        let [r, g, b, _] = self.tiles[tile].0[place];
        Vec3::new(self.values[usize::from(r)], self.values[usize::from(g)], self.values[usize::from(b)])
    }
}

/// Returns the index of a pixel's tile, and the index of the pixel in its tile.
#[inline]
fn locate(across: usize, column: usize, row: usize) -> (usize, usize) {
    (row / SIDE * across + column / SIDE, row % SIDE * SIDE + column % SIDE)
}

/// A table that gives each distinct value an index, in the order of first use.
struct Coder {
    values: [f32; MOST],
    count: usize,
    /// A hash table from a value's bits to its index plus 1; 0 marks a free slot.
    slots: [u16; Self::SLOTS],
}

impl Default for Coder {
    fn default() -> Self {
        Self { values: [0.0; MOST], count: 0, slots: [0; Self::SLOTS] }
    }
}

impl Coder {
    /// The size of the hash table: four times the largest number of values, which keeps searches short.
    const SLOTS: usize = 4 * MOST;

    /// Returns the index of a value; `None` if there are more than 256 distinct values.
    fn code(&mut self, value: f32) -> Option<u8> {
        // Multiplication by 2^32 divided by the golden ratio scatters the bits [after Knuth 1998, sec. 6.4].
        let mut slot = (value.to_bits().wrapping_mul(0x9E37_79B9) >> 22) as usize;
        loop {
            let number = usize::from(self.slots[slot]);
            if number == 0 {
                break;
            }
            if self.values[number - 1].to_bits() == value.to_bits() {
                return Some((number - 1) as u8);
            }
            slot = (slot + 1) % Self::SLOTS;
        }
        if self.count == MOST {
            return None;
        }
        self.values[self.count] = value;
        self.count += 1;
        self.slots[slot] = self.count as u16;
        Some((self.count - 1) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image with `count` values, each there.
    fn image(size: [u32; 2], count: u32) -> Image {
        let value = |i: u32| 1.0 / (1 + i.wrapping_mul(2_654_435_761) % count) as f32;
        let pixels = (0..size[0] * size[1]).map(|i| [value(3 * i), value(3 * i + 1), -value(3 * i + 2).abs()]);
        Image::new(size, pixels.collect()).expect("an image")
    }

    #[test]
    fn pixels_come_back_to_the_last_bit() {
        for size in [[1, 1], [4, 4], [5, 3], [37, 21]] {
            let image = image(size, 100);
            let coded = Coded::new(&image).expect("at most 200 values");
            for y in 0..image.height() {
                for x in 0..image.width() {
                    assert_eq!(coded.pixel(x, y).to_array(), image.pixel(x, y), "{x} {y} of {size:?}");
                }
            }
        }
    }

    #[test]
    fn values_are_counted_by_their_bits() {
        let row = |n: u32| Image::new([n, 1], (0..n).map(|i| [i as f32; 3]).collect()).expect("an image");
        assert!(Coded::new(&row(256)).is_some());
        assert!(Coded::new(&row(257)).is_none());
        let odd = [[0.0, -0.0, f32::NAN], [f32::INFINITY, f32::MIN_POSITIVE, 1.0]];
        let coded = Coded::new(&Image::new([2, 1], odd.to_vec()).expect("an image")).expect("six values");
        for (x, pixel) in odd.iter().enumerate() {
            assert_eq!(coded.pixel(x, 0).to_array().map(f32::to_bits), pixel.map(f32::to_bits));
        }
    }
}
