//! Printing to stdout and stderr; no other module of the program prints.

use crate::{Failure, Result};
use std::io::{self, ErrorKind, Write};

/// Writes the line `kind: line` to stderr. Ignores a closed stderr.
pub(crate) fn say(kind: &str, line: &str) {
    let _ = writeln!(io::stderr().lock(), "{kind}: {line}");
}

/// Writes a warning to stderr.
pub(crate) fn warn(line: impl AsRef<str>) {
    say("warning", line.as_ref());
}

/// Writes a result as a line to stdout. Ignores a closed pipe (`| head`).
pub(crate) fn tell(result: impl AsRef<str>) -> Result<()> {
    match writeln!(io::stdout().lock(), "{}", result.as_ref()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Failure::new(format!("cannot write to stdout: {e}"))),
        _ => Ok(()),
    }
}
