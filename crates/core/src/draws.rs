//! Random numbers of one sample, by named blocks.

use crate::{Needs, OwnedRng, PointSet, Rng, SampleId, point_set::streams, rng::Cursor};
use std::cell::Cell;
use std::sync::Arc;

/// A named group of four dimensions of a sample's random numbers, for one use of randomness such as the lens.
///
/// An integrator keeps its blocks as constants in one module, so that turning one effect off leaves the random numbers of all
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

    /// The block for repetition `k` (such as a path vertex), if each repetition owns `stride` blocks. Its number is this
    /// block's number plus `k * stride`, modulo 2^32.
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
/// Each use of randomness names its [`Block`], or takes the next number of a cursor, [`Draws::rng`].
///
/// ```
/// # use dapple_core::{Block, Draws, PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// const LENS: Block = Block::new(0);
///
/// let draws = Draws::new(&Centre, SampleId::new([3, 5], 0, 12));
/// let [x, y, u, v] = draws.block(LENS);
/// assert_eq!((draws.pixel(), draws.blocks_requested()), ([3, 5], 1));
/// let [again, time] = draws.two_blocks([LENS, Block::new(1)]);
/// assert_eq!((again, draws.blocks_requested()), ([x, y, u, v], 3));
/// # assert_eq!([x, y, u, v], [0.5; 4]);
/// # assert_eq!(time, [0.5; 4]);
/// ```
#[derive(Clone)]
pub struct Draws<'a> {
    points: Points<'a>,
    id: SampleId,
    /// The sample's position among its pixel's samples in this round.
    pub(crate) turn: u32,
    needs: Needs,
    requested: Cell<u32>,
    /// The number of the next block for a cursor.
    cursor: Cell<u32>,
}

/// A point set, borrowed from its sampler or shared with the host.
#[derive(Clone)]
enum Points<'a> {
    Borrowed(&'a dyn PointSet),
    Shared(Arc<dyn PointSet>),
}

impl Points<'_> {
    #[inline]
    fn get(&self) -> &dyn PointSet {
        match self {
            Self::Borrowed(points) => *points,
            Self::Shared(points) => &**points,
        }
    }
}

impl Draws<'static> {
    /// The random numbers of sample `id`, from a point set that is shared with a sampler. The result borrows nothing, so
    /// [`Draws::into_rng`] turns it into a generator that a thread-local variable can hold.
    ///
    /// ```
    /// # use dapple_core::{Draws, PointSet, SampleId};
    /// # struct Centre;
    /// # impl PointSet for Centre {
    /// #     fn describe(&self) -> String { "centre".into() }
    /// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
    /// # }
    /// use dapple_core::{OwnedRng, samplers::Uniform};
    /// use std::sync::Arc;
    ///
    /// let points: Arc<dyn PointSet> = Arc::new(Centre);
    /// let sampler = Uniform::new(points.clone()); // Goes to a session.
    /// let mut rng: OwnedRng<'static> = Draws::shared(points, SampleId::new([0, 0], 0, 0)).into_rng();
    /// # let sample = SampleId::new([3, 5], 0, 1);
    /// rng.start(sample); // In a session: rng.start(sample.id()).
    /// assert_eq!(rng.next_f32(), 0.5);
    /// ```
    pub fn shared(points: Arc<dyn PointSet>, id: SampleId) -> Self {
        Self::of(Points::Shared(points), id, Needs::none())
    }
}

impl<'a> Draws<'a> {
    fn of(points: Points<'a>, id: SampleId, needs: Needs) -> Self {
        Self { points, id, turn: 0, needs, requested: Cell::new(0), cursor: Cell::new(0) }
    }

    /// Switches to the random numbers of sample `id`.
    pub(crate) fn start(&mut self, id: SampleId) {
        (self.id, self.turn) = (id, 0);
        self.requested.set(0);
        self.cursor.set(0);
    }

    /// The random numbers of sample `id`, for an integrator that needs to return only radiance.
    #[inline]
    pub fn new(points: &'a dyn PointSet, id: SampleId) -> Self {
        Self::for_film(points, id, Needs::none())
    }

    /// The random numbers of sample `id`, for an integrator that returns radiance and the statistics listed in `needs`.
    #[inline]
    pub fn for_film(points: &'a dyn PointSet, id: SampleId, needs: Needs) -> Self {
        Self::of(Points::Borrowed(points), id, needs)
    }

    /// The four coordinates of `block`, each in `[0, 1)`: two 2-D pairs.
    #[inline]
    pub fn block(&self, block: Block) -> [f32; 4] {
        self.requested.set(self.requested.get() + 1);
        self.points.get().block(self.copied_id(), block.number())
    }

    /// The coordinates of two blocks, equal to those of two calls of [`Draws::block`]. Some point sets compute two blocks
    /// together faster.
    #[inline]
    pub fn two_blocks(&self, blocks: [Block; 2]) -> [[f32; 4]; 2] {
        self.requested.set(self.requested.get() + 2);
        self.points.get().two_blocks(self.copied_id(), blocks.map(Block::number))
    }

    /// The identity, copied field by field. A copy of the whole struct right after it was written stalls on its padding for
    /// 5 ns.
    #[inline]
    fn copied_id(&self) -> SampleId {
        let SampleId { pixel: [column, row], stream, index } = self.id;
        SampleId::new([column, row], stream, index)
    }

    /// A cursor that returns the sample's random numbers one after the other, from block 0 on. A second call returns a cursor
    /// that continues after the blocks taken so far.
    ///
    /// If a renderer also calls [`Draws::block`], it moves the cursor past the requested blocks with [`Rng::skip_to`].
    #[inline]
    pub fn rng(&self) -> Rng<'_> {
        Rng::new(self)
    }

    /// Turns `self` into a cursor, for renderers whose generator outlives the scope of the sample. If a later call of
    /// [`Tile::add`](crate::Tile::add) needs the [`Draws`], clone it first.
    #[inline]
    pub fn into_rng(self) -> OwnedRng<'a> {
        Cursor::new(self)
    }

    /// Returns the next block for a cursor, and advances the cursor.
    #[inline]
    pub(crate) fn next_block(&self) -> Block {
        Block(self.cursor.replace(self.cursor.get().wrapping_add(1)))
    }

    /// Moves the cursor forward to `block`. Returns `false` if the cursor is already beyond.
    pub(crate) fn skip_to(&self, block: Block) -> bool {
        let ahead = block.0 >= self.cursor.get();
        if ahead {
            self.cursor.set(block.0);
        }
        ahead
    }

    /// The sample's number in its pixel, from 0, for renderers that select a jitter cell by sample number.
    ///
    /// The two halves alternate: the first half has even numbers, the second odd ones. Kept and discarded samples are numbered
    /// separately.
    #[inline]
    pub fn sample_number(&self) -> u64 {
        let SampleId { stream, index, .. } = self.id;
        let is_of = |half: &usize| [streams::HALVES[*half], streams::DISCARDED_HALVES[*half]].contains(&stream);
        (0..2).find(is_of).map_or(index, |half| 2 * index + half as u64)
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
        self.needs.wants_first_hit()
    }

    /// Returns `true` if the film records features, which implies [`Draws::wants_first_hit`]. If `false`, leave
    /// [`Estimate::features`](crate::Estimate::features) at `None`.
    #[inline]
    pub fn wants_features(&self) -> bool {
        self.needs.features
    }

    /// Returns `true` if the film records the emission of light sources seen directly. If not, leave
    /// [`Estimate::emission`](crate::Estimate::emission) at 0.
    #[inline]
    pub fn wants_emission(&self) -> bool {
        self.needs.emission
    }

    /// Returns `true` if the film records indirect lighting. If not, leave
    /// [`Estimate::indirect`](crate::Estimate::indirect) at 0.
    #[inline]
    pub fn wants_indirect(&self) -> bool {
        self.needs.indirect
    }

    /// Returns `true` if the film records trajectories, which implies [`Draws::wants_first_hit`]. If `false`, leave
    /// [`Estimate::trajectory`](crate::Estimate::trajectory) at `None`.
    #[inline]
    pub fn wants_trajectory(&self) -> bool {
        self.needs.trajectories
    }

    /// The number of blocks requested so far. An effect that is off requests none.
    #[inline]
    pub fn blocks_requested(&self) -> u32 {
        self.requested.get()
    }
}
