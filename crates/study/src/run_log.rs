//! The file `runs.jsonl`: one complete line per finished run.

use crate::{Run, StudyError};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A store to which lines are appended, such as [`std::fs::File`]. A line is on the disk when `append` returns.
pub trait RunStore {
    /// Appends bytes and flushes them to the disk.
    ///
    /// # Errors
    ///
    /// The operating system's error; part of the bytes may be stored.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Truncates the store to `length` bytes.
    ///
    /// # Errors
    ///
    /// The operating system's error.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

impl RunStore for File {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.seek(SeekFrom::End(0))?;
        self.write_all(bytes)?;
        self.flush()?;
        self.sync_data()
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)?;
        self.sync_data()
    }
}

/// The finished runs of a study, in memory and on disk.
pub(crate) struct RunLog {
    path: PathBuf,
    store: Box<dyn RunStore>,
    length: u64,
    runs: Vec<Run>,
}

impl RunLog {
    /// Opens or creates the file and locks it for this process. Removes an incomplete last line, which a killed process
    /// leaves.
    ///
    /// # Errors
    ///
    /// [`StudyError::Busy`] if another process uses the file, [`StudyError::Line`] for a complete line that is not a
    /// run, [`StudyError::File`] for an error of the disk.
    pub(crate) fn open(path: &Path) -> Result<Self, StudyError> {
        let wrong = |action| move |e| StudyError::file(path, action, e);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
        let mut file = file.map_err(wrong("open the file of runs"))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                return Err(StudyError::Busy { folder });
            }
            // Some file systems have no locks; the study then runs without one.
            Err(TryLockError::Error(_)) => {}
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(wrong("read the file of runs"))?;
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |at| at + 1);
        let runs = parse(&bytes[..whole], path)?;
        let length = whole as u64;
        if whole < bytes.len() {
            file.cut(length).map_err(wrong("drop the unfinished last line of the file of runs"))?;
        }
        Ok(Self { path: path.to_owned(), store: Box::new(file), length, runs })
    }

    /// Replaces the file by another store, for tests of a full disk.
    pub(crate) fn with_store(mut self, store: Box<dyn RunStore>) -> Self {
        self.store = store;
        self
    }

    /// The finished runs in the order of their completion.
    pub(crate) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Appends a finished run in memory and on the disk.
    ///
    /// # Errors
    ///
    /// [`StudyError::File`] if the disk fails. Earlier runs are kept, and no part of this run is stored.
    pub(crate) fn append(&mut self, run: Run) -> Result<(), StudyError> {
        let refuse = |source: io::Error, kept: usize| StudyError::File {
            path: self.path.clone(),
            action: "store a finished run",
            kept: format!(
                "the {kept} runs before it are kept; free some space if the disk is full, then repeat the command"
            ),
            source,
        };
        let mut line = serde_json::to_vec(&run).map_err(|e| refuse(e.into(), self.runs.len()))?;
        line.push(b'\n');
        if let Err(e) = self.store.append(&line) {
            // If this fails too, `open` drops the incomplete line next time.
            let _ = self.store.cut(self.length);
            return Err(refuse(e, self.runs.len()));
        }
        self.length += line.len() as u64;
        self.runs.push(run);
        Ok(())
    }
}

fn parse(bytes: &[u8], path: &Path) -> Result<Vec<Run>, StudyError> {
    let mut runs: Vec<Run> = Vec::new();
    for (number, line) in bytes.split(|b| *b == b'\n').enumerate().filter(|(_, line)| !line.is_empty()) {
        let refuse = |why: String| StudyError::Line { file: path.to_owned(), line: number + 1, why };
        let run: Run = serde_json::from_slice(line).map_err(|e| refuse(format!("not a run: {e}")))?;
        if let Some(at) = runs.iter().position(|earlier| earlier.is_same_as(&run)) {
            return Err(refuse(format!("the same run as line {}", at + 1)));
        }
        runs.push(run);
    }
    Ok(runs)
}
