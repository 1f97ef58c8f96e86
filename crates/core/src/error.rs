//! Errors of renders, plans and allocations.

use crate::{Film, SampleId};

/// The reason why a render, a plan or an allocation fails. Most messages include a remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A time limit without a clock.
    #[error("a time limit needs a clock, and this machine has none; pass a clock to Session::with_clock")]
    NoClock,
    /// Random numbers of the host that are the same as in an earlier round.
    #[error(
        "the random numbers repeat: in all {pixels} pixels compared, the first samples equal those of an earlier \
         round; seed the generator with the pixel and the sample's number (Tile::pixels), or use one generator for \
         all rounds"
    )]
    RepeatedNumbers {
        /// The number of pixels that were compared.
        pixels: u32,
    },
    /// A frame without pixels.
    #[error("an image of {}x{} pixels is empty; both sides must be at least 1", .resolution[0], .resolution[1])]
    EmptyFrame {
        /// The requested width and height.
        resolution: [u32; 2],
    },
    /// A frame of more than 2^32 - 1 pixels.
    #[error("an image of {}x{} has more than 2^32 - 1 pixels; choose a lower resolution", .resolution[0], .resolution[1])]
    FrameTooLarge {
        /// The requested width and height.
        resolution: [u32; 2],
    },
    /// A window that is empty or reaches outside the image.
    #[error(
        "the crop {},{},{},{} is empty or reaches outside the {}x{} image; use X0,Y0,X1,Y1 with X0 < X1 <= width and Y0 < \
         Y1 <= height",
        .crop[0], .crop[1], .crop[2], .crop[3], .resolution[0], .resolution[1]
    )]
    BadCrop {
        /// The window `[x0, y0, x1, y1]` in pixels.
        crop: [u32; 4],
        /// The full image's width and height.
        resolution: [u32; 2],
    },
    /// A budget smaller than the sum of the pixels' minimum sample counts.
    #[error(
        "a budget of {budget} samples is too small: {pixels} pixels need at least {needed} samples; raise the budget, \
         or lower the minimum number of samples per pixel"
    )]
    BudgetTooSmall {
        /// The budget in samples.
        budget: u64,
        /// The sum of the pixels' minimum sample counts.
        needed: u64,
        /// The number of pixels.
        pixels: usize,
    },
    /// A budget larger than the sum of the pixels' maximum sample counts.
    #[error(
        "a budget of {budget} samples is too large: {pixels} pixels can take at most {most} samples; lower the \
         budget, or raise the maximum number of samples per pixel"
    )]
    BudgetTooLarge {
        /// The budget in samples.
        budget: u64,
        /// The sum of the pixels' maximum sample counts.
        most: u64,
        /// The number of pixels.
        pixels: usize,
    },
    /// A parameter outside its range.
    #[error("{name} = {value} is out of range; allowed: {allowed}")]
    OutOfRange {
        /// The parameter's name on the command line.
        name: &'static str,
        /// The rejected value.
        value: String,
        /// The allowed values, in words.
        allowed: &'static str,
    },
    /// A point set with too few samples per pixel.
    #[error(
        "point set \"{points}\" repeats after {capacity} samples per pixel, but {requested} are planned; use another \
         point set, or fewer samples"
    )]
    SequenceExhausted {
        /// The point set's description.
        points: String,
        /// The number of samples per pixel and stream before the point set repeats.
        capacity: u64,
        /// The planned number of samples per pixel.
        requested: u64,
    },
    /// A plan that breaks the rules of [`Plan`](crate::plan::Plan).
    #[error("sampler \"{sampler}\" made an invalid plan: {what}; this is a bug in the sampler")]
    BadPlan {
        /// The sampler's name.
        sampler: String,
        /// The fault of the plan, in words.
        what: String,
    },
    /// A film without the statistics that a sampler or filter reads.
    #[error("{who} reads {what}, which this film does not record; pass the needs() of {who} to Render::needs")]
    NotRecorded {
        /// The name of the sampler or filter.
        who: String,
        /// The missing statistics, as a noun phrase.
        what: &'static str,
    },
    /// A film or session that records features or first hits, but whose samples all report radiance only.
    #[error(
        "{who} reads {what}, but all samples report radiance only; set first hits with Estimate::with_first_hit (None for a \
         miss), in Film::push_estimate or a session, or use a filter that reads no features"
    )]
    NoneReported {
        /// The name of the sampler or filter.
        who: String,
        /// The missing statistics, as a noun phrase.
        what: &'static str,
    },
    /// A buffer of another program that cannot be converted to a film.
    #[error("buffer \"{buffer}\": {what}")]
    BadBuffer {
        /// The buffer's name, such as `normal`.
        buffer: &'static str,
        /// The fault of the buffer, and what to do about it.
        what: String,
    },
    /// A film that does not match data that a sampler or filter prepared, such as clusters of another image size.
    #[error("{who} does not fit this film: {what}")]
    Mismatch {
        /// The name of the sampler or filter.
        who: String,
        /// The difference, and what to do about it.
        what: String,
    },
    /// A round of a [`Session`](crate::Session) of which no tile was submitted.
    #[error(
        "no tile of the last round was submitted, and {left} of its samples are left; pass each traced tile to \
         Round::submit, or end with Session::finish"
    )]
    NothingSubmitted {
        /// The number of samples left in the round.
        left: u64,
    },
    /// A tile that was not accepted by its round.
    #[error(
        "the tile of columns {}..{} and rows {}..{} was not accepted: {what}",
        .area[0], .area[2], .area[1], .area[3]
    )]
    BadTile {
        /// The tile's area `[x0, y0, x1, y1]`, in pixels of the full image.
        area: [u32; 4],
        /// The fault, and what to do about it.
        what: String,
    },
    /// Bytes that are not a snapshot.
    #[error(
        "the render snapshot cannot be used: {what}; pass a snapshot that this version of Dapple saved, or start a new render"
    )]
    BadSnapshot {
        /// The fault, as a clause.
        what: &'static str,
    },
    /// A snapshot, or traced rows of a stage, of a render with other settings or at another point.
    #[error("the saved state does not fit this render: {what}")]
    OtherRender {
        /// The difference, and what to do about it.
        what: String,
    },
    /// A sample that is NaN, infinite or negative, under [`InvalidSample::Fail`](crate::InvalidSample).
    #[error(
        "sample {} of stream {} in pixel ({}, {}) is {value:?}, with point set \"{points}\"; replay the sample to \
         find the cause, or use InvalidSample::Reject to count such samples as black",
        .sample.index, .sample.stream, .sample.pixel[0], .sample.pixel[1]
    )]
    InvalidSample {
        /// The invalid sample; the same point set replays it.
        sample: SampleId,
        /// The radiance of the invalid sample, linear RGB.
        value: [f32; 3],
        /// The description of the point set, with its seed.
        points: String,
    },
    /// A panic of the integrator.
    #[error(
        "the integrator panicked at sample {} of stream {} in pixel ({}, {}), with point set \"{points}\": {message}",
        .sample.index, .sample.stream, .sample.pixel[0], .sample.pixel[1]
    )]
    Panicked {
        /// The sample whose estimate panicked; the same point set replays it.
        sample: SampleId,
        /// The panic's message.
        message: String,
        /// The description of the point set, with its seed.
        points: String,
        /// The film with the samples finished before the panic.
        film: Box<Film>,
    },
    /// An error in a method's name, parameters or library, for downcasting.
    #[error(transparent)]
    Method(Box<dyn std::error::Error + Send + Sync>),
    /// An error that a sampler or filter defines itself.
    #[error("{who}: {source}")]
    Other {
        /// The name of the sampler or filter.
        who: String,
        /// The original error, for downcasting.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl Error {
    /// Wraps an error that a sampler or filter defines itself, so that callers can downcast it.
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

    /// Makes [`Error::OutOfRange`] for a parameter outside its range.
    pub fn out_of_range(name: &'static str, value: impl ToString, allowed: &'static str) -> Self {
        Self::OutOfRange { name, value: value.to_string(), allowed }
    }
}
