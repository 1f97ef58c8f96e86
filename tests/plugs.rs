//! `examples/plugs/`: three renderers that know nothing of Dapple but for a plug of a few lines each.

mod common;

use dapple::core::samplers::Uniform;
use dapple::core::{Draws, Frame, Limits, Session, Tile};

/// The name of each example, its source, and the largest part of the plain image's error that Dapple's may have.
/// Measured: 0.080, 0.083 and 0.142.
const PLUGS: [(&str, &str, f64); 3] = [
    ("rng_everywhere", include_str!("../examples/plugs/rng_everywhere.rs"), 0.15),
    ("own_sampler", include_str!("../examples/plugs/own_sampler.rs"), 0.1),
    ("wavefront", include_str!("../examples/plugs/wavefront.rs"), 0.2),
];
const PAGE: &str = include_str!("../docs/book/src/your-renderer.md");

/// A source up to its plug, the plug, and the rest.
fn parts(text: &str) -> [&str; 3] {
    let (before, rest) = text.split_once("// --- plug\n").expect("the plug begins");
    let (plug, after) = rest.split_once("// --- end of plug\n").expect("the plug ends");
    [before, plug, after]
}

#[test]
fn each_plug_has_under_25_lines_and_the_host_does_not_know_dapple() {
    for (name, text, _) in PLUGS {
        let [before, plug, after] = parts(text);
        let lines = plug.lines().filter(|line| !line.trim().is_empty()).count();
        assert!((10..25).contains(&lines), "{name}: {lines} lines");
        assert!(plug.lines().all(|line| line.chars().count() <= 120), "{name}: no line hides another");
        assert!(plug.contains("dapple::default_pair"), "{name}");
        assert!(![before, after].iter().any(|part| part.contains("dapple::")), "{name}: the host knows Dapple");
        assert!(before.lines().count() + after.lines().count() < 175, "{name} is a small host");
    }
}

#[test]
fn the_page_shows_the_plugs_as_they_are() {
    for (name, text, _) in PLUGS {
        let [_, plug, _] = parts(text);
        assert!(PAGE.contains(&format!("```rust,ignore\n{plug}```\n")), "{name}: the page shows another plug");
    }
}

#[test]
fn each_plug_lowers_the_error() {
    for (name, _, most) in PLUGS {
        let output = common::example(name, &format!("plugs/{name}.rs")).output().expect("it starts");
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let said = String::from_utf8(output.stdout).expect("UTF-8");
        let numbers: Vec<f64> = said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
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
    text.split_once("was not taken: ").expect("the tile is named").1.to_owned()
}

#[test]
fn the_page_quotes_errors_as_they_are() {
    let twice = |tile: &mut Tile<'_>, last: &Draws<'_>| (0..2).for_each(|_| tile.add(last, [1.0; 3]));
    let texts = [
        submitted(|_, _, _| ()),
        submitted(|tile, last, _| twice(tile, last)),
        submitted(|tile, _, other| tile.add(&other.samples().next().expect("a sample"), [1.0; 3])),
        submitted(|tile, _, _| tile.push([0, 0], [1.0; 3])),
        submitted(|tile, last, _| tile.add_all(std::slice::from_ref(last), [[1.0; 3]; 0])),
    ];
    for text in texts {
        let quoted = text.split_once("belongs").map_or(text.clone(), |(_, rest)| format!("… belongs{rest}"));
        assert!(PAGE.contains(&format!("`{quoted}`")), "the page does not quote: {text}");
    }
}
