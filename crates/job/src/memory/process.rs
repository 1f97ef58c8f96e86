//! The memory of this process and of its machine, as Linux reports it.

/// The resident memory of this process in bytes: the present value, then the peak so far. `None` if the system does not
/// report them.
pub fn resident() -> Option<[u64; 2]> {
    let status = read_text("/proc/self/status")?;
    Some([kibibytes(&status, "VmRSS:")?, kibibytes(&status, "VmHWM:")?])
}

/// The memory in bytes that this process may use in total: the part in use plus the system's free memory, at most the
/// control group's limit. `None` if the system does not report these values.
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

/// The value in bytes of the line `name 123 kB` in `text`; `None` without such a line.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}
