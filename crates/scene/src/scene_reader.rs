//! The type of a reader of scenes: its options, and its errors.

use crate::files::Files;
use crate::{Scene, Source};
use glam::DVec3;
use std::fmt;
use std::io::ErrorKind;
use std::path::Path;

/// A reader of one file format of scenes or models.
///
/// A new format is a value of this type in [`READERS`](crate::READERS).
pub struct SceneReader {
    /// The format's name, for messages.
    pub name: &'static str,
    /// The file name extensions of the format, in lower case without a dot. The empty string stands for files without
    /// an extension.
    pub extensions: &'static [&'static str],
    /// Returns true if the bytes of a file show that it has this format, whatever its name.
    pub recognizes: fn(&[u8]) -> bool,
    /// Reads a file and all files that it names as one scene, or returns all problems found, each with file and line.
    pub read: fn(&dyn Files, &Path, &AnyOptions) -> Result<Scene, ReadError>,
}

/// Options of [`read_any`](crate::read_any) for all formats.
#[derive(Clone, Debug, Default)]
pub struct AnyOptions {
    /// Options of the pbrt reader.
    pub scene: ReadOptions,
    /// Options of the model readers (glTF, OBJ, PLY, STL).
    pub model: ModelOptions,
}

/// Options of the pbrt reader.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// If true, unsupported features are left out with a notice: an unknown material becomes diffuse, an unknown texture grey;
    /// other unsupported objects are dropped. If false, unsupported features are errors.
    pub allow_unsupported: bool,
    /// The memory limit in bytes for all subdivision surfaces together: at most about 300 MB, which is also the limit for
    /// `None`. A surface beyond the limit is refused before memory is allocated.
    pub memory: Option<u64>,
}

/// The axis of a model file that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// +y is up; the front faces +z.
    Y,
    /// +z is up; the front faces -y.
    Z,
}

impl UpAxis {
    /// Returns three directions: to the front, to the right of a viewer in front, and up.
    pub(crate) fn axes(self) -> (DVec3, DVec3, DVec3) {
        match self {
            Self::Y => (DVec3::Z, DVec3::X, DVec3::Y),
            Self::Z => (DVec3::NEG_Y, DVec3::X, DVec3::Z),
        }
    }
}

/// Options of the model readers.
#[derive(Clone, Copy, Debug, Default)]
pub struct ModelOptions {
    /// The axis that points up; `None` is y for OBJ and PLY files and z for STL files.
    pub up: Option<UpAxis>,
    /// Width over height of the image that the model should fill; `None` is 4:3.
    pub aspect: Option<f64>,
}

impl ModelOptions {
    /// The axis that points up, and the aspect ratio of the image. `up` is the default axis of the model's format.
    pub(crate) fn stage(&self, up: UpAxis) -> (UpAxis, Option<f64>) {
        (self.up.unwrap_or(up), self.aspect)
    }
}

/// Makes the error of a file that cannot be opened.
pub(crate) fn unreadable(source: Source, e: &std::io::Error) -> ReadError {
    let message = cannot_read(&source.file, e);
    ReadError::invalid(source, message)
}

/// The message about a file that cannot be read, with a remedy that fits the system's error.
pub(crate) fn cannot_read(file: &Path, e: &std::io::Error) -> String {
    let advice = match e.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => "check the name and that the file is there",
        ErrorKind::OutOfMemory => "raise the limit, or use a smaller file",
        _ => "check that it is a readable file",
    };
    format!("cannot read {}: {e}; {advice}", file.display())
}

/// The kind of a problem in a scene file, which determines the remedy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ProblemKind {
    /// The file is invalid or unreadable.
    Invalid,
    /// The file is valid and uses a feature that Dapple lacks.
    /// [`allow_unsupported`](crate::pbrt::ReadOptions::allow_unsupported) leaves the feature out.
    Unsupported,
}

/// One problem of a scene file.
///
/// Displayed as `FILE:LINE: message`, followed by advice for an unsupported feature. To show other advice, display
/// [`source`](Self::source) and [`message`](Self::message), and choose the advice by [`kind`](Self::kind).
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Problem {
    /// The file and line of the problem.
    pub source: Source,
    /// The kind of problem: an invalid file or an unsupported feature.
    pub kind: ProblemKind,
    /// One sentence: the error and its remedy, or the name of the unsupported feature.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.source, self.message)?;
        match self.kind {
            ProblemKind::Invalid => Ok(()),
            ProblemKind::Unsupported => f.write_str("; remove it, or allow unsupported directives"),
        }
    }
}

/// All problems of a scene file, in the order found. Displayed with one problem per line.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadError {
    /// The first problems, at most 100; never empty.
    pub problems: Vec<Problem>,
    /// Number of further problems that are not listed.
    pub more: usize,
}

impl ReadError {
    /// Makes an error with one problem of kind [`ProblemKind::Invalid`].
    pub(crate) fn invalid(source: Source, message: impl Into<String>) -> Self {
        let problem = Problem { source, kind: ProblemKind::Invalid, message: message.into() };
        Self { problems: vec![problem], more: 0 }
    }
}

impl std::error::Error for ReadError {}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.problems.iter().enumerate() {
            write!(f, "{}{problem}", if i == 0 { "" } else { "\n" })?;
        }
        if self.more > 0 {
            write!(f, "\n… and {} more problem{}", self.more, if self.more == 1 { "" } else { "s" })?;
        }
        Ok(())
    }
}
