//! Writing of files so that a file is either complete or absent.

use super::ImageError;
use super::read::Fault;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Cursor, ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// The format of an output image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// OpenEXR with any number of layers: `.exr`.
    Exr,
    /// Portable float map, RGB: `.pfm`.
    Pfm,
    /// PNG, 8-bit sRGB: `.png`.
    Png,
}

impl Format {
    /// Returns the format that the extension of `path` names, in upper or lower case.
    ///
    /// # Errors
    /// [`ImageError::UnknownExtension`], whose message lists the known extensions.
    pub fn from_path(path: &Path) -> Result<Self, ImageError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "exr" => Ok(Self::Exr),
            "pfm" => Ok(Self::Pfm),
            "png" => Ok(Self::Png),
            _ => Err(ImageError::UnknownExtension(path.to_owned())),
        }
    }
}

/// Writes a file so that `path` never holds an incomplete one. The bytes go to a part file `FILE.part-PID-N` beside it, which
/// is flushed to the disk and then renamed. On failure the part file is removed, and a file at `path` stays unchanged.
///
/// A symbolic link is followed. A device or a pipe is written to directly. A file marked read-only is not replaced.
///
/// # Errors
/// [`ImageError::Write`], with the path, the step, the system's message and a remedy.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), ImageError> {
    write_file_with(path, |file| file.write_all(bytes).map_err(Fault::Decoder))
}

/// The destination of a write: a file, or memory for a device or a pipe, which cannot seek.
pub(super) trait Sink: Read + Write + Seek {}

impl<T: Read + Write + Seek> Sink for T {}

/// Writes a file as [`write_file`] does; `fill` writes its contents.
pub(super) fn write_file_with(
    path: &Path,
    fill: impl FnOnce(&mut dyn Sink) -> Result<(), Fault<io::Error>>,
) -> Result<(), ImageError> {
    let target = Target::of(path)?;
    if let Place::Stream = target.place {
        let mut bytes = Cursor::new(Vec::new());
        target.outcome(fill(&mut bytes))?;
        let write = || OpenOptions::new().write(true).open(&target.path)?.write_all(bytes.get_ref());
        return write().map_err(|e| target.refuse("write to it", e));
    }
    let (mut file, part) = target.create_part()?;
    let outcome = target
        .outcome(fill(&mut file))
        .and_then(|()| target.finish(&file))
        .and_then(|()| fs::rename(&part, &target.path).map_err(|e| target.refuse("rename the finished file", e)));
    drop(file);
    if outcome.is_err() {
        // The first failure is reported; a second one is ignored.
        let _ = fs::remove_file(&part);
        return outcome;
    }
    sync_directory(&target.path);
    Ok(())
}

/// Checks before a long render that [`write_file`] will be able to write `path`, by creating and removing a part file
/// beside it.
///
/// # Errors
/// [`ImageError::Write`], with the path, the step, the system's message and a remedy.
pub fn check_writable(path: &Path) -> Result<(), ImageError> {
    let target = Target::of(path)?;
    if let Place::Stream = target.place {
        let open = OpenOptions::new().write(true).open(&target.path);
        return open.map(drop).map_err(|e| target.refuse("write to it", e));
    }
    let (_, part) = target.create_part()?;
    fs::remove_file(&part).map_err(|e| target.refuse("remove the test file", e))
}

enum Place {
    /// No file exists at the path.
    Free,
    /// A regular file with these permissions exists at the path.
    Taken(fs::Permissions),
    /// A device or a pipe. Renaming a file to the path would replace it.
    Stream,
}

/// The destination of a write, with symbolic links followed.
struct Target {
    path: PathBuf,
    place: Place,
}

impl Target {
    fn of(path: &Path) -> Result<Self, ImageError> {
        let mut target = Self { path: follow_link(path), place: Place::Free };
        target.place = match fs::metadata(&target.path) {
            Err(e) if e.kind() == ErrorKind::NotFound => Place::Free,
            Err(e) => return Err(target.refuse("inspect it", e)),
            Ok(found) if found.is_dir() => {
                return Err(target.refuse("write an image over a directory", ErrorKind::IsADirectory.into()));
            }
            Ok(found) if !found.is_file() => Place::Stream,
            Ok(found) if found.permissions().readonly() => {
                return Err(target.refuse("replace a file marked read-only", ErrorKind::PermissionDenied.into()));
            }
            Ok(found) => Place::Taken(found.permissions()),
        };
        Ok(target)
    }

    fn refuse(&self, action: &'static str, source: io::Error) -> ImageError {
        let advice = match source.kind() {
            ErrorKind::NotFound | ErrorKind::NotADirectory => "create the directory first, or choose another path",
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
                "choose another path, or change the permissions"
            }
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "free some space, or choose a path on another disk",
            ErrorKind::FileTooLarge => "raise the limit on the size of files (ulimit -f), or write a smaller image",
            ErrorKind::InvalidFilename => "choose a shorter or plainer file name",
            _ => "choose another path",
        };
        ImageError::Write { path: self.path.clone(), action, advice, source }
    }

    fn create_part(&self) -> Result<(File, PathBuf), ImageError> {
        /// Number of part files created so far. It keeps the names of concurrent writes apart.
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let Some(name) = self.path.file_name() else {
            return Err(self.refuse("write to a path without a file name", ErrorKind::InvalidInput.into()));
        };
        loop {
            let mut part = OsString::from(name);
            part.push(format!(".part-{}-{}", std::process::id(), NUMBER.fetch_add(1, Ordering::Relaxed)));
            let part = self.path.with_file_name(part);
            match OpenOptions::new().read(true).write(true).create_new(true).open(&part) {
                Ok(file) => return Ok((file, part)),
                // A killed process with the same id left this part file.
                Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
                Err(e) => return Err(self.refuse("create a file beside it", e)),
            }
        }
    }

    fn outcome(&self, filled: Result<(), Fault<io::Error>>) -> Result<(), ImageError> {
        filled.map_err(|fault| match fault {
            Fault::Ours(error) => error,
            Fault::Decoder(error) => self.refuse("write the file", error),
        })
    }

    fn finish(&self, file: &File) -> Result<(), ImageError> {
        if let Place::Taken(permissions) = &self.place {
            file.set_permissions(permissions.clone()).map_err(|e| self.refuse("keep its permissions", e))?;
        }
        file.sync_all().map_err(|e| self.refuse("flush the file to the disk", e))
    }
}

/// Returns the path that a symbolic link leads to, even if no file exists there.
fn follow_link(path: &Path) -> PathBuf {
    let Ok(link) = fs::read_link(path) else { return path.to_owned() };
    fs::canonicalize(path).unwrap_or_else(|_| path.parent().unwrap_or(Path::new("")).join(link))
}

/// Flushes the entry of a file in its directory to the disk, if the system can. The file's contents are complete either
/// way.
fn sync_directory(path: &Path) {
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if let Ok(directory) = File::open(parent) {
        let _ = directory.sync_all();
    }
}
