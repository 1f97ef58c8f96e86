//! What a reader has to say: problems, notices, and the error that holds all problems at once.

use crate::{Notice, Source};
use std::fmt;

/// Problems that are listed; more are only counted.
const LISTED_PROBLEMS: usize = 100;
/// Notices that are listed; more are only counted.
const LISTED_NOTICES: usize = 1000;

/// One thing wrong with a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Where.
    pub source: Source,
    /// What, and what to do about it.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.source, self.message)
    }
}

/// Everything wrong with a scene, in the order found.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadError {
    /// The first hundred problems; never empty.
    pub problems: Vec<Problem>,
    /// How many more there are.
    pub more: usize,
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

/// Collects what a reader has to say.
#[derive(Debug, Default)]
pub(super) struct Log {
    problems: Vec<Problem>,
    more: usize,
    notices: Vec<Notice>,
    more_notices: usize,
    allow_unsupported: bool,
}

impl Log {
    pub(super) fn new(allow_unsupported: bool) -> Self {
        Self { allow_unsupported, ..Self::default() }
    }

    pub(super) fn problem(&mut self, source: &Source, message: impl Into<String>) {
        if self.problems.len() < LISTED_PROBLEMS {
            self.problems.push(Problem { source: source.clone(), message: message.into() });
        } else {
            self.more += 1;
        }
    }

    pub(super) fn notice(&mut self, source: &Source, message: impl Into<String>) {
        if self.notices.len() < LISTED_NOTICES {
            self.notices.push(Notice { source: source.clone(), message: message.into() });
        } else {
            self.more_notices += 1;
        }
    }

    /// Something that the file may well say but the renderer cannot do.
    pub(super) fn unsupported(&mut self, source: &Source, what: &str) {
        if self.allow_unsupported {
            self.notice(source, format!("{what} is not supported: left out"));
        } else {
            self.problem(source, format!("{what} is not supported: remove it, or allow unsupported directives"));
        }
    }

    pub(super) fn has_problems(&self) -> bool {
        !self.problems.is_empty()
    }

    pub(super) fn finish(mut self) -> Result<Vec<Notice>, ReadError> {
        if self.has_problems() {
            return Err(ReadError { problems: self.problems, more: self.more });
        }
        if let (Some(last), more @ 1..) = (self.notices.last(), self.more_notices) {
            let source = last.source.clone();
            self.notices.push(Notice { source, message: format!("{more} more notices are not listed") });
        }
        Ok(self.notices)
    }
}

/// `: did you mean …?` where one of `known` is close to `word`.
pub(super) fn suggestion<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    // Words that only noise could make are not worth the time.
    if word.len() > 64 {
        return None;
    }
    let most = 1 + word.chars().count() / 4;
    known.into_iter().map(|k| (edit_distance(word, k), k)).filter(|&(d, _)| d <= most.min(3)).min().map(|(_, k)| k)
}

/// Insertions, deletions and replacements of ASCII-case-folded characters that turn `a` into `b`.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().map(|c| c.to_ascii_lowercase()).collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().map(|c| c.to_ascii_lowercase()).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_suggestions() {
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("Fov", "fov"), 0);
        assert_eq!(suggestion("fob", ["radius", "fov"]), Some("fov"));
        assert_eq!(suggestion("zzz", ["radius", "fov"]), None);
    }
}
