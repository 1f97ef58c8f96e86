//! Examples as programs: the renderer of a hundred lines, five that keep their loop with a plug of a few lines each, and the
//! generator of scenes.

use dapple_core::samplers::Uniform;
use dapple_core::{Draws, Frame, Limits, Session, Tile};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The command that runs an example whose source lies in `examples/SOURCE`.
fn example(name: &str, source: &str) -> Command {
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

/// The output of an example that succeeds, and the numbers among its words.
fn output_of(name: &str, source: &str, arguments: &[&Path]) -> (String, Vec<f64>) {
    let output = example(name, source).args(arguments).output().expect("it starts");
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8(output.stdout).expect("UTF-8");
    let numbers = said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    (said, numbers)
}

const MINIMAL: &str = include_str!("../../examples/minimal.rs");

#[test]
fn a_hundred_lines_on_core_and_points_alone() {
    assert!(MINIMAL.lines().count() <= 100, "{} lines", MINIMAL.lines().count());
    let longest = MINIMAL.lines().map(|l| l.chars().count()).max();
    assert!(longest.is_some_and(|n| n <= 120), "{longest:?}: no line hides another");
    let uses: Vec<&str> = MINIMAL.match_indices("dapple_").map(|(at, _)| &MINIMAL[at + 7..]).collect();
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
    let (said, errors) = output_of("minimal", "minimal.rs", &[folder.path()]);
    // Measured: 2.2 times.
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
fn computed_files_of_bundled_scenes_are_what_the_generator_makes() {
    let folder = tempfile::tempdir().expect("a folder");
    let _ = output_of("generate_scenes", "generate_scenes/main.rs", &[folder.path()]);
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/scene/src/bundled");
    let (made, committed) = (files(folder.path()), files(&committed));
    assert_eq!((made.len(), committed.len()), (11, 27), "{:?}", made.keys());
    for (name, bytes) in &made {
        assert!(committed.get(name) == Some(bytes), "{} differs: cargo run --example generate_scenes", name.display());
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

/// The name of each example, its source, and the largest part of the plain image's error that Dapple's may have.
/// Measured: 0.070, 0.088, 0.078, 0.145 and 0.141.
const PLUGS: [(&str, &str, f64); 5] = [
    ("rng_everywhere", include_str!("../../examples/plugs/rng_everywhere.rs"), 0.15),
    ("own_sampler", include_str!("../../examples/plugs/own_sampler.rs"), 0.1),
    ("global_generator", include_str!("../../examples/plugs/global_generator.rs"), 0.12),
    ("wavefront", include_str!("../../examples/plugs/wavefront.rs"), 0.2),
    ("viewer", include_str!("../../examples/plugs/viewer.rs"), 0.2),
];
const PAGE: &str = include_str!("../../docs/book/src/your-renderer.md");

/// A source up to its plug, the plug, and the rest.
fn parts(text: &str) -> [&str; 3] {
    let (before, rest) = text.split_once("// --- plug\n").expect("the plug begins");
    let (plug, after) = rest.split_once("// --- end of plug\n").expect("the plug ends");
    [before, plug, after]
}

#[test]
fn each_plug_has_at_most_15_lines_and_the_host_does_not_know_dapple() {
    for (name, text, _) in PLUGS {
        let [before, plug, after] = parts(text);
        // The line that records the first hit belongs to the host's loop.
        let counts = |line: &&str| !line.trim().is_empty() && !line.contains("FirstHit::new");
        let lines = plug.lines().filter(counts).count();
        assert!((10..=15).contains(&lines), "{name}: {lines} lines");
        assert!(plug.lines().all(|line| line.chars().count() <= 120), "{name}: no line hides another");
        assert!(plug.contains("dapple::default_pair"), "{name}");
        assert!(![before, after].iter().any(|part| part.contains("dapple::")), "{name}: the host knows Dapple");
        assert!(before.lines().count() + after.lines().count() < 175, "{name} is a small host");
    }
}

#[test]
fn the_page_names_each_plug() {
    assert!(PLUGS.iter().all(|(name, ..)| PAGE.contains(&format!("/examples/plugs/{name}.rs)"))));
}

#[test]
fn each_plug_lowers_the_error() {
    for (name, _, most) in PLUGS {
        let (said, numbers) = output_of(name, &format!("plugs/{name}.rs"), &[]);
        let [plain, dapple, part] = numbers[..] else { panic!("{name}: {said}") };
        assert!((dapple / plain - part).abs() < 0.01 && dapple > 0.0 && part < most, "{name}: {said}");
    }
}

/// The part of an error of `Round::submit` that the page quotes, after a mistake with a tile of 16 pixels and 2 samples each.
fn submitted(mistake: impl FnOnce(&mut Tile<'_>, &Draws<'_>, &Tile<'_>)) -> String {
    let points = dapple::points("sobol", 1).expect("a point set");
    let mut session = Session::new(Frame::new(8, 8).expect("a frame"), Limits::spp(2.0), Uniform::new(points))
        .expect("a session")
        .with_tile_side(4);
    let round = session.next_round().expect("a plan").expect("a round");
    let (mut tile, other) = (round.next_tile().expect("a tile"), round.next_tile().expect("a tile"));
    let mut samples: Vec<_> = tile.samples().collect();
    let last = samples.pop().expect("a sample");
    samples.iter().for_each(|sample| tile.add(sample, [1.0; 3]));
    mistake(&mut tile, &last, &other);
    let text = round.submit(tile).expect_err("a mistake").to_string();
    text.split_once("was not accepted: ").expect("the tile is named").1.to_owned()
}

#[test]
fn the_page_quotes_errors_as_they_are() {
    let twice = |tile: &mut Tile<'_>, last: &Draws<'_>| (0..2).for_each(|_| tile.add(last, [1.0; 3]));
    let texts = [
        submitted(|_, _, _| ()),
        submitted(|tile, last, _| twice(tile, last)),
        submitted(|tile, _, other| tile.add(&other.samples().next().expect("a sample"), [1.0; 3])),
    ];
    for text in texts {
        let quoted = text.split_once("belongs").map_or(text.clone(), |(_, rest)| format!("… belongs{rest}"));
        assert!(PAGE.contains(&format!("`{quoted}`")), "the page does not quote: {text}");
    }
}
