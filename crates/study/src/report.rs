//! The report of a study: `report.html`, `summary.csv`, `summary.md` and `plots`.

mod comparison_table;
mod gallery;
mod html;
mod log_log_chart;
mod markdown;
mod method_style;
mod plots;
mod table_cell;

use crate::recorded_study::{FolderError, RecordedStudy};
use crate::summary::Summary;
use dapple_scene::image::{ImageError, write_file};
use std::path::Path;

/// An error of writing a report. Each message names the remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The study cannot be read.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// An error of the CSV writer.
    #[error("summary.csv: {0}")]
    Csv(#[from] csv::Error),
    /// An error of the HTML template.
    #[error("report.html: {0}")]
    Page(#[from] askama::Error),
    /// A file cannot be written; an existing file of that name is unchanged.
    #[error(transparent)]
    Write(#[from] ImageError),
}

/// Reads a study, finished or not, and writes its report into the same folder.
///
/// | file | contents |
/// |---|---|
/// | `report.html` | the report: one file that needs neither network nor folder |
/// | `summary.csv` | every value of the report |
/// | `summary.md` | the tables as Markdown |
/// | `plots/SCENE.svg` | error against time |
///
/// Each file is written completely or not at all. Equal records give equal bytes.
///
/// # Errors
/// [`ReportError`] if the study cannot be read or a file cannot be written. Missing or broken images are no error; the
/// report lists them.
pub fn write_report(folder: &Path) -> Result<Summary, ReportError> {
    let recorded = RecordedStudy::read(folder)?;
    let summary = Summary::of(&recorded);
    let mut table = Vec::new();
    summary.write_csv(&mut table)?;
    let page = html::render(&recorded, &summary)?;
    write_file(&folder.join("summary.csv"), &table)?;
    write_file(&folder.join("report.html"), page.as_bytes())?;
    write_file(&folder.join("summary.md"), markdown::render(&recorded, &summary).as_bytes())?;
    // If this fails, writing the first plot fails too, with a clear error.
    let _ = std::fs::create_dir_all(folder.join("plots"));
    for (name, plot) in plots::plots(&recorded, &summary) {
        write_file(&folder.join("plots").join(name), plot.as_bytes())?;
    }
    Ok(summary)
}
