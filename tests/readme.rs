//! The README's commands and code are run, not trusted.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

const README: &str = include_str!("../README.md");
const GUIDE: &str = include_str!("../docs/ADDING-A-SAMPLER.md");

/// Fenced blocks of one language.
fn blocks(text: &str, language: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut open: Option<Vec<&str>> = None;
    for line in text.lines() {
        match &mut open {
            None if line.strip_prefix("```") == Some(language) => open = Some(Vec::new()),
            Some(lines) if line == "```" => {
                found.push(lines.join("\n"));
                open = None;
            }
            Some(lines) => lines.push(line),
            None => {}
        }
    }
    found
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_owned()
}

/// Runs Rust code as an example of this workspace would run, in a folder of its own.
fn run_as_program(name: &str, code: &str) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    let source = folder.path().join("src");
    std::fs::create_dir(&source).expect("src");
    let manifest = format!(
        "[package]\nname = \"{name}\"\nedition = \"2024\"\n[dependencies]\ndapple = {{ path = {root:?}, default-features = false, features = [\"low-discrepancy\"] }}\n\
         dapple-core = {{ path = {core:?} }}\n[workspace]\n",
        root = root(),
        core = root().join("crates/core"),
    );
    std::fs::write(folder.path().join("Cargo.toml"), manifest).expect("manifest");
    std::fs::copy(root().join("Cargo.lock"), folder.path().join("Cargo.lock")).expect("lock");
    std::fs::write(source.join("main.rs"), code).expect("code");
    let output = Command::new(env!("CARGO"))
        .args(["run", "--quiet", "--offline"])
        .env("CARGO_TARGET_DIR", root().join("target/readme"))
        .current_dir(folder.path())
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn the_code_runs() {
    let code = blocks(README, "rust");
    assert_eq!(code.len(), 1, "one program in the README");
    let said = run_as_program("readme", &code[0]);
    assert!(said.starts_with("16384 samples, "), "{said}");
}

#[test]
fn the_guide_compiles() {
    let code = blocks(GUIDE, "rust");
    assert_eq!(code.len(), 1, "one sampler in the guide");
    let main = r#"
fn main() -> Result<(), Box<dyn std::error::Error>> {
    use dapple::core::*;
    struct Ramp;
    impl Integrator for Ramp {
        fn estimate(&self, draws: &Draws<'_>, _: &mut TrainingLog) -> Estimate {
            Estimate::new([draws.pixel()[0] as f32; 3])
        }
    }
    let mut sampler = Brightness::new(dapple::low_discrepancy::Sobol::new(1));
    let film = Render::new(Frame::new(8, 8)?, &Limits::samples(1000)).run(&mut Ramp, &mut sampler)?;
    println!("{} {}", film.record().samples, film.count(7) > film.count(0));
    Ok(())
}
"#;
    assert_eq!(run_as_program("guide", &format!("{}\n{main}", code[0])), "1000 true\n");
}

/// The commands of the README's shell blocks, as they stand.
fn commands() -> Vec<String> {
    blocks(README, "sh").iter().flat_map(|b| b.lines().map(str::to_owned).collect::<Vec<_>>()).collect()
}

/// What a clone of this repository types before it has installed the program.
const FIRST: &str = "cargo run --release -p dapple-cli --";

/// The program as `cargo test --workspace` builds it for the tests of `dapple-cli`, which is nothing to do where that is what
/// runs. What differs from the README is the profile alone: `.ci/run` runs its command as it stands.
fn dapple() -> Command {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    Command::new(PROGRAM.get_or_init(|| {
        let mut build = Command::new(env!("CARGO"));
        build.args(["test", "--quiet", "--offline", "--workspace", "--no-run", "--test", "words"]);
        if !cfg!(debug_assertions) {
            build.arg("--release");
        }
        let output = build.current_dir(root()).output().expect("cargo runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let test = std::env::current_exe().expect("a test is a program");
        let folder = test.ancestors().nth(2).expect("tests lie in target/PROFILE/deps");
        folder.join(format!("dapple{}", std::env::consts::EXE_SUFFIX))
    }))
}

#[test]
fn the_render_command_makes_image_and_map() {
    let command = commands().into_iter().find(|c| c.starts_with("cargo run")).expect("a render command");
    let words = command.strip_prefix(FIRST).expect("the program of this workspace");
    let ci = std::fs::read_to_string(root().join(".ci/run")).expect(".ci/run");
    assert!(ci.lines().any(|line| line.trim() == command), ".ci/run does not run `{command}`");
    let folder = tempfile::tempdir().expect("a folder");
    let output = dapple()
        .args(words.split_whitespace())
        .args(["--resolution", "32x20", "--spp", "8"])
        .current_dir(folder.path())
        .output()
        .expect("it runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for file in ["teapot.exr", "teapot.png", "teapot-samples.png"] {
        assert!(folder.path().join(file).is_file(), "{file} is missing");
    }
}

/// `dapple …` as it stands, on a bundled scene under the name that the README uses, small and short.
#[test]
fn the_other_commands_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = root().join("examples/scenes/cornell/scene.pbrt");
    std::fs::copy(scene, folder.path().join("scene.pbrt")).expect("a scene of one file");
    let lines: Vec<String> = commands().into_iter().filter(|c| c.starts_with("dapple ")).collect();
    assert!(lines.len() >= 5, "{lines:?}");
    for line in lines {
        let words: Vec<&str> = line.split_whitespace().skip(1).map(|w| if w == "30" { "0.2" } else { w }).collect();
        let output = dapple()
            .args(&words)
            .args(match words[0] {
                "effects" => &["--resolution", "16x12", "--spp", "4"][..],
                "study" => &["--resolution", "16x12", "--spp", "1,2"],
                "render" => &["--resolution", "16x12", "--max-spp", "64"],
                _ => &[],
            })
            .current_dir(folder.path())
            .output()
            .expect("it runs");
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    }
    for made in ["study/report.html", "maps/samples.png", "maps/clusters.png", "scene.exr", "scene.png"] {
        assert!(folder.path().join(made).is_file(), "{made} is missing");
    }
}

#[test]
fn the_test_command_is_the_one_that_ci_runs() {
    let test = commands().into_iter().find(|c| c.starts_with("cargo test")).expect("a test command");
    let ci = std::fs::read_to_string(root().join(".ci/run")).expect(".ci/run");
    assert!(ci.lines().any(|l| l.trim() == test), ".ci/run does not run `{test}`");
}

#[test]
fn every_file_that_is_named_is_there() {
    for name in README
        .split(&['(', ')'][..])
        .filter(|w| w.starts_with("docs/") || w.starts_with("examples/") || w.starts_with("LICENSE"))
    {
        assert!(root().join(name).exists(), "README names {name}, which is not there");
    }
}
