//! Writing and reading of a checkpoint file and its previous version.
//!
//! Three more files are in the folder of FILE: `FILE.part` during a write, `FILE.previous` with the previous version,
//! and `FILE.lock`, which excludes a second writer. The lock file is empty and never removed: removing it would let two
//! processes hold the lock.

use super::Error;
use super::{StateFile, StateKind};
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// A file with its previous version, locked for writing by this process.
pub struct Store {
    path: PathBuf,
    system: Box<dyn FileSystem>,
    /// The locked file; dropping it releases the lock. The system releases the lock if the process is killed.
    _lock: File,
}

/// The result of [`Store::read`].
#[derive(Debug)]
pub struct LoadedState {
    /// The decoded contents of the file.
    pub contents: StateFile,
    /// The error of reading the newest version, if the contents come from the previous version; `None` otherwise.
    pub trouble: Option<Error>,
}

/// The number of bytes per write, so that a full disk is noticed early.
const PIECE: usize = 1 << 20;

impl Store {
    /// Locks the file at `path` for writing, until the value is dropped.
    ///
    /// # Errors
    ///
    /// [`Error::InUse`] while another process holds the lock; [`Error::Write`] if no file can be created in the folder.
    /// On a file system without locks, the call succeeds, and the caller must keep other processes from writing the file.
    pub fn lock(path: &Path) -> Result<Self, Error> {
        Self::lock_on(path, Box::new(Disk))
    }

    /// Locks the file at `path` for writing on the file system `system`, until the value is dropped.
    ///
    /// # Errors
    ///
    /// The errors of [`Store::lock`].
    pub fn lock_on(path: &Path, system: Box<dyn FileSystem>) -> Result<Self, Error> {
        let trouble = |source| Error::Write { path: path.to_owned(), step: "create a file in its folder", source };
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

    /// The path of the file's newest version.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes `contents` as the newest version; the replaced version becomes the previous one.
    ///
    /// The file is written under another name, flushed and renamed. After a crash or an error at any moment, [`Store::read`]
    /// finds the old or the new version complete.
    ///
    /// # Errors
    ///
    /// [`Error::Write`] with the step that failed. The call may be repeated.
    pub fn save(&self, contents: &StateFile) -> Result<(), Error> {
        let part = beside(&self.path, "part");
        let saved = self.put(&part, contents.bytes()).and_then(|()| self.put_in_place(&part));
        if saved.is_err() {
            // The incomplete file only takes space; an error of removing it is ignored.
            let _ = self.system.remove(&part);
        }
        saved
    }

    fn put(&self, part: &Path, bytes: &[u8]) -> Result<(), Error> {
        let mut file = self.system.create(part).map_err(|e| self.trouble("create a file in its folder", e))?;
        for piece in bytes.chunks(PIECE) {
            self.system.write(&mut file, piece).map_err(|e| self.trouble("write it", e))?;
        }
        self.system.sync(&file).map_err(|e| self.trouble("flush it to the disk", e))
    }

    fn put_in_place(&self, part: &Path) -> Result<(), Error> {
        let previous = beside(&self.path, "previous");
        if self.path.exists() {
            // A hard link gives the present file a second name before the new file replaces it, so that one of them always
            // exists.
            let step = |e| self.trouble("keep the previous version", e);
            let second = beside(&self.path, "second");
            self.system.remove(&second).map_err(step)?;
            match self.system.link(&self.path, &second) {
                Ok(()) => {
                    self.system.rename(&second, &previous).map_err(step)?;
                    // After a crash, both names may belong to one file. The rename then did nothing, and the second name is
                    // removed here.
                    let _ = self.system.remove(&second);
                }
                Err(_) => self.system.rename(&self.path, &previous).map_err(step)?,
            }
        }
        self.system.rename(part, &self.path).map_err(|e| self.trouble("rename the finished file", e))?;
        let folder = self.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        self.system.sync_folder(folder).map_err(|e| self.trouble("flush its folder to the disk", e))
    }

    fn trouble(&self, step: &'static str, source: std::io::Error) -> Error {
        Error::Write { path: self.path.clone(), step, source }
    }

    /// Reads the newest version of a file, or the previous one if the newest is missing or damaged. Takes no lock.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] if neither version exists, [`Error::NoGeneration`] if neither can be used. Without a previous
    /// version, the error of the newest one.
    pub fn read(path: &Path, kind: StateKind) -> Result<LoadedState, Error> {
        let newer = match StateFile::read(path, kind) {
            Ok(contents) => return Ok(LoadedState { contents, trouble: None }),
            Err(newer) => newer,
        };
        match StateFile::read(&beside(path, "previous"), kind) {
            Ok(contents) => Ok(LoadedState { contents, trouble: Some(newer) }),
            Err(Error::Missing { .. }) => Err(newer),
            Err(older) => Err(Error::NoGeneration { newer: Box::new(newer), older: Box::new(older) }),
        }
    }

    /// Returns `true` if the newest or the previous version of the file exists, even if it is damaged.
    pub fn exists(path: &Path) -> bool {
        path.exists() || beside(path, "previous").exists()
    }
}

/// The path of a file in the same folder: `path` with `.` and `what` appended.
fn beside(path: &Path, what: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".");
    name.push(what);
    PathBuf::from(name)
}

/// The calls to the operating system that write a file. [`Store::save`](super::Store::save) leaves a complete file even
/// if any of them fails. Tests pass an implementation that fails on purpose.
pub trait FileSystem: Send + Sync {
    /// Creates an empty file, replacing an existing one.
    ///
    /// # Errors
    /// The operating system's error.
    fn create(&self, path: &Path) -> io::Result<File> {
        OpenOptions::new().write(true).create(true).truncate(true).open(path)
    }

    /// Appends all bytes to the file.
    ///
    /// # Errors
    /// The operating system's error; part of the bytes may have been written.
    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<()> {
        file.write_all(bytes)
    }

    /// Flushes the file to the disk.
    ///
    /// # Errors
    /// The operating system's error.
    fn sync(&self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    /// Creates `to` as a hard link to the file `from`.
    ///
    /// # Errors
    /// The operating system's error; [`ErrorKind::Unsupported`] and others on disks without hard links.
    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::hard_link(from, to)
    }

    /// Renames the file `from` to `to`, replacing an existing file.
    ///
    /// # Errors
    /// The operating system's error.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    /// Removes the file, if it exists.
    ///
    /// # Errors
    /// The operating system's error.
    fn remove(&self, path: &Path) -> io::Result<()> {
        match fs::remove_file(path) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
            _ => Ok(()),
        }
    }

    /// Flushes a folder's list of file names to the disk. Does nothing if the system cannot open folders.
    ///
    /// # Errors
    /// The operating system's error.
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        match File::open(folder) {
            // Windows cannot open folders, and does not need this call.
            Err(_) => Ok(()),
            Ok(folder) => folder.sync_all(),
        }
    }
}

/// The file system of the operating system.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl FileSystem for Disk {}
