//! Reading of small text files, the identity of a file under several names, and a hash of contents.

use std::borrow::Cow;
use std::fs;
use std::io::{Error, ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Reads a text file of at most `longest` bytes. Bytes that are not UTF-8 are read as Latin-1.
///
/// # Errors
///
/// The operating system's error; [`ErrorKind::FileTooLarge`] for a longer file, [`ErrorKind::InvalidData`] for text in UTF-16
/// or UTF-32.
pub fn read_text(path: &Path, longest: u64) -> std::io::Result<String> {
    let mut bytes = Vec::new();
    fs::File::open(path)?.take(longest + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > longest {
        let what = format!("it is longer than {}", crate::memory::size(longest));
        return Err(Error::new(ErrorKind::FileTooLarge, what));
    }
    let text = dapple_scene::text::decode(&bytes);
    text.map(Cow::into_owned).map_err(|what| Error::new(ErrorKind::InvalidData, what))
}

/// Serialisation of paths: as text, or as a list of bytes if the path is not UTF-8.
pub(crate) mod path {
    use serde::de::{Deserializer, Error, SeqAccess, Visitor};
    use serde::ser::Serializer;
    use std::fmt;
    use std::path::{Path, PathBuf};

    pub(crate) fn serialize<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
        match path.to_str() {
            Some(text) => to.serialize_str(text),
            None => to.collect_seq(path.as_os_str().as_encoded_bytes()),
        }
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<PathBuf, D::Error> {
        from.deserialize_any(PathVisitor)
    }

    /// A path as JSON.
    #[derive(serde::Serialize, serde::Deserialize)]
    #[serde(transparent)]
    struct Json(#[serde(with = "self")] PathBuf);

    /// Returns a path as text: itself, or the list of its bytes if it is not UTF-8.
    pub(crate) fn to_text(path: &Path) -> String {
        let json = || serde_json::to_string(&Json(path.to_owned())).unwrap_or_default();
        path.to_str().map_or_else(json, str::to_owned)
    }

    /// Parses a text that [`to_text`] returned.
    pub(crate) fn of_text(text: &str) -> PathBuf {
        let list = Some(text).filter(|text| text.starts_with('[')).and_then(|text| serde_json::from_str(text).ok());
        list.map_or_else(|| text.into(), |Json(path)| path)
    }

    struct PathVisitor;

    impl<'de> Visitor<'de> for PathVisitor {
        type Value = PathBuf;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a string")
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<PathBuf, E> {
            Ok(text.into())
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<PathBuf, A::Error> {
            let bytes: Vec<u8> = std::iter::from_fn(|| bytes.next_element().transpose()).collect::<Result<_, _>>()?;
            of_bytes(bytes)
                .ok_or_else(|| A::Error::custom("this path was written on another system; give the path as a string"))
        }
    }

    #[cfg(unix)]
    fn of_bytes(bytes: Vec<u8>) -> Option<PathBuf> {
        use std::os::unix::ffi::OsStringExt;
        Some(std::ffi::OsString::from_vec(bytes).into())
    }

    #[cfg(not(unix))]
    fn of_bytes(bytes: Vec<u8>) -> Option<PathBuf> {
        String::from_utf8(bytes).ok().map(PathBuf::from)
    }
}

/// The identity of a file, which need not exist yet.
#[derive(Clone, Debug)]
pub struct FileIdentity {
    /// The path with links resolved, up to the last folder or file that exists.
    place: PathBuf,
    /// The device and inode numbers of the file, if the file exists and the system has such numbers.
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
    // The target of a link without an existing file; longer chains of links are not resolved.
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
    // Several outputs may share a device, such as /dev/null.
    fs::metadata(path).ok().filter(fs::Metadata::is_file).map(|found| (found.dev(), found.ino()))
}

#[cfg(not(unix))]
fn number(_: &Path) -> Option<(u64, u64)> {
    None
}

/// The FNV-1a hash in 128 bits, by Fowler, Noll and Vo. Not cryptographic: it detects changes, not forgeries.
#[derive(Clone, Debug)]
pub struct ContentHash(u128);

impl Default for ContentHash {
    fn default() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }
}

impl ContentHash {
    /// The hash of empty data.
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends bytes to the hashed data.
    pub fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u128::from(*byte)).wrapping_mul((1 << 88) + 0x13b);
        }
    }

    /// Appends the length of a text in bytes, then the text, to the hashed data.
    pub fn text(&mut self, text: &str) {
        self.add(&(text.len() as u64).to_le_bytes());
        self.add(text.as_bytes());
    }

    /// The hash of these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        let mut digest = Self::new();
        digest.add(bytes);
        digest
    }

    /// The hash as 32 hexadecimal digits.
    pub fn hex(&self) -> String {
        format!("{:032x}", self.0)
    }
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

    #[test]
    fn hashes_match_the_published_test_vectors() {
        // Test vectors published with the function: nothing, "a", "foobar".
        assert_eq!(ContentHash::new().hex(), "6c62272e07bb014262b821756295c58d");
        assert_eq!(ContentHash::of(b"a").hex(), "d228cb696f1a8caf78912b704e4a8964");
        assert_eq!(ContentHash::of(b"foobar").hex(), "343e1662793c64bf6f0d3597ba446f18");
        let mut parts = ContentHash::new();
        [&b"foo"[..], b"bar"].iter().for_each(|part| parts.add(part));
        assert_eq!(parts.hex(), ContentHash::of(b"foobar").hex());
    }
}
