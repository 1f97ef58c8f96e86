//! The calls to the operating system that write a file.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::Path;

/// The calls that write a file. Each may fail at any time; [`Store::save`](super::Store::save) leaves a whole
/// file all the same. Tests pass one that fails on purpose.
pub trait FileSystem: Send + Sync {
    /// Makes an empty file, in place of an existing one.
    ///
    /// # Errors
    /// The system's.
    fn create(&self, path: &Path) -> io::Result<File> {
        OpenOptions::new().write(true).create(true).truncate(true).open(path)
    }

    /// Writes all bytes at the end.
    ///
    /// # Errors
    /// The system's; some of the bytes may be written then.
    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<()> {
        file.write_all(bytes)
    }

    /// Flushes the file to the disk.
    ///
    /// # Errors
    /// The system's.
    fn sync(&self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    /// Gives a file a second name.
    ///
    /// # Errors
    /// The system's; [`ErrorKind::Unsupported`] and others on disks without second names.
    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::hard_link(from, to)
    }

    /// Gives a file another name, in place of its former owner.
    ///
    /// # Errors
    /// The system's.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    /// Removes a name, if it is there.
    ///
    /// # Errors
    /// The system's.
    fn remove(&self, path: &Path) -> io::Result<()> {
        match fs::remove_file(path) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
            _ => Ok(()),
        }
    }

    /// Makes the names in a folder durable, where the system can.
    ///
    /// # Errors
    /// The system's.
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        match File::open(folder) {
            // Windows opens no folders, and needs none of this.
            Err(_) => Ok(()),
            Ok(folder) => folder.sync_all(),
        }
    }
}

/// The operating system's own.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl FileSystem for Disk {}
