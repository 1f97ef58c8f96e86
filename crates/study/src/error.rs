//! Errors of a study.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// An error that stops a study. Each message names the remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// An error in the plan.
    #[error(transparent)]
    Plan(#[from] crate::PlanError),
    /// A scene that cannot be read or built.
    #[error(transparent)]
    Load(#[from] dapple_job::JobError),
    /// A scene, a reference, a run or a record that the study cannot use.
    #[error("{what}: {why}")]
    Refused {
        /// The name of the scene or run, or the path of the file, with a line number for an error in one line.
        what: String,
        /// The problem, and the remedy.
        why: String,
    },
    /// A file or folder that cannot be read or written.
    #[error("{}: cannot {action}: {source}; {kept}", path.display())]
    File {
        /// The path of the file or folder.
        path: PathBuf,
        /// The action that failed, as a verb phrase.
        action: &'static str,
        /// The remedy, and for `runs.jsonl` the number of runs that are kept.
        kept: String,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// An image file that cannot be read or written.
    #[error(transparent)]
    Image(#[from] dapple_scene::image::ImageError),
    /// An error of the CSV writer.
    #[error("summary.csv or runs.csv cannot be written: {0}; repeat the command")]
    Csv(#[from] csv::Error),
    /// An error of the HTML template.
    #[error("report.html cannot be written: {0}; repeat the command")]
    Page(#[from] askama::Error),
}

impl StudyError {
    pub(crate) fn refused(what: impl ToString, why: impl ToString) -> Self {
        Self::Refused { what: what.to_string(), why: why.to_string() }
    }

    /// The error about line `line` of `runs.jsonl` or `study.json`.
    pub(crate) fn line(file: &Path, line: usize, why: impl Display) -> Self {
        Self::refused(format_args!("{}:{line}", file.display()), why)
    }

    /// The error about a reference image of another scene, size or setting than the study's.
    pub(crate) fn reference(file: &Path, scene: &str, why: impl ToString) -> Self {
        Self::refused(format_args!("{}: not a reference for {scene}", file.display()), why)
    }

    pub(crate) fn file(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        let kept = match source.kind() {
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => "free disk space and try again",
            std::io::ErrorKind::NotFound | std::io::ErrorKind::FileTooLarge => "check the name",
            std::io::ErrorKind::PermissionDenied => "choose another path, or change the permissions",
            _ => "choose another path, or try again",
        };
        Self::File { path: path.to_owned(), action, kept: kept.to_owned(), source }
    }
}
