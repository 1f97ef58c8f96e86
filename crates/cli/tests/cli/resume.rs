//! Renders that are killed, stopped and resumed, and images made in parts, as their user meets them (X01, X04 to X08).

use crate::common::{Folder, Said, signal};
use std::time::{Duration, Instant};

/// Some seconds of work on one thread; counts that adapt need the state between rounds.
const WORK: &str = "render tiny.pbrt --resolution 96x64 --max-depth 4";
const ADAPTIVE: &str = "--sampler mitchell --points random";

impl Folder {
    /// Waits until there is such a file, other than `before`.
    fn wait_for(&self, name: &str, before: &Option<Vec<u8>>) -> bool {
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(30) {
            if std::fs::read(self.path(name)).ok().is_some_and(|now| Some(&now) != before.as_ref()) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        false
    }

    fn same(&self, a: &str, b: &str) {
        assert!(self.read(a) == self.read(b), "{a} and {b} differ");
    }
}

/// Kills a render again and again, at moments that depend on nothing but `moments`, and goes on each time with other threads.
fn killed(words: &str, spp: u32, every: f64, moments: &[u64]) {
    let folder = Folder::new();
    folder.done(&format!("{WORK} {words} --spp {spp} -q -o whole.pfm"));
    let command =
        format!("{WORK} {words} --spp {spp} -q -o a.pfm --checkpoint c --resume c --checkpoint-every {every}");
    let (mut kills, mut begun) = (0, None);
    for (i, moment) in moments.iter().enumerate() {
        let mut child = folder.start(&format!("{command} --threads {}", 1 + i % 3));
        // It got further than the last one: then at any moment, in the middle of a write too.
        assert!(folder.wait_for("c", &begun), "no checkpoint after {kills} kills");
        std::thread::sleep(Duration::from_millis(*moment));
        if child.try_wait().expect("a child").is_none() {
            kills += 1;
        }
        child.kill().expect("SIGKILL");
        child.wait().expect("its end");
        begun = std::fs::read(folder.path("c")).ok();
        if folder.path("a.pfm").exists() {
            break;
        }
    }
    folder.done(&format!("{command} --threads 2"));
    folder.same("a.pfm", "whole.pfm");
    assert!(kills + 1 >= moments.len().min(2), "{kills} kills: the work is too short to be killed");
}

#[test]
fn killed_and_gone_on_with_x01() {
    killed("--sampler uniform", 96, 0.02, &[3, 0]);
    killed(ADAPTIVE, 64, 0.02, &[0, 5]);
}

#[test]
fn other_threads_and_filters_x05() {
    let folder = Folder::new();
    let words = "render tiny.pbrt -q --sampler variance --spp 24 --seed 3";
    folder.done(&format!("{words} --filter none -o whole.exr -o whole.pfm"));
    folder.done(&format!("{words} --filter none -o a.exr --threads 1 --checkpoint c --checkpoint-every 0.001"));
    folder.done(&format!("{words} --filter none -o b.pfm --threads 3 --resume c"));
    folder.same("b.pfm", "whole.pfm");
    // The budget that was met is met; a filter that reads what is there may follow.
    folder.done(&format!("{words} -o c.pfm --filter gaussian --resume c"));
    assert!(folder.read("c.pfm") != folder.read("b.pfm"));
    folder.says(&format!("{words} -o c.pfm --filter nlm --resume c"), 1, &["was one sequence, not two halves"]);
}

#[test]
fn samples_64_and_64_make_128_x06() {
    let folder = Folder::new();
    let words = "render tiny.pbrt -q --sampler uniform";
    folder.done(&format!("{words} --spp 128 -o whole.pfm"));
    folder.done(&format!("{words} --spp 64 -o half.pfm --checkpoint c"));
    folder.done(&format!("{words} --spp 128 -o all.pfm --resume c"));
    folder.same("all.pfm", "whole.pfm");
    assert!(folder.read("half.pfm") != folder.read("whole.pfm"));
    let fewer = format!("{words} --spp 32 -o less.pfm --resume c");
    folder.says(&fewer, 1, &["49152 samples are traced or planned already"]);
}

#[test]
fn another_render_is_refused_x04() {
    let folder = Folder::new();
    let words = "render tiny.pbrt --spp 2 --sampler uniform -q -o a.pfm";
    folder.done(&format!("{words} --checkpoint c"));
    let before = folder.read("c");
    let cases = [
        ("--seed 2", vec!["seed: 1, not 2", "points: sobol"]),
        ("--points halton", vec!["points: sobol"]),
        ("--sampler variance", vec!["sampler: uniform, not variance:"]),
        ("--resolution 12x8", vec!["resolution: 24x16, not 12x8", "window: 0,0,24,16, not 0,0,12,8"]),
        ("--max-depth 2", vec!["max depth: ", ", not 2"]),
        ("--pixel-filter box", vec!["pixel filter: "]),
        ("--light-selection uniform", vec!["light selection: learned, not uniform"]),
        ("--without interreflection", vec!["without: "]),
        ("--max-spp 9", vec!["samples per pixel: 1 to 4294967295, not 1 to 9"]),
    ];
    // Words are taken once each: those that are replaced are left out.
    for (other, expected) in cases {
        let name = other.split(' ').next().unwrap();
        let words = if name == "--sampler" { words.replace("--sampler uniform ", "") } else { words.to_owned() };
        let said = folder.says(&format!("{words} {other} --resume c"), 1, &expected);
        assert!(said.err.contains("error: c: the file belongs to another render; use the arguments"), "{}", said.err);
    }
    let scene = folder.text("tiny.pbrt").replace("[ 4 4 4 ]", "[ 4 4 5 ]");
    folder.write("tiny.pbrt", scene);
    folder.says(&format!("{words} --resume c"), 1, &["c: scene files: "]);
    folder.write("tiny.pbrt", crate::common::TINY);
    // What is no checkpoint, is none yet, or would be lost.
    for (word, expected) in [
        ("--resume tiny.pbrt", "tiny.pbrt: the file is not a Dapple file"),
        ("--resume missing", "missing: there is no such file; check the name of the checkpoint"),
        ("--checkpoint c", "c: a checkpoint exists; resume from it with --resume c"),
        ("--checkpoint d --resume missing", "missing: there is no such file; check the name of the checkpoint"),
        ("--checkpoint folder/c", "folder/c: cannot create a file in its folder"),
    ] {
        folder.says(&format!("{words} {word}"), 1, &[expected]);
    }
    folder.says(&format!("{words} --checkpoint-every 3"), 2, &["needs --checkpoint FILE"]);
    assert_eq!(folder.read("c"), before);
    folder.done(&format!("{words} --resume c"));
}

#[test]
fn a_damaged_checkpoint_gives_way_to_the_one_before_x03() {
    let folder = Folder::new();
    let words = "render tiny.pbrt --spp 2 --sampler uniform -q -o a.pfm";
    folder.done(&format!("{words} --checkpoint c"));
    folder.done(&format!("{} --resume c", words.replace("--spp 2", "--spp 4").replace("a.pfm", "b.pfm")));
    let mut bytes = folder.read("c");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    folder.write("c", &bytes);
    let again = words.replace("--spp 2", "--spp 4").replace("a.pfm", "again.pfm");
    let warning =
        "warning: c: the file is damaged (a checksum is wrong); resuming from the previous version of the checkpoint";
    folder.says(&format!("{again} --resume c"), 0, &[warning]);
    folder.same("again.pfm", "b.pfm");
}

#[cfg(unix)]
#[test]
fn a_signal_leaves_image_and_checkpoint_x08() {
    for (name, first) in [("INT", "--checkpoint c"), ("TERM", "--checkpoint c --resume c")] {
        let folder = Folder::new();
        let words = "render tiny.pbrt --sampler uniform --resolution 64x48";
        let child = folder.start(&format!("{words} --spp 100000 -q -o a.pfm -o a.exr {first}"));
        assert!(folder.wait_for("c", &None), "no checkpoint");
        // One writer at a time.
        folder.says(
            &format!("{words} --spp 1 -q -o b.pfm --resume c"),
            1,
            &["c: another process is writing to this file"],
        );
        std::thread::sleep(Duration::from_millis(100));
        let asked = Instant::now();
        signal(&child, name);
        let said = Said::of(child.wait_with_output().expect("it ends"));
        assert!(asked.elapsed() < Duration::from_secs(2), "{:?}", asked.elapsed());
        assert_eq!(said.status, Some(130), "{}", said.err);
        assert!(said.err.ends_with("interrupted: to resume, repeat the command with --resume c\n"), "{}", said.err);
        let size = folder.read("a.pfm").len();
        assert!(size > 12 * 64 * 48);
        // The image is that of the checkpoint: no sample is lost.
        assert_eq!(folder.names(), ["a.exr", "a.pfm", "c", "c.lock", "c.previous"]);
        assert_eq!(folder.header("a.exr", "interrupted"), "true");
    }
}

/// Its filter alone would take longer than the two seconds that stopping may take.
#[cfg(unix)]
#[test]
fn a_large_image_is_left_unfiltered_by_a_signal_x08() {
    let folder = Folder::new();
    let child = folder.start(
        "render tiny.pbrt --resolution 512x384 --spp 100000 --threads 1 -o a.exr --checkpoint c --checkpoint-every 0.1",
    );
    assert!(folder.wait_for("c", &None), "no checkpoint");
    signal(&child, "INT");
    let said = Said::of(child.wait_with_output().expect("it ends"));
    assert!(said.status == Some(130) && said.err.contains("the image is not filtered"), "{}", said.err);
    assert_eq!(folder.header("a.exr", "filter"), "none");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_tried_again_x08() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("full")).unwrap();
    // As if the disk were full: where the part would go there is a link to a device that is.
    std::os::unix::fs::symlink("/dev/full", folder.path("full/c.part")).unwrap();
    let words = "render tiny.pbrt --sampler uniform --resolution 32x24 --spp 400 -q";
    let child = folder.start(&format!("{words} -o a.pfm --checkpoint full/c --checkpoint-every 0.01"));
    let said = Said::of(child.wait_with_output().expect("it ends"));
    assert_eq!(said.status, Some(0), "{}", said.err);
    assert!(said.err.contains("full/c: cannot "), "{}", said.err);
    folder.done(&format!("{words} -o b.pfm"));
    folder.same("a.pfm", "b.pfm");
    // If every try fails, the image is written, and the status tells scripts that nothing can be resumed.
    std::fs::create_dir(folder.path("full/d.part")).unwrap();
    let words = format!("{words} -o c.pfm --checkpoint full/d --checkpoint-every 0.01");
    folder.says(&words, 3, &["full/d: cannot create a file in its folder"]);
    folder.same("a.pfm", "c.pfm");
}

/// One file by two names is one checkpoint.
#[test]
fn a_checkpoint_is_known_by_its_file_not_its_name() {
    let folder = Folder::new();
    folder.done("render tiny.pbrt --sampler uniform --spp 4 -q -o a.pfm --checkpoint c");
    folder.done("render tiny.pbrt --sampler uniform --spp 9 -q -o a.pfm --checkpoint ./c --resume c");
    folder.done("render tiny.pbrt --sampler uniform --spp 9 -q -o b.pfm");
    folder.same("a.pfm", "b.pfm");
}

#[test]
fn shards_make_the_image_of_one_machine_x07() {
    let folder = Folder::new();
    for (words, of) in [
        ("render tiny.pbrt --sampler uniform --spp 9.5 --seed 4 --max-depth 3", 3),
        ("render tiny.pbrt --sampler cluster-thesis --spp 16 --filter cluster-gaussian --crop 3,2,21,15", 4),
        ("render room --resolution 24x16 --light-choice power --sampler uniform --spp 2", 2),
    ] {
        folder.done(&format!("{words} -q -o whole.exr -o whole.pfm -o whole.png"));
        let names: Vec<String> = (1..=of).rev().map(|i| format!("{i}.shard")).collect();
        for (i, name) in names.iter().enumerate() {
            let out = folder.done(&format!("{words} --threads {} --part {}/{of} -o {name}", 1 + i % 2, of - i));
            assert!(out.contains("dapple merge makes the image of all parts"), "{out}");
        }
        let all = names.join(" ");
        let json = folder.line(&format!("merge {all} --json -o all.exr -o all.pfm -o all.png"));
        for extension in ["pfm", "png"] {
            folder.same(&format!("all.{extension}"), &format!("whole.{extension}"));
        }
        folder.same_channels("all.exr", "whole.exr");
        let alone = folder.line(&format!("{words} --json -o b.pfm"));
        assert_eq!((&json["samples"], &json["sampler"]), (&alone["samples"], &alone["sampler"]));
    }
}

/// Parts that do not fit are refused before they are read, and a filter that does not fit before it runs.
#[test]
fn a_merge_that_does_not_fit_is_refused() {
    let folder = Folder::new();
    let words = "render tiny.pbrt --resolution 256x256 --sampler uniform --spp 1 -q";
    // The former name of --part is still accepted.
    for part in ["--part 1/2", "--shard 2/2"] {
        folder.done(&format!("{words} {part}"));
    }
    let merge = "merge tiny-1-of-2.part tiny-2-of-2.part -o a.pfm";
    for (limit, what) in [("16", "merging these parts takes "), ("60", "creating the image takes ")] {
        folder.says(&format!("{merge} --memory {limit}M"), 1, &[what, &format!("the limit is {limit}.0 MiB")]);
    }
    assert!(!folder.names().contains(&"a.pfm".to_owned()));
    folder.done(&format!("{merge} -q --memory 1G"));
    assert!(folder.names().contains(&"a.pfm".to_owned()));
}

#[test]
fn shards_that_make_no_image_x07() {
    let folder = Folder::new();
    let words = "render tiny.pbrt --resolution 24x64 --sampler uniform --spp 2 -q";
    let unfiltered = format!("{words} --filter none");
    for shard in ["1/3", "2/3", "3/3"] {
        folder.done(&format!("{unfiltered} --part {shard}"));
    }
    folder.done(&format!("{} --part 2/3 -o more.shard", unfiltered.replace("--spp 2", "--spp 3")));
    folder.done(&format!("{words} --part 2/3 --filter gaussian -o filtered.shard"));
    let [a, b, c] = [1, 2, 3].map(|i| format!("tiny-{i}-of-3.part"));
    for (shards, expected) in [
        (
            format!("{a} filtered.shard {c}"),
            format!("filtered.shard: the part belongs to another render than {a}: filter: gaussian"),
        ),
        (format!("{a} more.shard {c}"), "more.shard: the rows belong to another stage".into()),
    ] {
        folder.says(&format!("merge {shards} -q -o p.pfm"), 1, &[&expected]);
    }
    assert!(!folder.path("p.pfm").exists());
    for (other, status, expected) in [
        ("--part 1/2 --sampler variance", 1, "or render in stages (dapple plan)"),
        ("--part 1/17 --sampler uniform", 1, "the rendered window has 16 rows; use at most 16 parts"),
        ("--part 1/2 --sampler uniform --light-choice cells", 2, "needs samples of the whole image"),
        ("--part 0/2", 2, "is not a part; write I/N"),
        ("--part 3/2", 2, "is not a part; write I/N"),
        ("--part 1/2 --time 3", 2, "cannot be used with"),
        ("--part 1/2 -o a.png", 2, "a .part file"),
        ("-o a.part", 2, "needs --part I/N"),
    ] {
        folder.says(&format!("render tiny.pbrt -q {other}"), status, &[expected]);
    }
    // A scene that moved, and one that changed.
    std::fs::create_dir(folder.path("new")).unwrap();
    std::fs::rename(folder.path("tiny.pbrt"), folder.path("new/tiny.pbrt")).unwrap();
    folder.says(&format!("merge {a} {b} {c} -q -o p.pfm"), 1, &["tiny.pbrt: no such file or bundled scene"]);
    folder.done(&format!("merge {a} {b} {c} -q -o p.pfm --scene new/tiny.pbrt"));
    let scene = folder.text("new/tiny.pbrt").replace("[ 4 4 4 ]", "[ 4 4 5 ]");
    folder.write("new/tiny.pbrt", scene);
    folder.says(&format!("merge {a} {b} {c} -q -o p.pfm --scene new/tiny.pbrt"), 1, &["scene files: "]);
}
