//! The container of everything that is written: named sections, each with its checksum.
//!
//! Bytes begin with a signature and the version. A section is its name and its bytes, each after its length, and the CRC-32 of both.
//! Sections may be appended: a program adds what it needs to find a state again.

/// The first bytes.
const MAGIC: &[u8; 8] = b"dapple\r\n";
/// The version of the container and of the sections of a render's state.
const VERSION: u32 = 13;

/// The reason why bytes are no container.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// They begin otherwise.
    Foreign,
    /// Another version of Dapple wrote them.
    Version,
    /// They end within a section.
    Short,
    /// The checksum of a section is wrong.
    Checksum,
}

impl Fault {
    /// The fault as the end of a sentence.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Foreign => "they are not of Dapple's kind",
            Self::Version => "another version of Dapple wrote them; finish with that version, or render again",
            Self::Short => "they end too early",
            Self::Checksum => "a checksum is wrong, so they are damaged",
        }
    }
}

/// A container without sections.
pub fn begin(capacity: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(capacity + 64);
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes
}

/// Appends a section.
pub fn append(bytes: &mut Vec<u8>, name: &str, section: &[u8]) {
    let mut sum = crc32fast::Hasher::new();
    for part in [name.as_bytes(), section] {
        bytes.extend((part.len() as u64).to_le_bytes());
        bytes.extend(part);
        sum.update(part);
    }
    bytes.extend(sum.finalize().to_le_bytes());
}

/// The sections, in order, with their checksums checked.
///
/// # Errors
///
/// [`Fault`] for bytes that are no container of this version, or are damaged.
///
/// ```
/// use dapple_core::container::{Fault, append, begin, sections};
///
/// let mut bytes = begin(0);
/// append(&mut bytes, "header", b"a scene");
/// assert_eq!(sections(&bytes)?, [("header", &b"a scene"[..])]);
/// bytes[36] ^= 1;
/// assert_eq!(sections(&bytes), Err(Fault::Checksum));
/// # Ok::<(), Fault>(())
/// ```
pub fn sections(bytes: &[u8]) -> Result<Vec<(&str, &[u8])>, Fault> {
    if !MAGIC.starts_with(&bytes[..bytes.len().min(MAGIC.len())]) {
        return Err(Fault::Foreign);
    }
    let mut rest = bytes.get(MAGIC.len()..).ok_or(Fault::Short)?;
    let (version, after) = rest.split_first_chunk().ok_or(Fault::Short)?;
    if u32::from_le_bytes(*version) != VERSION {
        return Err(Fault::Version);
    }
    rest = after;
    let mut found = Vec::new();
    while !rest.is_empty() {
        let mut part = || -> Result<&[u8], Fault> {
            let (length, after) = rest.split_first_chunk().ok_or(Fault::Short)?;
            let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| Fault::Short)?;
            let (part, after) = after.split_at_checked(length).ok_or(Fault::Short)?;
            rest = after;
            Ok(part)
        };
        let (name, section) = (part()?, part()?);
        let (sum, after) = rest.split_first_chunk().ok_or(Fault::Short)?;
        rest = after;
        let mut own = crc32fast::Hasher::new();
        own.update(name);
        own.update(section);
        match std::str::from_utf8(name) {
            Ok(name) if own.finalize() == u32::from_le_bytes(*sum) => found.push((name, section)),
            _ => return Err(Fault::Checksum),
        }
    }
    Ok(found)
}
