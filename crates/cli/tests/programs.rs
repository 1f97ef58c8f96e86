//! Files of this program in other programs: OpenEXR's own library and Blender, which `bash .ci/python` installs.

mod common;

use common::Folder;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A Python with `bpy`, `OpenEXR` and `numpy`.
fn python() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let said = Command::new("bash").arg(root.join(".ci/python")).output().expect("bash runs");
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    String::from_utf8(said.stdout).expect("a path").trim().into()
}

fn script(name: &str, arguments: &[&str]) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/results").join(name);
    let run = Command::new(python()).arg(file).args(arguments).output().expect("Python runs");
    let out = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(run.status.success(), "{out}\n{}", String::from_utf8_lossy(&run.stderr));
    out
}

#[test]
#[ignore = "needs Blender as a Python package, which it installs (some 400 MB)"]
fn exr_files_are_read_by_openexr_and_blender() {
    let folder = Folder::new();
    let out = script("exr_in_programs.py", &[env!("CARGO_BIN_EXE_dapple"), &folder.path("").to_string_lossy()]);
    assert!(out.contains("ok ") && !out.contains("WRONG"), "{out}");
}

/// Ten materials under three lights: means of blocks in both programs. The rows of the page are made with more files and samples.
#[test]
#[ignore = "needs Blender as a Python package, which it installs (some 400 MB); 3 minutes"]
fn gltf_files_look_as_in_cycles() {
    let folder = Folder::new();
    let out = script("gltf_cycles.py", &[env!("CARGO_BIN_EXE_dapple"), &folder.path("").to_string_lossy()]);
    let number = |before: &str| -> f64 {
        let rest = &out[out.find(before).unwrap_or_else(|| panic!("{before} in {out}")) + before.len()..];
        rest.split_whitespace().next().expect("a word").trim_end_matches(',').parse().expect("a number")
    };
    assert!((number("ratio ") - 1.0).abs() < 0.01, "{out}");
    assert!(number("blocks within 3 %: ") > 85.0, "{out}");
    assert!((number("median ") - 1.0).abs() < 0.01, "{out}");
}
