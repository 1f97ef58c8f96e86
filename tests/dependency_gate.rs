//! Who may know whom: the table in docs/ARCHITECTURE.md, checked against `cargo metadata`; and the licences and versions of
//! outsiders: `deny.toml`, as far as that needs no more than the metadata.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// The resolved graph of normal dependencies: package name to the names it depends on.
fn graph() -> (BTreeMap<String, BTreeSet<String>>, Value) {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo metadata runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("metadata is JSON");
    let names: BTreeMap<&str, &str> = metadata["packages"]
        .as_array()
        .expect("packages")
        .iter()
        .map(|p| (p["id"].as_str().expect("id"), p["name"].as_str().expect("name")))
        .collect();
    let mut graph = BTreeMap::new();
    for node in metadata["resolve"]["nodes"].as_array().expect("nodes") {
        let mut needs = BTreeSet::new();
        for dep in node["deps"].as_array().expect("deps") {
            let kinds = dep["dep_kinds"].as_array().expect("kinds");
            if kinds.iter().any(|k| k["kind"].is_null()) {
                needs.insert(names[dep["pkg"].as_str().expect("pkg")].to_owned());
            }
        }
        graph.insert(names[node["id"].as_str().expect("id")].to_owned(), needs);
    }
    (graph, metadata)
}

/// Names of everything that a crate is really built with. `cargo metadata` also resolves optional
/// dependencies that no feature asks for (obvhs reaches criterion that way), so outsiders are asked for here.
fn built_with(name: &str) -> BTreeSet<String> {
    tree(&["--package", name])
}

/// What the facade is built with if it is asked for these features only.
fn facade_built_with(features: &str) -> BTreeSet<String> {
    tree(&["--package", "dapple", "--no-default-features", "--features", features])
}

fn tree(of: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .arg("tree")
        .args(of)
        .args(["--edges", "normal", "--prefix", "none", "--locked", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo tree runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines().filter_map(|l| l.split_whitespace().next()).map(str::to_owned).collect()
}

fn reaches(graph: &BTreeMap<String, BTreeSet<String>>, from: &str) -> BTreeSet<String> {
    let mut seen = BTreeSet::new();
    let mut waiting = vec![from.to_owned()];
    while let Some(name) = waiting.pop() {
        for next in graph.get(&name).into_iter().flatten() {
            if seen.insert(next.clone()) {
                waiting.push(next.clone());
            }
        }
    }
    seen
}

/// Dapple crates that each may reach, and outsiders that it must not.
const RULES: &[(&str, &[&str], &[&str])] = &[
    ("dapple-core", &[], &["glam", "obvhs", "image", "exr", "rand"]),
    ("dapple-low-discrepancy", &["dapple-core"], &["glam", "obvhs", "image", "exr"]),
    ("dapple-conformance", &["dapple-core", "dapple-metrics"], &["glam", "obvhs", "image", "exr"]),
    ("dapple-adaptive", &["dapple-core"], OF_A_SCENE),
    ("dapple-mitchell", &["dapple-core"], OF_A_SCENE),
    ("dapple-light-selection", &[], OF_A_SCENE),
    ("dapple-clustering", &[], OF_A_SCENE),
    ("dapple-cluster-adaptive", &["dapple-core", "dapple-clustering"], OF_A_SCENE),
    ("dapple-denoise", &["dapple-core"], OF_A_SCENE),
    ("dapple-metrics", &[], &["glam", "obvhs", "image", "exr", "rayon"]),
    ("dapple-checkpoint", &[], &["glam", "obvhs", "image", "exr", "rayon"]),
    ("dapple-geometry", &[], &["image", "exr", "rayon", "clap"]),
    (
        "dapple-renderer",
        &[
            "dapple-core",
            "dapple-geometry",
            "dapple-low-discrepancy",
            "dapple-adaptive",
            "dapple-light-selection",
            "dapple-mitchell",
            "dapple-clustering",
            "dapple-cluster-adaptive",
            "dapple-denoise",
        ],
        &["clap", "indicatif"],
    ),
    (
        "dapple-study",
        &[
            "dapple-core",
            "dapple-geometry",
            "dapple-low-discrepancy",
            "dapple-adaptive",
            "dapple-light-selection",
            "dapple-mitchell",
            "dapple-clustering",
            "dapple-cluster-adaptive",
            "dapple-denoise",
            "dapple-metrics",
            "dapple-renderer",
        ],
        &["clap", "indicatif", "ctrlc", "dapple-conformance"],
    ),
    (
        "dapple-price",
        &[
            "dapple-core",
            "dapple-geometry",
            "dapple-low-discrepancy",
            "dapple-adaptive",
            "dapple-light-selection",
            "dapple-mitchell",
            "dapple-clustering",
            "dapple-cluster-adaptive",
            "dapple-denoise",
            "dapple-renderer",
            "dapple-checkpoint",
        ],
        &["clap", "indicatif", "ctrlc", "dapple-conformance"],
    ),
    (
        "dapple-cli",
        &[
            "dapple-core",
            "dapple-geometry",
            "dapple-low-discrepancy",
            "dapple-adaptive",
            "dapple-light-selection",
            "dapple-mitchell",
            "dapple-clustering",
            "dapple-cluster-adaptive",
            "dapple-denoise",
            "dapple-metrics",
            "dapple-renderer",
            "dapple-study",
            "dapple-checkpoint",
            "dapple-price",
        ],
        &["dapple-conformance"],
    ),
];

/// What knows of scenes, BVHs, vectors or image files.
const OF_A_SCENE: &[&str] = &["glam", "obvhs", "image", "exr", "dapple-geometry", "dapple-renderer"];

/// What `examples/foreign_renderer.rs` asks for in the manifest.
const FOREIGN: &str = "clustering,cluster-adaptive,denoise,low-discrepancy,metrics";

#[test]
fn crates_know_only_what_they_may() {
    let (graph, metadata) = graph();
    for (name, allowed, forbidden) in RULES {
        let reached = reaches(&graph, name);
        for other in reached.iter().filter(|n| n.starts_with("dapple")) {
            assert!(allowed.contains(&other.as_str()), "{name} must not know {other}");
        }
        let built = built_with(name);
        assert!(built.contains(*name), "cargo tree shows nothing of {name}");
        for outsider in *forbidden {
            assert!(!built.contains(*outsider), "{name} must not reach {outsider}");
        }
    }
    // A crate without a rule is a rule forgotten.
    for package in metadata["packages"].as_array().expect("packages") {
        let name = package["name"].as_str().expect("name");
        if name.starts_with("dapple-") {
            assert!(RULES.iter().any(|r| r.0 == name), "{name} has no rule in tests/dependency_gate.rs");
        }
    }
}

#[test]
fn a_foreign_renderer_takes_no_scene_along() {
    let (_, metadata) = graph();
    let packages = metadata["packages"].as_array().expect("packages");
    let facade = packages.iter().find(|p| p["name"] == "dapple").expect("the facade");
    let targets = facade["targets"].as_array().expect("targets");
    let example = targets.iter().find(|t| t["name"] == "foreign_renderer").expect("the example");
    let asked: Vec<&str> = example["required-features"]
        .as_array()
        .expect("required features")
        .iter()
        .map(|f| f.as_str().expect("a feature"))
        .collect();
    assert_eq!(asked.join(","), FOREIGN, "the example asks for other features than are checked here");

    let built = facade_built_with(FOREIGN);
    assert!(built.contains("dapple-cluster-adaptive"), "cargo tree shows nothing of what the example uses");
    let control = facade_built_with("renderer");
    for outsider in OF_A_SCENE {
        assert!(!built.contains(*outsider), "a foreign renderer must not be given {outsider}");
        assert!(control.contains(*outsider), "the tree does not show {outsider} where it is");
    }
}

#[test]
fn one_version_of_what_matters() {
    let (_, metadata) = graph();
    for name in ["glam", "thiserror", "rand", "rayon", "image", "exr", "serde"] {
        let versions: Vec<_> = metadata["packages"]
            .as_array()
            .expect("packages")
            .iter()
            .filter(|p| p["name"] == name)
            .map(|p| p["version"].to_string())
            .collect();
        assert_eq!(versions.len(), 1, "{name} comes in versions {versions:?}");
    }
}

/// Whether a licence expression can be met with allowed licences [after SPDX 2.3, annex D]; `/` is an old way to say OR.
fn is_allowed(expression: &str, allowed: &[&str]) -> bool {
    let spaced = expression.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let (met, rest) = either(&words, allowed);
    met && rest.is_empty()
}

fn either<'a, 'w>(words: &'a [&'w str], allowed: &[&str]) -> (bool, &'a [&'w str]) {
    let (mut met, mut rest) = both(words, allowed);
    while let ["OR", after @ ..] = rest {
        let (other, left) = both(after, allowed);
        (met, rest) = (met || other, left);
    }
    (met, rest)
}

fn both<'a, 'w>(words: &'a [&'w str], allowed: &[&str]) -> (bool, &'a [&'w str]) {
    let (mut met, mut rest) = one(words, allowed);
    while let ["AND", after @ ..] = rest {
        let (other, left) = one(after, allowed);
        (met, rest) = (met && other, left);
    }
    (met, rest)
}

fn one<'a, 'w>(words: &'a [&'w str], allowed: &[&str]) -> (bool, &'a [&'w str]) {
    match words {
        ["(", within @ ..] => match either(within, allowed) {
            (met, [")", rest @ ..]) => (met, rest),
            (_, rest) => (false, rest),
        },
        // An exception is a licence of its own name.
        [licence, "WITH", exception, rest @ ..] => {
            (allowed.contains(&format!("{licence} WITH {exception}").as_str()), rest)
        }
        [licence, rest @ ..] => (allowed.contains(licence), rest),
        [] => (false, words),
    }
}

/// `deny.toml`, which `cargo deny` reads as well.
fn denied() -> toml::Table {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/deny.toml");
    toml::from_str(&std::fs::read_to_string(path).expect("deny.toml")).expect("TOML")
}

#[test]
fn licences_are_allowed() {
    let (denied, (_, metadata)) = (denied(), graph());
    let allowed = denied["licenses"]["allow"].as_array().expect("a list");
    let allowed: Vec<&str> = allowed.iter().map(|licence| licence.as_str().expect("a name")).collect();
    let packages = metadata["packages"].as_array().expect("packages");
    let licences: Vec<(&str, &str)> = packages
        .iter()
        .map(|p| (p["name"].as_str().expect("name"), p["license"].as_str().unwrap_or("none stated")))
        .collect();
    assert!(licences.len() > 100, "cargo metadata shows little");
    for (name, licence) in &licences {
        assert!(is_allowed(licence, &allowed), "{name} is licensed under {licence}, which deny.toml does not allow");
    }
    // Negative controls: without any of them something is not allowed, and what must not be is not.
    for one in &allowed {
        let others: Vec<&str> = allowed.iter().copied().filter(|other| other != one).collect();
        assert!(licences.iter().any(|(_, licence)| !is_allowed(licence, &others)), "nobody needs {one}");
    }
    let wrong = [
        "GPL-3.0",
        "MIT AND GPL-3.0",
        "(MIT OR GPL-3.0) AND GPL-3.0",
        "MIT WITH GPL-3.0",
        "(MIT",
        "MIT)",
        "",
        "none stated",
    ];
    for wrong in wrong {
        assert!(!is_allowed(wrong, &allowed), "{wrong}");
    }
    assert!(is_allowed("GPL-3.0 OR (MIT AND Apache-2.0)", &allowed) && is_allowed("GPL-3.0/MIT", &allowed));
}

#[test]
fn second_versions_have_a_reason() {
    let (denied, (_, metadata)) = (denied(), graph());
    let skipped = denied["bans"]["skip"].as_array().expect("a list");
    let reasons: BTreeMap<&str, &str> = skipped
        .iter()
        .map(|s| (s["crate"].as_str().expect("a crate"), s["reason"].as_str().expect("a reason")))
        .collect();
    assert!(reasons.values().all(|reason| !reason.is_empty()));
    let mut versions: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for package in metadata["packages"].as_array().expect("packages") {
        let [name, version] = ["name", "version"].map(|key| package[key].as_str().expect("text"));
        versions.entry(name).or_default().push(version);
    }
    let mut used = 0;
    for (name, versions) in versions.iter().filter(|(_, versions)| versions.len() > 1) {
        let known =
            versions.iter().filter(|version| reasons.contains_key(format!("{name}@{version}").as_str())).count();
        assert_eq!(known + 1, versions.len(), "{name} comes in versions {versions:?}: deny.toml has no reason for it");
        used += known;
    }
    assert_eq!(used, reasons.len(), "deny.toml excuses versions that are not there");
}

#[test]
fn a_forbidden_edge_would_be_seen() {
    let (mut graph, _) = graph();
    graph.get_mut("dapple-core").expect("core").insert("dapple-geometry".into());
    assert!(reaches(&graph, "dapple-core").contains("obvhs"), "the walk does not see through edges");
    assert!(built_with("dapple-cli").contains("clap"), "the tree does not show what is there");
}
