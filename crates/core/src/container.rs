//! The container format of checkpoints and messages: named sections, each with a checksum.
//!
//! A container begins with a signature and the version. Each section consists of a name and bytes, each preceded by its
//! length, and the CRC-32 of both.
//!
//! Programs may append sections of their own, with the data that they need to resume.

/// The signature at the start of every container.
const MAGIC: &[u8; 8] = b"dapple\r\n";
/// The version of the container and of the sections of a render's state.
const VERSION: u32 = 13;

/// The reason why bytes are not a valid [container](crate::container).
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The signature is missing.
    Foreign,
    /// Another version of Dapple wrote the bytes.
    Version,
    /// The bytes end within a section.
    Short,
    /// The checksum of a section is wrong.
    Checksum,
}

impl Fault {
    /// The fault as a clause for error messages.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Foreign => "Dapple did not write the data",
            Self::Version => "another version of Dapple wrote the data",
            Self::Short => "the data are truncated",
            Self::Checksum => "the data are damaged (a checksum is wrong)",
        }
    }
}

/// Creates a container without sections. Memory is reserved for sections of `capacity` bytes in total.
pub fn begin(capacity: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(capacity + 64);
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes
}

/// Appends a section and its checksum.
pub fn append(bytes: &mut Vec<u8>, name: &str, section: &[u8]) {
    let mut sum = crc32fast::Hasher::new();
    for part in [name.as_bytes(), section] {
        bytes.extend((part.len() as u64).to_le_bytes());
        bytes.extend(part);
        sum.update(part);
    }
    bytes.extend(sum.finalize().to_le_bytes());
}

/// Reads the names and bytes of all sections, in order, and verifies their checksums.
///
/// # Errors
///
/// [`Fault`] for bytes that are not a container of this version, or are damaged.
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
