//! Files that hold a render's state: a `dapple_core` container, and in it a header with the settings of the render.

use dapple_core::container::{Fault, append, sections};
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};

/// The name of each section of traced rows. A section holds consecutive rows; sections follow in the order of tracing.
pub const ROWS: &str = "rows";
/// The name of the section that holds the header. It follows the sections of the state.
const HEADER: &str = "header";

/// The kind of a state file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StateKind {
    /// The state of a render, from which it resumes.
    Checkpoint,
    /// The state of a render with a planned stage.
    Plan,
    /// Traced rows of a stage.
    Rows,
}

impl StateKind {
    /// The name of the kind in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Checkpoint => "checkpoint",
            Self::Plan => "plan",
            Self::Rows => "part",
        }
    }
}

/// The settings on which a file depends, as pairs of name and value.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    pairs: Vec<(String, String)>,
}

impl Identity {
    /// An identity of these pairs of name and value.
    pub fn new<N: Into<String>, V: Into<String>>(pairs: impl IntoIterator<Item = (N, V)>) -> Self {
        Self { pairs: pairs.into_iter().map(|(name, value)| (name.into(), value.into())).collect() }
    }

    /// The pairs of name and value.
    pub fn pairs(&self) -> &[(String, String)] {
        &self.pairs
    }

    /// The value of the pair called `name`; `None` if there is no such pair.
    pub fn value(&self, name: &str) -> Option<&str> {
        self.pairs.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// The differing settings, each as `NAME: VALUE IN THERE, not VALUE IN SELF`, with `none` for a missing value.
    pub fn differences(&self, there: &Self) -> Vec<String> {
        let none = "none";
        let known = self.pairs.iter().map(|(name, here)| (name, there.value(name).unwrap_or(none), here.as_str()));
        let unknown = there.pairs.iter().filter(|(name, _)| self.value(name).is_none());
        let unknown = unknown.map(|(name, there)| (name, there.as_str(), none));
        let differ = known.filter(|(_, there, here)| there != here).chain(unknown);
        differ.map(|(name, there, here)| format!("{name}: {there}, not {here}")).collect()
    }
}

#[derive(Serialize, Deserialize)]
struct Header {
    kind: StateKind,
    identity: Identity,
}

/// The contents of a state file: the encoded state of a render, and the header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StateFile {
    /// The kind of the file.
    pub kind: StateKind,
    /// The settings that the state depends on.
    pub identity: Identity,
    bytes: Vec<u8>,
}

/// The reason why a file is not a usable state file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateDamage {
    /// A fault of the container.
    Container(Fault),
    /// A file whose header cannot be parsed.
    Nonsense,
    /// A file of another kind.
    Kind,
}

impl StateDamage {
    /// The message about the fault, and the remedy.
    const fn words(self) -> [&'static str; 2] {
        const RESTORE: &str = "restore the file from a copy, or render again";
        const NAME: &str = "check the name of the file";
        match self {
            Self::Container(Fault::Short) => ["the file is truncated", RESTORE],
            Self::Container(Fault::Foreign) => ["the file is not a Dapple file", NAME],
            Self::Container(Fault::Version) => {
                ["another version of Dapple wrote the file", "finish the render with that version, or render again"]
            }
            Self::Container(_) => ["the file is damaged (a checksum is wrong)", RESTORE],
            Self::Nonsense => ["the header of the file cannot be read", RESTORE],
            Self::Kind => ["the file is a checkpoint, a plan or a part, but not of the kind needed here", NAME],
        }
    }
}

impl std::fmt::Display for StateDamage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.words()[0])
    }
}

impl StateFile {
    /// Appends a header to `state`, the state of a render as `dapple_core` encodes it.
    pub fn new(kind: StateKind, identity: Identity, mut state: Vec<u8>) -> Self {
        let header = Header { kind, identity };
        let json = serde_json::to_vec(&header).unwrap_or_default();
        append(&mut state, HEADER, &json);
        Self { kind, identity: header.identity, bytes: state }
    }

    /// The bytes of the file. `dapple_core` can decode them as a state: it ignores the header.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The bytes of the file, without a copy.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// The encoded traced rows in the file, in tracing order. Each item holds consecutive rows.
    pub fn rows(&self) -> impl Iterator<Item = &[u8]> {
        let found = sections(&self.bytes).unwrap_or_default();
        found.into_iter().filter(|(name, _)| *name == ROWS).map(|(_, section)| section)
    }

    /// Parses the bytes of a file.
    ///
    /// # Errors
    ///
    /// [`StateDamage`] for bytes that are not a state with a header.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, StateDamage> {
        let found = sections(&bytes).map_err(StateDamage::Container)?;
        // The header comes last, so that a file without one is cut short.
        let (_, json) = found.last().filter(|(name, _)| *name == HEADER).ok_or(StateDamage::Container(Fault::Short))?;
        let Header { kind, identity } = serde_json::from_slice(json).map_err(|_| StateDamage::Nonsense)?;
        Ok(Self { kind, identity, bytes })
    }

    /// Reads the file at `path`, which must be of this `kind`.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] without a file, [`Error::Damaged`] for another kind or a damaged file, otherwise [`Error::Read`].
    pub fn read(path: &Path, kind: StateKind) -> Result<Self, Error> {
        let read = || match std::fs::metadata(path)?.is_file() {
            true => std::fs::read(path),
            false => Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")),
        };
        let bytes = read().map_err(|source| match source.kind() {
            io::ErrorKind::NotFound => Error::Missing { path: path.to_owned(), kind: kind.name() },
            _ => Error::Read { path: path.to_owned(), source },
        })?;
        let damaged = |damage| Error::Damaged { path: path.to_owned(), damage };
        let file = Self::from_bytes(bytes).map_err(damaged)?;
        if file.kind == kind { Ok(file) } else { Err(damaged(StateDamage::Kind)) }
    }
}

/// An error of writing or reading a checkpoint or part file. Each message names the file and the remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A failed step of writing a file. A file of that name then has all of its old or all of its new contents.
    #[error("{}: cannot {step}: {source} (an existing file of that name is not damaged); free disk space, or choose another folder", path.display())]
    Write {
        /// The path of the file that was to be written.
        path: PathBuf,
        /// The step that failed, as a verb phrase.
        step: &'static str,
        /// The operating system's error.
        source: io::Error,
    },
    /// A file that another process is writing.
    #[error("{}: another process is writing to this file; wait until that process ends, or choose another file", path.display())]
    InUse {
        /// The path of the file that another process is writing.
        path: PathBuf,
    },
    /// A missing file.
    #[error("{}: there is no such file; check the name of the {kind}", path.display())]
    Missing {
        /// The path of the missing file.
        path: PathBuf,
        /// The name of the file's kind: `checkpoint`, `plan` or `part`.
        kind: &'static str,
    },
    /// A file that cannot be read.
    #[error("{}: cannot read the file: {source}; check that it is a readable file", path.display())]
    Read {
        /// The path of the file that cannot be read.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// A damaged file, or a file of another kind than requested.
    #[error("{}: {damage}; {}", path.display(), damage.words()[1])]
    Damaged {
        /// The path of the damaged file.
        path: PathBuf,
        /// The damage that was found.
        damage: StateDamage,
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
