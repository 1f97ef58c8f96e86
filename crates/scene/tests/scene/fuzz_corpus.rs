//! The fuzz targets' functions on their seeds, so that a build without `cargo fuzz` sees failures at once.
//!
//! The seeds are in `fuzz/seeds` and `tests/corpus`, inputs that once broke something in `fuzz/found`.

#![allow(clippy::print_stderr)] // How long the slowest input took is told.

#[allow(unreachable_pub)] // A library of its own where cargo-fuzz builds it.
#[path = "../../../../fuzz/src/lib.rs"]
mod targets;

use crate::corpus::files::cases;
use rand::{RngExt, SeedableRng};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Name and function.
type Target = (&'static str, fn(&[u8]));

const TARGETS: [Target; 7] = [
    ("scene", targets::scene),
    ("ply", targets::ply),
    ("obj", targets::obj),
    ("gltf", targets::gltf),
    ("stl", targets::stl),
    ("image", targets::image),
    ("geometry", targets::geometry),
];

/// The inputs of a target in `fuzz/seeds` (small files of every kind, made from our own scenes) or `fuzz/found` (inputs
/// that once broke something), by name.
fn inputs(folder: &str, target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz")).join(folder).join(target);
    let mut paths: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().map(|e| e.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// Seeds, inputs that once broke something, and each damaged in a hundred ways: no panic, and none takes long.
#[test]
fn readers_survive_seeds_and_damaged_seeds_i01() {
    const MOST: Duration = Duration::from_secs(1);
    let slowest = std::thread::scope(|threads| {
        let running = TARGETS.map(|(target, run)| threads.spawn(move || slowest_of(target, run)));
        running.into_iter().map(|one| one.join().expect("no reader panics")).max()
    });
    let slowest = slowest.expect("there are targets");
    // Told, not judged: other tests share the machine.
    eprintln!("slowest input: {slowest:?} (at most {MOST:?} is asked for)");
    assert!(slowest < 10 * MOST, "{slowest:?}");
}

/// Gives a target its inputs and a hundred damaged copies of each. Returns the longest time that one took.
fn slowest_of(target: &str, run: fn(&[u8])) -> Duration {
    let mut random = rand_pcg::Pcg64::seed_from_u64(1);
    let mut slowest = Duration::ZERO;
    let mut timed = |bytes: &[u8]| {
        let start = Instant::now();
        run(bytes);
        slowest = slowest.max(start.elapsed());
    };
    let mut seeds = inputs("seeds", target);
    let corpus = cases().into_iter().filter(|case| case.target == target);
    seeds.extend(corpus.flat_map(|case| case.files).map(|(_, bytes)| bytes));
    assert!(!seeds.is_empty(), "{target} has no seeds");
    for input in seeds.iter().chain(&inputs("found", target)) {
        timed(input);
        for _ in 0..100 {
            let mut bytes = input.clone();
            for _ in 0..random.random_range(1..6) {
                let (from, to) = (random.random_range(0..bytes.len()), random.random_range(0..bytes.len()));
                match random.random_range(0..4) {
                    0 => bytes[from] ^= 1 << random.random_range(0..8),
                    1 => bytes[from] = random.random(),
                    2 => bytes[from] = bytes[to],
                    // A piece twice: numbers grow, lists repeat.
                    _ => {
                        let piece = bytes[from.min(to)..from.max(to).min(from.min(to) + 16)].to_vec();
                        bytes.splice(from..from, piece);
                    }
                }
            }
            timed(&bytes);
        }
    }
    slowest
}

/// Ten minutes of damaged glTF files, those of the scenes of others included, without a panic or a slow file.
///
/// A stand-in for cargo-fuzz, without its guidance by coverage: each input that was read goes on to be damaged further.
#[test]
#[ignore = "ten minutes: cargo test -p dapple-scene --test fuzz_corpus -- --ignored --nocapture"]
fn gltf_survives_ten_minutes_of_damage_i01() {
    let mut pool = inputs("seeds", "gltf");
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let scenes = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from).join("gltf");
    let shared = ["BoxTextured/glTF-Binary/BoxTextured.glb", "bevy/CornellBox/CornellBox.glb"];
    for path in shared.map(|name| scenes.join(name)) {
        match std::fs::read(&path) {
            Ok(bytes) => pool.push(bytes),
            Err(_) => eprintln!("skipped: {} is not there", path.display()),
        }
    }
    let first = pool.len();
    let mut random = rand_pcg::Pcg64::seed_from_u64(600);
    let (began, mut slowest, mut inputs, mut read) = (Instant::now(), Duration::ZERO, 0_u64, 0_u64);
    while began.elapsed() < Duration::from_secs(600) {
        let mut bytes = pool[random.random_range(0..pool.len())].clone();
        let other = pool[random.random_range(0..pool.len())].clone();
        (0..random.random_range(1..4)).for_each(|_| damage(&mut bytes, &other, &mut random));
        let start = Instant::now();
        targets::gltf(&bytes);
        slowest = slowest.max(start.elapsed());
        inputs += 1;
        let files: &[(&str, &[u8])] = &[("m.gltf", &bytes), ("p.png", &bytes)];
        if inputs.is_multiple_of(8) && dapple_scene::read_any_from(files, "m.gltf", &Default::default()).is_ok() {
            read += 1;
            // What is read replaces an earlier descendant, so that damage adds up, and the first files stay.
            if pool.len() < 256 {
                pool.push(bytes);
            } else {
                let at = random.random_range(first..pool.len());
                pool[at] = bytes;
            }
        }
    }
    eprintln!("{inputs} inputs in 600 s, slowest {slowest:?}; of every eighth, {read} could be read");
    assert!(read > inputs / 8 / 20, "too few files are read for their contents to be tried: {read}");
    assert!(slowest < Duration::from_secs(10), "{slowest:?}");
}

/// One damage: a bit, a byte, a number, a lost or doubled piece, or a piece of another file.
fn damage(bytes: &mut Vec<u8>, other: &[u8], random: &mut rand_pcg::Pcg64) {
    const NUMBERS: [&str; 12] =
        ["0", "-1", "1", "2", "3", "1e39", "-1e-30", "0.5", "255", "65536", "4294967295", "18446744073709551615"];
    if bytes.is_empty() || other.is_empty() {
        return;
    }
    let at = random.random_range(0..bytes.len());
    let end = (at + random.random_range(1..32)).min(bytes.len());
    match random.random_range(0..8) {
        0 => bytes[at] ^= 1 << random.random_range(0..8),
        1 => bytes[at] = random.random(),
        2 => drop(bytes.drain(at..end)),
        3 => {
            let piece = bytes[at..end].to_vec();
            bytes.splice(at..at, piece);
        }
        4 => {
            let from = random.random_range(0..other.len());
            let to = (from + random.random_range(1..64)).min(other.len());
            bytes.splice(at..end, other[from..to].iter().copied());
        }
        _ => {
            let digit = |b: &u8| b.is_ascii_digit() || b".-".contains(b);
            let Some(from) = bytes[at..].iter().position(digit).map(|n| at + n) else { return };
            let to = bytes[from..].iter().position(|b| !digit(b)).map_or(bytes.len(), |n| from + n);
            bytes.splice(from..to, NUMBERS[random.random_range(0..NUMBERS.len())].bytes());
        }
    }
}
