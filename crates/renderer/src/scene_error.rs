//! The reason why an object of a scene was refused.

use dapple_scene::Source;

/// The reason why a camera, a light or a medium of a scene was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{at}: {what}")]
pub struct SceneError {
    /// The line of the scene file that defines the object.
    pub at: Source,
    /// The problem and its remedy.
    pub what: String,
}

impl SceneError {
    pub(crate) fn new(at: &Source, what: impl Into<String>) -> Self {
        Self { at: at.clone(), what: what.into() }
    }
}
