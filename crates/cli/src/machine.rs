//! This process: its threads, clock, command line and signals.

use crate::{Failure, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Starts `threads` rendering threads; 0 is one per core.
pub(crate) fn start_threads(threads: u16) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
    pool.build_global()
        .map_err(|e| Failure::new(format!("cannot start the rendering threads: {e}; use fewer (--threads N)")))
}

/// The command line of this process; arguments that contain spaces are quoted.
pub(crate) fn command() -> String {
    let quoted = |word: std::ffi::OsString| {
        let word = word.to_string_lossy().into_owned();
        if word.contains(char::is_whitespace) || word.is_empty() { format!("'{word}'") } else { word }
    };
    std::env::args_os().map(quoted).collect::<Vec<String>>().join(" ")
}

/// Makes a write beyond the largest file size (`ulimit -f`) an error instead of a signal that ends the process. Must be
/// called before other threads start, which inherit the blocked signal.
pub(crate) fn turn_file_limits_into_errors() {
    #[cfg(any(target_os = "linux", target_os = "macos", target_os = "freebsd"))]
    {
        let mut signals = nix::sys::signal::SigSet::empty();
        signals.add(nix::sys::signal::Signal::SIGXFSZ);
        // If this fails, the signal still ends the process.
        let _ = signals.thread_block();
    }
}

/// The user and system time of this process so far, in seconds; `None` if the system does not report it.
pub(crate) fn cpu_seconds() -> Option<f64> {
    #[cfg(any(target_os = "linux", target_os = "macos", target_os = "freebsd"))]
    {
        let now = nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID.now().ok()?;
        Some(now.tv_sec() as f64 + now.tv_nsec() as f64 * 1e-9)
    }
    #[cfg(not(any(target_os = "linux", target_os = "macos", target_os = "freebsd")))]
    None
}

/// A flag that requests a stop, set by Ctrl-C or SIGTERM. The first signal stops the render and saves it, a second one ends
/// the program at once. Clones share the flag.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Installs the handler of Ctrl-C and SIGTERM; may be called once per process.
    pub(crate) fn listen() -> Result<Self> {
        let stop = Self::default();
        let asked = stop.clone();
        ctrlc::set_handler(move || {
            if asked.0.swap(true, Ordering::Relaxed) {
                // A second signal ends the program without waiting for files.
                #[allow(clippy::exit)]
                std::process::exit(130);
            }
        })
        .map_err(|e| Failure::new(format!("cannot listen for Ctrl-C: {e}")))?;
        Ok(stop)
    }

    pub(crate) fn asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
