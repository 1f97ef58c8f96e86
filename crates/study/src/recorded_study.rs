//! A study's folder, read back.

use crate::record::{Manifest, Method, Run, RunBudget};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Why a folder gives no report. Each message says what to do.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// A file that cannot be read.
    #[error("cannot read {}: {source}; give the folder that `dapple study -o` wrote to", path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// A line that is no record. The last one, if cut off, is not counted as such.
    #[error("{} line {line} is no record of a study: {source}; mend or remove the line", path.display())]
    Malformed {
        /// Which file.
        path: PathBuf,
        /// Which line, from 1.
        line: usize,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// A manifest that contradicts itself.
    #[error("{} names a baseline that is none of its methods: add it to them", path.display())]
    Baseline {
        /// Which file.
        path: PathBuf,
    },
}

/// What was planned, and what of it was done.
#[derive(Clone, Debug)]
pub struct RecordedStudy {
    /// Where it lies.
    pub folder: PathBuf,
    /// `study.json`.
    pub manifest: Manifest,
    /// `runs.jsonl`, in the order of its lines; of runs made twice the last one.
    pub runs: Vec<Run>,
    /// Lines left out: of scenes, methods, budgets or seeds that the manifest does not have.
    pub foreign: usize,
    /// Lines left out since a later one made the same run.
    pub repeated: usize,
    /// Whether the last line was cut off, as a full disk leaves it, and left out.
    pub torn: bool,
}

impl RecordedStudy {
    /// Reads `study.json` and `runs.jsonl`; no runs yet is no error.
    ///
    /// # Errors
    /// [`FolderError`], which names the file and the line.
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

    /// How many runs the manifest plans. A baseline whose equal-time runs were left out, since its samples are that
    /// time, is not asked for them.
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

/// Runs line by line, and whether the last line was cut off.
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
