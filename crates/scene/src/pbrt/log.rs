//! The problems and notices of a pbrt scene.

use crate::scene_reader::{Problem, ProblemKind, ReadError};
use crate::{Notice, NoticeKind, Source};
use std::collections::BTreeMap;

/// The largest number of problems that an error lists; further problems are only counted.
const LISTED_PROBLEMS: usize = 100;
/// The largest number of notices in a scene; further notices are only counted.
const LISTED_NOTICES: usize = 1000;

/// The problems and notices collected while a pbrt scene is read.
#[derive(Debug, Default)]
pub(super) struct Log {
    problems: Vec<Problem>,
    more: usize,
    /// The listed notices, each with the number of its repetitions.
    notices: Vec<(Notice, usize)>,
    /// The index in `notices` of each message.
    said: BTreeMap<String, usize>,
    more_notices: usize,
    pub(super) allow_unsupported: bool,
}

impl Log {
    pub(super) fn problem(&mut self, source: &Source, message: impl Into<String>) {
        self.push(source, ProblemKind::Invalid, message.into());
    }

    fn push(&mut self, source: &Source, kind: ProblemKind, message: String) {
        if self.problems.len() < LISTED_PROBLEMS {
            self.problems.push(Problem { source: source.clone(), kind, message });
        } else {
            self.more += 1;
        }
    }

    pub(super) fn notice(&mut self, source: &Source, message: impl Into<String>) {
        self.push_notice(Notice::warning(source.clone(), message));
    }

    /// Adds a notice of an ignored setting, such as a sampler, which the user of Dapple chooses.
    pub(super) fn ignored_setting(&mut self, source: &Source, message: String) {
        self.push_notice(Notice { source: source.clone(), kind: NoticeKind::IgnoredSetting, message });
    }

    /// Adds a notice. Of notices with the same message only the first is listed, and the others are counted.
    fn push_notice(&mut self, notice: Notice) {
        if let Some(&first) = self.said.get(&notice.message) {
            self.notices[first].1 += 1;
        } else if self.notices.len() < LISTED_NOTICES {
            self.said.insert(notice.message.clone(), self.notices.len());
            self.notices.push((notice, 0));
        } else {
            self.more_notices += 1;
        }
    }

    /// Reports a valid but unsupported feature: as a notice if unsupported features may be left out, else as a problem.
    pub(super) fn unsupported(&mut self, source: &Source, what: &str) {
        if self.allow_unsupported {
            self.notice(source, format!("{what} is not supported; left out"));
        } else {
            self.push(source, ProblemKind::Unsupported, format!("{what} is not supported"));
        }
    }

    pub(super) fn has_problems(&self) -> bool {
        !self.problems.is_empty()
    }

    pub(super) fn finish(mut self) -> Result<Vec<Notice>, ReadError> {
        if self.has_problems() {
            return Err(ReadError { problems: self.problems, more: self.more });
        }
        if let (Some((last, _)), more @ 1..) = (self.notices.last(), self.more_notices) {
            let source = last.source.clone();
            self.notices.push((Notice::warning(source, format!("{more} more notices are not listed")), 0));
        }
        let counted = |(notice, count): (Notice, usize)| match count {
            0 => notice,
            _ => Notice { message: notice.message + &format!(" (and {count} more times)"), ..notice },
        };
        Ok(self.notices.into_iter().map(counted).collect())
    }
}
