//! Messages between processes that mpirun starts. Without mpirun, the tests report that they are skipped.

#![expect(clippy::print_stderr, reason = "tests report what they skip")]

use std::path::PathBuf;
use std::process::{Command, Output};

/// Runs the example `messages` by `mpirun`; `None` if it is not installed.
fn messages(processes: u32, arguments: &[&str]) -> Option<Output> {
    if Command::new("mpirun").arg("--version").output().is_err() {
        eprintln!("skipped: mpirun is not installed (apt-get install openmpi-bin)");
        return None;
    }
    let program: PathBuf = std::env::current_exe().ok()?.parent()?.parent()?.join("examples/messages");
    let count = processes.to_string();
    let all = ["--allow-run-as-root", "--oversubscribe", "-n", &count];
    Some(Command::new("mpirun").args(all).arg(program).args(arguments).output().expect("mpirun runs"))
}

#[test]
fn messages_of_any_length_arrive_whole() {
    // The second limit cuts each message in many pieces; the third one in single bytes.
    for limit in ["1000000", "40", "1"] {
        for processes in [1, 2, 3] {
            let Some(output) = messages(processes, &[limit]) else { return };
            let text = String::from_utf8_lossy(&output.stdout);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            assert_eq!(text.trim(), format!("{processes} processes"));
        }
    }
}

#[test]
fn a_process_that_dies_ends_all() {
    let Some(output) = messages(3, &["1000000", "1"]) else { return };
    assert!(!output.status.success());
    assert!(!String::from_utf8_lossy(&output.stdout).contains("processes"), "the others did not go on");
}
