//! The memory of this process and of its machine, as Linux reports it.

/// The bytes of memory that this process uses now, and their peak so far; `None` if the system does not report them.
pub fn resident() -> Option<[u64; 2]> {
    let status = read_text("/proc/self/status")?;
    Some([kibibytes(&status, "VmRSS:")?, kibibytes(&status, "VmHWM:")?])
}

/// The bytes that this process may use in all: those it uses and the system's free ones, within the control group's
/// limit. `None` if the system does not report them.
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

/// The number in the line `name 123 kB` of `text`.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}
