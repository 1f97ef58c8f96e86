//! Damaged scenes given to the program: an image or an error, in bounded time and memory.

mod common;

use common::Folder;
use rand::{RngExt, SeedableRng};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The program's limit of memory in MiB, as `--memory` states it.
const STATED: u32 = 1024;
/// The address space in KiB: the stated memory, and what the program's code, stacks and allocator reserve beside it.
const GRANTED: u32 = (STATED + 1024) * 1024;
const LIMIT: Duration = Duration::from_secs(60);

/// Numbers that damage goes for.
const NUMBERS: [&str; 14] = [
    "0",
    "-1",
    "1e30",
    "-1e30",
    "1e-30",
    "1e-45",
    "nan",
    "inf",
    "2147483648",
    "4294967296",
    "99999999",
    "0.5",
    "3",
    "65537",
];

/// One to four damages of a file: other numbers in text, lost or doubled lines and parts, changed bytes.
fn damaged(bytes: &[u8], random: &mut rand_pcg::Pcg64Mcg) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..random.random_range(1..5) {
        if bytes.is_empty() {
            return bytes;
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
                let number = NUMBERS[random.random_range(0..NUMBERS.len())];
                bytes.splice(from..to, number.bytes());
            }
        }
    }
    bytes
}

#[test]
fn damaged_scenes_end_in_an_image_or_an_error_within_time_and_memory() {
    render_damaged(300);
}

#[test]
#[ignore = "half a minute"]
fn ten_times_as_many_damaged_scenes_end_in_an_image_or_an_error() {
    render_damaged(3000);
}

fn render_damaged(scenes: usize) {
    let folder = Folder::new();
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds");
    let mut files = Vec::new();
    for (kind, ending) in [("scene", "pbrt"), ("gltf", "gltf"), ("ply", "ply"), ("obj", "obj"), ("stl", "stl")] {
        let mut here: Vec<_> =
            std::fs::read_dir(seeds.join(kind)).expect("seeds").map(|f| f.expect("a file").path()).collect();
        here.sort();
        files.extend(here.into_iter().map(|path| (std::fs::read(&path).expect("a seed"), ending)));
    }
    files.push((common::TINY.as_bytes().to_vec(), "pbrt"));
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(23);
    let (mut images, mut slowest) = (0, Duration::ZERO);
    for number in 0..scenes {
        let (bytes, ending) = &files[number % files.len()];
        let bytes = damaged(bytes, &mut random);
        let name = format!("damaged.{ending}");
        std::fs::write(folder.path(&name), &bytes).expect("written");
        let command = format!(
            "ulimit -v {GRANTED} && exec \"$0\" render {name} -o image.png --resolution 16x12 --spp 2 --memory {STATED}M -q"
        );
        let start = Instant::now();
        let mut child = Command::new("sh")
            .args(["-c", &command, env!("CARGO_BIN_EXE_dapple")])
            .current_dir(folder.path(""))
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("it starts");
        let status = loop {
            match child.try_wait().expect("it can be waited for") {
                Some(status) => break status,
                None if start.elapsed() > LIMIT => {
                    child.kill().expect("it can be ended");
                    panic!("number {number} ({name}) takes over {LIMIT:?}:\n{}", String::from_utf8_lossy(&bytes));
                }
                None => std::thread::sleep(Duration::from_millis(2)),
            }
        };
        slowest = slowest.max(start.elapsed());
        let said = std::io::read_to_string(child.stderr.take().expect("its errors")).unwrap_or_default();
        let fine = matches!(status.code(), Some(0..=2)) && status.signal().is_none() && !said.contains("panicked");
        assert!(fine, "number {number} ({name}): {status}\n{said}\n{}", String::from_utf8_lossy(&bytes));
        images += usize::from(status.success());
    }
    // Both outcomes must occur, or nothing was tested.
    assert!(images * 10 > scenes && images * 30 < scenes * 29, "{images} of {scenes} were rendered");
    assert!(slowest < LIMIT, "{slowest:?}");
}
