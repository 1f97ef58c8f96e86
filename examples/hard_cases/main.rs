//! The catalogue of hard cases.
//!
//! ```text
//! cargo run --example hard_cases                             prints docs/results/hard-cases.md as it should be
//! cargo run --example hard_cases -- --write                  writes it
//! cargo run --example hard_cases -- --mutations [NAME]...    takes safeguards out, one by one, in a copy of the tree, and
//!                                                            notes whether their tests fail (half an hour)
//! ```
#![allow(clippy::print_stdout, unreachable_pub)]

mod catalogue;
mod mutations;

use std::path::{Path, PathBuf};
use std::process::Command;

fn main() -> Result<(), String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.first().map(String::as_str) {
        Some("--mutations") => mutate(root, &words[1..])?,
        Some("--write") => {}
        _ => {
            println!("{}", page(root)?);
            return Ok(());
        }
    }
    let path = root.join("docs/results/hard-cases.md");
    std::fs::write(&path, page(root)?).map_err(|e| format!("{}: {e}", path.display()))
}

fn page(root: &Path) -> Result<String, String> {
    Ok(catalogue::page(&catalogue::cases(root)?, &catalogue::tests(root)?, &mutations::section(root)?))
}

fn mutate(root: &Path, names: &[String]) -> Result<(), String> {
    let git = |words: &[&str], at: &Path| {
        let output = Command::new("git").args(words).current_dir(at).output().map_err(|e| format!("git: {e}"))?;
        let said = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        if output.status.success() { Ok(said) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
    };
    // A clone with a target of its own, kept between runs: third-party crates are compiled once.
    let tree: PathBuf = root.join("target/mutations");
    let commit = git(&["rev-parse", "--short", "HEAD"], root)?;
    if !tree.join(".git").exists() {
        git(&["clone", "--shared", &root.to_string_lossy(), &tree.to_string_lossy()], root)?;
    }
    git(&["fetch", "--quiet", &root.to_string_lossy(), "HEAD"], &tree)?;
    git(&["checkout", "--quiet", "--force", "--detach", "FETCH_HEAD"], &tree)?;
    for m in mutations::mutations(root)?.iter().filter(|m| names.is_empty() || names.contains(&m.name)) {
        let (outcome, seconds) = m.run(&tree, &commit)?;
        println!(
            "{:<24} {} ({seconds:.0} s) {}",
            m.name,
            if outcome.caught { "caught" } else { "NOT CAUGHT" },
            outcome.said
        );
        note(root, &m.name, &outcome)?;
    }
    Ok(())
}

/// Keeps an outcome in the file of outcomes, names in order.
fn note(root: &Path, name: &str, outcome: &mutations::Outcome) -> Result<(), String> {
    let path = root.join("tests/mutations/outcomes.toml");
    let text = std::fs::read_to_string(&path).unwrap_or_default();
    let of_another = |line: &&str| !line.starts_with(&format!("{name} = "));
    let mut lines: Vec<String> = text.lines().filter(of_another).map(str::to_owned).collect();
    let said: String = outcome.said.chars().filter(|c| !"\"\\".contains(*c) && !c.is_control()).collect();
    lines.push(format!(
        "{name} = {{ caught = {}, said = \"{said}\", commit = \"{}\" }}",
        outcome.caught, outcome.commit
    ));
    lines.sort();
    std::fs::write(&path, lines.join("\n") + "\n").map_err(|e| format!("{}: {e}", path.display()))
}
