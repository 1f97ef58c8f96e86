//! The readers of all scene and model formats, and the choice of a reader for a file.

mod foreign;

use crate::files::{Disk, Files};
use crate::gltf::GltfReader;
use crate::model::{ModelOptions, ObjReader, PlyReader, StlReader};
use crate::pbrt::{PbrtReader, ReadOptions};
use crate::{ReadError, Scene, Source};
use std::cell::RefCell;
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
// One a line, so that a new one is a line of its own.
#[rustfmt::skip]
pub const READERS: &[&dyn SceneReader] = &[
    &PbrtReader,
    &GltfReader,
    &ObjReader,
    &PlyReader,
    &StlReader,
];

/// Options of [`read_any`] for all formats.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct AnyOptions {
    /// Options of the pbrt reader.
    pub scene: ReadOptions,
    /// Options of the model readers (glTF, OBJ, PLY, STL).
    pub model: ModelOptions,
}

impl AnyOptions {
    /// Replaces the options of the pbrt reader.
    pub fn with_scene(mut self, scene: ReadOptions) -> Self {
        self.scene = scene;
        self
    }

    /// Replaces the options of the model readers (glTF, OBJ, PLY, STL).
    pub fn with_model(mut self, model: ModelOptions) -> Self {
        self.model = model;
        self
    }
}

/// Reads a scene (pbrt, glTF) or a model (OBJ, PLY, STL) from disk.
///
/// The content decides on the format, whatever the file is called. If it doesn't show the format, the extension decides, in
/// upper or lower case.
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
    let content = files.read(path).map_err(|e| unreadable(source(), &e))?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let by_content = READERS.iter().find(|reader| reader.recognizes(&content));
    let refusal = || foreign::by_content(&content).map(|advice| ReadError::invalid(source(), advice));
    let by_name = || READERS.iter().find(|reader| reader.extensions().contains(&&*extension));
    let reader = match by_content {
        Some(reader) => reader,
        None => match refusal() {
            Some(refusal) => return Err(refusal),
            None => by_name().ok_or_else(|| ReadError::invalid(source(), foreign::by_extension(&extension)))?,
        },
    };
    reader.read(&Opened { files, path, content: RefCell::new(Some(content)) }, path, options)
}

/// Files of which one has been read already.
struct Opened<'f> {
    files: &'f dyn Files,
    path: &'f Path,
    content: RefCell<Option<Vec<u8>>>,
}

impl Files for Opened<'_> {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let opened = if path == self.path { self.content.take() } else { None };
        opened.map_or_else(|| self.files.read(path), Ok)
    }
}

/// The first word of a text, after empty lines and `#` comments. Only the first 64 KiB count.
pub(crate) fn first_word(content: &[u8]) -> Option<&[u8]> {
    let head = &content[..content.len().min(1 << 16)];
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    let mut lines = head.split(|byte| matches!(byte, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"#"))?;
    first.split(|byte| byte.is_ascii_whitespace() || matches!(byte, b'"' | b'[')).next()
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
