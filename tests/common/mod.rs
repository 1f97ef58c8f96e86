//! Examples as programs, for tests that run them.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The command that runs an example whose source lies in `examples/SOURCE`.
pub(crate) fn example(name: &str, source: &str) -> Command {
    built(name, source).map_or_else(|| run_by_cargo(name), Command::new)
}

/// The example as `cargo test` has just built it beside this test; `None` if only this test was built.
fn built(name: &str, source: &str) -> Option<PathBuf> {
    let test = std::env::current_exe().ok()?;
    let example = test.ancestors().nth(2)?.join("examples").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    let age = |path: &Path| path.metadata().and_then(|m| m.modified()).ok();
    // An example older than its source is out of date.
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples").join(source);
    (age(&example)? >= age(&source)?).then_some(example)
}

fn run_by_cargo(name: &str) -> Command {
    let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
    let mut command = Command::new(env!("CARGO"));
    command.args(["run", "--quiet", "--offline", "--locked", "--profile", profile, "--example", name, "--"]);
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}
