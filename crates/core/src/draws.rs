//! Named blocks of coordinates, as an integrator sees them.

use crate::{PointSet, SampleId};
use std::cell::Cell;

/// The name of one use of randomness: four coordinates that nobody else uses.
///
/// An integrator keeps its blocks as constants in one module and never writes a bare number at a
/// call, so that an effect which is off shifts nobody else's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Block(u32);

impl Block {
    /// The block with this number.
    pub const fn new(number: u32) -> Self {
        Self(number)
    }

    /// The same use at the `k`-th repetition (path vertex, say), where each repetition owns `stride`
    /// blocks. Wraps past 2^32 blocks, after some 10^8 vertices.
    pub const fn at(self, k: u32, stride: u32) -> Self {
        Self(self.0.wrapping_add(k.wrapping_mul(stride)))
    }

    /// Its number, as [`PointSet::block`] takes it.
    pub const fn number(self) -> u32 {
        self.0
    }
}

/// The coordinates of one sample, asked for by name.
pub struct Draws<'a> {
    points: &'a dyn PointSet,
    id: SampleId,
    first_hit: bool,
    asked: Cell<u32>,
}

impl<'a> Draws<'a> {
    /// The coordinates of sample `id`. `first_hit` says whether anybody wants the first hit reported.
    pub fn new(points: &'a dyn PointSet, id: SampleId, first_hit: bool) -> Self {
        Self { points, id, first_hit, asked: Cell::new(0) }
    }

    /// The four coordinates of `block`, each in `[0, 1)`: two 2-D pairs.
    #[inline]
    pub fn block(&self, block: Block) -> [f32; 4] {
        self.asked.set(self.asked.get() + 1);
        self.points.block(self.id, block.number())
    }

    /// Column and row of the pixel in the full frame.
    #[inline]
    pub fn pixel(&self) -> [u32; 2] {
        self.id.pixel
    }

    /// Which sample this is.
    #[inline]
    pub fn id(&self) -> SampleId {
        self.id
    }

    /// Whether somebody reads [`Estimate::first_hit`](crate::Estimate::first_hit); when nobody does,
    /// leave it `None`.
    #[inline]
    pub fn wants_first_hit(&self) -> bool {
        self.first_hit
    }

    /// How many blocks were asked for so far: an effect that is off asks for none.
    #[inline]
    pub fn blocks_requested(&self) -> u32 {
        self.asked.get()
    }
}
