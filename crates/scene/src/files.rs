//! Sources of file contents: disk or memory.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// A source of file contents by path. Readers read through this trait, so that bundled scenes and fuzzers need no disk.
pub trait Files {
    /// Returns all bytes of one file.
    ///
    /// # Errors
    /// The operating system's error; [`io::ErrorKind::NotFound`] for a missing file.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;
}

impl<F: Files + ?Sized> Files for &F {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        (**self).read(path)
    }
}

/// The files on disk. Devices and pipes are refused, since reading them may never end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl Files for Disk {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        if !std::fs::metadata(path)?.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"));
        }
        std::fs::read(path)
    }
}

impl Default for &dyn Files {
    fn default() -> Self {
        &Disk
    }
}

/// Files in memory, found by their exact path.
impl Files for BTreeMap<PathBuf, Vec<u8>> {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        self.get(path).cloned().ok_or_else(not_found)
    }
}

/// Files built into a program (`include_bytes!`), found by their exact path.
impl Files for [(&str, &[u8])] {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let found = self.iter().find(|(name, _)| Path::new(name) == path);
        found.map(|(_, bytes)| bytes.to_vec()).ok_or_else(not_found)
    }
}

fn not_found() -> io::Error {
    io::Error::new(io::ErrorKind::NotFound, "no such file")
}
