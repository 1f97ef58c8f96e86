//! Renders that do not fit into memory are refused before they start, and the estimate is right (Z03).

#![allow(clippy::print_stderr, reason = "tests say when they skip, and what they measure")]

use crate::common::{Folder, Said};

const MIB: f64 = 1024.0 * 1024.0;

/// The bytes that follow `before`, as people read them.
fn bytes_after(text: &str, before: &str) -> Option<f64> {
    let (_, rest) = text.split_once(before)?;
    let mut words = rest.split_whitespace();
    let number: f64 = words.next()?.parse().ok()?;
    let unit = words.next()?.trim_matches(|c: char| !c.is_alphabetic());
    Some(number * MIB * if unit == "GiB" { 1024.0 } else { 1.0 })
}

#[test]
fn what_does_not_fit_is_refused_before_it_starts_z03() {
    let folder = Folder::new();
    let refused = |words: &str| -> Said {
        let clock = std::time::Instant::now();
        let said = folder.run(&format!("render {words} -o a.exr --maps maps"));
        assert_eq!((said.status, said.out.as_str()), (Some(1), ""), "{words}: {}", said.err);
        assert!(clock.elapsed() < std::time::Duration::from_secs(10), "{words}");
        assert!(folder.names().is_empty() || folder.names() == ["maps"], "{words}: {:?}", folder.names());
        said
    };
    // The film alone, before the scene is built: 28 bytes a pixel at least.
    let said = refused("tiny.pbrt --resolution 65535x65535 --spp 1 --memory 20G");
    let film = bytes_after(&said.err, ", film ").expect("the film");
    assert!(film >= 112.0 * 1024.0 * 0.99 * MIB && said.err.contains("20.0 GiB is the limit (--memory)"), "{film}");
    assert!(said.err.contains("--crop") && folder.names().is_empty(), "{}", said.err);
    // The film fits, the filter does not.
    // Rows in memory make it large for a wide image.
    let said = refused("tiny.pbrt --resolution 4096x256 --spp 2 --memory 500M");
    assert!(said.err.contains("film 196.0 MiB, filter 3") && said.err.contains("--filter none"), "{}", said.err);
    let sum = bytes_after(&said.err, "this render needs ").expect("the sum") / MIB;
    assert!((536.0..636.0).contains(&sum), "{}", said.err);
    // A discarded pilot keeps statistics of its own, a checkpoint is a copy of the film.
    let keep = refused("tiny.pbrt --resolution 1024x1024 --filter none --sampler cluster --memory 64M");
    let discard =
        refused("tiny.pbrt --resolution 1024x1024 --filter none --sampler cluster:policy=discard --memory 64M");
    let [keep, discard] = [keep, discard].map(|said| bytes_after(&said.err, ", film ").expect("the film"));
    assert_eq!(discard - keep, 40.0 * MIB);
    let words = "render tiny.pbrt --resolution 1024x1024 --filter none --sampler cycles -o a.pfm";
    let said = folder.run(&format!("{words} --memory 64M --checkpoint c"));
    assert!(said.err.contains("checkpoint 64.0 MiB"), "{}", said.err);
    // Files are read whole.
    folder.write("long.pbrt", vec![b' '; 3 << 20]);
    folder.says("render long.pbrt --memory 2M", 1, &["the file has 3.0 MiB"]);
    // A subdivision surface is refused before it is made: a pyramid of 2^22 triangles would take some 300 MiB.
    let pyramid = "Shape \"loopsubdiv\" \"integer levels\" [ 10 ] \"integer indices\" [ 0 1 2 0 2 3 0 3 1 1 3 2 ]\n\
        \"point3 P\" [ 0 0 1 1 0 0 -1 1 0 -1 -1 0 ]\n";
    folder.write("fine.pbrt", crate::common::TINY.to_owned() + pyramid);
    let said = folder.run("render fine.pbrt --memory 100M -o a.pfm");
    assert!(said.err.contains("fine.pbrt:13: Shape \"loopsubdiv\" would make 4194304 triangles"), "{}", said.err);
    assert!(said.status == Some(1) && said.err.contains("are allowed in total (memory limit)"), "{}", said.err);
    // The tree of a scene is known before it is built.
    folder.says("render terrain --memory 40M --resolution 8x8", 1, &["the scene alone does not fit"]);
    // What fits is made, and no limit is needed for that.
    folder.done("render tiny.pbrt --spp 1 --memory 2G -o a.pfm");
    for wrong in ["0", "-1", "2X", "G", "nan"] {
        assert_eq!(folder.run(&format!("render tiny.pbrt --memory={wrong}")).status, Some(2), "{wrong}");
    }
}

/// Sums beyond 64 bits, and images of more pixels than have numbers.
#[test]
fn sizes_that_overflow_are_refused_z03() {
    let folder = Folder::new();
    for resolution in ["65537x65537", "4294967295x4294967295"] {
        folder.says(&format!("render tiny.pbrt --resolution {resolution} --memory 1000T"), 2, &[]);
    }
    folder.says("render tiny.pbrt --resolution 65535x65537 --memory 100G", 1, &["this render needs 112."]);
}

/// Without a limit of the user's, what the machine has is one.
#[cfg(target_os = "linux")]
#[test]
fn images_larger_than_the_machine_are_refused_z03() {
    let available = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let available = available.lines().find_map(|line| line.strip_prefix("MemAvailable:"));
    let available = available.and_then(|rest| rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    if available.is_none_or(|kibibytes| kibibytes > 100 << 20) {
        eprintln!("skipped: a machine that has room for a film of 128 GiB, or does not tell what it has");
        return;
    }
    let folder = Folder::new();
    let said = folder.run("render tiny.pbrt --resolution 65535x65535 --spp 1 -o a.png");
    assert_eq!((said.status, said.out.as_str()), (Some(1), ""));
    assert!(
        said.err.contains("is all the memory available (--memory SIZE") && said.err.contains("--crop"),
        "{}",
        said.err
    );
    assert!(folder.names().is_empty(), "{:?}", folder.names());
}

/// The memory in a render's summary, and the peak that the system measured.
#[cfg(target_os = "linux")]
struct Taken {
    line: String,
    seen: f64,
}

#[cfg(target_os = "linux")]
fn taken(folder: &Folder, words: &str) -> Taken {
    let mut child = folder.start(words);
    let status = format!("/proc/{}/status", child.id());
    let mut seen = 0.0_f64;
    while child.try_wait().expect("a status").is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let most = text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse().ok());
        seen = seen.max(most.unwrap_or(0.0) * 1024.0);
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let said = Said::of(child.wait_with_output().expect("its output"));
    assert_eq!(said.status, Some(0), "{words}: {}", said.err);
    let line = said.out.lines().find(|line| line.starts_with("memory: ")).expect("a line about memory").to_owned();
    Taken { line, seen }
}

#[cfg(target_os = "linux")]
#[test]
fn estimates_hold_within_a_tenth_z03() {
    let folder = Folder::new();
    if std::fs::read_to_string("/proc/self/status").is_err() {
        eprintln!("skipped: no /proc here, which tells what memory a process has");
        return;
    }
    let cases = [
        ("--spp 1 --filter none --sampler uniform --resolution 1000x800 --threads 1", "files"),
        ("--spp 2 --resolution 400x300 --threads 1", "filter"),
        ("--spp 2 --resolution 400x300 --threads 2", "filter"),
        ("--filter none --error 1e-9 --max-spp 8 --resolution 480x360", "files"),
    ];
    for (words, stage) in cases {
        let Taken { line, seen } = taken(&folder, &format!("render tiny.pbrt -o a.pfm {words}"));
        let expected = bytes_after(&line, "taken, ").expect("what was expected");
        let own = bytes_after(&line, "memory: ").expect("what was taken");
        assert!((0.98..1.02).contains(&(own / seen)), "{words}: it says {own}, the system {seen}");
        let ratio = expected / seen;
        eprintln!("{words}: {line}, {ratio:.3} of {:.1} MiB", seen / MIB);
        assert!((0.9..1.1).contains(&ratio), "{words}: {line}, seen {seen}");
        // Negative control: without its largest stage, or without the film, the estimate is off by more than a tenth.
        for part in [stage, "film"] {
            let part = bytes_after(&line, &format!("{part} ")).unwrap_or_else(|| panic!("{line} has no {part}"));
            assert!((expected - part) / seen < 0.9, "{words}: {line} would do without {part}");
        }
    }
}
