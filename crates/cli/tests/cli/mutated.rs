//! Damaged scenes given to the program: an image or an error, in bounded time and in the memory that it states.

#![allow(clippy::print_stderr, reason = "how many scenes are rendered, in what time and memory, is a result")]

use crate::common::{Folder, TINY};
use dapple_scene::bundled;
use nix::sys::resource::{UsageWho, getrusage};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The program's limit of memory in MiB, as `--memory` states it. The largest seed takes some 50.
const STATED: u64 = 80;
/// The largest peak in MiB. The program's estimates hold within a tenth, which tests of its memory assert.
const PEAK: u64 = STATED + STATED / 10;
/// A fence of address space in KiB, far beyond the limit, that keeps the machine alive if the program runs away.
const FENCE: u64 = (STATED + 2048) * 1024;
const LIMIT: Duration = Duration::from_secs(60);
/// The largest size in bytes of a seed. Rendering larger ones takes most of the time and tries nothing more.
const LARGEST: usize = 400_000;

/// Numbers that damage goes for.
const NUMBERS: &str = "0 -1 1e30 -1e30 1e-30 1e-45 nan inf 2147483648 4294967296 99999999 0.5 3 65537";

/// Files of one scene; the first is the one to render.
type Seed = Vec<(String, Vec<u8>)>;

/// Damages a file `times` times: other numbers in text, lost or doubled lines and parts, changed bytes.
fn damage(bytes: &mut Vec<u8>, times: usize, random: &mut Pcg64Mcg) {
    for _ in 0..times {
        if bytes.is_empty() {
            return;
        }
        let at = random.random_range(0..bytes.len());
        let end = (at + random.random_range(1..64)).min(bytes.len());
        match random.random_range(0..6) {
            0 => bytes[at] = random.random(),
            1 => drop(bytes.drain(at..end)),
            2 => {
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            3 if random.random_range(0..8) == 0 => bytes.truncate(at),
            _ => {
                let digit = |b: &u8| b.is_ascii_digit() || b".-".contains(b);
                let Some(from) = bytes[at..].iter().position(digit).map(|n| at + n) else { continue };
                let to = bytes[from..].iter().position(|b| !digit(b)).map_or(bytes.len(), |n| from + n);
                let number = NUMBERS.split(' ').nth(random.random_range(0..14)).unwrap_or_default();
                bytes.splice(from..to, number.bytes());
            }
        }
    }
}

/// The seeds: bundled scenes with their meshes and textures, models and glTF with an image, and a scene that reads a mesh
/// and an image of every format.
fn seeds() -> Vec<Seed> {
    let bundles = bundled::names().iter().filter_map(|name| bundled::files(name));
    let mut seeds: Vec<Seed> = bundles.map(|bundle| bundle.files).collect();
    seeds.retain(|files| files.iter().map(|(_, bytes)| bytes.len()).sum::<usize>() < LARGEST);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds");
    let of = |kind: &str| -> Seed {
        let entries = std::fs::read_dir(folder.join(kind)).expect("seeds").map(|f| f.expect("a file").path());
        let name = |path: &Path| path.file_name().expect("a name").to_string_lossy().into_owned();
        let mut files: Seed = entries.map(|path| (name(&path), std::fs::read(&path).expect("a seed"))).collect();
        files.sort();
        files
    };
    let images = of("image");
    let image = images.iter().find(|(name, _)| name == "8.png").expect("an image").1.clone();
    for (kind, ending) in [("gltf", "gltf"), ("ply", "ply"), ("obj", "obj"), ("stl", "stl")] {
        for (name, bytes) in of(kind) {
            seeds.push(vec![(format!("{name}.{ending}"), bytes), ("p.png".into(), image.clone())]);
        }
    }
    let meshes = of("ply");
    for (k, (name, bytes)) in images.into_iter().enumerate() {
        let (mesh, mesh_bytes) = &meshes[k % meshes.len()];
        let more = format!(
            "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"{name}\"\nMaterial \"diffuse\" \"texture reflectance\" \"t\"\n\
             Shape \"sphere\"\nShape \"plymesh\" \"string filename\" \"{mesh}.ply\"\n"
        );
        let scene = TINY.to_owned() + &more;
        let mesh = (format!("{mesh}.ply"), mesh_bytes.clone());
        seeds.push(vec![("scene.pbrt".into(), scene.into_bytes()), (name, bytes), mesh]);
    }
    seeds
}

#[test]
fn damaged_scenes_end_in_an_image_or_an_error_within_time_and_memory_i01() {
    alone("damaged_scenes_end_in_an_image_or_an_error_within_time_and_memory_i01", 100);
}

#[test]
#[ignore = "five minutes"]
fn twenty_times_as_many_damaged_scenes_end_in_an_image_or_an_error_i01() {
    alone("twenty_times_as_many_damaged_scenes_end_in_an_image_or_an_error_i01", 3000);
}

/// Runs a test of this module in a process of its own, whose children's memory is that of damaged scenes.
fn alone(test: &str, scenes: usize) {
    const ALONE: &str = "DAPPLE_TEST_ALONE";
    if std::env::var_os(ALONE).is_some() {
        return render_damaged(scenes);
    }
    let mut again = Command::new(std::env::current_exe().expect("this program"));
    again.args(["--exact", &format!("mutated::{test}"), "--include-ignored", "--nocapture"]).env(ALONE, "1");
    assert!(again.status().expect("it starts").success());
}

fn render_damaged(scenes: usize) {
    let seeds = seeds();
    let mut random = Pcg64Mcg::seed_from_u64(23);
    // The undamaged seeds are the control: the program renders every one within the limit.
    let control: Vec<_> = seeds.iter().map(|seed| (seed.clone(), "a seed".into())).collect();
    for (seed, ended) in seeds.iter().zip(render_all(&control)) {
        assert!(ended.is_image, "{}: {}", seed[0].0, ended.said);
    }
    let mut damaged = |number: usize| {
        let mut seed = seeds[number % seeds.len()].clone();
        // Every second scene has its damage in a mesh or an image, if it has any.
        let file = if (number / seeds.len()).is_multiple_of(2) {
            0
        } else {
            random.random_range(1..seed.len().max(2)) % seed.len()
        };
        let times = if random.random() { 1 } else { random.random_range(2..5) };
        damage(&mut seed[file].1, times, &mut random);
        let name = format!("number {number} ({} of {})", seed[file].0, seed[0].0);
        (file > 0, (seed, name))
    };
    let (mut images, mut of_side_files, mut slowest) = (0, [0, 0], Duration::ZERO);
    // Some at a time, for their memory.
    for first in (0..scenes).step_by(64) {
        let (in_side_file, inputs): (Vec<_>, Vec<_>) = (first..scenes.min(first + 64)).map(&mut damaged).unzip();
        for (ended, in_side_file) in render_all(&inputs).into_iter().zip(in_side_file) {
            images += usize::from(ended.is_image);
            if in_side_file {
                of_side_files[usize::from(ended.is_image)] += 1;
            }
            slowest = slowest.max(ended.took);
        }
    }
    let peak = peak_of_children();
    eprintln!(
        "{images} of {scenes} were rendered, of those damaged in a mesh or an image {} of {}; slowest {slowest:?}, largest {peak} MiB",
        of_side_files[1],
        of_side_files[0] + of_side_files[1]
    );
    // Both outcomes must occur, or nothing was tested.
    assert!(images * 10 > scenes && images * 30 < scenes * 29, "{images} of {scenes} were rendered");
    assert!(of_side_files.iter().all(|n| n * 100 > scenes), "{of_side_files:?} with damaged meshes and images");
    assert!(slowest < LIMIT, "{slowest:?}");
}

struct Ended {
    is_image: bool,
    said: String,
    took: Duration,
}

/// The largest resident memory in MiB of any process that this one has waited for.
fn peak_of_children() -> u64 {
    // Linux counts in KiB.
    getrusage(UsageWho::RUSAGE_CHILDREN).expect("usage").max_rss() as u64 / 1024
}

/// Renders named scenes, as many at once as there are processors.
fn render_all(scenes: &[(Seed, String)]) -> Vec<Ended> {
    let at_once = std::thread::available_parallelism().map_or(1, usize::from);
    let share = scenes.len().div_ceil(at_once).max(1);
    std::thread::scope(|threads| {
        let one = |(seed, name): &(Seed, String)| render(seed, name);
        let running = scenes.chunks(share).map(|part| threads.spawn(move || part.iter().map(one).collect::<Vec<_>>()));
        let running: Vec<_> = running.collect();
        running.into_iter().flat_map(|part| part.join().expect("every scene ends as it should")).collect()
    })
}

/// Renders a scene in a folder of its own. Panics at a crash, a hang, and at more memory than stated.
fn render(seed: &Seed, name: &str) -> Ended {
    let folder = Folder::new();
    for (file, bytes) in seed {
        let path = folder.path(file);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        std::fs::write(path, bytes).expect("written");
    }
    let command = format!(
        "ulimit -v {FENCE} && exec \"$0\" render {} -o image.png --resolution 16x12 --spp 2 --memory {STATED}M",
        seed[0].0
    );
    let start = Instant::now();
    let mut child = Command::new("sh")
        .args(["-c", &command, env!("CARGO_BIN_EXE_dapple")])
        .current_dir(folder.path(""))
        .stderr(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let shown = || seed.iter().map(|(f, b)| format!("{f}:\n{}\n", String::from_utf8_lossy(b))).collect::<String>();
    let status = loop {
        match child.try_wait().expect("it can be waited for") {
            Some(status) => break status,
            None if start.elapsed() > LIMIT => {
                child.kill().expect("it can be ended");
                panic!("{name} takes over {LIMIT:?}:\n{}", shown());
            }
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    };
    let took = start.elapsed();
    let said = std::io::read_to_string(child.stderr.take().expect("its errors")).unwrap_or_default();
    let fine = matches!(status.code(), Some(0..=2)) && status.signal().is_none() && !said.contains("panicked");
    assert!(fine, "{name}: {status}\n{said}\n{}", shown());
    let peak = peak_of_children();
    assert!(peak <= PEAK, "{name}: {peak} MiB, and {STATED} were stated\n{said}\n{}", shown());
    let summary = std::io::read_to_string(child.stdout.take().expect("its summary")).unwrap_or_default();
    if status.success() {
        let [taken, expected] = memory(&summary).unwrap_or_else(|| panic!("{name}: no memory in {summary}"));
        assert!(taken <= 1.1 * expected + 8.0, "{name}: {taken} MiB of {expected}\n{}", shown());
    }
    Ended { is_image: status.success(), said, took }
}

/// The memory in MiB that a render's summary states as taken, and as expected.
fn memory(summary: &str) -> Option<[f64; 2]> {
    let (taken, expected) = summary.split_once("memory: ")?.1.split_once(" taken, ")?;
    let number = |text: &str| text.split(' ').next()?.parse().ok();
    Some([number(taken)?, number(expected)?])
}
