//! Errors of readers.

use crate::Source;
use std::fmt;

/// The kind of a problem, which decides on the remedy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ProblemKind {
    /// The file is wrong or unreadable.
    Invalid,
    /// The file is valid and uses a feature that Dapple lacks;
    /// [`allow_unsupported`](crate::pbrt::ReadOptions::allow_unsupported) leaves it out.
    Unsupported,
}

/// One problem of a scene file.
///
/// Shown as `FILE:LINE: message`; an unsupported feature is followed by advice. A program that advises in its own terms
/// formats [`source`](Self::source) and [`message`](Self::message) by [`kind`](Self::kind).
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Problem {
    /// File and line.
    pub source: Source,
    /// The kind of problem.
    pub kind: ProblemKind,
    /// One sentence: the mistake and its remedy, or the name of the unsupported feature.
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

/// All problems of a scene file, in the order found, one per line.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadError {
    /// The first 100 problems; never empty.
    pub problems: Vec<Problem>,
    /// Number of further problems, not listed.
    pub more: usize,
}

impl ReadError {
    /// Makes an error of one problem of kind [`ProblemKind::Invalid`].
    pub(crate) fn invalid(source: Source, message: impl Into<String>) -> Self {
        let problem = Problem { source, kind: ProblemKind::Invalid, message: message.into() };
        Self { problems: vec![problem], more: 0 }
    }

    /// Returns true if every listed problem is an unsupported feature, so that `allow_unsupported` helps.
    pub fn is_unsupported(&self) -> bool {
        self.problems.iter().all(|p| p.kind == ProblemKind::Unsupported)
    }
}

impl std::error::Error for ReadError {}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.problems.iter().enumerate() {
            write!(f, "{}{problem}", if i == 0 { "" } else { "\n" })?;
        }
        if self.more > 0 {
            write!(f, "\n… and {} more problems", self.more)?;
        }
        Ok(())
    }
}
