//! `runs.jsonl`: one line for each finished run, whole or not there.

use crate::{Run, StudyError};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Where lines go. Each is on the disk when `append` comes back.
pub trait RunStore {
    /// Adds bytes at the end.
    ///
    /// # Errors
    ///
    /// The system's; then any part of the bytes may be there.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Makes it as short as it was before.
    ///
    /// # Errors
    ///
    /// The system's.
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
    /// Opens a file, or makes one, for this process alone. What stands behind the last whole line was being written
    /// when a process was killed: it is dropped.
    ///
    /// # Errors
    ///
    /// [`StudyError::Busy`], [`StudyError::Line`] for a whole line that is no run, [`StudyError::File`].
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
            // A file system without locks is no reason not to study.
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

    /// The same with another store: for tests of what happens when a disk is full.
    pub(crate) fn with_store(mut self, store: Box<dyn RunStore>) -> Self {
        self.store = store;
        self
    }

    /// The finished runs, in the order in which they were finished.
    pub(crate) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Writes a run down.
    ///
    /// # Errors
    ///
    /// [`StudyError::File`]; the runs before it are still there, and nothing of this one.
    pub(crate) fn append(&mut self, run: Run) -> Result<(), StudyError> {
        let refuse = |source: io::Error, kept: usize| StudyError::File {
            path: self.path.clone(),
            action: "write down a finished run",
            kept: format!(
                "the {kept} runs before it are kept: mend that (is the disk full?) and give the same command again"
            ),
            source,
        };
        let mut line = serde_json::to_vec(&run).map_err(|e| refuse(e.into(), self.runs.len()))?;
        line.push(b'\n');
        if let Err(e) = self.store.append(&line) {
            // Where even that fails, the torn line is dropped by whoever opens the file next.
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
        let run: Run = serde_json::from_slice(line).map_err(|e| refuse(format!("this is no run: {e}")))?;
        if let Some(at) = runs.iter().position(|earlier| earlier.is_same_as(&run)) {
            return Err(refuse(format!("this run is the {}th line's again", at + 1)));
        }
        runs.push(run);
    }
    Ok(runs)
}
