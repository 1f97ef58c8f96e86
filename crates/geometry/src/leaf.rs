//! The memory layout of triangle leaves.
//!
//! A leaf is eleven rows of words: nine rows of coordinates, one of primitive numbers and one of shape numbers. A row has one
//! word per triangle, and rows follow each other without a gap. A leaf of five triangles therefore takes five eighths of the
//! memory of a full leaf. Small leaves matter in large scenes, where memory access limits the speed of rays. Vectors load eight
//! words of a row. Beyond the leaf's triangles they contain unrelated numbers, which a mask excludes.

use crate::bvh::{TRIANGLES, key};
use crate::lanes::{Eight, Lanes, WIDTH};
use crate::mesh::between;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// The number of words per triangle: the coordinates of its corners, its primitive number and its shape number.
pub(crate) const WORDS: usize = 11;
/// The number of rows of coordinates, which come first.
const COORDINATES: usize = 9;
const PRIMITIVES: usize = 9;
const SHAPES: usize = 10;
/// The number of words that can be read from the start of any leaf, including the last one.
pub(crate) const SPAN: usize = 12 * WIDTH;
/// The position, in a child's code, of the bits with the number of triangles minus 1. The lower bits hold the number of
/// triangles in all leaves before this one.
const COUNT: u32 = 28;
/// The upper limit of the number of triangles.
pub(crate) const LIMIT: usize = 1 << COUNT;
/// The bits that are flipped in stored primitive and shape numbers, so that small integers are normal floats. Arithmetic on
/// denormal numbers in unused lanes would be slow on some processors.
pub(crate) const FLIPPED: u32 = 1 << 30;

/// Up to eight triangles, corner by corner and axis by axis.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Triangles8 {
    corners: [[Eight; 3]; 3],
}

impl Triangles8 {
    #[inline(always)]
    pub(crate) fn put(&mut self, lane: usize, triangle: [Vec3; 3]) {
        for (packed, corner) in self.corners.iter_mut().zip(triangle) {
            for axis in 0..3 {
                packed[axis].0[lane] = corner[axis];
            }
        }
    }

    /// Returns a coordinate of the triangle in a lane.
    #[inline(always)]
    pub(crate) fn coordinate(&self, corner: usize, axis: usize, lane: usize) -> f32 {
        self.corners[corner][axis].0[lane]
    }

    /// Returns the lower and the upper bounds of the triangles along an axis.
    #[inline(always)]
    pub(crate) fn bounds<L: Lanes>(&self, token: L::Token, axis: usize) -> [L; 2] {
        let [a, b, c] = &self.corners;
        let (a, b, c) = (L::load(token, &a[axis].0), L::load(token, &b[axis].0), L::load(token, &c[axis].0));
        [a.min(b).min(c), a.max(b).max(c)]
    }
}

/// Returns the bits of a child's code that locate a leaf: `first` is the number of triangles in all leaves before it, and
/// `count` the number in it.
pub(crate) fn place(first: u32, count: usize) -> u32 {
    first | (count as u32 - 1) << COUNT
}

/// Writes up to eight triangles and their keys to the words of a leaf. There are [`WORDS`] words per key.
#[inline(always)]
pub(crate) fn write(words: &mut [f32], triangles: &Triangles8, keys: &[u64]) {
    let rows = words.chunks_exact_mut(keys.len().max(1));
    for (number, row) in rows.enumerate() {
        for (lane, word) in row.iter_mut().enumerate() {
            *word = match number {
                PRIMITIVES => f32::from_bits(keys[lane] as u32 ^ FLIPPED),
                SHAPES => f32::from_bits((keys[lane] >> 32) as u32 ^ FLIPPED),
                _ => triangles.coordinate(number % 3, number / 3, lane),
            };
        }
    }
}

/// A leaf of one to eight triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Leaf<'a> {
    words: &'a [f32; SPAN],
    count: usize,
}

impl<'a> Leaf<'a> {
    /// Returns the leaf that a child's code refers to.
    #[inline(always)]
    pub(crate) fn at(leaves: &'a [f32], code: u32) -> Self {
        let first = (code & !TRIANGLES & (LIMIT as u32 - 1)) as usize * WORDS;
        let count = (code >> COUNT & (WIDTH as u32 - 1)) as usize + 1;
        Self { words: leaves[first..].first_chunk().unwrap_or(&[0.0; SPAN]), count }
    }

    /// Returns the mask of the lanes that hold triangles.
    #[inline(always)]
    pub(crate) fn mask(&self) -> u32 {
        (1 << self.count) - 1
    }

    /// Returns the three corners' coordinates along an axis.
    #[inline(always)]
    pub(crate) fn along(&self, axis: usize) -> [&'a [f32; WIDTH]; 3] {
        let first = 3 * self.count * (axis & 3);
        [self.from(first), self.from(first + self.count), self.from(first + 2 * self.count)]
    }

    #[inline(always)]
    fn from(&self, word: usize) -> &'a [f32; WIDTH] {
        self.words[word..].first_chunk().unwrap_or(&[0.0; WIDTH])
    }

    #[inline(always)]
    fn row(&self, row: usize) -> &'a [f32; WIDTH] {
        self.from(row * self.count)
    }

    /// Returns the corners of the triangle in a lane.
    #[inline(always)]
    pub(crate) fn corners(&self, lane: usize) -> [Vec3; 3] {
        let [x, y, z] = [self.along(0), self.along(1), self.along(2)];
        [0, 1, 2].map(|corner| Vec3::new(x[corner][lane], y[corner][lane], z[corner][lane]))
    }

    /// Returns the key of the triangle in a lane.
    #[inline(always)]
    pub(crate) fn key(&self, lane: usize) -> u64 {
        let [shape, primitive] = [SHAPES, PRIMITIVES].map(|row| self.row(row)[lane].to_bits() ^ FLIPPED);
        key(shape, primitive)
    }

    /// Returns the mask of the lanes whose triangle has this key.
    #[inline(always)]
    pub(crate) fn equal<L: Lanes>(&self, token: L::Token, key: u64) -> u32 {
        let equal = |row: usize, word: u32| L::equal(token, bytemuck::cast_ref(self.row(row)), word ^ FLIPPED);
        equal(SHAPES, (key >> 32) as u32) & equal(PRIMITIVES, key as u32)
    }

    /// Returns the words of the leaf at a time in `[0, 1]`, interpolated linearly between `self` (time 0) and `end`
    /// (time 1).
    #[inline(always)]
    pub(crate) fn toward(&self, end: &Self, time: f32) -> [f32; SPAN] {
        let mut words = *self.words;
        for (word, &to) in words.iter_mut().zip(end.words).take(COORDINATES * self.count) {
            *word = between(*word, to, time);
        }
        words
    }

    /// Returns a leaf with the same number of triangles in other memory.
    #[inline(always)]
    pub(crate) fn with<'b>(&self, words: &'b [f32; SPAN]) -> Leaf<'b> {
        Leaf { words, count: self.count }
    }
}
