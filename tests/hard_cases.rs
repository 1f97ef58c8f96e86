//! The catalogue of hard cases is true: docs/results/hard-cases.md against the list and the tests of the tree.

#![allow(dead_code, unreachable_pub, reason = "modules of an example")]

#[path = "../examples/hard_cases/catalogue.rs"]
mod catalogue;
#[path = "../examples/hard_cases/mutations.rs"]
mod mutations;

use std::path::Path;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn every_case_has_its_test_or_says_what_it_needs() {
    let (cases, tests) = (catalogue::cases(root()).expect("a list"), catalogue::tests(root()).expect("a tree"));
    assert_eq!(cases.len(), 121);
    assert_eq!(cases.iter().filter(|c| c.tier == "T1").count(), 95);
    let mutations = mutations::mutations(root()).expect("a list");
    let taken_out: Vec<String> = mutations.iter().flat_map(|m| m.cases.split(", ").map(str::to_owned)).collect();
    let found = catalogue::contradictions(&cases, &tests, &taken_out);
    assert!(found.is_empty(), "{found:#?}");
    // Negative controls: a case that loses its tests, a test of no case, and safeguards that nobody has taken out.
    let without: Vec<_> = tests.iter().filter(|t| t.id != "F01").cloned().collect();
    assert_eq!(catalogue::contradictions(&cases, &without, &taken_out).len(), 1);
    let fewer: Vec<_> = cases.iter().filter(|c| c.id != "T01").cloned().collect();
    assert!(catalogue::contradictions(&fewer, &tests, &taken_out)[0].contains("there is no case T01"));
    assert!(catalogue::contradictions(&cases, &tests, &[]).len() > 90);
}

#[test]
fn the_page_is_up_to_date() {
    let (cases, tests) = (catalogue::cases(root()).expect("a list"), catalogue::tests(root()).expect("a tree"));
    let page = catalogue::page(&cases, &tests, &mutations::section(root()).expect("mutations"));
    let there = std::fs::read_to_string(root().join("docs/results/hard-cases.md")).unwrap_or_default();
    let off = page.lines().zip(there.lines()).find(|(a, b)| a != b);
    assert!(page == there, "out of date: cargo run --example hard_cases -- --write\n{off:?}");
}

#[test]
fn every_mutation_still_applies_and_names_a_test() {
    let tests = catalogue::tests(root()).expect("a tree");
    let all = mutations::mutations(root()).expect("a list");
    assert!(all.len() >= 20);
    for m in &all {
        m.applied(root()).unwrap_or_else(|e| panic!("{e}"));
        let of_case = |id: &str| tests.iter().any(|t| t.id == id);
        assert!(m.cases.split(", ").all(of_case), "{}: {}", m.name, m.cases);
        let outcome = mutations::outcome(root(), &m.name).unwrap_or_else(|| panic!("{} was never run", m.name));
        assert!(outcome.caught, "{} is not caught", m.name);
    }
}

/// A file that the `main.rs` of its test program does not name is never compiled, and its tests never run.
#[test]
fn every_file_of_tests_belongs_to_its_program() {
    let mut files = 0;
    for entry in std::fs::read_dir(root().join("crates")).expect("crates") {
        let entry = entry.expect("an entry");
        let folder = entry.path().join("tests").join(entry.file_name());
        let Ok(main) = std::fs::read_to_string(folder.join("main.rs")) else { continue };
        for file in std::fs::read_dir(&folder).expect("a folder") {
            let path = file.expect("an entry").path();
            let name = path.file_stem().expect("a name").to_string_lossy();
            if name != "main" {
                assert!(main.contains(&format!("\nmod {name};\n")), "{}: no `mod {name};` beside it", path.display());
                files += 1;
            }
        }
    }
    assert!(files >= 90, "{files}");
}

/// D07: no crate of ours has a way to say `unsafe`, and what is released looks out for overflow.
#[test]
fn d07_unsafe_is_forbidden_everywhere() {
    let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let manifest = |path: &Path| -> toml::Table { toml::from_str(&read(path)).expect("TOML") };
    let workspace = manifest(&root().join("Cargo.toml"));
    assert_eq!(workspace["workspace"]["lints"]["rust"]["unsafe_code"].as_str(), Some("forbid"));
    let release = &workspace["profile"]["release"];
    assert_eq!(release["overflow-checks"].as_bool(), Some(true));
    let without: Vec<&str> = release["package"].as_table().expect("packages").keys().map(String::as_str).collect();
    assert_eq!(without, ["*", "dapple-geometry"], "docs/results/price.md says which crates go without, and why");
    let crates = std::fs::read_dir(root().join("crates")).expect("crates");
    let mut manifests: Vec<_> = crates.map(|e| e.expect("an entry").path().join("Cargo.toml")).collect();
    manifests.push(root().join("Cargo.toml"));
    assert!(manifests.len() >= 12);
    for path in manifests {
        let inherits = manifest(&path).get("lints").and_then(|l| l.get("workspace")).and_then(toml::Value::as_bool);
        assert_eq!(inherits, Some(true), "{}: [lints] workspace = true is missing", path.display());
    }
}
