//! `dapple study` as its user meets it.

use crate::common::{Folder, Said, signal};
use dapple_study::Plan;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Small enough to be made often.
const SMALL: &str = "--set scenes=tiny.pbrt --set resolution=12x8 --set spp=[2,4] --set seeds=2 --set reference_spp=32";

impl Folder {
    /// The runs of a study, by what tells them apart.
    fn study(&self, folder: &str) -> BTreeMap<String, serde_json::Value> {
        let text = self.text(&format!("{folder}/runs.jsonl"));
        let run = |line: &str| {
            let run: serde_json::Value = serde_json::from_str(line).expect("JSON");
            (format!("{} {} {} {}", run["scene"], run["method"], run["budget"], run["seed"]), run)
        };
        let runs: BTreeMap<_, _> = text.lines().map(run).collect();
        assert_eq!(runs.len(), text.lines().count(), "no run twice");
        runs
    }

    fn manifest(&self, folder: &str) -> serde_json::Value {
        serde_json::from_slice(&self.read(&format!("{folder}/study.json"))).expect("JSON")
    }

    /// The number of lines; 0 while the file is missing.
    fn lines(&self, folder: &str) -> usize {
        std::fs::read(self.path(folder).join("runs.jsonl")).map_or(0, |b| b.iter().filter(|b| **b == b'\n').count())
    }
}

#[test]
fn a_study_is_made_with_one_command() {
    let folder = Folder::new();
    let out = folder.done(&format!("study {SMALL} -o s"));
    assert!(out.contains("runs.jsonl") && out.contains("study.json"), "{out}");
    let runs = folder.study("s");
    // Four methods, two budgets and one of time, two seeds.
    assert_eq!(runs.len(), 4 * 3 * 2);
    for (what, run) in &runs {
        assert!(run["render_s"].as_f64().expect("seconds") > 0.0, "{what}");
        assert!(run["errors"]["relmse"].is_f64() && run["errors"]["flip"].as_f64() > Some(0.0), "{what}");
        assert_eq!(run["fresh"], false, "{what}");
    }
    let clustered = |(what, run): &(&String, &serde_json::Value)| {
        what.contains("cluster-regression") && run["seconds"]["cluster"].as_f64() > Some(0.0)
    };
    assert!(runs.iter().any(|r| clustered(&r)), "clusters are timed");
    let first = runs.values().find(|r| r["seed"] == 1).expect("a first seed");
    for key in ["image", "sample_map"] {
        folder.read(&format!("s/{}", first[key].as_str().expect("a file")));
    }
    let manifest = folder.manifest("s");
    assert_eq!(manifest["command"][1], "study");
    assert_eq!(manifest["baseline"]["sampler"], "uniform");
    // Once more there is nothing to do.
    let before = folder.read("s/runs.jsonl");
    folder.done(&format!("study {SMALL} -o s"));
    assert_eq!(folder.read("s/runs.jsonl"), before);
    // Another study is refused.
    let methods = "\nerror: methods: adaptive/sobol/cluster-regression adaptive/sobol/none";
    let wrong = [methods, "this folder holds another study; choose another folder"];
    folder.says(&format!("study {SMALL} --set filters=none -o s"), 1, &wrong);
    assert_eq!(folder.read("s/runs.jsonl"), before);
}

/// Keys of the plan in the help whose values are examples.
const EXAMPLES: [&str; 7] = ["only", "methods", "resolution", "max_depth", "[[external]]", "name", "command"];

#[test]
fn the_plan_in_the_help_has_the_defaults() {
    let help = Folder::new().done("study --help");
    let (_, plan) =
        help.split_once("Values are defaults, except those of lines marked \"example\":\n").expect("a plan");
    let (plan, _) = plan.split_once("\n\n").expect("its end");
    let is_default = |line: &&str| !EXAMPLES.iter().any(|key| line.trim_start().starts_with(key));
    let lines: Vec<&str> = plan.lines().filter(is_default).collect();
    assert!(lines.len() > 12, "{lines:?}");
    let mut read = Plan::parse(&lines.join("\n"), "help".as_ref(), &[]).expect("a plan");
    let default = Plan::parse("", "none".as_ref(), &[]).expect("a plan");
    let settings = &mut read.settings;
    (settings.samplers, settings.spp, settings.seeds, settings.time_of) = (None, None, None, None);
    assert_eq!(read, default);
    let quick = Plan::parse("quick = true", "quick".as_ref(), &[]).expect("a plan");
    let said = format!("{0}x{0} pixels, {1} seeds, and {2:?} spp", quick.side, quick.seeds.len(), quick.spp);
    assert_eq!(said, "64x64 pixels, 4 seeds, and [4, 8, 16] spp");
    assert!(plan.contains("64x64 pixels, 4 seeds, and 4, 8 and 16 spp"), "{plan}");
}

/// The defaults of both commands come from one place.
#[test]
fn a_study_measures_what_dapple_render_does_by_default_first() {
    let folder = Folder::new();
    folder.done("render tiny.pbrt --spp 1 -o a.exr");
    let header = String::from_utf8_lossy(&folder.read("a.exr")).into_owned();
    assert!(header.contains("dapple:light-selection\0string\0\u{7}\0\0\0learned"), "the render's light selection");
    let spec: serde_json::Value = serde_json::from_str(&folder.done("render tiny.pbrt --print-spec")).expect("JSON");
    let words = format!("study {SMALL} --set spp=2 --set seeds=1 --set time_of=0 -q");
    folder.done(&format!("{words} -o s"));
    let manifest = folder.manifest("s");
    for part in ["sampler", "points", "filter"] {
        assert_eq!(manifest["methods"][0][part], spec[part], "{part}");
    }
    assert_eq!(manifest["scenes"][0]["lights"], "learned");
    // Another rule can be requested for all scenes.
    folder.done(&format!("{words} --set lights=power -o p"));
    let manifest = folder.manifest("p");
    assert_eq!(manifest["scenes"][0]["lights"], "power");
}

#[test]
fn files_beside_the_report_name_their_methods() {
    let folder = Folder::new();
    let out = folder.done(&format!("study {SMALL} --set filters=none -o s"));
    for file in ["report.html", "summary.csv", "runs.csv", "runs.jsonl", "study.json"] {
        assert!(out.contains(&format!("s/{file}: ")), "{file}: {out}");
        assert!(folder.path("s").join(file).exists(), "{file}");
    }
    let runs = folder.study("s");
    let images: Vec<&str> = runs.values().filter_map(|run| run["image"].as_str()).collect();
    assert_eq!(images.len(), 2 * 3);
    for image in ["adaptive-none-2spp", "adaptive-none-4spp", "uniform-none-time-of-2spp"] {
        assert!(images.contains(&format!("images/tiny/{image}.exr").as_str()), "{image}: {images:?}");
        folder.read(&format!("s/images/tiny/{image}.exr"));
    }
    assert_eq!(folder.text("s/runs.csv").lines().count(), 1 + runs.len());
    // Written anew, without runs.
    let (page, lines) = (folder.read("s/report.html"), folder.lines("s"));
    for file in ["report.html", "runs.csv"] {
        std::fs::remove_file(folder.path("s").join(file)).expect("a file");
    }
    folder.done("study --report-only -o s -q");
    assert!(folder.read("s/report.html") == page && folder.lines("s") == lines);
    folder.says("study --report-only -o nowhere", 1, &["nowhere/study.json: there is no study"]);
}

#[test]
fn a_process_for_each_run_makes_the_same_images() {
    let folder = Folder::new();
    let words = format!("study {SMALL} --set samplers=[\"uniform\",\"variance\"] --set filters=none --set time_of=0");
    folder.done(&format!("{words} -o a"));
    folder.done(&format!("{words} -o b --set fresh=true"));
    let (a, b) = (folder.study("a"), folder.study("b"));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (a, b) in a.values().zip(b.values()) {
        assert_eq!((&a["errors"], &a["rays"]), (&b["errors"], &b["rays"]));
        assert_eq!((&a["fresh"], &b["fresh"]), (&false.into(), &true.into()));
    }
}

#[test]
fn wrong_words_say_what_there_is() {
    let folder = Folder::new();
    folder.write("bad.toml", "spp = [2]\nsamplers = [\n  \"nonesuch\",\n]\n");
    folder.write("key.toml", "samplesr = []\n");
    folder.done("render tiny.pbrt --spp 1 --pixel-filter box --seed 77 -o r.exr");
    folder.done("render cornell --spp 1 --resolution 12x8 --pixel-filter box --seed 77 -o c.exr");
    let with = |file: &str| format!("--set scenes={{source=\"tiny.pbrt\",reference=\"{file}\"}}");
    let cases = [
        (
            "--set samplers=[\"uniform\",\"nonesuch\"]",
            2,
            "samplers: there is no sampler \"nonesuch\"; choose among variance, ",
        ),
        ("--set spp=a", 2, "invalid type: string \"a\", expected u64"),
        ("--set spp", 2, "--set spp: this is not a setting; write KEY=VALUE"),
        ("--set time_of=3", 2, "time_of: 3 is not one of spp (4, 8, 16, 32)"),
        ("tiny.pbrt", 2, "tiny.pbrt is not a plan (FILE.toml); use --set scenes=tiny.pbrt to study a scene"),
        ("nowhere.toml", 1, "nowhere.toml: cannot read the plan"),
        ("bad.toml", 1, "bad.toml:3: samplers: there is no sampler \"nonesuch\""),
        ("key.toml", 1, "key.toml:1: unknown field `samplesr`, expected one of `scenes`, `only`, `samplers`"),
        ("--set scenes=nonesuch", 1, "nonesuch: no such file or bundled scene; the bundled scenes are teapot, "),
        (&with("nowhere.exr"), 1, "nowhere.exr: cannot read the reference"),
        (&format!("--set resolution=13x8 {}", with("r.exr")), 1, "it has 24x16 pixels, but the study uses 13x8"),
        (&with("c.exr"), 1, "its header states scene \"cornell\", but the study has \"tiny\""),
        (&format!("--set max_depth=2 {}", with("r.exr")), 1, "its header states max depth "),
    ];
    for (words, status, message) in cases {
        let said = folder.says(&format!("study -o s {words}"), status, &["error: ", message]);
        assert_eq!((said.out.as_str(), folder.lines("s")), ("", 0), "{words}");
    }
    // The control.
    let words = "--set spp=2 --set seeds=1 --set samplers=uniform --set filters=none";
    folder.done(&format!("study -o s {words} {}", with("r.exr")));
}

/// Waits until so many runs are written down.
fn wait_for(folder: &Folder, study: &str, lines: usize) {
    let start = Instant::now();
    while folder.lines(study) < lines {
        assert!(start.elapsed() < Duration::from_secs(60), "no {lines} runs in a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_killed_study_goes_on_where_it_was() {
    let folder = Folder::new();
    // Without equal time, whose sample counts are the clock's to say.
    let words = "study --set scenes=tiny.pbrt --set resolution=24x16 --set spp=[8,16] --set seeds=6 --set reference_spp=32 \
                 --set time_of=0 -q";
    folder.done(&format!("{words} -o whole"));
    for lines in [1, 30] {
        let name = format!("killed-{lines}");
        let mut child = folder.command(&format!("{words} -o {name}")).spawn().expect("it starts");
        wait_for(&folder, &name, lines);
        child.kill().expect("a kill");
        child.wait().expect("an end");
        let kept = folder.lines(&name);
        assert!(kept >= lines);
        let before = folder.read(&format!("{name}/runs.jsonl"));
        let whole = before.iter().rposition(|b| *b == b'\n').map_or(0, |at| at + 1);
        folder.done(&format!("{words} -o {name}"));
        assert!(folder.read(&format!("{name}/runs.jsonl")).starts_with(&before[..whole]), "runs were lost");
        let (a, b) = (folder.study("whole"), folder.study(&name));
        assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
        for (what, run) in &a {
            assert_eq!(run["errors"], b[what]["errors"], "{what}");
        }
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_stops_between_runs_and_says_how_to_go_on() {
    let folder = Folder::new();
    let words = "study --set scenes=tiny.pbrt --set resolution=24x16 --set spp=[16,32] --set seeds=40 --set reference_spp=32 \
                 --set time_of=0 -o s";
    let child = folder.start(words);
    wait_for(&folder, "s", 3);
    signal(&child, "INT");
    let said = Said::of(child.wait_with_output().expect("an end"));
    assert_eq!(said.status, Some(130), "{}", said.err);
    let expected = format!("interrupted: {} of 320 runs are in s; the same command resumes", folder.lines("s"));
    assert!(said.err.contains(&expected), "{}", said.err);
    let bytes = folder.read("s/runs.jsonl");
    assert_eq!(bytes.last(), Some(&b'\n'), "a whole last line");
}

#[cfg(target_os = "linux")]
#[test]
fn a_study_that_does_not_fit_into_memory_is_refused() {
    let folder = Folder::new();
    // The film takes 128 GiB. The limit makes the test fail, not the machine, should the check be missing.
    let words = "study --set scenes=tiny.pbrt --set resolution=65535x65535 --set spp=1 -q";
    let said = folder.limited("-v 16000000", words);
    assert_eq!(said.status, Some(1), "{}", said.err);
    for part in ["error: a run takes at least ", "lower the resolution"] {
        assert!(said.err.contains(part), "{}", said.err);
    }
}
