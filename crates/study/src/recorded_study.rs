//! Reading of a study from its folder.

use crate::record::{Manifest, Method, Run, RunBudget};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// An error of reading a study. Each message names the remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// A file that cannot be read.
    #[error("{}: cannot be read: {source}; pass the folder that `dapple study -o` wrote to", path.display())]
    Read {
        /// The path of the file that cannot be read.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// A line of `runs.jsonl`, or of `study.json`, that cannot be parsed. An incomplete last line of `runs.jsonl` is no
    /// error.
    #[error("{}:{line}: not a record of a study: {source}; correct or remove the line", path.display())]
    Malformed {
        /// The path of the file.
        path: PathBuf,
        /// The number of the line, from 1.
        line: usize,
        /// The error of parsing the line.
        source: serde_json::Error,
    },
    /// A `study.json` whose baseline is not one of its methods.
    #[error("{}: the baseline is not one of the methods; add it to them", path.display())]
    Baseline {
        /// The path of `study.json`.
        path: PathBuf,
    },
}

/// A study read back: its manifest and its finished runs.
///
/// ```no_run
/// let study = dapple_study::RecordedStudy::read("results".as_ref())?;
/// println!("{} of {} runs", study.runs.len(), study.expected());
/// # Ok::<(), dapple_study::FolderError>(())
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RecordedStudy {
    /// The study's folder.
    pub folder: PathBuf,
    /// The contents of `study.json`.
    pub manifest: Manifest,
    /// The finished runs, in the order of the lines of `runs.jsonl`. If several lines have the same scene, method,
    /// budget and seed, only the last one counts.
    pub runs: Vec<Run>,
    /// The number of lines of `runs.jsonl` that were skipped because their scene, method, budget or seed is not in the
    /// manifest.
    pub foreign: usize,
    /// The number of lines of `runs.jsonl` that were skipped because a later line is the same run.
    pub repeated: usize,
    /// True if the last line of `runs.jsonl` was skipped because it is incomplete, as after a full disk.
    pub torn: bool,
}

impl RecordedStudy {
    /// Reads `study.json` and `runs.jsonl`; a study without runs is not an error.
    ///
    /// # Errors
    /// [`FolderError`], which names the file and, for invalid contents, the line.
    pub fn read(folder: &Path) -> Result<Self, FolderError> {
        let path = folder.join("study.json");
        let manifest: Manifest = serde_json::from_slice(&read(&path)?).map_err(|source| FolderError::Malformed {
            path: path.clone(),
            line: source.line(),
            source,
        })?;
        if !manifest.methods.contains(&manifest.baseline) {
            return Err(FolderError::Baseline { path });
        }
        let path = folder.join("runs.jsonl");
        let bytes = match read(&path) {
            Err(FolderError::Read { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            other => other?,
        };
        let (lines, torn) = lines(&path, &bytes)?;
        let total = lines.len();
        let planned: Vec<Run> = lines.into_iter().filter(|run| plans(&manifest, run)).collect();
        let foreign = total - planned.len();
        let last: BTreeMap<_, _> = planned.iter().enumerate().map(|(i, run)| (identity(run), i)).collect();
        let repeated = planned.len() - last.len();
        let mut kept: Vec<usize> = last.into_values().collect();
        kept.sort_unstable();
        let runs = kept.into_iter().map(|i| planned[i].clone()).collect();
        Ok(Self { folder: folder.to_owned(), manifest, runs, foreign, repeated, torn })
    }

    /// The number of planned runs. Equal-time runs of the baseline are not counted if other methods have equal-time
    /// runs and the baseline has none: its runs at that spp replace them.
    pub fn expected(&self) -> usize {
        let m = &self.manifest;
        let timed = |own: bool| {
            let of_time = |run: &Run| matches!(run.budget, RunBudget::TimeOf(_)) && (run.method == m.baseline) == own;
            self.runs.iter().any(of_time)
        };
        let without = usize::from(timed(false) && !timed(true));
        let of_time = if m.time_of.is_some() { m.methods.len() - without } else { 0 };
        m.scenes.len() * m.seeds.len() * (m.methods.len() * m.spp.len() + of_time)
    }
}

fn read(path: &Path) -> Result<Vec<u8>, FolderError> {
    std::fs::read(path).map_err(|source| FolderError::Read { path: path.to_owned(), source })
}

/// Parses the runs line by line. Also returns `true` if the last line was incomplete.
fn lines(path: &Path, bytes: &[u8]) -> Result<(Vec<Run>, bool), FolderError> {
    let mut runs = Vec::new();
    let whole = bytes.is_empty() || bytes.ends_with(b"\n");
    let mut rest = bytes.split(|&b| b == b'\n').enumerate().peekable();
    while let Some((index, line)) = rest.next() {
        if line.trim_ascii().is_empty() {
            continue;
        }
        match serde_json::from_slice(line) {
            Ok(run) => runs.push(run),
            Err(_) if rest.peek().is_none() && !whole => return Ok((runs, true)),
            Err(source) => return Err(FolderError::Malformed { path: path.to_owned(), line: index + 1, source }),
        }
    }
    Ok((runs, false))
}

fn plans(manifest: &Manifest, run: &Run) -> bool {
    let budget = match run.budget {
        RunBudget::Spp(spp) => manifest.spp.contains(&spp),
        RunBudget::TimeOf(spp) => manifest.time_of == Some(spp),
    };
    budget
        && manifest.scenes.iter().any(|scene| scene.name == run.scene)
        && manifest.methods.contains(&run.method)
        && manifest.seeds.contains(&run.seed)
}

fn identity(run: &Run) -> (String, Method, (bool, u64), u64) {
    let budget = match run.budget {
        RunBudget::Spp(spp) => (false, spp),
        RunBudget::TimeOf(spp) => (true, spp),
    };
    (run.scene.clone(), run.method.clone(), budget, run.seed)
}
