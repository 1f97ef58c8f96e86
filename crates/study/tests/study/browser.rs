//! The report in headless Chromium. `.ci/browser` installs the tools.
#![allow(clippy::print_stderr)]

use crate::support::{Law, MadeUp, example};
use dapple_study::{InProcess, Plan, StudyOptions};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The tools of the test; `None`, with a message, if one is missing.
fn tools() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser");
    let answers = |program: &str| Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    let chromium = std::env::var("CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".into());
    for (there, what) in [
        (answers(&chromium), "Chromium"),
        (answers("node"), "Node.js"),
        (folder.join("node_modules/playwright-core").exists(), "playwright-core"),
    ] {
        if !there {
            eprintln!("skipped: no {what}; `bash .ci/browser` installs it");
            return None;
        }
    }
    Some(folder)
}

/// Opens the page of a study if the tools are installed. Screenshots requested by `expected` stay in `target/tmp/NAME`.
fn open(name: &str, study: &mut MadeUp, images: bool, expected: &serde_json::Value) -> Result<(), String> {
    let Some(tools) = tools() else { return Ok(()) };
    let folder = folder(name);
    study.size = [256, 160];
    study.write(&folder, images);
    look(&tools, &folder, expected)
}

/// A new folder.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn look(tools: &Path, folder: &Path, expected: &serde_json::Value) -> Result<(), String> {
    let _ = dapple_study::write_report(folder).unwrap();
    let wanted = folder.join("expected.json");
    std::fs::write(&wanted, expected.to_string()).unwrap();
    let output = Command::new("node")
        .arg(tools.join("report.mjs"))
        .args([&folder.join("report.html"), folder, &wanted])
        .current_dir(tools)
        .output()
        .unwrap();
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

/// Two scenes x six methods: two charts per scene with one curve per method; an image and two maps per method.
fn whole() -> serde_json::Value {
    serde_json::json!({
        "scenes": 2, "charts": 4, "curves": 24, "images": 12, "maps": 24, "bars": 12,
        "viewers": 2, "whole": 14,
        // Tables of wins, equal spp and references, and of times and points per scene.
        "tables": 7,
    })
}

#[test]
fn a_whole_report_works_in_a_browser() {
    let found = open("report-whole", &mut example(), true, &whole());
    assert_eq!(found, Ok(()));
}

#[test]
#[ignore = "14 s: a negative control of the test before"]
fn a_browser_notices_missing_parts() {
    if tools().is_none() {
        return;
    }
    let mut study = example();
    let _ = study.manifest.methods.pop();
    let found = open("report-lacking", &mut study, true, &whole()).unwrap_err();
    assert!(found.contains("curves: 20, expected 24"), "{found}");
}

/// One scene without any run, one seed, no images.
#[test]
fn an_unfinished_report_works_in_a_browser() {
    let laws = [Law::new("uniform", "none"), Law::new("mitchell", "none")];
    let mut study = MadeUp::new(&["a", "b"], &laws, &[4], None, 1);
    study.runs.retain(|run| run.scene == "a");
    let expected = serde_json::json!({
        "scenes": 2, "charts": 2, "curves": 4, "images": 0, "maps": 0, "bars": 2, "tables": 4,
        "viewers": 0, "whole": 0,
    });
    assert_eq!(open("report-unfinished", &mut study, false, &expected), Ok(()));
}

/// A study of two bundled scenes that are rendered.
#[test]
#[ignore = "half a minute; a report made up for the test runs always"]
fn a_real_study_works_in_a_browser() {
    let plan = r#"
        scenes = ["cornell", "teapot"]
        samplers = ["uniform", "cluster-thesis"]
        filters = ["none", "gaussian"]
        spp = [1, 2, 4]
        seeds = 3
        reference_spp = 32
        resolution = [64, 64]
    "#;
    let Some(tools) = tools() else { return };
    let plan = Plan::parse(plan, Path::new("plan.toml"), &[]).unwrap();
    let folder = folder("report-real");
    let study = dapple_study::Study::open(plan, &folder, &StudyOptions::default(), &mut ());
    let mut study = study.unwrap().expect("not stopped");
    let _ = study.run(&mut InProcess::new(|| None), &mut ()).unwrap();
    // Four methods. Times to errors and comparisons depend on the clock; the numbers of tables and figures do not.
    let expected = serde_json::json!({
        "scenes": 2, "charts": 4, "curves": 16, "images": 8, "maps": 16, "bars": 8, "tables": 7,
        "viewers": 2, "whole": 10, "screenshots": true,
    });
    assert_eq!(look(&tools, &folder, &expected), Ok(()));
}
