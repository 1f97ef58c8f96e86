//! The report of a study: `report.html`, `summary.csv`, `summary.md` and `plots`.

mod colour_scale;
mod comparison_table;
mod gallery;
mod html;
mod latex;
mod log_log_chart;
mod markdown;
mod method_style;
mod notebook;
mod plots;
mod provenance;
mod scene_images;
mod table_cell;
mod tidy_csv;
mod viewer_folder;

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
    #[error("summary.csv or runs.csv: {0}")]
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
/// | `runs.csv` | every run as a line, with CPU seconds |
/// | `notebook.ipynb` | a notebook that reads `runs.jsonl` and plots error against time |
/// | `latex/` | tables (booktabs) and curves (pgfplots); `study.tex` has all of them |
/// | `viewer/` | images named by method, with the reference, for tev and JERI |
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
    let (page, pictures) = html::render(&recorded, &summary)?;
    write_file(&folder.join("summary.csv"), &table)?;
    write_file(&folder.join("report.html"), page.as_bytes())?;
    write_file(&folder.join("summary.md"), markdown::render(&recorded, &summary).as_bytes())?;
    write_file(&folder.join("runs.csv"), &tidy_csv::render(&recorded)?)?;
    write_file(&folder.join("notebook.ipynb"), notebook::render(&recorded).as_bytes())?;
    write_all(&folder.join("plots"), plots::plots(&recorded, &summary))?;
    write_all(&folder.join("latex"), latex::render(&recorded, &summary))?;
    write_all(folder, pictures)?;
    viewer_folder::write(&recorded)?;
    Ok(summary)
}

/// Writes files into a folder, and makes the folders of their names.
fn write_all(folder: &Path, files: Vec<(String, impl AsRef<[u8]>)>) -> Result<(), ImageError> {
    for (name, contents) in files {
        let file = folder.join(name);
        // If this fails, writing the file fails too, with a clear error.
        let _ = file.parent().map(std::fs::create_dir_all);
        write_file(&file, contents.as_ref())?;
    }
    Ok(())
}
