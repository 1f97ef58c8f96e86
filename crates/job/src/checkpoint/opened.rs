//! Files that are read in pieces.

use super::contents::{Contents, begin, judged, length, unread};
use super::{Damage, Error, Identity, Kind};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// The bytes read at once for the checksum.
const PIECE: usize = 1 << 20;

/// A complete file with a right checksum, open for reading its body in pieces.
#[derive(Debug)]
pub struct Opened {
    identity: Identity,
    length: u64,
    body: io::Take<File>,
}

impl Opened {
    /// Opens the file at `path`, which must be of kind `kind`, and reads it once for its checksum. Other files that get its name
    /// meanwhile change nothing.
    ///
    /// # Errors
    ///
    /// As [`Contents::read`].
    pub fn open(path: &Path, kind: Kind) -> Result<Self, Error> {
        let open = || -> io::Result<(File, u64)> {
            let found = std::fs::metadata(path)?;
            match found.is_file() {
                true => Ok((File::open(path)?, found.len())),
                false => Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")),
            }
        };
        let opened = open().and_then(|(file, all)| Ok((checked(&file, all)?, file, all)));
        let (checked, mut file, all) = opened.map_err(|source| unread(path, kind, source))?;
        let damaged = |damage| Error::Damaged { path: path.to_owned(), damage };
        // The checksum of a plan ends before its bands.
        if kind != Kind::Plan && checked.is_followed && Contents::read_start(path).is_ok() {
            return Err(damaged(Damage::Kind));
        }
        let (found, identity) = checked.head.map_err(damaged)?;
        if found != kind {
            return Err(damaged(Damage::Kind));
        }
        let length = all - 4 - checked.start;
        file.seek(SeekFrom::Start(checked.start)).map_err(|source| unread(path, kind, source))?;
        Ok(Self { identity, length, body: file.take(length) })
    }

    /// The settings that the body depends on.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The number of bytes of the body.
    pub fn length(&self) -> u64 {
        self.length
    }
}

impl Read for Opened {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        self.body.read(to)
    }
}

/// The findings of reading a file once.
struct Checked {
    head: Result<(Kind, Identity), Damage>,
    /// The place of the body.
    start: u64,
    /// True if the contents end before the file does.
    is_followed: bool,
}

/// Reads a file of `all` bytes for its head and checksum.
fn checked(file: &File, all: u64) -> io::Result<Checked> {
    let mut bytes = Vec::new();
    let covered = all.saturating_sub(4);
    let most = covered.max(all.min(8));
    // The head is short; bytes that are none may look like a long one.
    let (begun, start) = loop {
        let more = (most - bytes.len() as u64).min(bytes.len().max(PIECE) as u64);
        let read = file.take(more).read_to_end(&mut bytes)?;
        match begin(&bytes) {
            Ok((Err(Damage::Short), _)) | Err(Damage::Short) if read > 0 => {}
            Ok((head, start)) => break (Ok(head), start as u64),
            Err(damage) => break (Err(damage), 0),
        }
    };
    let is_followed = length(&bytes).is_some_and(|ends| ends < all);
    let head = match begun {
        Ok(head) => {
            let whole = checksum_is_right(file, (&bytes, covered))?;
            judged(head, covered - start, whole)
        }
        Err(damage) => Err(damage),
    };
    Ok(Checked { head, start, is_followed })
}

/// Compares the checksum of the first `covered` bytes, of which some were read, with the four bytes that follow.
fn checksum_is_right(mut file: &File, (read, covered): (&[u8], u64)) -> io::Result<bool> {
    let mut sum = crc32fast::Hasher::new();
    sum.update(read);
    let mut left = covered - read.len() as u64;
    let mut piece = vec![0; PIECE];
    while left > 0 {
        let piece = &mut piece[..left.min(PIECE as u64) as usize];
        file.read_exact(piece)?;
        sum.update(piece);
        left -= piece.len() as u64;
    }
    let mut stored = [0; 4];
    file.read_exact(&mut stored)?;
    Ok(sum.finalize() == u32::from_le_bytes(stored))
}
