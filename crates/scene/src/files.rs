//! Sources of file contents: disk or memory.

use std::borrow::Cow;
use std::collections::BTreeMap;
#[cfg(unix)]
use std::ffi::{OsStr, OsString};
use std::io;
use std::path::{Path, PathBuf};

/// A source of file contents by path. Readers read through this trait, so that bundled scenes and fuzzers need no disk.
pub trait Files {
    /// Returns all bytes of one file.
    ///
    /// # Errors
    /// Returns the operating system's error; [`io::ErrorKind::NotFound`] for a missing file.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;
}

impl<F: Files + ?Sized> Files for &F {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        (**self).read(path)
    }
}

/// The files on disk, found by [`Disk::locate`]. Devices and pipes are refused, since reading them may never end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl Disk {
    /// Returns the path under which a file exists: `path` itself or, if no such file exists, its variant in Latin-1, since a
    /// scene and a file system may encode names differently. Returns `path` if neither exists.
    pub fn locate(path: &Path) -> Cow<'_, Path> {
        let latin = || in_latin1(path).into_iter().find(|path| path.exists());
        if path.exists() { path.into() } else { latin().map_or(path.into(), Cow::Owned) }
    }
}

impl Files for Disk {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let path = Self::locate(path);
        if !std::fs::metadata(&path)?.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"));
        }
        std::fs::read(path)
    }
}

/// Returns `path` with its file name in Latin-1, and with all names in Latin-1; empty if `path` is ASCII, or not UTF-8.
#[cfg(unix)]
fn in_latin1(path: &Path) -> Vec<PathBuf> {
    use std::os::unix::ffi::OsStringExt;
    let latin = |path: &OsStr| {
        let text = path.to_str().filter(|text| !text.is_ascii())?;
        let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(c).ok()).collect();
        bytes.map(OsString::from_vec)
    };
    let name = path.file_name().and_then(latin).map(|name| path.with_file_name(name));
    name.into_iter().chain(latin(path.as_os_str()).map(PathBuf::from)).collect()
}

#[cfg(not(unix))]
fn in_latin1(_: &Path) -> Vec<PathBuf> {
    Vec::new()
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
