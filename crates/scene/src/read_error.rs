//! Errors of scene and model readers.

use crate::Source;
use std::fmt;

/// The kind of a problem in a scene file, which decides on the remedy.
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
/// Displayed as `FILE:LINE: message`; advice follows for an unsupported feature. A program that gives its own advice
/// formats [`source`](Self::source) and [`message`](Self::message) by [`kind`](Self::kind).
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
