//! Errors of checkpoint files.

use super::Damage;
use std::io;
use std::path::PathBuf;

/// An error of writing or reading a checkpoint or shard file. Each message names the file and the remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A step of writing a file that failed. An existing file of that name is unchanged.
    #[error("{}: cannot {step}: {source}; an existing file is unchanged; free some space, or choose another place", path.display())]
    Write {
        /// The path of the file that was to be written.
        path: PathBuf,
        /// The step that failed, as a verb phrase.
        step: &'static str,
        /// The operating system's error.
        source: io::Error,
    },
    /// A file that another process is writing.
    #[error("{}: another process is writing to it; wait for its end, or choose another file", path.display())]
    InUse {
        /// The path of the file that another process is writing.
        path: PathBuf,
    },
    /// A missing file.
    #[error("{}: there is no such file; check the name of the {kind}", path.display())]
    Missing {
        /// The path of the missing file.
        path: PathBuf,
        /// The name of the file's kind: `checkpoint` or `shard`.
        kind: &'static str,
    },
    /// A file that the system cannot read.
    #[error("{}: cannot read it: {source}", path.display())]
    Read {
        /// The path of the file that cannot be read.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// A damaged file, or a file of another kind than requested.
    #[error("{}: {damage}; {}", path.display(), damage.remedy())]
    Damaged {
        /// The path of the damaged file.
        path: PathBuf,
        /// The damage that was found.
        damage: Damage,
    },
    /// A file whose newest and previous versions are both unusable.
    #[error("{}; and {older}", newer.fault())]
    NoGeneration {
        /// The error of reading the file's newest version.
        newer: Box<Error>,
        /// The error of reading the file's previous version.
        older: Box<Error>,
    },
}

impl Error {
    /// The message without its remedy, for a fault that the caller works around.
    pub(crate) fn fault(&self) -> String {
        match self {
            Self::Damaged { path, damage } => format!("{}: {damage}", path.display()),
            other => other.to_string(),
        }
    }
}
