//! Time limits of `dapple render`: met, or missed with a warning. A program of its own, beside which no other test runs.

#[path = "cli/common.rs"]
mod common;

use common::Folder;

/// An image whose first sample per pixel takes longer than the limit is finished all the same.
#[test]
fn a_time_limit_that_cannot_be_met_is_named_with_its_excess() {
    let folder = Folder::new();
    let said = folder.says("render cornell --resolution 800x600 --time 0.05 --filter none --json -o a.pfm", 0, &[]);
    let lines: Vec<&str> = said.err.lines().collect();
    let [before, after] = lines[..] else { panic!("two warnings: {}", said.err) };
    assert!(before.starts_with("warning: one sample per pixel will take about "), "{before}");
    assert!(before.contains(" s, but the time limit is 0.05 s; rendering continues"), "{before}");
    assert!(after.starts_with("warning: the render took ") && after.contains("more than the time limit of"), "{after}");
    let json: serde_json::Value = serde_json::from_str(&said.out).expect("JSON");
    assert_eq!(json["samples"], 800 * 600, "one sample per pixel");
    // Without a budget of time, there is nothing to warn about.
    assert_eq!(folder.run("render cornell --resolution 80x60 --spp 1 --json -o a.pfm").err, "");
}

/// The filter of this image takes some 0.4 of the limit. Without room for it, tracing would take the whole limit.
#[test]
fn a_time_limit_includes_the_filter() {
    let folder = Folder::new();
    let json = folder.json("cornell --resolution 400x300 --time 1.2 -o a.pfm");
    let filter = json["seconds"]["filter"].as_f64().expect("seconds");
    let traced = json["seconds"]["trace"].as_f64().expect("seconds");
    assert!(traced + 0.3 * filter < 1.2, "the filter's {filter} s are reserved: {json}");
}

#[test]
fn absurd_time_limits_are_refused() {
    let folder = Folder::new();
    for (word, why) in [
        ("1e30", "at most 31557600 seconds (a year) are allowed"),
        ("1e300", "at most 31557600 seconds (a year) are allowed"),
        ("inf", "a finite number above zero is required"),
        ("nan", "a finite number above zero is required"),
        ("0", "a finite number above zero is required"),
        ("-1", "a finite number above zero is required"),
    ] {
        let said = folder.run(&format!("render tiny.pbrt --time {word}"));
        assert_eq!((said.status, said.out.as_str()), (Some(2), ""), "{word}: {}", said.err);
        assert!(said.err.contains(&format!("'--time <SECONDS>': {why}")), "{word}: {}", said.err);
    }
    // The description as JSON has the same bound.
    let spec = r#"{"version":1,"scene":"tiny.pbrt","budget":{"seconds":1e30}}"#;
    folder.write("spec.json", spec);
    folder.says("render --spec spec.json", 1, &["is above the maximum of 31557600 seconds (a year)"]);
}

/// The first plan after the pilot is bounded by `--max-spp`, not by the seconds left.
#[test]
fn a_long_time_limit_ends_at_the_largest_count() {
    let folder = Folder::new();
    let json = folder.json("tiny.pbrt --time 31557600 --max-spp 8 -o a.pfm");
    assert_eq!(json["spp"], 8.0);
}
