//! Point sets: random numbers as a pure function of a sample's identity.

pub use crate::rng::Cursor;

use crate::macros::forward;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The identity of one sample of one pixel.
///
/// Four coordinates depend only on the identity, a block number and the seed of the [`PointSet`]. So any sample can be
/// replayed alone.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct SampleId {
    /// Column and row in the full image, also in the render of a crop.
    pub pixel: [u32; 2],
    /// The number of the pixel's point sequence; a pixel's sequences are scrambled independently of each other (see
    /// [`streams`]).
    pub stream: u32,
    /// The sample's index in the stream (point sequence), from 0, less than [`PointSet::capacity`]. It continues over
    /// rounds.
    pub index: u64,
}

impl SampleId {
    /// Sample `index` of `stream` in the pixel at this column and row.
    #[inline]
    pub const fn new(pixel: [u32; 2], stream: u32, index: u64) -> Self {
        Self { pixel, stream, index }
    }
}

/// Numbers of the point sequences ("streams") that the render loop uses.
///
/// Two streams of one pixel are scrambled independently, so the difference between their means estimates the error.
pub mod streams {
    /// The stream of the image's samples in a render without halves.
    pub const WHOLE: u32 = 0;
    /// The streams of the image's samples in a render with two halves. If samples alternate between the halves, a
    /// pixel's sample `i` is sample `i >> 1` of stream `HALVES[i & 1]`.
    pub const HALVES: [u32; 2] = [1, 2];
    /// The stream of discarded samples, which do not enter the image. A stream of their own leaves no gaps in the
    /// sequence of the image's samples.
    pub const DISCARDED: u32 = 3;
    /// The streams of discarded samples in a render with two halves.
    pub const DISCARDED_HALVES: [u32; 2] = [4, 5];
    /// The stream of first-hit rays, which samplers that plan from geometry trace before a render.
    pub const FIRST_HITS: u32 = 6;
    /// The stream of paths from the lights, which an integrator traces to prepare for samples; see
    /// [`Pass::draws`](crate::integrator::Pass::draws).
    pub const LIGHT: u32 = 7;
    /// The stream of feature-only samples; see [`Integrator::features_alone`](crate::Integrator::features_alone).
    pub const FEATURES: u32 = 8;
    /// The streams of feature-only samples at the edge of a light source, one for each half; see
    /// [`Film::emission_alone`](crate::Film::emission_alone).
    pub const EMISSION: [u32; 2] = [9, 10];
}

/// A pure function from (seed, pixel, stream, index, block) to four coordinates in `[0, 1)`.
///
/// pbrt and Mitsuba call this role the sampler. Implementations have a seed and no mutable state. They must pass
/// `dapple_conformance::point_set`.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
///
/// /// Independent random numbers: a hash of the sample's name.
/// struct Hashed {
///     seed: u64,
/// }
///
/// impl PointSet for Hashed {
///     fn describe(&self) -> String {
///         format!("hashed:seed={}", self.seed)
///     }
///
///     fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
///         let mut x = self.seed;
///         for part in [id.pixel[0].into(), id.pixel[1].into(), id.stream.into(), id.index, block.into()] {
///             x = (x ^ part).wrapping_mul(0xbf58_476d_1ce4_e5b9);
///             x ^= x >> 31;
///         }
///         std::array::from_fn(|k| {
///             let y = (x ^ k as u64).wrapping_mul(0x94d0_49bb_1331_11eb);
///             (y >> 40) as f32 / (1 << 24) as f32
///         })
///     }
/// }
///
/// let id = SampleId::new([3, 5], 0, 12);
/// let u = Hashed { seed: 7 }.block(id, 0);
/// assert!(u.iter().all(|x| (0.0..1.0).contains(x)));
/// ```
pub trait PointSet: Send + Sync {
    /// The name and every parameter, in the form of the command line: `sobol:seed=7`.
    fn describe(&self) -> String;

    /// Coordinates `4 * block .. 4 * block + 4` of the sample, each in `[0, 1)`.
    ///
    /// The four are two 2-D pairs, `[0..2]` and `[2..4]`; an integrator uses each pair together. Must not panic for any
    /// `index < capacity()`.
    fn block(&self, id: SampleId, block: u32) -> [f32; 4];

    /// Two blocks of one sample, bit-identical to two calls of [`block`](Self::block). Point sets that compute two blocks
    /// together faster override this.
    #[inline]
    fn two_blocks(&self, id: SampleId, blocks: [u32; 2]) -> [[f32; 4]; 2] {
        blocks.map(|block| self.block(id, block))
    }

    /// The number of samples per pixel and stream before the points repeat. The render loop refuses to trace more, with
    /// [`Error::SequenceExhausted`](crate::Error::SequenceExhausted). `u64::MAX` by default: points never repeat.
    fn capacity(&self) -> u64 {
        u64::MAX
    }

    /// The smallest count that is at least `n` and well stratified; by default `n` itself.
    fn preferred_count(&self, n: u64) -> u64 {
        n
    }

    /// Returns `true` if the numbers of a pixel's samples are independent of each other, so that squared errors fall as
    /// 1/n. They fall faster for better distributed point sets. `false` by default.
    fn is_independent(&self) -> bool {
        false
    }

    /// Returns `true` if the numbers of neighbouring pixels are correlated on purpose, so that their errors differ. The numbers
    /// of pixels 1009 columns or rows apart must be uncorrelated even then. `false` by default: all pixels are independent.
    fn couples_pixels(&self) -> bool {
        false
    }
}

forward!(PointSet for &T, Box<T>, Arc<T>; {
    ref describe() -> String;
    ref block(id: SampleId, block: u32) -> [f32; 4];
    ref two_blocks(id: SampleId, blocks: [u32; 2]) -> [[f32; 4]; 2];
    ref capacity() -> u64;
    ref preferred_count(n: u64) -> u64;
    ref is_independent() -> bool;
    ref couples_pixels() -> bool;
});

/// The point set of a renderer that has its own random numbers, and uses only the sample counts of Dapple.
///
/// Samplers plan for independent samples. In a [`Session`](crate::Session), [`Tile::pixels`](crate::Tile::pixels) returns the
/// number of samples for each pixel, and [`Tile::push`](crate::Tile::push) adds the results. [`PointSet::block`] returns
/// independent random numbers, a hash of the sample's identity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HostNumbers;

impl PointSet for HostNumbers {
    fn describe(&self) -> String {
        "host".to_owned()
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let [column, row] = id.pixel.map(u64::from);
        let name = [column | row << 32, u64::from(id.stream) | u64::from(block) << 32, id.index];
        let first = name.into_iter().fold(0, |x, part| mix(x ^ part));
        let unit = |x: u64| (x >> 40) as f32 / (1 << 24) as f32;
        [0, 1, 2, 3].map(|k| unit(mix(first ^ k)))
    }

    fn is_independent(&self) -> bool {
        true
    }
}

/// A bijective 64-bit mix (the finaliser of SplitMix64, [Steele, Lea and Flood 2014]).
#[inline]
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
