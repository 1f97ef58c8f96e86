//! Choices that samplers share: the retention of pilot samples, and when refinement stops.

/// The use of pilot samples, which decide the counts, in the image; this determines the image's bias.
///
/// A sampler accepts the policies that its documentation names, and refuses the others with
/// [`Error::OutOfRange`](crate::Error::OutOfRange).
///
/// The formulas below give the expected value of a pixel whose samples are 1 with probability `p`, else 0. The pixel
/// has two pilot samples, and is refined if the two differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PilotPolicy {
    /// The pilot samples stay in the image: least noise. Biased, because kept samples decide how many follow [Kirk and
    /// Arvo 1991]. With `k` additional samples the expected value (see [`PilotPolicy`]) is `p^2 + 2 p (1 - p) (1 + k p)
    /// / (2 + k)`. The bias falls with the pilot's size. Decisions pooled over 5x5 pixels reduce it to 1/25.
    #[default]
    Keep,
    /// Pilot samples of refined pixels are discarded; those of other pixels stay in the image, as in pbrt-v2. More
    /// biased than [`PilotPolicy::Keep`]: the expected value (see [`PilotPolicy`]) is `3 p^2 - 2 p^3`, for any number
    /// of additional samples.
    Refined,
    /// All pilot samples are discarded, so they are lost to the image. Exactly unbiased if the budget is known at the
    /// start.
    Discard,
    /// Each pixel's samples are split into two halves. Each half decides the sample counts of the other half, and the
    /// means of the halves are averaged with equal weights. Exactly unbiased if the budget is known at the start, but
    /// two half-length sequences have more error than one. If the budget is raised later, a half's earlier samples
    /// influence its later counts through the other half.
    Cross,
    /// All samples stay in the image, and a pixel's count depends on the samples of its neighbours only.
    ///
    /// A first round after the pilot reads the other colour of a chessboard, a second the pixel's own colour. Then no
    /// path of decisions leads from a pixel's samples to its count. What remains is the pixel's share in the total of all
    /// scores: a bias of the order of 1 over the number of pixels.
    Neighbours,
}

/// The point at which samplers that compare an error estimate with a threshold stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stopping {
    /// Stop when the budget is spent exactly; the threshold only ranks pixels.
    #[default]
    Budget,
    /// Stop when all error estimates are below the threshold. The budget is an upper bound; the film's record has the
    /// number of samples spent.
    Threshold,
}
