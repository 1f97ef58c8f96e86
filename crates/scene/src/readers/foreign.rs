//! Files of formats that no reader accepts: what they are, and what converts them.

/// The conversion of formats that Blender imports.
const BLENDER: &str = "open it in Blender and export glTF";
/// The conversion of formats that assimp reads.
const ASSIMP: &str = "convert it by `assimp export IN OUT.obj` (package assimp-utils), or export glTF";
const MITSUBA: &str =
    "import it into Blender with Mitsuba's add-on and export glTF; its meshes (OBJ, PLY) can be read one by one";

/// A format that users may expect: name, extensions, the first bytes of its files, and the conversion.
struct Foreign {
    name: &'static str,
    extensions: &'static [&'static str],
    starts: &'static [&'static [u8]],
    remedy: &'static str,
}

const FOREIGN: [Foreign; 8] = [
    Foreign {
        name: "USD",
        extensions: &["usd", "usda", "usdc", "usdz"],
        starts: &[b"#usda", b"PXR-USDC"],
        remedy: BLENDER,
    },
    Foreign { name: "Mitsuba XML", extensions: &["xml"], starts: &[b"<scene"], remedy: MITSUBA },
    Foreign {
        name: "OFF",
        extensions: &["off"],
        starts: &[b"OFF", b"COFF", b"NOFF", b"CNOFF", b"STOFF", b"4OFF", b"nOFF"],
        remedy: ASSIMP,
    },
    Foreign { name: "COLLADA", extensions: &["dae"], starts: &[b"<COLLADA"], remedy: ASSIMP },
    Foreign { name: "FBX", extensions: &["fbx"], starts: &[b"Kaydara FBX", b"; FBX"], remedy: BLENDER },
    Foreign { name: "Blender", extensions: &["blend"], starts: &[b"BLENDER"], remedy: BLENDER },
    Foreign { name: "3ds Max", extensions: &["3ds", "max"], starts: &[b"MM"], remedy: ASSIMP },
    Foreign { name: "Alembic", extensions: &["abc"], starts: &[b"Ogawa"], remedy: BLENDER },
];

/// Returns the error message for a file whose content shows an unsupported format; `None` if it doesn't.
pub(super) fn by_content(content: &[u8]) -> Option<String> {
    if let Some(advice) = compression(content) {
        return Some(advice.into());
    }
    let text = after_prolog(content.strip_prefix(b"\xef\xbb\xbf").unwrap_or(content).trim_ascii_start());
    let known = FOREIGN.iter().find(|format| format.starts.iter().any(|start| text.starts_with(start)));
    known.filter(|format| format.name != "3ds Max" || is_3ds(content)).map(message)
}

/// Returns the error message for a file of an extension that no reader has, whose content shows no format.
pub(super) fn by_extension(extension: &str) -> String {
    if ["gz", "zip", "zst", "bz2", "xz"].contains(&extension) {
        return format!("files with extension \".{extension}\" are compressed; unpack the file first");
    }
    match FOREIGN.iter().find(|format| format.extensions.contains(&extension)) {
        Some(format) => message(format),
        None if extension.is_empty() => "its format is unknown; export pbrt, glTF, OBJ, PLY or STL".into(),
        None => {
            format!("its format is unknown, and so is extension \".{extension}\"; export pbrt, glTF, OBJ, PLY or STL")
        }
    }
}

fn message(format: &Foreign) -> String {
    let Foreign { name, remedy, .. } = format;
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

/// Returns the error message for a compressed file; `None` if the bytes are not those of a known compression.
fn compression(bytes: &[u8]) -> Option<&'static str> {
    let starts = |magic: &[u8]| bytes.starts_with(magic);
    if starts(&[0x1f, 0x8b]) {
        Some("the file is compressed by gzip; unpack it first (gunzip)")
    } else if starts(&[0x28, 0xb5, 0x2f, 0xfd]) {
        Some("the file is compressed by zstd; unpack it first (unzstd)")
    } else if starts(b"PK\x03\x04") && bytes.windows(4).take(256).any(|window| window == b".usd") {
        Some("USD files are not supported; open it in Blender and export glTF")
    } else if starts(b"BZh") || starts(&[0xfd, b'7', b'z', b'X', b'Z', 0]) || starts(b"PK\x03\x04") {
        Some("the file is compressed; unpack it first")
    } else {
        None
    }
}
