//! Errors of jobs.

use crate::memory::{MemoryEstimate, MemoryLimit, size};
use crate::registry::RegistryError;
use crate::{PartNumber, SpecError, checkpoint};
use dapple_renderer::{IntegratorError, WorldError};
use dapple_scene::ReadError;
use dapple_scene::{Effect, WithoutError, bundled};
use std::path::PathBuf;

/// An error in preparing, running, resuming or merging a job (a render with its description).
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// An invalid description of a render.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// A scene name that is neither the path of a file nor the name of a bundled scene.
    #[error("{name}: no such file or bundled scene; {} bundled scenes are {}", meant(name), bundled::names().join(", "))]
    NoScene {
        /// The name of the scene.
        name: String,
    },
    /// A scene that cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A scene that cannot be built for tracing.
    #[error(transparent)]
    World(#[from] WorldError),
    /// A sampler, a point set or a filter that cannot be created.
    #[error(transparent)]
    Registry(#[from] RegistryError),
    /// An integrator that cannot be created.
    #[error(transparent)]
    Integrator(#[from] IntegratorError),
    /// An error limit in a render whose integrator adds light to pixels other than the sampled one. The error estimate does not
    /// include the noise of that light.
    #[error(
        "an error limit cannot be used with {integrator}: the light that this integrator adds to other pixels than the sampled one has no error estimate; set the number of samples or a time limit, or use bdpt:splat=0"
    )]
    SplatsWithoutError {
        /// The integrator, as requested.
        integrator: String,
    },
    /// An error from `dapple_core`, which plans and traces the samples.
    #[error(transparent)]
    Core(#[from] dapple_core::Error),
    /// An effect (a kind of light transport) that cannot be left out of the scene.
    #[error("cannot leave out {effect}: {source}")]
    Without {
        /// The effect that was to be left out.
        effect: Effect,
        /// The reason why the effect cannot be left out.
        source: WithoutError,
    },
    /// A request to leave out an effect that the scene does not use.
    #[error("cannot leave out {effect}: the scene does not use this effect; {}", choice(called))]
    NotCalledFor {
        /// The effect that was to be left out.
        effect: Effect,
        /// All effects that the scene uses.
        called: Vec<Effect>,
    },
    /// A render that needs more memory than the limit.
    #[error("{}", refusal(estimate, *limit, advice))]
    Memory {
        /// The estimated memory of the render.
        estimate: Box<MemoryEstimate>,
        /// The largest memory that the render may use.
        limit: MemoryLimit,
        /// The suggested remedy.
        advice: &'static str,
    },
    /// A checkpoint or a part that cannot be read or written.
    #[error(transparent)]
    Checkpoint(#[from] checkpoint::Error),
    /// An existing checkpoint file that the render would overwrite without resuming from it.
    #[error("{path}: a checkpoint exists; resume from it, or remove it and {path}.previous", path = path.display())]
    CheckpointExists {
        /// The path of the existing checkpoint file.
        path: PathBuf,
    },
    /// A checkpoint or part file made by a render with other settings.
    #[error("{}", other_render(path, differences))]
    OtherRender {
        /// The path of the checkpoint or part file.
        path: PathBuf,
        /// The settings that differ, one phrase for each.
        differences: Vec<String>,
    },
    /// A checkpoint file whose snapshot of the film is inconsistent.
    #[error("{}: {source}", path.display())]
    Snapshot {
        /// The path of the checkpoint file.
        path: PathBuf,
        /// The error of decoding the snapshot.
        source: dapple_core::Error,
    },
    /// Part files that cannot be read or do not belong together: one message per problem.
    #[error("{}", .0.join("\n"))]
    Parts(Vec<String>),
    /// A panic in the integrator, with its message.
    #[error("{0}")]
    Panicked(String),
    /// An image that cannot be rendered in parts without a plan.
    #[error("part {part}: {why}")]
    NoParts {
        /// The part that was requested.
        part: PartNumber,
        /// The reason why the image cannot be rendered in parts.
        why: String,
    },
    /// A plan from which no image can be made yet, because samples are left to trace.
    #[error("{}: samples are left to trace; render the parts of this plan, then make the next plan from them", path.display())]
    NotDone {
        /// The plan file.
        path: PathBuf,
    },
    /// A description that needs another world (scene built for tracing) than the prepared one.
    #[error(
        "scene, resolution or light selection of the render settings differ from the prepared scene; prepare the scene again with these settings"
    )]
    OtherWorld,
    /// A checkpoint or part of a scene that was read without a digest (hash of its files).
    #[error("checkpoints and parts need a digest of the scene; load the scene with LoadOptions::digest")]
    NoDigest,
    /// Image files that cannot be written: one message per file.
    #[error("{}", .0.join("\n"))]
    Files(Vec<String>),
}

/// The suggestion of the bundled scene most similar to `name`, and the article before the list of all scenes.
fn meant(name: &str) -> String {
    let nearest = dapple_core::options::nearest_name(name, bundled::names().iter().copied());
    nearest.map_or_else(|| "the".to_owned(), |known| format!("did you mean \"{known}\"? The"))
}

fn choice(effects: &[Effect]) -> String {
    let names: Vec<&str> = effects.iter().map(|effect| effect.name()).collect();
    if names.is_empty() { "it uses no effects".into() } else { format!("choose among {}", names.join(", ")) }
}

fn refusal(estimate: &MemoryEstimate, limit: MemoryLimit, advice: &str) -> String {
    let of = if limit.is_given() { "the limit" } else { "all the memory available" };
    let bytes = limit.bytes().filter(|bytes| estimate.peak() > *bytes);
    let exceeded = bytes.map_or_else(String::new, |bytes| format!(", and {} is {of}", size(bytes)));
    format!("this render needs {estimate}{exceeded}; {advice}")
}

fn other_render(path: &std::path::Path, differences: &[String]) -> String {
    let first =
        "the file belongs to another render; use the arguments of that render, or another file; the differences are:";
    let lines = std::iter::once(first).chain(differences.iter().map(String::as_str));
    lines.map(|line| format!("{}: {line}", path.display())).collect::<Vec<_>>().join("\n")
}
