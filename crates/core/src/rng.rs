//! A cursor over a sample's random numbers, for renderers that draw "the next number".

use crate::{Block, Draws, SampleId, point_set::mix};

/// A cursor that hands out the random numbers of one sample one after the other; made by [`Draws::rng`].
///
/// * [`Rng::next_2d`] returns a pair of dimensions that belong together, for a position, a direction or a lens. If the next
///   dimension is odd, it is skipped.
/// * [`Rng::next_f32`] returns one number.
/// * [`Rng::next_u32`] and [`Rng::next_u64`] return integers: the upper 24 bits come from the point set, the others from a
///   hash. Floats that `rand` makes from them are as well distributed as the point set.
///
/// With the features `rand_core_0_10`, `rand_core_0_9` and `rand_core_0_6` it implements the traits of these versions, and
/// so works as the generator of `rand` 0.10, 0.9 and 0.8.
///
/// ```
/// # use dapple_core::{Draws, PointSet, SampleId};
/// # struct Count;
/// # impl PointSet for Count {
/// #     fn describe(&self) -> String { "count".into() }
/// #     fn block(&self, _: SampleId, block: u32) -> [f32; 4] { [0, 1, 2, 3].map(|k| (4 * block + k) as f32 / 64.0) }
/// # }
/// # let points = Count;
/// let draws = Draws::new(&points, SampleId::new([3, 5], 0, 12));
/// let mut rng = draws.rng();
/// let light = rng.next_f32();             // dimension 0
/// let [u, v] = rng.next_2d();             // dimensions 2 and 3
/// let [s, t] = rng.next_2d();             // dimensions 4 and 5
/// # assert_eq!([light, u, v, s, t].map(|x| x * 64.0), [0.0, 2.0, 3.0, 4.0, 5.0]);
/// ```
///
/// # Guarantees
///
/// Each number is a pure function of the sample's identity and of its own dimension. The number of dimensions is unlimited.
///
/// # Limits
///
/// A dimension means the same thing in all samples only if all samples take numbers in the same order. A loop that takes a
/// varying count, such as rejection sampling, shifts all later dimensions. The result stays correct, but loses the
/// advantage over independent numbers. [`Rng::skip_to`] restores the order after such a loop.
pub type Rng<'a> = Cursor<&'a Draws<'a>>;

/// A cursor that owns its sample; made by [`Draws::into_rng`]. With [`Draws::shared`] it borrows nothing, so that renderers
/// can store it in a thread-local variable or in an enum of samplers.
pub type OwnedRng<'a> = Cursor<Draws<'a>>;

/// A cursor over the random numbers of a sample: [`Rng`] or [`OwnedRng`].
pub struct Cursor<D> {
    /// The sample, borrowed or owned.
    draws: D,
    /// The number of the block that `values` came from.
    block: u32,
    values: [f32; 4],
    /// The number of `values` already handed out; 4 before the first block.
    taken: usize,
}

/// The sample of a cursor, borrowed or owned.
pub trait CursorDraws {
    /// The sample.
    fn draws(&self) -> &Draws<'_>;
}

impl CursorDraws for &Draws<'_> {
    #[inline]
    fn draws(&self) -> &Draws<'_> {
        self
    }
}

impl CursorDraws for Draws<'_> {
    #[inline]
    fn draws(&self) -> &Draws<'_> {
        self
    }
}

impl Cursor<Draws<'_>> {
    /// Restarts at the first number of sample `id`. [`Draws::id`] returns the identity of a [`Tile`](crate::Tile)'s sample.
    pub fn start(&mut self, id: SampleId) {
        self.draws.start(id);
        self.taken = 4;
    }
}

impl<D: CursorDraws> Cursor<D> {
    pub(crate) fn new(draws: D) -> Self {
        Self { draws, block: 0, values: [0.0; 4], taken: 4 }
    }

    /// The next number, in `[0, 1)`.
    #[inline]
    pub fn next_f32(&mut self) -> f32 {
        if self.taken == 4 {
            self.refill();
        }
        let value = self.values[self.taken];
        self.taken += 1;
        value
    }

    /// The next pair of numbers, each in `[0, 1)`.
    #[inline]
    pub fn next_2d(&mut self) -> [f32; 2] {
        self.taken += self.taken & 1;
        [self.next_f32(), self.next_f32()]
    }

    /// The next 32 random bits, from one dimension. The upper 24 come from the point set.
    #[inline]
    pub fn next_u32(&mut self) -> u32 {
        (self.next_u64() >> 32) as u32
    }

    /// The next 64 random bits, from one dimension. The upper 24 come from the point set.
    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        let high = (self.next_f32() * (1 << 24) as f32) as u64;
        let id = self.draws.draws().id();
        let place = u64::from(self.block) << 2 | self.taken as u64;
        let [column, row] = id.pixel.map(u64::from);
        let low = [column | row << 32, u64::from(id.stream), id.index].into_iter().fold(place, |x, y| mix(x ^ y));
        high << 40 | low >> 24
    }

    /// Fills the bytes with words of [`Rng::next_u64`], the lowest byte first.
    pub fn fill_bytes(&mut self, bytes: &mut [u8]) {
        for part in bytes.chunks_mut(8) {
            part.copy_from_slice(&self.next_u64().to_le_bytes()[..part.len()]);
        }
    }

    /// Continues at the first of this block's four numbers, so that later numbers have the same dimensions in every sample.
    /// Does nothing if the cursor has passed that number.
    pub fn skip_to(&mut self, block: Block) {
        if self.draws.draws().skip_to(block) {
            self.taken = 4;
        }
    }

    #[inline]
    fn refill(&mut self) {
        let draws = self.draws.draws();
        let block = draws.next_block();
        (self.values, self.block, self.taken) = (draws.block(block), block.number(), 0);
    }
}

#[cfg(feature = "rand_core_0_10")]
impl<D: CursorDraws> rand_core_0_10::TryRng for Cursor<D> {
    type Error = std::convert::Infallible;

    #[inline]
    fn try_next_u32(&mut self) -> Result<u32, Self::Error> {
        Ok(self.next_u32())
    }

    #[inline]
    fn try_next_u64(&mut self) -> Result<u64, Self::Error> {
        Ok(self.next_u64())
    }

    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.fill_bytes(bytes);
        Ok(())
    }
}

/// Implements `RngCore` of an older version of `rand_core`, with additional methods of that version.
#[cfg(any(feature = "rand_core_0_9", feature = "rand_core_0_6"))]
macro_rules! rng_core {
    ($version:ident, $($other:item)*) => {
        impl<D: CursorDraws> $version::RngCore for Cursor<D> {
            #[inline]
            fn next_u32(&mut self) -> u32 {
                Self::next_u32(self)
            }

            #[inline]
            fn next_u64(&mut self) -> u64 {
                Self::next_u64(self)
            }

            fn fill_bytes(&mut self, bytes: &mut [u8]) {
                Self::fill_bytes(self, bytes);
            }

            $($other)*
        }
    };
}

#[cfg(feature = "rand_core_0_9")]
rng_core!(rand_core_0_9,);

#[cfg(feature = "rand_core_0_6")]
rng_core!(
    rand_core_0_6,
    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), rand_core_0_6::Error> {
        Self::fill_bytes(self, bytes);
        Ok(())
    }
);
