//! The machine's threads, clocks and memory.

use crate::{Failure, Result};

/// Starts the threads that render; 0 is one per core.
pub(crate) fn start_threads(threads: u16) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
    pool.build_global().map_err(|e| Failure::new(format!("cannot start {threads} threads: {e}")))
}

/// User and system seconds of this process so far; `None` where the system does not tell.
pub(crate) fn cpu_seconds() -> Option<f64> {
    #[cfg(any(target_os = "linux", target_os = "macos", target_os = "freebsd"))]
    {
        let now = nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID.now().ok()?;
        Some(now.tv_sec() as f64 + now.tv_nsec() as f64 * 1e-9)
    }
    #[cfg(not(any(target_os = "linux", target_os = "macos", target_os = "freebsd")))]
    None
}

/// Bytes of memory that this process has now, and the most that it ever had; `None` where the system does not tell.
pub(crate) fn resident() -> Option<[u64; 2]> {
    let status = read_text("/proc/self/status")?;
    Some([kibibytes(&status, "VmRSS:")?, kibibytes(&status, "VmHWM:")?])
}

/// Bytes that this process may have in all: what it has, what the system has left, and within the limit of its control
/// group. `None` where the system does not tell.
pub(crate) fn memory() -> Option<u64> {
    let available = kibibytes(&read_text("/proc/meminfo")?, "MemAvailable:")?;
    let left = available.saturating_add(resident()?[0]);
    let group = read_text("/sys/fs/cgroup/memory.max").and_then(|most| most.trim().parse().ok());
    Some(left.min(group.unwrap_or(u64::MAX)))
}

fn read_text(path: &str) -> Option<String> {
    // Elsewhere there may be something else of that name.
    if cfg!(target_os = "linux") { std::fs::read_to_string(path).ok() } else { None }
}

/// The number of a line `name 123 kB`.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}
