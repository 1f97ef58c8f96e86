//! Errors of a study.

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
    /// A scene that cannot be rendered as the plan describes: the message.
    #[error("{0}")]
    Scene(String),
    /// A reference image that cannot be read, or does not fit the study: another scene, size or setting.
    #[error("{file}: not a reference for {scene}: {why}", file = file.display())]
    Reference {
        /// The path of the reference image.
        file: PathBuf,
        /// The name of the reference's scene.
        scene: String,
        /// The problem with the reference, and the remedy.
        why: String,
    },
    /// A folder that already holds a study with other settings.
    #[error(
        "{}: the folder holds another study; choose another folder, or use the settings of that study\n{}",
        folder.display(), differences.join("\n")
    )]
    AnotherStudy {
        /// The study's folder.
        folder: PathBuf,
        /// The settings that differ, one line each.
        differences: Vec<String>,
    },
    /// A folder without a study.
    #[error("{}/study.json: there is no study; pass the folder that `dapple study -o` wrote to", folder.display())]
    NoStudy {
        /// The folder.
        folder: PathBuf,
    },
    /// A folder that another process is using.
    #[error("{}: another process is at work on the study in this folder; wait for it, or choose another folder", folder.display())]
    Busy {
        /// The study's folder.
        folder: PathBuf,
    },
    /// A line of `runs.jsonl` that is not a finished run, or a `study.json` that is not a study.
    #[error("{}:{line}: {why}; correct it, or remove the line to repeat that run", file.display())]
    Line {
        /// The path of the file.
        file: PathBuf,
        /// The number of the line, from 1.
        line: usize,
        /// The problem with the line.
        why: String,
    },
    /// A file or folder that cannot be read or written.
    #[error("{}: cannot {action}: {source}; {kept}", path.display())]
    File {
        /// The path of the file or folder.
        path: PathBuf,
        /// The action that failed, as a verb phrase.
        action: &'static str,
        /// A phrase about the files that are kept and the remedy.
        kept: String,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// An image file that cannot be read or written.
    #[error(transparent)]
    Image(#[from] dapple_scene::image::ImageError),
    /// An error of the CSV writer.
    #[error("summary.csv or runs.csv: {0}")]
    Csv(#[from] csv::Error),
    /// An error of the HTML template.
    #[error("report.html: {0}")]
    Page(#[from] askama::Error),
    /// A run that failed.
    #[error("{what}: {why}")]
    Run {
        /// The run: scene, method, seed and samples.
        what: String,
        /// The cause of the failure.
        why: String,
    },
}

impl StudyError {
    pub(crate) fn file(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        let kept = match source.kind() {
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => "free some space and try again",
            std::io::ErrorKind::NotFound | std::io::ErrorKind::FileTooLarge => "check the name",
            std::io::ErrorKind::PermissionDenied => "choose another path, or change the permissions",
            _ => "choose another path, or try again",
        };
        Self::File { path: path.to_owned(), action, kept: kept.to_owned(), source }
    }
}
