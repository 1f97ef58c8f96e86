//! The files of a render's state: the core's container with a header of the settings that the state belongs to.

use super::Error;
use dapple_core::container::{Fault, append, sections};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The sections that traced runs of rows are, in the order of tracing.
pub const ROWS: &str = "rows";
/// The section that the header is, after those of the state.
const HEADER: &str = "header";

/// The kind of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// The state of a render, from which it resumes.
    Checkpoint,
    /// The state of a render with a planned stage.
    Plan,
    /// Traced rows of a stage.
    Rows,
}

impl Kind {
    /// The kind in words.
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

    /// The value of this name.
    pub fn value(&self, name: &str) -> Option<&str> {
        self.pairs.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// The settings that `there` has otherwise, one phrase each.
    pub fn differences(&self, there: &Self) -> Vec<String> {
        let nothing = "none";
        let mut differ = Vec::new();
        for (name, here) in &self.pairs {
            let there = there.value(name).unwrap_or(nothing);
            if there != here {
                differ.push(format!("{name}: {there}, not {here}"));
            }
        }
        let unknown = there.pairs.iter().filter(|(name, _)| self.value(name).is_none());
        differ.extend(unknown.map(|(name, there)| format!("{name}: {there}, not {nothing}")));
        differ
    }
}

#[derive(Serialize, Deserialize)]
struct Header {
    kind: Kind,
    identity: Identity,
}

/// A state of a render with its header, as a file holds it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StateFile {
    /// The kind of the file.
    pub kind: Kind,
    /// The settings that the state depends on.
    pub identity: Identity,
    bytes: Vec<u8>,
}

/// The reason why a file holds no such state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// A fault of the container.
    Container(Fault),
    /// A file without a header that can be read.
    Nonsense,
    /// A file of another kind.
    Kind,
}

impl std::fmt::Display for Damage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Container(Fault::Short) => "it is cut short",
            Self::Container(Fault::Foreign) => "it is not a file of Dapple's",
            Self::Container(Fault::Version) => "another version of Dapple wrote it",
            Self::Container(_) => "it is damaged (its checksum is wrong)",
            Self::Nonsense => "its contents make no sense",
            Self::Kind => "it is of another kind: checkpoints, plans and parts are not the same",
        })
    }
}

impl Damage {
    pub(crate) fn remedy(self) -> &'static str {
        match self {
            Self::Container(Fault::Foreign) | Self::Kind => "check the name of the file",
            Self::Container(Fault::Version) => "finish it with that version, or render it again",
            _ => "restore it from a copy, or render it again",
        }
    }
}

impl StateFile {
    /// Gives a state, as the core writes it, a header.
    pub fn new(kind: Kind, identity: Identity, mut state: Vec<u8>) -> Self {
        let header = Header { kind, identity };
        let json = serde_json::to_vec(&header).unwrap_or_default();
        append(&mut state, HEADER, &json);
        Self { kind, identity: header.identity, bytes: state }
    }

    /// The bytes of the file, which the core reads as well.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The bytes of the file, without a copy.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// The traced runs of rows in it.
    pub fn rows(&self) -> impl Iterator<Item = &[u8]> {
        let found = sections(&self.bytes).unwrap_or_default();
        found.into_iter().filter(|(name, _)| *name == ROWS).map(|(_, section)| section)
    }

    /// Reads the bytes of a file.
    ///
    /// # Errors
    ///
    /// [`Damage`] for bytes that are no state with a header.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, Damage> {
        let found = sections(&bytes).map_err(Damage::Container)?;
        // The header comes last, so that a file without one is cut short.
        let (_, json) = found.last().filter(|(name, _)| *name == HEADER).ok_or(Damage::Container(Fault::Short))?;
        let Header { kind, identity } = serde_json::from_slice(json).map_err(|_| Damage::Nonsense)?;
        Ok(Self { kind, identity, bytes })
    }

    /// Reads a file of this kind.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`], [`Error::Read`], and [`Error::Damaged`] for another kind or a damaged file.
    pub fn read(path: &Path, kind: Kind) -> Result<Self, Error> {
        let read = || match std::fs::metadata(path)?.is_file() {
            true => std::fs::read(path),
            false => Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, "not a regular file")),
        };
        let bytes = read().map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => Error::Missing { path: path.to_owned(), kind: kind.name() },
            _ => Error::Read { path: path.to_owned(), source },
        })?;
        let damaged = |damage| Error::Damaged { path: path.to_owned(), damage };
        let file = Self::from_bytes(bytes).map_err(damaged)?;
        if file.kind == kind { Ok(file) } else { Err(damaged(Damage::Kind)) }
    }
}
