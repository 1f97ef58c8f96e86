//! Warnings as data.

use dapple_core::{Rejected, streams};
use dapple_scene::{Called, Effect, Notice};
use std::fmt;

/// A condition that a user should know, and that stops nothing.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Warning {
    /// Something in the scene file is read otherwise than written.
    Notice(Notice),
    /// The scene suggests another number of samples per pixel.
    SuggestedSpp {
        /// The name of the scene.
        scene: String,
        /// Its suggestion.
        suggested: u32,
        /// The render's number.
        spp: f64,
    },
    /// An effect is left out.
    LeftOut {
        /// The effect.
        effect: Effect,
        /// The object that calls for it.
        by: Option<Called>,
    },
    /// A path tracer finds some light by chance only.
    FoundByChance(Called),
    /// Triangles without area are left out.
    DroppedTriangles(usize),
    /// The newer checkpoint is damaged, and the render resumes from the one before it.
    PreviousCheckpoint(String),
    /// A checkpoint was not written; the render goes on and tries again.
    NoCheckpoint(String),
    /// Samples were NaN, infinite or negative, and count as 0.
    RejectedSamples {
        /// Their number.
        rejected: u64,
        /// The number of all samples.
        samples: u64,
        /// The first of them.
        first: Rejected,
        /// The point set, described.
        points: String,
    },
    /// Nearly all triangles are in few voxels of the clustering grid.
    DegenerateClusters {
        /// Voxels that the parameters request.
        requested: u64,
        /// Voxels with triangles.
        occupied: u64,
    },
    /// Probes hit a place that is NaN or infinite, and count as background.
    RejectedProbes(u64),
    /// An error budget ended above its goal.
    ErrorNotReached {
        /// The predicted relMSE, if known.
        predicted: Option<f64>,
        /// The goal.
        goal: f64,
    },
    /// The image of a stopped render is not filtered, because the filter would take too long.
    NotFiltered {
        /// The filter's name.
        filter: String,
    },
    /// Values were too large for the file.
    Clamped {
        /// The file.
        path: std::path::PathBuf,
        /// The number of values.
        values: u64,
    },
    /// A shard of a stopped render is not written.
    ShardStopped(dapple_core::Shard),
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Notice(notice) => write!(f, "{}: {}", notice.source, notice.message),
            Self::SuggestedSpp { scene, suggested, spp } => {
                write!(f, "{scene}: the file suggests {suggested} spp, and the render takes {spp}")
            }
            Self::LeftOut { effect, by: Some(by) } => {
                let left_out = effect.left_out();
                write!(f, "without {effect}: {left_out}; {} calls for it ({})", by.source, by.because)
            }
            Self::LeftOut { effect, by: None } => write!(f, "without {effect}: {}", effect.left_out()),
            Self::FoundByChance(called) => write!(f, "{}: {}", called.source, found_by_chance(called)),
            Self::DroppedTriangles(dropped) => write!(f, "{dropped} triangles have no area and are left out"),
            Self::PreviousCheckpoint(trouble) => write!(f, "{trouble}; resuming from the checkpoint before it"),
            Self::NoCheckpoint(trouble) => {
                write!(f, "no checkpoint was written: {trouble}; rendering goes on, and will try again")
            }
            Self::RejectedSamples { rejected, samples, first, points } => {
                let id = first.sample;
                let [x, y] = id.pixel;
                write!(
                    f,
                    "{rejected} of {samples} samples were NaN, infinite or negative and count as 0; the first is sample {} \
                     of stream {} in pixel ({x}, {y}) with {points}",
                    id.index, id.stream
                )
            }
            Self::DegenerateClusters { requested, occupied } => write!(
                f,
                "of {requested} voxels {occupied} hold all triangles, so that clusters tell little apart; leave out what \
                 stretches the scene, or raise clamp= and k="
            ),
            Self::RejectedProbes(rejected) => {
                write!(f, "{rejected} probes hit a place that is NaN or infinite, and count as background")
            }
            Self::ErrorNotReached { predicted, goal } => {
                let known = predicted.map_or_else(|| "unknown".to_owned(), |predicted| format!("{predicted:.2e}"));
                write!(
                    f,
                    "the predicted relMSE is {known}, and the goal is {goal}: the sampler's threshold or the largest number \
                     of samples ended the render"
                )
            }
            Self::NotFiltered { filter } => {
                write!(f, "stopped: the image is not filtered, since {filter} would take too long")
            }
            Self::Clamped { path, values } => write!(f, "{}: {values} values were too large for it", path.display()),
            Self::ShardStopped(shard) => write!(f, "shard {shard} was stopped, and is not written"),
        }
    }
}

/// The effect of light that is found by chance, as a sentence.
pub fn found_by_chance(called: &Called) -> String {
    let others = match called.objects {
        1 => String::new(),
        2 => " (and one more light like it)".into(),
        n => format!(" (and {} more lights like it)", n - 1),
    };
    format!(
        "{}{others}: its light is found by chance only, and leaves specks that many samples do not smooth",
        called.because
    )
}

/// Returns true if uniform sampling can replay a rejected sample.
pub fn can_be_replayed(first: &Rejected) -> bool {
    first.sample.stream == streams::WHOLE
}
