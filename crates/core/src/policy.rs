//! Choices that samplers share: the retention of a pilot, and the end of refinement.

/// The pilot's retention: which of the samples that decide on counts stay in the image, and so the image's bias.
///
/// A sampler accepts the policies that its documentation names, and refuses the others with
/// [`Error::OutOfRange`](crate::Error::OutOfRange).
///
/// The closed forms are the mean of a pixel whose samples are 1 with probability `p` and else 0. Its pilot has two
/// samples, and it is refined where the two differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PilotPolicy {
    /// The pilot stays in the image: least noise. Biased, since samples that are kept also decide how many follow [Kirk
    /// and Arvo 1991]: `p^2 + 2 p (1 - p) (1 + k p) / (2 + k)` with `k` additional samples. The bias falls with the
    /// pilot's size. A decision pooled over several pixels dilutes it: to 1/25 over 5x5 pixels.
    #[default]
    Keep,
    /// The pilot of refined pixels is discarded, that of the others stays, as in pbrt-v2. More biased than
    /// [`PilotPolicy::Keep`]: `3 p^2 - 2 p^3`, for any number of additional samples.
    Refined,
    /// The whole pilot is discarded: exactly unbiased where the budget is known at the start, at the price of its
    /// samples.
    Discard,
    /// Two halves: the samples of each decide the counts of the other, and the halves are averaged with equal weights.
    /// Exactly unbiased where the budget is known at the start, at the price of two shorter nets. Where the budget is
    /// raised later, a half's earlier samples reach its later counts through the other half's.
    Cross,
}

/// The end of refinement, for samplers that compare a measure of error with a threshold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stopping {
    /// At the budget, met exactly: the threshold only ranks pixels.
    #[default]
    Budget,
    /// At the threshold, as published: the budget is a ceiling, and the film's record has the samples spent.
    Threshold,
}
