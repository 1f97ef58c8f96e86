//! Writing and reading of a checkpoint file and its previous version.
//!
//! Beside FILE lie `FILE.part` during a write, `FILE.previous` with the previous version, and `FILE.lock`, which keeps
//! a second writer away. The lock file is empty and never removed: removing it would let two processes hold the lock.

use super::Error;
use super::file_system::{Disk, FileSystem};
use super::{Contents, Kind};
use std::ffi::OsString;
use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

/// A file with its previous version, locked for writing by this process.
pub struct Store {
    path: PathBuf,
    system: Box<dyn FileSystem>,
    /// The lock, held as long as this value. The system releases it if the process is killed.
    _lock: File,
}

/// The version of a file that was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Generation {
    /// The newest version.
    Newest,
    /// The previous version, read because the newest is missing or damaged.
    Previous,
}

/// The result of [`Store::read`].
#[derive(Debug)]
pub struct Found {
    /// The contents of the file.
    pub contents: Contents,
    /// The version that was read.
    pub generation: Generation,
    /// The error of the newest version, if the previous one was read.
    pub trouble: Option<Error>,
}

/// The number of bytes per write, so that a full disk is noticed early.
const PIECE: usize = 1 << 20;

impl Store {
    /// Locks the file at `path` for writing, until the value is dropped.
    ///
    /// # Errors
    ///
    /// [`Error::InUse`] while another process holds the lock; [`Error::Write`] if no file can be made there. On disks
    /// without locks, only one process may write.
    pub fn lock(path: &Path) -> Result<Self, Error> {
        Self::lock_on(path, Box::new(Disk))
    }

    /// As [`Store::lock`], on the file system `system`.
    ///
    /// # Errors
    ///
    /// As [`Store::lock`].
    pub fn lock_on(path: &Path, system: Box<dyn FileSystem>) -> Result<Self, Error> {
        let trouble = |source| Error::Write { path: path.to_owned(), step: "make a file beside it", source };
        if path.is_dir() {
            return Err(trouble(std::io::ErrorKind::IsADirectory.into()));
        }
        let lock = OpenOptions::new().write(true).create(true).truncate(false).open(beside(path, "lock"));
        let lock = lock.map_err(trouble)?;
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => Err(Error::InUse { path: path.to_owned() }),
            Ok(()) | Err(TryLockError::Error(_)) => Ok(Self { path: path.to_owned(), system, _lock: lock }),
        }
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes `contents` as the newest version; the former newest becomes the previous one.
    ///
    /// The file is written under another name, flushed and renamed. A crash or an error at any moment leaves a complete
    /// newest file. On disks without hard links, for a moment only the previous version exists, which [`Store::read`]
    /// finds as well.
    ///
    /// # Errors
    ///
    /// [`Error::Write`] with the step that failed. An existing file is unchanged, and the call may be repeated.
    pub fn save(&self, contents: &Contents) -> Result<(), Error> {
        let part = beside(&self.path, "part");
        let outcome = self.write(&part, contents).and_then(|()| self.put_in_place(&part));
        if outcome.is_err() {
            // It takes space; if even that fails there is nothing more to do.
            let _ = self.system.remove(&part);
        }
        outcome
    }

    fn write(&self, part: &Path, contents: &Contents) -> Result<(), Error> {
        let head = contents.head()?;
        let mut sum = crc32fast::Hasher::new();
        let mut file = self.system.create(part).map_err(|e| self.trouble("make a file beside it", e))?;
        for piece in head.chunks(PIECE).chain(contents.body.chunks(PIECE)) {
            sum.update(piece);
            self.system.write(&mut file, piece).map_err(|e| self.trouble("write it", e))?;
        }
        self.system.write(&mut file, &sum.finalize().to_le_bytes()).map_err(|e| self.trouble("write it", e))?;
        self.system.sync(&file).map_err(|e| self.trouble("flush it to the disk", e))
    }

    fn put_in_place(&self, part: &Path) -> Result<(), Error> {
        let previous = beside(&self.path, "previous");
        if self.path.exists() {
            // A second name first, then the first one changes hands: no moment without a newest file.
            let step = |e| self.trouble("keep the generation before", e);
            let second = beside(&self.path, "second");
            self.system.remove(&second).map_err(step)?;
            match self.system.link(&self.path, &second) {
                Ok(()) => {
                    self.system.rename(&second, &previous).map_err(step)?;
                    // It stays where both are names of the same file, after a crash at this very place.
                    let _ = self.system.remove(&second);
                }
                Err(_) => self.system.rename(&self.path, &previous).map_err(step)?,
            }
        }
        self.system.rename(part, &self.path).map_err(|e| self.trouble("rename the finished file to it", e))?;
        let folder = self.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        self.system.sync_folder(folder).map_err(|e| self.trouble("flush its folder to the disk", e))
    }

    fn trouble(&self, step: &'static str, source: std::io::Error) -> Error {
        Error::Write { path: self.path.clone(), step, source }
    }

    /// Reads the newest version, or the previous one if the newest is missing or damaged. Takes no lock.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] if neither version exists, [`Error::NoGeneration`] if neither can be used. Without a previous
    /// version, the error of the newest one.
    pub fn read(path: &Path, kind: Kind) -> Result<Found, Error> {
        let newer = match Contents::read(path, kind) {
            Ok(contents) => return Ok(Found { contents, generation: Generation::Newest, trouble: None }),
            Err(newer) => newer,
        };
        match Contents::read(&beside(path, "previous"), kind) {
            Ok(contents) => Ok(Found { contents, generation: Generation::Previous, trouble: Some(newer) }),
            Err(Error::Missing { .. }) => Err(newer),
            Err(older) => Err(Error::NoGeneration { newer: Box::new(newer), older: Box::new(older) }),
        }
    }

    /// Returns `true` if either version exists, damaged or not.
    pub fn exists(path: &Path) -> bool {
        path.exists() || beside(path, "previous").exists()
    }
}

/// The path `FILE.what` beside the file `path`.
fn beside(path: &Path, what: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".");
    name.push(what);
    PathBuf::from(name)
}
