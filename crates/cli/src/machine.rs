//! Rendering threads and the process clock.

use crate::{Failure, Result};

/// Starts `threads` rendering threads; 0 is one per core.
pub(crate) fn start_threads(threads: u16) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
    pool.build_global().map_err(|e| Failure::new(format!("cannot start {threads} threads: {e}")))
}

/// Makes a write beyond the largest file size (`ulimit -f`) an error instead of a signal that ends the process. Must be
/// called before other threads start, which inherit the blocked signal.
pub(crate) fn turn_file_limits_into_errors() {
    #[cfg(any(target_os = "linux", target_os = "macos", target_os = "freebsd"))]
    {
        let mut signals = nix::sys::signal::SigSet::empty();
        signals.add(nix::sys::signal::Signal::SIGXFSZ);
        // Without it, the signal ends the process as it always did.
        let _ = signals.thread_block();
    }
}

/// User and system seconds of this process so far; `None` if the system does not report them.
pub(crate) fn cpu_seconds() -> Option<f64> {
    #[cfg(any(target_os = "linux", target_os = "macos", target_os = "freebsd"))]
    {
        let now = nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID.now().ok()?;
        Some(now.tv_sec() as f64 + now.tv_nsec() as f64 * 1e-9)
    }
    #[cfg(not(any(target_os = "linux", target_os = "macos", target_os = "freebsd")))]
    None
}
