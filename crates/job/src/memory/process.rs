//! The memory of this process and of its machine, as Linux reports it.

/// Bytes of memory that this process has now, and the most that it ever had; `None` where the system does not tell.
pub fn resident() -> Option<[u64; 2]> {
    let status = read_text("/proc/self/status")?;
    Some([kibibytes(&status, "VmRSS:")?, kibibytes(&status, "VmHWM:")?])
}

/// Bytes that this process may have in all: its own and the system's free ones, within the limit of its control group.
/// `None` where the system does not tell.
pub fn available() -> Option<u64> {
    let free = kibibytes(&read_text("/proc/meminfo")?, "MemAvailable:")?;
    let left = free.saturating_add(resident()?[0]);
    let group = read_text("/sys/fs/cgroup/memory.max").and_then(|most| most.trim().parse().ok());
    Some(left.min(group.unwrap_or(u64::MAX)))
}

fn read_text(path: &str) -> Option<String> {
    // Other systems may have another file of that name.
    if cfg!(target_os = "linux") { std::fs::read_to_string(path).ok() } else { None }
}

/// The number of a line `name 123 kB`.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}
