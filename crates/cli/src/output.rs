//! Printing to stdout and stderr; no other module of the program prints.

use crate::{Failure, Result};
use indicatif::ProgressBar;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::{Mutex, PoisonError};

/// The progress bar on the terminal, if there is one: lines are printed above it.
static BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Sets the progress bar above which later lines are printed; `None` removes it.
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

/// The terminal's colour code for a kind of line; `None` if stderr is not a terminal with colours.
///
/// The environment variable `NO_COLOR` disables colours (<https://no-color.org>), `CLICOLOR_FORCE` forces them
/// (<https://bixense.com/clicolors>), as in clap's own errors.
fn colour(kind: &str) -> Option<u8> {
    let code = match kind {
        "error" => 31,
        "warning" => 33,
        _ => return None,
    };
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty() && value != "0");
    let is_capable = std::env::var_os("TERM").is_none_or(|term| term != "dumb")
        // Older consoles of Windows print the codes as they are.
        && !cfg!(windows)
        && io::stderr().is_terminal();
    let refused = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    (!refused && (is_capable || is_set("CLICOLOR_FORCE"))).then_some(code)
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
