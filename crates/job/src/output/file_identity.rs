//! Identity of files: two names of one file, through links or folders.

use std::fs;
use std::path::{Path, PathBuf};

/// The identity of a file, which need not exist yet.
#[derive(Clone, Debug)]
pub struct FileIdentity {
    /// The path with links followed, as far as they lead to folders and files that exist.
    place: PathBuf,
    /// Device and number of the file, if it exists and the system numbers files.
    number: Option<(u64, u64)>,
}

impl FileIdentity {
    /// Looks up the identity of the file at `path`.
    pub fn of(path: &Path) -> Self {
        Self { place: place(path), number: number(path) }
    }

    /// Returns `true` if writing to one of the files changes the other.
    pub fn is_same(&self, other: &Self) -> bool {
        self.place == other.place || self.number.is_some() && self.number == other.number
    }
}

fn place(path: &Path) -> PathBuf {
    if let Ok(place) = fs::canonicalize(path) {
        return place;
    }
    // A link that leads to no file yet; a longer chain of links is left as it is.
    let target = fs::read_link(path).map(|link| path.parent().unwrap_or(Path::new("")).join(link));
    let path = target.as_deref().unwrap_or(path);
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match (fs::canonicalize(folder), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
}

#[cfg(unix)]
fn number(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    // Devices such as /dev/null may be written to by several names.
    fs::metadata(path).ok().filter(fs::Metadata::is_file).map(|found| (found.dev(), found.ino()))
}

#[cfg(not(unix))]
fn number(_: &Path) -> Option<(u64, u64)> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_one_file_are_the_same() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        fs::create_dir(path("sub")).expect("a folder");
        fs::write(path("a"), "").expect("a file");
        let same = |a: &str, b: &str| FileIdentity::of(&path(a)).is_same(&FileIdentity::of(&path(b)));
        assert!(same("a", "a") && same("a", "sub/../a") && same("new", "./new") && same("new", "sub/../new"));
        assert!(!same("a", "new") && !same("a", "sub/a"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(path("a"), path("link")).expect("a link");
            std::os::unix::fs::symlink("new", path("dangling")).expect("a link");
            fs::hard_link(path("a"), path("hard")).expect("a link");
            assert!(same("a", "link") && same("a", "hard") && same("dangling", "new") && same("link", "hard"));
        }
    }
}
