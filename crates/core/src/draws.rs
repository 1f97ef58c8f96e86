//! Random numbers of one sample, by named blocks.

use crate::{Needs, PointSet, SampleId};
use std::cell::Cell;

/// A named group of four dimensions of a sample's random numbers, for one use of randomness such as the lens.
///
/// An integrator keeps its blocks as constants in one module, so that turning one effect off leaves the numbers of all
/// others unchanged.
///
/// ```
/// use dapple_core::Block;
///
/// const CAMERA: Block = Block::new(0);
/// const SCATTER: Block = Block::new(1);
/// const LIGHT: Block = Block::new(2);
///
/// // Each path vertex owns two blocks.
/// assert_eq!(SCATTER.at(3, 2).number(), 7);
/// assert_eq!(LIGHT.at(3, 2).number(), 8);
/// # assert_eq!(CAMERA.number(), 0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Block(u32);

impl Block {
    /// Makes the block (four dimensions of a sample's random numbers) with this number.
    pub const fn new(number: u32) -> Self {
        Self(number)
    }

    /// The block for repetition `k` (such as a path vertex), if each repetition owns `stride` blocks. Its number is
    /// this block's number plus `k * stride`, and wraps past 2^32 blocks, after some 10^8 vertices.
    pub const fn at(self, k: u32, stride: u32) -> Self {
        Self(self.0.wrapping_add(k.wrapping_mul(stride)))
    }

    /// The block's number, the argument of [`PointSet::block`].
    pub const fn number(self) -> u32 {
        self.0
    }
}

/// The random numbers of one sample.
///
/// There is no cursor that returns "the next number": each use names its [`Block`].
///
/// ```
/// # use dapple_core::{Block, Draws, PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// #     fn capacity(&self) -> u64 { u64::MAX }
/// # }
/// const LENS: Block = Block::new(0);
///
/// let draws = Draws::new(&Centre, SampleId::new([3, 5], 0, 12));
/// let [x, y, u, v] = draws.block(LENS);
/// assert_eq!((draws.pixel(), draws.blocks_requested()), ([3, 5], 1));
/// # assert_eq!([x, y, u, v], [0.5; 4]);
/// ```
pub struct Draws<'a> {
    points: &'a dyn PointSet,
    id: SampleId,
    first_hit: bool,
    features: bool,
    emission: bool,
    requested: Cell<u32>,
}

impl<'a> Draws<'a> {
    /// The random numbers of sample `id`, without a request for its first hit.
    #[inline]
    pub fn new(points: &'a dyn PointSet, id: SampleId) -> Self {
        Self { points, id, first_hit: false, features: false, emission: false, requested: Cell::new(0) }
    }

    /// Requests the first hit from the integrator.
    #[inline]
    #[must_use]
    pub fn with_first_hit(self) -> Self {
        Self { first_hit: true, ..self }
    }

    /// Requests the first hit and the features from the integrator.
    #[inline]
    #[must_use]
    pub fn with_features(self) -> Self {
        Self { first_hit: true, features: true, ..self }
    }

    /// Requests the emission of light sources seen directly from the integrator.
    #[inline]
    #[must_use]
    pub fn with_emission(self) -> Self {
        Self { emission: true, ..self }
    }

    /// The random numbers of sample `id` in a render, with requests for what the film records.
    #[inline]
    pub(crate) fn of_round(points: &'a dyn PointSet, id: SampleId, needs: &Needs) -> Self {
        let Needs { features, emission, .. } = *needs;
        Self { points, id, first_hit: needs.wants_first_hit(), features, emission, requested: Cell::new(0) }
    }

    /// The four coordinates of `block`, each in `[0, 1)`: two 2-D pairs.
    #[inline]
    pub fn block(&self, block: Block) -> [f32; 4] {
        self.requested.set(self.requested.get() + 1);
        self.points.block(self.id, block.number())
    }

    /// Column and row of the pixel in the full frame.
    #[inline]
    pub fn pixel(&self) -> [u32; 2] {
        self.id.pixel
    }

    /// The sample's pixel, stream and index.
    #[inline]
    pub fn id(&self) -> SampleId {
        self.id
    }

    /// Returns `true` if the film records first hits. If not, leave [`Estimate::first_hit`](crate::Estimate::first_hit)
    /// at `None`.
    #[inline]
    pub fn wants_first_hit(&self) -> bool {
        self.first_hit
    }

    /// Returns `true` if the film records features. Then [`Draws::wants_first_hit`] returns `true` as well. If not, leave
    /// [`Estimate::features`](crate::Estimate::features) at `None`.
    #[inline]
    pub fn wants_features(&self) -> bool {
        self.features
    }

    /// Returns `true` if the film records the emission of light sources seen directly. If not, leave
    /// [`Estimate::emission`](crate::Estimate::emission) at 0.
    #[inline]
    pub fn wants_emission(&self) -> bool {
        self.emission
    }

    /// The number of calls of [`Draws::block`] so far. An effect that is off requests no block.
    #[inline]
    pub fn blocks_requested(&self) -> u32 {
        self.requested.get()
    }
}
