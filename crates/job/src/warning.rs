//! Warnings of a render.

use dapple_core::film::Rejected;
use dapple_core::point_set::streams;
use dapple_scene::{CalledEffect, Effect, Notice, Source};

/// A condition that a user should know about, but that does not stop the render.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Warning {
    /// A note about a directive of the scene file that was adjusted or ignored.
    #[error("{}: {}", .0.source, .0.message)]
    Notice(Notice),
    /// An effect (a kind of light transport) that is left out of the image at the user's request.
    #[error("{effect} is left out: {}{}", effect.left_out(), caller(by.as_ref()))]
    LeftOut {
        /// The effect that is left out.
        effect: Effect,
        /// The first object in the scene that uses the effect; `None` if unknown.
        by: Option<CalledEffect>,
    },
    /// A light that a path tracer finds by chance only, such as a small light behind glass.
    #[error("{}: {}; --integrator photons renders this light (not with --part or motion blur)", .0.source, found_by_chance(.0))]
    FoundByChance(CalledEffect),
    /// A light that a path tracer finds by chance only. The default integrator for the scene is therefore `photons`.
    #[error("{}: {}; photon mapping renders this light (--integrator path would leave specks)", .0.source, .0.because)]
    Photons(CalledEffect),
    /// An area light whose triangles have zero area, so that it emits no light.
    #[error("{0}: this area light has zero area and emits no light; make it larger, or remove it")]
    LampWithoutArea(Source),
    /// The number of triangles with zero area, which are left out.
    #[error("{}", dropped(*.0))]
    DroppedTriangles(usize),
    /// The error of reading the newest version of a checkpoint. The render resumes from the previous version.
    #[error("{0}; resuming from the previous version of the checkpoint")]
    PreviousCheckpoint(String),
    /// The error of writing a checkpoint. The render continues and tries again.
    #[error("no checkpoint was written: {0}; rendering continues and will try again")]
    NoCheckpoint(String),
    /// Samples whose radiance was NaN, infinite or negative; they count as black.
    #[error("{rejected} of {samples} samples were NaN, infinite or negative and count as 0; the first is sample {} of stream {} in pixel ({}, {}) with {points}", first.sample.index, first.sample.stream, first.sample.pixel[0], first.sample.pixel[1])]
    RejectedSamples {
        /// The number of rejected samples.
        rejected: u64,
        /// The number of all samples of the render.
        samples: u64,
        /// The first rejected sample.
        first: Rejected,
        /// The description of the point set that placed the samples.
        points: String,
    },
    /// A clustering grid that is too coarse for the scene: one voxel holds more than half of the triangles.
    #[error(
        "one of the clustering grid's {voxels} voxels holds {fullest} of {triangles} triangles, so clusters hardly separate objects; raise k= and clamp=, or remove distant objects, which enlarge the grid"
    )]
    DegenerateClusters {
        /// The number of voxels of the grid.
        voxels: u64,
        /// The number of triangles in the fullest voxel.
        fullest: u32,
        /// The number of triangles in the scene.
        triangles: u32,
    },
    /// The number of first-hit rays whose hit position was NaN or infinite; they count as background.
    #[error(
        "NaN or infinite hits of first-hit rays: {0}; these rays count as background; move the camera nearer to the scene"
    )]
    RejectedFirstHits(u64),
    /// A render that ended before its predicted error fell to the goal.
    #[error("the predicted relMSE is {}, but the goal is {goal}: the render ended at the sampler's threshold or at the maximum number of samples", predicted.map_or_else(|| "unknown".to_owned(), |predicted| format!("{predicted:.2e}")))]
    ErrorNotReached {
        /// The predicted relMSE at the end; `None` if unknown.
        predicted: Option<f64>,
        /// The relMSE to reach.
        goal: f64,
    },
    /// A time limit that is too short for the first samples of all pixels, noticed while these samples are traced.
    #[error("{} per pixel will take about {} s, but the time limit is {} s; rendering continues until every pixel has this many, since a pixel without samples is black", least(*min_spp), rounded(*needed), rounded(*limit))]
    TimeTooShort {
        /// The time limit in seconds.
        limit: f64,
        /// The least number of samples per pixel.
        min_spp: u32,
        /// The estimated seconds until every pixel has `min_spp` samples.
        needed: f64,
    },
    /// A render that took longer than its time limit.
    #[error("the render took {} s, {} s more than the time limit of {} s: {}", rounded(*taken), rounded(taken - limit), rounded(*limit), reason(*first, *filter))]
    TimeExceeded {
        /// The time limit in seconds.
        limit: f64,
        /// The seconds from clustering to filtering.
        taken: f64,
        /// The seconds of the first round, and the least number of samples per pixel, if no other round was traced.
        first: Option<(f64, u32)>,
        /// The seconds of the filter.
        filter: f64,
    },
    /// A stopped render whose image is left unfiltered, because the filter would take too long.
    #[error("stopped: the image is not filtered, since {filter} would take too long")]
    NotFiltered {
        /// The name of the filter that was not applied.
        filter: String,
    },
    /// Pixels with fireflies, which the filter treats separately.
    #[error("{0}; to remove them, use more samples or --filter cluster-regression:fireflies=drop")]
    Fireflies(dapple_core::filter::Fireflies),
    /// Pixel values that were too large for the file format, and were clamped to its maximum.
    #[error("{}: values beyond 65504, the limit of 16-bit floats, are clamped ({values}); omit --half to keep them", path.display())]
    Clamped {
        /// The path of the image file.
        path: std::path::PathBuf,
        /// The number of clamped values.
        values: u64,
    },
    /// A requested layer of an EXR file that this render does not have.
    #[error("{}: no layer \"{layer}\": {}", path.display(), missing(layer))]
    NoLayer {
        /// The path of the EXR file.
        path: std::path::PathBuf,
        /// The name of the layer.
        layer: String,
    },
    /// A part whose file is not written, because its render was stopped.
    #[error("part {0} was stopped, and is not written; run the same command again")]
    PartStopped(crate::PartNumber),
}

/// The object that uses an effect, as the end of a sentence.
fn caller(by: Option<&CalledEffect>) -> String {
    by.map_or_else(String::new, |by| format!("; {} uses the effect ({})", by.source, by.because))
}

/// The reason why a render took longer than its time limit.
fn reason(first: Option<(f64, u32)>, filter: f64) -> String {
    let filter = rounded(filter);
    match first {
        Some((seconds, spp)) => {
            let (samples, seconds) = (least(spp), rounded(seconds));
            format!("{samples} per pixel took {seconds} s, the filter {filter} s; render fewer pixels to save time")
        }
        None => format!("samples were slower than those of the first round; the filter took {filter} s"),
    }
}

/// The reason why an EXR file lacks a layer.
fn missing(layer: &str) -> &'static str {
    match layer {
        "unfiltered" => "the image itself is unfiltered",
        "cluster" => "neither sampler nor filter makes clusters",
        _ => "this render does not record it",
    }
}

/// The message about triangles of zero area.
fn dropped(triangles: usize) -> String {
    match triangles {
        1 => "1 triangle has zero area and is left out".into(),
        n => format!("{n} triangles have zero area and are left out"),
    }
}

/// A number of samples with its noun.
fn least(samples: u32) -> String {
    if samples <= 1 { "one sample".into() } else { format!("{samples} samples") }
}

/// Seconds rounded to two digits, or to whole seconds.
fn rounded(seconds: f64) -> String {
    let step = match seconds {
        s if s < 0.1 => 1000.0,
        s if s < 1.0 => 100.0,
        s if s < 10.0 => 10.0,
        _ => 1.0,
    };
    ((seconds * step).round() / step).to_string()
}

/// Formats a warning that paths find a light by chance only, so that the image has specks.
pub fn found_by_chance(called: &CalledEffect) -> String {
    let others = match called.objects {
        1 => String::new(),
        2 => " (and one more light like it)".into(),
        n => format!(" (and {} more lights like it)", n - 1),
    };
    format!("{}{others}: its light is found by chance only, and leaves specks even with many samples", called.because)
}

/// Returns `true` if uniform sampling with the same seed can replay a rejected sample. Only samples of the stream
/// [`streams::WHOLE`] can be replayed; halves and discarded pilots have other streams.
pub fn can_be_replayed(first: &Rejected) -> bool {
    first.sample.stream == streams::WHOLE
}
