//! What can go wrong between a plan and its last run.

use std::path::{Path, PathBuf};

/// Why a study cannot be planned, begun or continued. Each message says what to do.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// Something in the plan.
    #[error(transparent)]
    Plan(#[from] crate::PlanError),
    /// A scene that cannot be read or built.
    #[error("{0}")]
    Scene(String),
    /// A reference that is not of this scene, at this size, with these settings; or that cannot be read.
    #[error("{file}: not a reference for {scene}: {why}", file = file.display())]
    Reference {
        /// The file.
        file: PathBuf,
        /// The scene's name.
        scene: String,
        /// The difference, and what to do.
        why: String,
    },
    /// The folder holds another study.
    #[error(
        "{}: the folder holds another study; choose another folder, or give the words of the one that is there\n{}",
        folder.display(), differences.join("\n")
    )]
    AnotherStudy {
        /// The study's folder.
        folder: PathBuf,
        /// One for each setting that differs.
        differences: Vec<String>,
    },
    /// Somebody else is at work in the folder.
    #[error("{}: another process is at work on the study in this folder: wait for it, or choose another folder", folder.display())]
    Busy {
        /// The study's folder.
        folder: PathBuf,
    },
    /// A line that is no finished run.
    #[error("{}:{line}: {why}; remove the line to have that run made again", file.display())]
    Line {
        /// `runs.jsonl`.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// What is wrong with it.
        why: String,
    },
    /// A file or folder that cannot be read or written.
    #[error("{}: cannot {action}: {source}; {kept}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// What is still there and what to do.
        kept: String,
        /// The system's words.
        source: std::io::Error,
    },
    /// An image file that cannot be read or written.
    #[error(transparent)]
    Image(#[from] dapple_scene::image::ImageError),
    /// A run that failed.
    #[error("{what}: {why}")]
    Run {
        /// Which.
        what: String,
        /// What went wrong.
        why: String,
    },
}

impl StudyError {
    pub(crate) fn file(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        let kept = match source.kind() {
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => "free some space and try again",
            std::io::ErrorKind::NotFound => "is the name right?",
            std::io::ErrorKind::PermissionDenied => "choose another path, or change the permissions",
            _ => "choose another path, or try again",
        };
        Self::File { path: path.to_owned(), action, kept: kept.to_owned(), source }
    }
}
