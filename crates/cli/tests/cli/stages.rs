//! Renders in stages, as their user meets them.

use crate::common::Folder;

/// Renders in stages of `of` parts; returns the number of stages.
fn staged(folder: &Folder, words: &str, of: u32) -> u32 {
    let said = folder.done(&format!("{words} -o 0.plan"));
    assert!(said.contains("0.plan: a plan; "), "{said}");
    for stage in 0..30 {
        let parts: Vec<String> = (1..=of).rev().map(|part| format!("{stage}-{part}.part")).collect();
        for (i, part) in parts.iter().enumerate() {
            let (shard, threads) = (of - i as u32, 1 + i % 2);
            folder.done(&format!("render --from {stage}.plan --part {shard}/{of} --threads {threads} -o {part}"));
        }
        // Without --from, the plan is the one that the parts name.
        let said = folder.done(&format!("plan {} -o {}.plan", parts.join(" "), stage + 1));
        if said.contains("done") {
            return stage + 1;
        }
    }
    panic!("it has no end");
}

#[test]
fn stages_make_the_default_image_of_one_machine() {
    let folder = Folder::new();
    for (words, of, expected) in [
        ("render room --resolution 16x50 --spp 17", 3, 6),
        ("render tiny.pbrt --max-depth 4 --sampler uniform --light-selection power --spp 5", 2, 1),
        ("render tiny.pbrt --max-depth 4 --error 0.05 --max-spp 64", 2, 4),
    ] {
        folder.done(&format!("{words} -q -o whole.exr -o whole.pfm"));
        let stages = staged(&folder, words, of);
        assert_eq!(stages, expected, "{words}");
        folder.done(&format!("merge {stages}.plan -o all.exr -o all.pfm"));
        assert!(folder.read("all.pfm") == folder.read("whole.pfm"), "{words}");
        folder.same_channels("all.exr", "whole.exr");
    }
}

#[test]
fn wrong_plans_and_parts_are_refused() {
    let folder = Folder::new();
    let words = "render tiny.pbrt --resolution 24x64 --max-depth 4 --sampler uniform --light-selection power --spp 2";
    folder.done(&format!("{words} -o 0.plan"));
    folder.done(&format!("{words} --seed 9 -o other.plan"));
    folder.done("render --from 0.plan --part 1/2 -o 1.part");
    folder.done("render --from other.plan --part 2/2 -o foreign.part");
    folder.done("render --from 0.plan --part 2/2 -o 2.part");
    folder.write("cut.part", &folder.read("2.part")[..200]);
    let long = folder.read("0.plan").len();
    folder.write("cut.plan", &folder.read("0.plan")[..long - 9]);
    let before = folder.read("0.plan");
    for (words, expected) in [
        ("plan 1.part -o 1.plan", "are missing; pass every part exactly once"),
        ("plan 1.part 1.part 2.part -o 1.plan", "1.part: the rows were joined already"),
        ("plan 1.part foreign.part -o 1.plan", "foreign.part: the part belongs to another render than 1.part: "),
        ("plan 1.part cut.part -o 1.plan", "cut.part: the file is "),
        ("plan 1.part nowhere.part -o 1.plan", "nowhere.part: there is no such file; check the name of the part"),
        ("plan 1.part 2.part -o 0.plan", "this file is --from (0.plan); write to another"),
        ("plan 1.part 2.part -o 1.part", "a file name that ends in .plan is required"),
        ("plan 0.plan -o 1.plan", "not of the kind needed here"),
        ("render --from cut.plan --part 1/2 -o 3.part", "cut.plan: the file is truncated"),
        ("render tiny.pbrt -o a.png --checkpoint c --resume 0.plan", "not of the kind needed here"),
        ("merge 0.plan -o a.png", "0.plan: samples are left to trace"),
        ("render --from 1.part --part 1/2 -o 3.part", "not of the kind needed here"),
        ("render --from 0.plan -o 3.part", "--part"),
        ("render --from 0.plan --part 1/2 -o a.png", "a .part file"),
        ("render tiny.pbrt -o 3.part", "a .part file needs --part I/N"),
        ("render tiny.pbrt --time 3 -o 3.plan", "no common clock"),
        ("render tiny.pbrt --sampler uniform --part 1/2 -o 3.plan", "a single --output, a .part file"),
        ("plan -o 1.plan", "required"),
    ] {
        let said = folder.run(words);
        assert!(said.status != Some(0) && said.err.contains(expected), "{words}: {}", said.err);
    }
    assert!(folder.read("0.plan") == before && !folder.path("1.plan").exists() && !folder.path("3.part").exists());
    // A plan that is newer than the parts.
    folder.done("plan 1.part 2.part -o 1.plan");
    folder.says("plan --from 1.plan 1.part 2.part -o 2.plan", 1, &["the plan is done"]);
    folder.says("render --from 1.plan --part 1/2 -o 3.part", 1, &["all samples are traced"]);
}

#[test]
fn a_full_disk_leaves_no_half_part_and_no_half_plan() {
    let folder = Folder::new();
    folder.done("render tiny.pbrt --max-depth 4 --resolution 96x64 --sampler uniform --spp 1 -o 0.plan");
    folder.done("render --from 0.plan --part 1/1 -o 1.part");
    for (words, file) in [("render --from 0.plan --part 1/1 -o 2.part", "2.part"), ("plan 1.part -o 1.plan", "1.plan")]
    {
        // A limit on the size of files stands in for a full disk.
        let said = folder.limited("-f 4", words);
        let written = format!("{file}: cannot write the file: ");
        assert!(said.status != Some(0) && said.err.contains(&written), "{}", said.err);
    }
    assert_eq!(folder.names(), ["0.plan", "1.part"]);
}
