//! Files of this program in other programs: OpenEXR's own library and Blender, which `bash .ci/python` installs.

#![allow(clippy::print_stderr, reason = "tests say when they skip")]

use crate::common::Folder;
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

/// The shared glTF files that are there; the others are named.
fn shared_files() -> Vec<String> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes");
    let folder = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from).join("gltf");
    let names =
        ["BoxTextured/glTF-Binary/BoxTextured.glb", "Suzanne/glTF/Suzanne.gltf", "bevy/CornellBox/CornellBox.glb"];
    let (here, missing): (Vec<_>, Vec<_>) =
        names.map(|name| folder.join(name)).into_iter().partition(|path| path.exists());
    missing.iter().for_each(|path| eprintln!("skipped: {} is not there", path.display()));
    here.into_iter().map(|path| path.to_string_lossy().into_owned()).collect()
}

/// The number that follows `before` in the line of the output that begins with `line`.
fn number(out: &str, line: &str, before: &str) -> f64 {
    let found = out.lines().find_map(|text| text.strip_prefix(line)?.split_once(before));
    let rest = found.unwrap_or_else(|| panic!("{line}{before} in {out}")).1;
    rest.split([',', ';']).next().expect("a word").trim().parse().expect("a number")
}

/// Materials that dapple and Cycles define alike.
const COMMON: [&str; 8] = [
    "matte",
    "plastic, rough 1",
    "plastic, rough 0.6",
    "plastic, rough 0.25",
    "metal, rough 0.3",
    "half metal",
    "coated",
    "lamp",
];

/// Ten materials, and three files of others. Materials that both programs define alike agree within 3 %; the others are
/// named here, with the ratios that their definitions lead to.
#[test]
#[ignore = "needs Blender as a Python package, which it installs (some 400 MB); 15 minutes"]
fn gltf_files_look_as_in_cycles() {
    let folder = Folder::new();
    let files = shared_files();
    let directory = folder.path("").to_string_lossy().into_owned();
    let mut arguments = vec![env!("CARGO_BIN_EXE_dapple"), &directory];
    arguments.extend(files.iter().map(String::as_str));
    let out = script("gltf_cycles.py", &arguments);
    let within = |scene: &str, material: &str, range: std::ops::Range<f64>| {
        let ratio = number(&out, &format!("{scene}, {material}"), ": ");
        assert!(range.contains(&ratio), "{scene}, {material}: {ratio}\n{out}");
    };
    COMMON.iter().for_each(|material| within("lamps", material, 0.97..1.03));
    // Inside an evenly shining shell only sums over all directions count, which are alike for rough metal, too.
    COMMON.iter().chain(&["metal, rough 0.8"]).for_each(|material| within("shell", material, 0.97..1.03));
    assert_eq!(number(&out, "shell: ", "blocks within 3 %: "), 100.0, "{out}");
    // Light between microfacets leaves rough metal in all directions here, and like the reflection itself in Cycles.
    within("lamps", "metal, rough 0.8", 1.05..1.15);
    // Rough glass loses that light here. Cycles without it agrees.
    within("lamps", "glass, rough 0.3", 0.92..0.97);
    within("lamps-single-scattering", "glass, rough 0.3", 0.97..1.03);
    for file in &files {
        let name = Path::new(file).file_stem().expect("a name").to_string_lossy().into_owned();
        let [given, matte] = [format!("{name}: "), format!("{name}-matte: ")];
        assert!(number(&out, &matte, "blocks within 3 %: ") >= 97.0, "{out}");
        assert!(number(&out, &given, "blocks within 3 %: ") >= 85.0, "{out}");
        for scene in [given, matte] {
            assert!((number(&out, &scene, "mean ") - 1.0).abs() < 0.01, "{scene}: {out}");
            assert!((number(&out, &scene, "median ") - 1.0).abs() < 0.01, "{scene}: {out}");
        }
    }
}
