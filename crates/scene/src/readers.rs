//! The readers of all scene and model formats, and the choice of a reader for a file.

use crate::files::{Disk, Files};
use crate::model::{ModelOptions, ObjReader, PlyReader, StlReader};
use crate::pbrt::{PbrtReader, ReadOptions};
use crate::{ReadError, Scene, Source};
use std::path::Path;
use std::sync::Arc;

/// A reader of one file format of scenes or models.
///
/// A new format is a type that implements this trait, and a line in [`READERS`].
pub trait SceneReader: Sync {
    /// Returns the format's name, for messages.
    fn name(&self) -> &'static str;

    /// Returns the file name extensions of the format, in lower case without a dot. The empty string stands for files
    /// without an extension.
    fn extensions(&self) -> &'static [&'static str];

    /// Returns true if the bytes of a file show that it has this format, whatever its name. The default returns false.
    fn recognizes(&self, content: &[u8]) -> bool {
        let _ = content;
        false
    }

    /// Reads the file `path` and all files that it names as one scene.
    ///
    /// # Errors
    /// Returns all problems found, each with file and line.
    fn read(&self, files: &dyn Files, path: &Path, options: &AnyOptions) -> Result<Scene, ReadError>;
}

/// The readers of all supported formats.
pub const READERS: [&dyn SceneReader; 4] = [&PbrtReader, &ObjReader, &PlyReader, &StlReader];

/// Options of [`read_any`] for all formats.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct AnyOptions {
    /// Options of the pbrt reader.
    pub scene: ReadOptions,
    /// Options of the model readers (OBJ, PLY, STL).
    pub model: ModelOptions,
}

impl AnyOptions {
    /// Replaces the options of the pbrt reader.
    pub fn with_scene(mut self, scene: ReadOptions) -> Self {
        self.scene = scene;
        self
    }

    /// Replaces the options of the model readers (OBJ, PLY, STL).
    pub fn with_model(mut self, model: ModelOptions) -> Self {
        self.model = model;
        self
    }
}

/// Reads a scene (`.pbrt`, or no extension) or a model (`.obj`, `.ply`, `.stl`) from disk.
///
/// The extension, in upper or lower case, decides on the format. For an unknown extension the content decides.
///
/// # Errors
/// Returns all problems of the file, each with file and line, or the problem of an unknown format.
pub fn read_any(path: impl AsRef<Path>, options: &AnyOptions) -> Result<Scene, ReadError> {
    read_any_from(&Disk, path, options)
}

/// Reads a scene or a model from `files`, with the choice of format of [`read_any`].
///
/// # Errors
/// Returns all problems of the file, each with file and line, or the problem of an unknown format.
pub fn read_any_from(
    files: &(impl Files + ?Sized),
    path: impl AsRef<Path>,
    options: &AnyOptions,
) -> Result<Scene, ReadError> {
    let (files, path) = (&Unsized(files), path.as_ref());
    let source = || Source { file: Arc::new(path.to_owned()), line: 0 };
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if let Some(reader) = READERS.into_iter().find(|reader| reader.extensions().contains(&&*extension)) {
        let outcome = reader.read(files, path, options);
        // Compressed bytes cause many errors; one problem replaces them.
        let compressed = || files.read(path).ok().and_then(|bytes| compression(&bytes));
        return outcome.map_err(|e| compressed().map_or(e, |advice| ReadError::invalid(source(), advice)));
    }
    let content = files.read(path).map_err(|e| unreadable(source(), &e))?;
    match READERS.into_iter().find(|reader| reader.recognizes(&content)) {
        Some(reader) => reader.read(files, path, options),
        None => Err(ReadError::invalid(source(), unsupported(&extension, &content))),
    }
}

/// A wrapper that makes a trait object of any [`Files`], sized or not.
pub(crate) struct Unsized<'f, F: ?Sized>(pub(crate) &'f F);

impl<F: Files + ?Sized> Files for Unsized<'_, F> {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        self.0.read(path)
    }
}

/// Makes the error of a file that cannot be opened.
pub(crate) fn unreadable(source: Source, e: &std::io::Error) -> ReadError {
    let message = format!("cannot read {}: {e}; check the name and that the file is there", source.file.display());
    ReadError::invalid(source, message)
}

/// Unsupported formats that users may expect: extension, and name of the format or program.
const FOREIGN: [(&str, &str); 9] = [
    ("3ds", "3ds Max"),
    ("blend", "Blender"),
    ("dae", "COLLADA"),
    ("fbx", "FBX"),
    ("glb", "glTF binary"),
    ("gltf", "glTF"),
    ("usd", "USD"),
    ("usdz", "USD"),
    ("xml", "Mitsuba XML"),
];

/// Returns the error message for a file that no reader accepts.
fn unsupported(extension: &str, content: &[u8]) -> String {
    if let Some(advice) = compression(content) {
        return advice.into();
    }
    if ["gz", "zip", "zst", "bz2", "xz"].contains(&extension) {
        return format!("files with extension \".{extension}\" are compressed; unpack the file first");
    }
    match FOREIGN.iter().find(|(known, _)| *known == extension) {
        Some((_, name)) => format!("{name} (.{extension}) is not supported; export pbrt, OBJ, PLY or STL"),
        None => format!(
            "extension \".{extension}\" is unknown; export pbrt, OBJ, PLY or STL, or rename the file to one of .pbrt, .obj, .ply, .stl"
        ),
    }
}

/// Returns the error message for a compressed file; `None` if the bytes are not those of a known compression.
fn compression(bytes: &[u8]) -> Option<&'static str> {
    let starts = |magic: &[u8]| bytes.starts_with(magic);
    if starts(&[0x1f, 0x8b]) {
        Some("the file is compressed by gzip; unpack it first (gunzip)")
    } else if starts(&[0x28, 0xb5, 0x2f, 0xfd]) {
        Some("the file is compressed by zstd; unpack it first (unzstd)")
    } else if starts(b"BZh") || starts(&[0xfd, b'7', b'z', b'X', b'Z', 0]) || starts(b"PK\x03\x04") {
        Some("the file is compressed; unpack it first")
    } else {
        None
    }
}
