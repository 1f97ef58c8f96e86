//! The contents of a checkpoint, shard, plan or part file, and the binary format.
//!
//! A file consists of: eight magic bytes; the version, the kind and the number of pairs in the identity (4 bytes each);
//! the pairs, each text after its length in 4 bytes; the length of the body in 8 bytes; the body; the CRC-32 (IEEE
//! 802.3) of all bytes before it. All numbers are little-endian.
//!
//! In a plan file, bands of the film follow. The body lists their lengths and checksums, so that a task reads its own only.

use super::{Error, Opened};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

const MAGIC: &[u8; 8] = b"dapple-c";
const VERSION: u32 = 2;
/// The largest length in bytes of a name or value in an identity.
const LONGEST: usize = 1 << 20;

/// The kind of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The state of an unfinished or finished render, from which it can be resumed.
    Checkpoint,
    /// The film of one shard (every N-th row) of an image.
    Shard,
    /// The state of a render between two stages, with the plan of the next one.
    Plan,
    /// One machine's part of a stage.
    Part,
}

impl Kind {
    const fn number(self) -> u32 {
        match self {
            Self::Checkpoint => 1,
            Self::Shard => 2,
            Self::Plan => 3,
            Self::Part => 4,
        }
    }

    /// The kind's name in messages: `checkpoint`, `shard`, `plan` or `part`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Checkpoint => "checkpoint",
            Self::Shard => "shard",
            Self::Plan => "plan",
            Self::Part => "part",
        }
    }
}

/// The settings that a file's contents depend on, as ordered pairs of name and value.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    pairs: Vec<(String, String)>,
}

impl Identity {
    /// Makes an identity of these pairs of name and value, in this order.
    pub fn new<N: Into<String>, V: Into<String>>(pairs: impl IntoIterator<Item = (N, V)>) -> Self {
        Self { pairs: pairs.into_iter().map(|(name, value)| (name.into(), value.into())).collect() }
    }

    /// The pairs of name and value, in order.
    pub fn pairs(&self) -> &[(String, String)] {
        &self.pairs
    }

    /// The value of the pair called `name`; `None` if there is none.
    pub fn value(&self, name: &str) -> Option<&str> {
        self.pairs.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// Lists the pairs in which the identity `there` differs from this one, one phrase each: `seed: 3, not 4`.
    pub fn differences(&self, there: &Self) -> Vec<String> {
        let nothing = "none";
        let mut differ = Vec::new();
        for (name, here) in &self.pairs {
            let there = there.value(name).unwrap_or(nothing);
            if there != here {
                differ.push(format!("{name}: {there}, not {here}"));
            }
        }
        let unknown = there.pairs.iter().filter(|(name, _)| self.value(name).is_none());
        differ.extend(unknown.map(|(name, there)| format!("{name}: {there}, not {nothing}")));
        differ
    }
}

/// The contents of a checkpoint, shard, plan or part file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contents {
    /// The kind of the file.
    pub kind: Kind,
    /// The settings that the body depends on, as pairs of name and value.
    pub identity: Identity,
    /// The stored bytes: an encoded snapshot, shard, stage or part of a stage.
    pub body: Vec<u8>,
}

/// The reason why the bytes of a file cannot be decoded as [`Contents`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// The file is empty or truncated.
    Short,
    /// The file does not begin with this format's magic bytes.
    Foreign,
    /// The file has another version of the format.
    Version,
    /// The checksum does not match: bytes have changed.
    Checksum,
    /// The checksum is right, but the contents are inconsistent.
    Nonsense,
    /// The file is of another [`Kind`] than requested.
    Kind,
}

impl std::fmt::Display for Damage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Short => "it is cut short",
            Self::Foreign => "it is not a file of Dapple's",
            Self::Version => "another version of Dapple wrote it",
            Self::Checksum => "it is damaged (its checksum is wrong)",
            Self::Nonsense => "its contents make no sense",
            Self::Kind => "it is of another kind: checkpoints, shards, plans and parts are not the same",
        })
    }
}

impl Damage {
    /// The advice that follows the reason in an error message.
    pub(crate) fn remedy(self) -> &'static str {
        match self {
            Self::Short | Self::Checksum | Self::Nonsense => "restore it from a copy, or render it again",
            Self::Foreign | Self::Kind => "check the name of the file",
            Self::Version => "finish it with that version, or render it again",
        }
    }
}

impl Contents {
    /// Encodes the contents as the bytes of a file.
    ///
    /// # Errors
    ///
    /// [`Error::LongText`] if a name or value in the identity is longer than 1 MiB.
    pub fn to_bytes(&self) -> Result<Vec<u8>, Error> {
        let mut bytes = head(self.kind, &self.identity, self.body.len() as u64)?;
        bytes.extend(&self.body);
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        Ok(bytes)
    }

    /// Reads the file at `path`, which must be of kind `kind`.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] without a file, [`Error::Read`] if the system cannot read it, [`Error::Damaged`] if its bytes
    /// are invalid.
    pub fn read(path: &Path, kind: Kind) -> Result<Self, Error> {
        let mut opened = Opened::open(path, kind)?;
        let mut body = Vec::with_capacity(usize::try_from(opened.length()).unwrap_or(0));
        opened.read_to_end(&mut body).map_err(|source| unread(path, kind, source))?;
        match body.len() as u64 == opened.length() {
            true => Ok(Self { kind, identity: opened.identity().clone(), body }),
            false => Err(Error::Damaged { path: path.to_owned(), damage: Damage::Short }),
        }
    }

    /// Reads the beginning of a plan file, without the bands that follow. Returns the open file and the length of what was
    /// read.
    ///
    /// # Errors
    ///
    /// As [`Contents::read`].
    pub fn read_start(path: &Path) -> Result<(Self, File, u64), Error> {
        let kind = Kind::Plan;
        let open = || -> io::Result<(Vec<u8>, File)> {
            if !std::fs::metadata(path)?.is_file() {
                return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"));
            }
            let mut file = File::open(path)?;
            let mut bytes = Vec::new();
            let mut wanted = 1 << 16;
            loop {
                let more = (&mut file).take(wanted - bytes.len() as u64).read_to_end(&mut bytes)?;
                match length(&bytes) {
                    Some(all) if all <= bytes.len() as u64 => bytes.truncate(all as usize),
                    Some(all) if more > 0 => {
                        wanted = all;
                        continue;
                    }
                    None if more > 0 => {
                        wanted *= 2;
                        continue;
                    }
                    _ => {}
                }
                return Ok((bytes, file));
            }
        };
        let (bytes, file) = open().map_err(|source| unread(path, kind, source))?;
        let end = bytes.len() as u64;
        let damaged = |damage| Error::Damaged { path: path.to_owned(), damage };
        let contents = Contents::from_bytes(bytes).map_err(damaged)?;
        if contents.kind == kind { Ok((contents, file, end)) } else { Err(damaged(Damage::Kind)) }
    }

    /// Decodes bytes that [`Contents::to_bytes`] encoded. Uses at most twice the memory of the bytes, even if they are
    /// invalid.
    ///
    /// # Errors
    ///
    /// The [`Damage`], which distinguishes truncated, changed and foreign files.
    pub fn from_bytes(mut bytes: Vec<u8>) -> Result<Self, Damage> {
        let covered = bytes.len().saturating_sub(4);
        let (head, start) = begin(&bytes[..covered.max(bytes.len().min(MAGIC.len()))])?;
        let (covered, sum) = bytes.split_last_chunk::<4>().ok_or(Damage::Short)?;
        let whole = crc32fast::hash(covered) == u32::from_le_bytes(*sum);
        let (kind, identity) = judged(head, (covered.len() - start) as u64, whole)?;
        bytes.truncate(bytes.len() - 4);
        bytes.drain(..start);
        Ok(Self { kind, identity, body: bytes })
    }
}

/// The kind, the identity and the length of the body.
type Head = (Kind, Identity, u64);

/// Decodes the beginning of a file: its head, which may be truncated or damaged, and where the body starts.
///
/// # Errors
///
/// [`Damage`] of bytes that do not begin like a file of this version.
pub(super) fn begin(bytes: &[u8]) -> Result<(Result<Head, Damage>, usize), Damage> {
    if !MAGIC.starts_with(&bytes[..bytes.len().min(MAGIC.len())]) {
        return Err(Damage::Foreign);
    }
    let mut reader = Reader(bytes.get(MAGIC.len()..).ok_or(Damage::Short)?);
    if reader.number()? != VERSION {
        return Err(Damage::Version);
    }
    let head = reader.head();
    Ok((head, bytes.len() - reader.0.len()))
}

/// The kind and identity of a file with `rest` bytes after its head. `whole` is true if its checksum is right.
pub(super) fn judged(head: Result<Head, Damage>, rest: u64, whole: bool) -> Result<(Kind, Identity), Damage> {
    match head {
        Ok((kind, identity, length)) if whole && rest == length => Ok((kind, identity)),
        // Truncated and changed bytes look alike, except if the body is shorter than its stored length.
        Ok((_, _, length)) if !whole && rest != length => Err(Damage::Short),
        _ if !whole => Err(Damage::Checksum),
        _ => Err(Damage::Nonsense),
    }
}

/// Encodes all bytes of a file before its body of `length` bytes.
pub(super) fn head(kind: Kind, Identity { pairs }: &Identity, length: u64) -> Result<Vec<u8>, Error> {
    let mut head = MAGIC.to_vec();
    for number in [VERSION, kind.number(), pairs.len() as u32] {
        head.extend(number.to_le_bytes());
    }
    for text in pairs.iter().flat_map(|(name, value)| [name, value]) {
        if text.len() > LONGEST {
            return Err(Error::LongText { bytes: text.len(), most: LONGEST });
        }
        head.extend((text.len() as u32).to_le_bytes());
        head.extend(text.as_bytes());
    }
    head.extend(length.to_le_bytes());
    Ok(head)
}

/// The length of the contents that these bytes begin with; `None` for bytes that are too short or of another format.
pub(super) fn length(bytes: &[u8]) -> Option<u64> {
    let mut reader = Reader(bytes.strip_prefix(MAGIC)?);
    let version = reader.number().ok()?;
    let (_, _, body) = reader.head().ok().filter(|_| version == VERSION)?;
    body.checked_add((bytes.len() - reader.0.len() + 4) as u64)
}

pub(super) fn unread(path: &Path, kind: Kind, source: io::Error) -> Error {
    match source.kind() {
        io::ErrorKind::NotFound => Error::Missing { path: path.to_owned(), kind: kind.name() },
        _ => Error::Read { path: path.to_owned(), source },
    }
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Damage> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(Damage::Short)?;
        self.0 = rest;
        Ok(taken)
    }

    fn number(&mut self) -> Result<u32, Damage> {
        let (number, rest) = self.0.split_first_chunk().ok_or(Damage::Short)?;
        self.0 = rest;
        Ok(u32::from_le_bytes(*number))
    }

    fn text(&mut self) -> Result<String, Damage> {
        let length = self.number()? as usize;
        let bytes = self.take(length)?;
        std::str::from_utf8(bytes).map(str::to_owned).map_err(|_| Damage::Nonsense)
    }

    /// Decodes the kind, the identity and the length of the body; the remaining bytes are the body.
    fn head(&mut self) -> Result<(Kind, Identity, u64), Damage> {
        let number = self.number()?;
        let kinds = [Kind::Checkpoint, Kind::Shard, Kind::Plan, Kind::Part];
        let kind = kinds.into_iter().find(|kind| kind.number() == number);
        let count = self.number()?;
        let mut pairs = Vec::new();
        for _ in 0..count {
            pairs.push((self.text()?, self.text()?));
        }
        let (length, rest) = self.0.split_first_chunk().ok_or(Damage::Short)?;
        self.0 = rest;
        Ok((kind.ok_or(Damage::Nonsense)?, Identity { pairs }, u64::from_le_bytes(*length)))
    }
}
