//! Printing to stdout and stderr; no other module of the program prints.

use crate::{Failure, Result};
use indicatif::ProgressBar;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::{Mutex, PoisonError};

/// The progress bar on the terminal, if there is one: lines are printed above it.
static BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Prints later lines above this progress bar; `None` after the bar has gone.
pub(crate) fn print_above(bar: Option<ProgressBar>) {
    *BAR.lock().unwrap_or_else(PoisonError::into_inner) = bar;
}

/// Writes the line `kind: line` to stderr. Ignores a closed stderr.
pub(crate) fn say(kind: &str, line: &str) {
    let write = || {
        let _ = match colour(kind) {
            Some(code) => writeln!(io::stderr().lock(), "\x1b[1;{code}m{kind}:\x1b[0m {line}"),
            None => writeln!(io::stderr().lock(), "{kind}: {line}"),
        };
    };
    let bar = BAR.lock().unwrap_or_else(PoisonError::into_inner).clone();
    match bar {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

/// The terminal's code for the colour of a kind of line. `None` without a terminal, in a terminal without colours, and
/// if the environment variable `NO_COLOR` is set (<https://no-color.org>).
fn colour(kind: &str) -> Option<u8> {
    let code = match kind {
        "error" => 31,
        "warning" => 33,
        _ => return None,
    };
    let refused = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty())
        || std::env::var_os("TERM").is_some_and(|term| term == "dumb")
        // Older consoles of Windows print the codes as they are.
        || cfg!(windows);
    (!refused && io::stderr().is_terminal()).then_some(code)
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
