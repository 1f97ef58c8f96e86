//! `summary.csv`, `report.html`, and `summary.md` with `plots`: what a study found, to read, to show, and for other pages.

mod chart;
mod images;
mod markdown;
mod page;
mod plots;
mod style;
mod verdicts;
mod words;

use crate::folder::{FolderError, Recorded};
use crate::summary::Summary;
use dapple_scene::image::{ImageError, write_file};
use std::path::Path;

/// Why there is no report. Each message says what to do.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The study cannot be read.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The summary cannot be written down.
    #[error("summary.csv: {0}")]
    Csv(#[from] csv::Error),
    /// The page cannot be written down.
    #[error("report.html: {0}")]
    Page(#[from] askama::Error),
    /// A file cannot be written; an older one is left as it was.
    #[error(transparent)]
    Write(#[from] ImageError),
}

/// Reads a study's folder, finished or not, and writes `summary.csv` and `report.html` there, each whole or not at
/// all. The page is one file that needs nothing else, neither network nor the folder. For other people's pages there
/// are `summary.md`, its tables, and `plots/SCENE.svg`, its curves of error against time.
///
/// The same records give the same bytes.
///
/// # Errors
/// [`ReportError`]. Images that are missing or broken are no error: the page says so.
pub fn write_report(folder: &Path) -> Result<Summary, ReportError> {
    let recorded = Recorded::read(folder)?;
    let summary = Summary::of(&recorded);
    let mut table = Vec::new();
    summary.write_csv(&mut table)?;
    let page = page::render(&recorded, &summary)?;
    write_file(&folder.join("summary.csv"), &table)?;
    write_file(&folder.join("report.html"), page.as_bytes())?;
    write_file(&folder.join("summary.md"), markdown::render(&recorded, &summary).as_bytes())?;
    // If this fails, so does the first file there, and its error has a name.
    let _ = std::fs::create_dir_all(folder.join("plots"));
    for (name, plot) in plots::plots(&recorded, &summary) {
        write_file(&folder.join("plots").join(name), plot.as_bytes())?;
    }
    Ok(summary)
}
