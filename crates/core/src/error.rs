//! Errors of renders, plans and allocations.

use crate::{Film, SampleId};

/// The reason why a render, a plan or an allocation fails. Each message says what to do.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A frame without pixels.
    #[error("an image of {}x{} pixels is empty; both sides must be at least 1", resolution[0], resolution[1])]
    EmptyFrame {
        /// The requested width and height.
        resolution: [u32; 2],
    },
    /// A frame of more than 2^32 - 1 pixels.
    #[error("an image of {}x{} has more than 2^32 - 1 pixels; render it in crops", resolution[0], resolution[1])]
    FrameTooLarge {
        /// The requested width and height.
        resolution: [u32; 2],
    },
    /// A window that is empty or outside.
    #[error("the crop {},{},{},{} is empty or reaches outside the {}x{} image; give X0,Y0,X1,Y1 with X0 < X1 <= width and Y0 < Y1 <= height",
        crop[0], crop[1], crop[2], crop[3], resolution[0], resolution[1])]
    BadCrop {
        /// The window, x0, y0, x1, y1.
        crop: [u32; 4],
        /// The full image's width and height.
        resolution: [u32; 2],
    },
    /// A budget below the floors of all pixels.
    #[error(
        "a budget of {budget} samples is too small: {pixels} pixels need at least {needed}; raise the budget or lower the floor"
    )]
    BudgetTooSmall {
        /// Samples allowed.
        budget: u64,
        /// The sum of the floors.
        needed: u64,
        /// The number of pixels.
        pixels: usize,
    },
    /// A budget above the ceilings of all pixels.
    #[error(
        "a budget of {budget} samples is too large: {pixels} pixels may take at most {most}; lower the budget or raise the ceiling"
    )]
    BudgetTooLarge {
        /// Samples allowed.
        budget: u64,
        /// Samples that the ceilings add up to.
        most: u64,
        /// The number of pixels.
        pixels: usize,
    },
    /// A parameter outside its range.
    #[error("{name} = {value} is out of range: {allowed}")]
    OutOfRange {
        /// The name that the user knows.
        name: &'static str,
        /// The value.
        value: String,
        /// The allowed values.
        allowed: &'static str,
    },
    /// A point set with too few samples per pixel.
    #[error(
        "point set \"{points}\" repeats after {capacity} samples per pixel, and {requested} are planned; take another point set or fewer samples"
    )]
    SequenceExhausted {
        /// The point set.
        points: String,
        /// Samples that it has.
        capacity: u64,
        /// Samples planned.
        requested: u64,
    },
    /// An invalid plan of a sampler.
    #[error("sampler \"{sampler}\" made an invalid plan: {what}; this is a bug in the sampler")]
    BadPlan {
        /// The sampler.
        sampler: String,
        /// The fault of the plan.
        what: String,
    },
    /// A film without statistics that a sampler or filter reads.
    #[error("{who} reads {what}, which this film does not hold; pass its needs() to Render::needs")]
    NotRecorded {
        /// The sampler or filter.
        who: String,
        /// The missing statistics.
        what: &'static str,
    },
    /// A film that does not fit data made for it in advance.
    #[error("{who} does not fit this film: {what}")]
    Mismatch {
        /// The sampler or filter.
        who: String,
        /// The difference, and what to do about it.
        what: String,
    },
    /// Bytes that are not a snapshot.
    #[error("these bytes are not a snapshot of a render: {what}")]
    BadSnapshot {
        /// The end of the sentence: their fault.
        what: &'static str,
    },
    /// A snapshot of another render than the resumed one.
    #[error(
        "the snapshot is of another render: {what}; resume with the settings that it was made with, or start a new render"
    )]
    OtherRender {
        /// The differences.
        what: String,
    },
    /// A render that cannot be split into shards.
    #[error("{who} cannot be split into shards: {why}")]
    NoShards {
        /// The sampler or limit.
        who: String,
        /// The reason, and what to do.
        why: &'static str,
    },
    /// Shards that do not make an image together.
    #[error("these shards do not make an image: {what}")]
    BadShards {
        /// The shard that is missing, a duplicate, or of another image.
        what: String,
    },
    /// A sample that is NaN, infinite or negative, under [`InvalidSample::Fail`](crate::InvalidSample).
    #[error("sample {} of stream {} in pixel ({}, {}) is {value:?}, with point set \"{points}\"; replay it, or take InvalidSample::Reject", sample.index, sample.stream, sample.pixel[0], sample.pixel[1])]
    InvalidSample {
        /// The sample: replay it with the same point set.
        sample: SampleId,
        /// Its value.
        value: [f32; 3],
        /// The point set with its seed.
        points: String,
    },
    /// A panic of the integrator.
    #[error("the integrator panicked at sample {} of stream {} in pixel ({}, {}), with point set \"{points}\": {message}", sample.index, sample.stream, sample.pixel[0], sample.pixel[1])]
    Panicked {
        /// The sample: replay it with the same point set.
        sample: SampleId,
        /// The panic's message.
        message: String,
        /// The point set with its seed.
        points: String,
        /// The finished samples.
        film: Box<Film>,
    },
    /// An error of a sampler's or filter's own.
    #[error("{who}: {source}")]
    Other {
        /// The sampler or filter.
        who: String,
        /// The error, which keeps its type.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl Error {
    /// An error of a sampler's or filter's own kind, which callers can downcast.
    ///
    /// ```
    /// use dapple_core::Error;
    ///
    /// let error = Error::other("my-sampler", "probes.bin".parse::<u32>().unwrap_err());
    /// assert_eq!(error.to_string(), "my-sampler: invalid digit found in string");
    /// let Error::Other { source, .. } = error else { panic!() };
    /// assert!(source.is::<std::num::ParseIntError>());
    /// ```
    pub fn other(who: impl Into<String>, source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        Self::Other { who: who.into(), source: source.into() }
    }

    /// A parameter outside its range.
    pub fn out_of_range(name: &'static str, value: impl ToString, allowed: &'static str) -> Self {
        Self::OutOfRange { name, value: value.to_string(), allowed }
    }
}
