//! Reading of small text files.

use std::io::{Error, ErrorKind, Read};
use std::path::Path;

/// Reads a text file of at most `longest` bytes. A device that never ends, such as `/dev/zero`, is refused, too.
///
/// # Errors
///
/// The operating system's error; [`ErrorKind::FileTooLarge`] for a longer file, [`ErrorKind::InvalidData`] for a file that
/// is not UTF-8.
pub fn read_text(path: &Path, longest: u64) -> std::io::Result<String> {
    let mut bytes = Vec::new();
    std::fs::File::open(path)?.take(longest + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > longest {
        let what = format!("it is longer than {}", crate::memory::size(longest));
        return Err(Error::new(ErrorKind::FileTooLarge, what));
    }
    String::from_utf8(bytes).map_err(|_| Error::new(ErrorKind::InvalidData, "it is not a text in UTF-8"))
}
