//! Scenes and models by their file's extension.

use crate::files::{Disk, Files};
use crate::model::{ModelFormat, ModelOptions, compressed, read_model_from};
use crate::pbrt::{Problem, ReadError, ReadOptions, read_scene_from};
use crate::{Scene, Source};
use std::path::Path;
use std::sync::Arc;

/// How a file is read, whatever it holds.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct AnyOptions {
    /// For scenes.
    pub scene: ReadOptions,
    /// For models.
    pub model: ModelOptions,
}

impl AnyOptions {
    /// These options, scenes being read as said.
    pub fn with_scene(mut self, scene: ReadOptions) -> Self {
        self.scene = scene;
        self
    }

    /// These options, models being shown as said.
    pub fn with_model(mut self, model: ModelOptions) -> Self {
        self.model = model;
        self
    }
}

/// Reads a scene (`.pbrt`, or no extension) or a model (`.obj`, `.ply`, `.stl`) from disk. The extension tells which, in
/// capital letters or small ones.
///
/// # Errors
/// Everything wrong with it; an extension that is none of these.
pub fn read_any(path: impl AsRef<Path>, options: &AnyOptions) -> Result<Scene, ReadError> {
    read_any_from(&Disk, path, options)
}

/// Reads a scene or a model from `files`: see [`read_any`].
///
/// # Errors
/// As [`read_any`].
pub fn read_any_from(
    files: &(impl Files + ?Sized),
    path: impl AsRef<Path>,
    options: &AnyOptions,
) -> Result<Scene, ReadError> {
    let path = path.as_ref();
    if ModelFormat::from_path(path).is_some() {
        return read_model_from(files, path, &options.model);
    }
    let refuse = |message: String| {
        let source = Source { file: Arc::new(path.to_owned()), line: 0 };
        ReadError { problems: vec![Problem { source, message }], more: 0 }
    };
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let scene = extension.is_empty() || extension.eq_ignore_ascii_case("pbrt");
    // What cannot be read at all is told as such, by the scene reader.
    if !scene && files.read(path).is_ok() {
        let packed = ["gz", "zip", "zst", "bz2", "xz"].iter().any(|known| extension.eq_ignore_ascii_case(known));
        let advice = if packed { "unpack the file first" } else { "rename or convert the file" };
        return Err(refuse(format!(
            "the extension '{extension}' is none that is read: .pbrt (scenes), .obj, .ply and .stl (models) are; {advice}"
        )));
    }
    let outcome = read_scene_from(files, path, &options.scene);
    // Packed bytes make a wall of complaints: one is enough.
    let packed = || files.read(path).ok().and_then(|bytes| compressed(&bytes));
    outcome.map_err(|e| packed().map_or(e, |advice| refuse(advice.into())))
}
