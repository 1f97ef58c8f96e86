//! The readers of all scene and model formats, and the choice of a reader for a file.

use crate::files::{Disk, Files};
use crate::scene_reader::{AnyOptions, ReadError, SceneReader, unreadable};
use crate::{Scene, Source, text};
use std::cell::RefCell;
use std::path::Path;
use std::sync::Arc;

/// The readers of all supported formats.
// One per line, so that a new reader adds a line.
#[rustfmt::skip]
pub const READERS: &[SceneReader] = &[
    crate::pbrt::READER,
    crate::gltf::READER,
    crate::model::OBJ,
    crate::model::PLY,
    crate::model::STL,
];

/// Reads a scene (pbrt, glTF) or a model (OBJ, PLY, STL) from disk.
///
/// The content determines the format. For unrecognized content, the extension does, in upper or lower case.
///
/// # Errors
/// Returns all problems of the file, each with file and line, or the problem of an unknown format.
pub fn read_any(path: impl AsRef<Path>, options: &AnyOptions) -> Result<Scene, ReadError> {
    read_any_from(&Disk, path, options)
}

/// Reads a scene or a model from `files`; determines the format as [`read_any`] does.
///
/// # Errors
/// Returns all problems of the file, each with file and line, or the problem of an unknown format.
pub fn read_any_from(
    files: &(impl Files + ?Sized),
    path: impl AsRef<Path>,
    options: &AnyOptions,
) -> Result<Scene, ReadError> {
    let (files, path) = (&files, path.as_ref());
    let source = || Source { file: Arc::new(path.to_owned()), line: 0 };
    let content = files.read(path).map_err(|e| unreadable(source(), &e))?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let by_content = READERS.iter().find(|reader| (reader.recognizes)(&content));
    let by_name = || READERS.iter().find(|reader| reader.extensions.contains(&&*extension));
    let reader = match by_content.ok_or_else(|| foreign_content(&content)) {
        Ok(reader) => reader,
        Err(Some(advice)) => return Err(ReadError::invalid(source(), advice)),
        Err(None) => by_name().ok_or_else(|| ReadError::invalid(source(), foreign_extension(&extension)))?,
    };
    (reader.read)(&Opened { files, path, content: RefCell::new(Some(content)) }, path, options)
}

/// A source of files, one of which has already been read.
struct Opened<'f> {
    files: &'f dyn Files,
    path: &'f Path,
    content: RefCell<Option<Vec<u8>>>,
}

impl Files for Opened<'_> {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let opened = if path == self.path { self.content.take() } else { None };
        opened.map_or_else(|| self.files.read(path), Ok)
    }
}

/// The conversion of formats that Blender imports.
const BLENDER: &str = "open the file in Blender and export glTF";
/// The conversion of formats that assimp reads.
const ASSIMP: &str = "convert the file by `assimp export IN OUT.obj` (package assimp-utils), or export glTF";
const MITSUBA: &str = "import the file into Blender with Mitsuba's add-on and export glTF, or read the scene's meshes (OBJ, PLY) one by one";

/// Formats that users may expect: name, extensions, the first bytes of their files, and the conversion.
type Foreign = (&'static str, &'static [&'static str], &'static [&'static [u8]], &'static str);
const FOREIGN: [Foreign; 8] = [
    ("USD", &["usd", "usda", "usdc", "usdz"], &[b"#usda", b"PXR-USDC"], BLENDER),
    ("Mitsuba XML", &["xml"], &[b"<scene"], MITSUBA),
    ("OFF", &["off"], &[b"OFF", b"COFF", b"NOFF", b"CNOFF", b"STOFF", b"4OFF", b"nOFF"], ASSIMP),
    ("COLLADA", &["dae"], &[b"<COLLADA"], ASSIMP),
    ("FBX", &["fbx"], &[b"Kaydara FBX", b"; FBX"], BLENDER),
    ("Blender", &["blend"], &[b"BLENDER"], BLENDER),
    ("3ds Max", &["3ds", "max"], &[b"MM"], ASSIMP),
    ("Alembic", &["abc"], &[b"Ogawa"], BLENDER),
];

/// Returns the error message for a file whose content shows an unsupported format; `None` if it doesn't.
fn foreign_content(content: &[u8]) -> Option<String> {
    if let Some(advice) = compression(content) {
        return Some(advice.into());
    }
    let text = match text::without_mark(content) {
        Ok(text) => after_prolog(text.trim_ascii_start()),
        Err(advice) => return Some(advice.into()),
    };
    let known = FOREIGN.iter().find(|format| format.2.iter().any(|start| text.starts_with(start)));
    known.filter(|format| format.0 != "3ds Max" || is_3ds(content)).map(message)
}

/// Returns the error message for a file whose content shows no format and whose extension no reader has.
fn foreign_extension(extension: &str) -> String {
    if ["gz", "zip", "zst", "bz2", "xz"].contains(&extension) {
        return format!("files with extension \".{extension}\" are compressed; unpack the file first");
    }
    match FOREIGN.iter().find(|format| format.1.contains(&extension)) {
        Some(format) => message(format),
        None if extension.is_empty() => "the file's format is unknown; export pbrt, glTF, OBJ, PLY or STL".into(),
        None => {
            format!("the file's format and extension \".{extension}\" are unknown; export pbrt, glTF, OBJ, PLY or STL")
        }
    }
}

fn message(format: &Foreign) -> String {
    let (name, _, _, remedy) = format;
    format!("{name} files are not supported; {remedy}")
}

/// A 3ds file begins with "MM" and the length of the file.
fn is_3ds(content: &[u8]) -> bool {
    content.get(2..6).is_some_and(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize == content.len())
}

/// The text after XML declarations and comments.
fn after_prolog(mut text: &[u8]) -> &[u8] {
    for (start, end) in [(&b"<?"[..], &b"?>"[..]), (b"<!--", b"-->")].into_iter().cycle().take(32) {
        if text.starts_with(start)
            && let Some(at) = text.windows(end.len()).position(|window| window == end)
        {
            text = text[at + end.len()..].trim_ascii_start();
        }
    }
    text
}

/// Returns the error message for a compressed file; `None` if the bytes show no known compression.
fn compression(bytes: &[u8]) -> Option<&'static str> {
    const OTHER: &str = "the file is compressed; unpack it first";
    const STARTS: [(&[u8], &str); 5] = [
        (b"\x1f\x8b", "the file is compressed by gzip; unpack it first (gunzip)"),
        (b"\x28\xb5\x2f\xfd", "the file is compressed by zstd; unpack it first (unzstd)"),
        (b"BZh", OTHER),
        (b"\xfd7zXZ\0", OTHER),
        (b"PK\x03\x04", OTHER),
    ];
    if bytes.starts_with(b"PK\x03\x04") && bytes.windows(4).take(256).any(|window| window == b".usd") {
        return Some("USD files are not supported; open the file in Blender and export glTF");
    }
    STARTS.iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, message)| *message)
}
