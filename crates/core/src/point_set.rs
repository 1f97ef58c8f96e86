//! Where samples lie: coordinates as a pure function.

/// Names one sample of one pixel. Together with a seed, which lives in the [`PointSet`], and a block
/// number it decides four coordinates; nothing else does, so any sample can be replayed alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SampleId {
    /// Column and row in the full frame, also when only a crop of it is rendered.
    pub pixel: [u32; 2],
    /// Streams are scrambled independently of each other; see [`streams`].
    pub stream: u32,
    /// Goes on over rounds, never restarts. Less than [`PointSet::capacity`].
    pub index: u64,
}

/// The streams that the render loop uses. Two streams of one pixel share nothing: their points are
/// scrambled independently, which is what an honest error estimate from two halves needs.
pub mod streams {
    /// All samples of a render without halves.
    pub const WHOLE: u32 = 0;
    /// Sample `i` of a render with halves is sample `i >> 1` of stream `HALVES[i & 1]`.
    pub const HALVES: [u32; 2] = [1, 2];
    /// Samples of discarded rounds: the kept ones stay an unbroken prefix of their own stream.
    pub const DISCARDED: u32 = 3;
    /// Discarded samples of a render with halves.
    pub const DISCARDED_HALVES: [u32; 2] = [4, 5];
    /// First-hit probes traced before a render, by samplers that plan from geometry.
    pub const PROBE: u32 = 6;
}

/// Where samples lie: a pure function from (seed, pixel, stream, index, block) to four numbers.
///
/// Implementations hold their seed and nothing that changes. They must pass
/// `dapple_conformance::point_set`.
pub trait PointSet: Send + Sync {
    /// The name and every parameter, as the command line would take them: `sobol:seed=7`.
    fn describe(&self) -> String;

    /// Coordinates `4 * block .. 4 * block + 4` of the sample, each in `[0, 1)`.
    ///
    /// The four are two 2-D pairs, `[0..2]` and `[2..4]`; an integrator uses each pair together.
    /// Must not panic for any `index < capacity()`.
    fn block(&self, id: SampleId, block: u32) -> [f32; 4];

    /// Samples per pixel and stream before the set repeats itself. A round that asks for more is
    /// refused with [`Error::SequenceExhausted`](crate::Error::SequenceExhausted).
    fn capacity(&self) -> u64;

    /// The smallest well-stratified count that is at least `n`. The default says any count will do.
    fn preferred_count(&self, n: u64) -> u64 {
        n
    }
}
