//! Two examples that run without a scene: `minimal.rs`, a hundred lines on core and points, and `generate_scenes`.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const TEXT: &str = include_str!("../examples/minimal.rs");

#[test]
fn a_hundred_lines_on_core_and_points_alone() {
    assert!(TEXT.lines().count() <= 100, "{} lines", TEXT.lines().count());
    let longest = TEXT.lines().map(|l| l.chars().count()).max();
    assert!(longest.is_some_and(|n| n <= 120), "{longest:?}: no line hides another");
    let uses: Vec<&str> = TEXT.match_indices("dapple::").map(|(at, _)| &TEXT[at + 8..]).collect();
    assert!(
        uses.len() >= 3
            && uses
                .iter()
                .all(|u| u.starts_with("adaptive") || u.starts_with("core") || u.starts_with("low_discrepancy"))
    );
}

#[test]
fn it_draws_and_the_adaptive_image_is_better() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = common::example("minimal", "minimal.rs").arg(folder.path()).output().expect("it starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8(output.stdout).expect("UTF-8");
    let errors: Vec<f64> = said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    // Measured: 2.5 times.
    assert!(errors.len() == 2 && errors[0] > 1.8 * errors[1] && errors[1] > 0.0, "{said}");
    for name in ["uniform.ppm", "adaptive.ppm", "samples.ppm"] {
        let pixels = pixels(&folder.path().join(name));
        let mean = pixels.iter().map(|&p| f64::from(p)).sum::<f64>() / pixels.len() as f64;
        let span = pixels.iter().max().zip(pixels.iter().min()).map(|(high, low)| high - low);
        assert!(mean > 10.0 && span.is_some_and(|s| s > 200), "{name}: {mean} {span:?}");
    }
}

fn pixels(path: &Path) -> Vec<u8> {
    let file = std::fs::read(path).expect("it was written");
    let head = b"P6\n240 135\n255\n";
    assert!(file.starts_with(head) && file.len() == head.len() + 3 * 240 * 135);
    file[head.len()..].to_vec()
}

#[test]
fn bundled_scenes_are_what_the_generator_makes() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = common::example("generate_scenes", "generate_scenes/main.rs").arg(folder.path()).output();
    let output = output.expect("it starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/scene/src/bundled");
    let (made, committed) = (files(folder.path()), files(&committed));
    assert!(made.keys().eq(committed.keys()) && made.len() == 27, "{:?}", made.keys());
    for (name, bytes) in &made {
        assert!(committed[name] == *bytes, "{} differs: cargo run --example generate_scenes", name.display());
    }
}

/// Path and bytes of each file in the folders of a folder.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries =
        |folder: &Path| std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let scenes = entries(folder).filter(|path| path.is_dir());
    let paths = scenes.flat_map(|scene| entries(&scene).collect::<Vec<_>>());
    let named = |path: &Path| path.strip_prefix(folder).expect("within the folder").to_owned();
    paths.map(|path| (named(&path), std::fs::read(&path).expect("a file"))).collect()
}
