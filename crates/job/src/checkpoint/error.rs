//! What can go wrong with a file.

use super::Damage;
use std::io;
use std::path::PathBuf;

/// Why a file was not written or read. Each message names the file and says what to do.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A step of writing failed. The file that was there is as it was.
    #[error("{}: cannot {step}: {source}; what was there before is as it was. Free some space, or choose another place", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What was tried.
        step: &'static str,
        /// The system's words.
        source: io::Error,
    },
    /// Another process writes to it.
    #[error("{}: another process is writing to it; wait for its end, or choose another file", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// There is none.
    #[error("{}: there is no such {kind}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// What it should be.
        kind: &'static str,
    },
    /// The system does not give its bytes.
    #[error("{}: cannot read it: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: io::Error,
    },
    /// It is not whole, or not what it should be.
    #[error("{}: {damage}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        damage: Damage,
    },
    /// Neither generation can be used.
    #[error("{newer}; and {older}")]
    NoGeneration {
        /// What is wrong with the newer one.
        newer: Box<Error>,
        /// What is wrong with the one before.
        older: Box<Error>,
    },
    /// A text that cannot be stored.
    #[error("a text of {bytes} bytes is too long: {most} at most")]
    LongText {
        /// Its length.
        bytes: usize,
        /// The longest.
        most: usize,
    },
}
