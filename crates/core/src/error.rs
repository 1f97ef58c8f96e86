//! Everything that can go wrong between a sampler and an image.

use crate::{Film, SampleId};

/// Why a render, a plan or an allocation is refused. Each message says what to do.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A frame without pixels.
    #[error("an image of {}x{} pixels is empty: both sides must be at least 1", resolution[0], resolution[1])]
    EmptyFrame {
        /// Width and height asked for.
        resolution: [u32; 2],
    },
    /// A frame with more pixels than are numbered.
    #[error("an image of {}x{} has more than 2^32 - 1 pixels: render it in crops", resolution[0], resolution[1])]
    FrameTooLarge {
        /// Width and height asked for.
        resolution: [u32; 2],
    },
    /// A window that is empty or outside.
    #[error("the crop {},{},{},{} is empty or reaches outside the {}x{} image: give X0,Y0,X1,Y1 with X0 < X1 <= width and Y0 < Y1 <= height",
        crop[0], crop[1], crop[2], crop[3], resolution[0], resolution[1])]
    BadCrop {
        /// The window, x0, y0, x1, y1.
        crop: [u32; 4],
        /// The full image's width and height.
        resolution: [u32; 2],
    },
    /// Fewer samples than the pixels must have.
    #[error(
        "a budget of {budget} samples is too small: {pixels} pixels need at least {needed}; raise the budget or lower the floor"
    )]
    BudgetTooSmall {
        /// Samples allowed.
        budget: u64,
        /// Samples that the floors add up to.
        needed: u64,
        /// How many pixels there are.
        pixels: usize,
    },
    /// More samples than the pixels may have.
    #[error(
        "a budget of {budget} samples is too large: {pixels} pixels may take at most {most}; lower the budget or raise the ceiling"
    )]
    BudgetTooLarge {
        /// Samples allowed.
        budget: u64,
        /// Samples that the ceilings add up to.
        most: u64,
        /// How many pixels there are.
        pixels: usize,
    },
    /// A parameter outside its range.
    #[error("{name} = {value} is out of range: {allowed}")]
    OutOfRange {
        /// The parameter, as the user knows it.
        name: &'static str,
        /// The value given.
        value: String,
        /// What is allowed.
        allowed: &'static str,
    },
    /// A point set cannot give so many samples per pixel.
    #[error(
        "{points} repeats after {capacity} samples per pixel, and sample {asked} was asked for: take another point set or fewer samples"
    )]
    SequenceExhausted {
        /// The point set.
        points: String,
        /// Samples it has.
        capacity: u64,
        /// Samples asked for.
        asked: u64,
    },
    /// A sampler broke its word.
    #[error("the sampler {sampler} broke its word: {what}; this is a bug in the sampler")]
    BadPlan {
        /// The sampler.
        sampler: String,
        /// What it did.
        what: String,
    },
    /// A film lacks what somebody reads.
    #[error("{who} reads {what}, which this film does not hold: pass its needs() to render")]
    NotRecorded {
        /// The sampler or filter.
        who: String,
        /// What it reads.
        what: &'static str,
    },
    /// A film and what was made for it beforehand do not belong together.
    #[error("{who} does not fit this film: {what}")]
    Mismatch {
        /// The sampler or filter.
        who: String,
        /// What differs, and what to do about it.
        what: String,
    },
    /// Bytes that are no snapshot.
    #[error("these bytes are no snapshot of a render: {what}")]
    BadSnapshot {
        /// What is wrong with them.
        what: &'static str,
    },
    /// A snapshot of another render than the one that shall go on.
    #[error("the snapshot is of another render: {what}; go on with the settings that it was made with, or start anew")]
    OtherRender {
        /// What differs.
        what: String,
    },
    /// A render that cannot be shared out among machines.
    #[error("{who} cannot be shared out among machines: {why}")]
    NoShards {
        /// The sampler, or what else it is.
        who: String,
        /// Why, and what can.
        why: &'static str,
    },
    /// Shards that do not make an image.
    #[error("these shards make no image: {what}")]
    BadShards {
        /// What is missing, twice there, or does not belong to the others.
        what: String,
    },
    /// A sample was no radiance, in strict mode.
    #[error("sample {} of stream {} in pixel ({}, {}) is {value:?}, with {points}", sample.index, sample.stream, sample.pixel[0], sample.pixel[1])]
    InvalidSample {
        /// Which sample: replay it with the same point set.
        sample: SampleId,
        /// What it returned.
        value: [f32; 3],
        /// The point set with its seed.
        points: String,
    },
    /// An integrator panicked.
    #[error("the integrator panicked at sample {} of stream {} in pixel ({}, {}), with {points}: {message}", sample.index, sample.stream, sample.pixel[0], sample.pixel[1])]
    Panicked {
        /// Which sample: replay it with the same point set.
        sample: SampleId,
        /// The panic's message.
        message: String,
        /// The point set with its seed.
        points: String,
        /// What was finished before.
        film: Box<Film>,
    },
}
