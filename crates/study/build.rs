//! Finds the git commit of the build, for `study.json` and reports: the environment variable `DAPPLE_COMMIT`, else the commit
//! recorded in a published package, else the repository's commit. An empty text means unknown.

#![allow(clippy::print_stdout)]

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-env-changed=DAPPLE_COMMIT");
    println!("cargo:rerun-if-changed=build.rs");
    let package = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let package = Path::new(&package);
    let given = std::env::var("DAPPLE_COMMIT").ok().filter(|commit| !commit.is_empty());
    let commit = given.or_else(|| of_package(package)).or_else(|| of_repository(package)).unwrap_or_default();
    println!("cargo:rustc-env=DAPPLE_BUILD_COMMIT={}", commit.trim());
}

/// The commit that `cargo package` recorded.
fn of_package(package: &Path) -> Option<String> {
    let record = std::fs::read_to_string(package.join(".cargo_vcs_info.json")).ok()?;
    let (_, rest) = record.split_once("\"sha1\"")?;
    Some(rest.split('"').nth(1)?.chars().take(12).collect())
}

/// The commit that is checked out, with a `+` appended if tracked files have changes. `None` if the repository around the
/// package is not Dapple's.
fn of_repository(package: &Path) -> Option<String> {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").arg("-C").arg(package).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let root = std::fs::canonicalize(git(&["rev-parse", "--show-toplevel"])?).ok()?;
    if root.join("crates/study") != std::fs::canonicalize(package).ok()? {
        return None;
    }
    // A new commit, or a change of a source file, runs this script again.
    let folder = git(&["rev-parse", "--absolute-git-dir"])?;
    for file in ["HEAD", "logs/HEAD"].map(|name| Path::new(&folder).join(name)).iter().filter(|file| file.exists()) {
        println!("cargo:rerun-if-changed={}", file.display());
    }
    for krate in std::fs::read_dir(root.join("crates")).ok()?.flatten() {
        println!("cargo:rerun-if-changed={}", krate.path().join("src").display());
    }
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|files| !files.is_empty());
    Some(if changed { format!("{commit}+") } else { commit })
}
