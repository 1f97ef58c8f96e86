//! The calls to the operating system by which files are written.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::Path;

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
