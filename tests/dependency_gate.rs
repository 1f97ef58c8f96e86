//! The direction of dependencies between crates: the table in docs/ARCHITECTURE.md, checked against `cargo metadata`.
//!
//! Also licences, second versions and sources, by the lists of deny.toml. `cargo deny check` also reads licence texts and
//! advisories; it takes two minutes to install, so that CI runs it only where it is.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

fn metadata(more: &[&str]) -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked"])
        .args(more)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo metadata runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("metadata is JSON")
}

/// The resolved graph of normal dependencies: each package with its direct dependencies.
fn graph() -> (BTreeMap<String, BTreeSet<String>>, Value) {
    let metadata = metadata(&[]);
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

/// Names of all packages that a crate is really built with, by `cargo tree`. `cargo metadata` also resolves optional
/// dependencies of disabled features, such as criterion through obvhs.
fn built_with(name: &str) -> BTreeSet<String> {
    tree(&["--package", name])
}

/// Names of all packages that the facade is built with, given only these features.
fn facade_built_with(features: &str) -> BTreeSet<String> {
    tree(&["--package", "dapple", "--no-default-features", "--features", features])
}

fn tree(of: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .arg("tree")
        .args(of)
        .args(["--edges", "normal", "--prefix", "none", "--locked"])
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

/// A crate, the Dapple crates that it may depend on, and the other crates that it may not.
type Rule = (&'static str, &'static [&'static str], &'static [&'static str]);

const RULES: &[Rule] = &[
    ("dapple-core", &[], &["glam", "obvhs", "image", "exr", "rand"]),
    ("dapple-low-discrepancy", &["dapple-core"], &["glam", "obvhs", "image", "exr"]),
    ("dapple-conformance", &["dapple-core", "dapple-metrics"], &["glam", "obvhs", "image", "exr"]),
    ("dapple-adaptive", &["dapple-core"], OF_A_SCENE),
    ("dapple-mitchell", &["dapple-core"], OF_A_SCENE),
    ("dapple-classics", CLASSICS, OF_A_SCENE),
    ("dapple-light-selection", &[], OF_A_SCENE),
    ("dapple-clustering", &[], OF_A_SCENE),
    ("dapple-cluster-adaptive", &["dapple-core", "dapple-clustering"], OF_A_SCENE),
    ("dapple-denoise", &["dapple-core"], OF_A_SCENE),
    ("dapple-oidn", &["dapple-core"], OF_A_SCENE),
    ("dapple-registry", REGISTRY, OF_A_SCENE),
    ("dapple-metrics", &[], &["glam", "obvhs", "image", "exr", "rayon"]),
    ("dapple-geometry", &[], &["image", "exr", "clap"]),
    ("dapple-scene", &["dapple-core"], &["obvhs", "clap", "indicatif"]),
    ("dapple-renderer", RENDERER, &["clap", "indicatif"]),
    ("dapple-distributed", &["dapple-core"], OF_A_SCENE),
    ("dapple-mpi", &["dapple-core", "dapple-distributed"], OF_A_SCENE),
    ("dapple-transport", TRANSPORT, &["clap", "indicatif"]),
    ("dapple-job", JOB, &["clap", "indicatif", "ctrlc"]),
    ("dapple-study", STUDY, &["clap", "indicatif", "ctrlc"]),
    ("dapple-cli", LAYERS, &[]),
];
/// The crates of the methods that published ones build on.
const CLASSICS: &[&str] = &["dapple-core", "dapple-denoise", "dapple-low-discrepancy", "dapple-mitchell"];
/// Crates from the bottom up: the dependencies that the top four may have are prefixes.
const LAYERS: &[&str] = &[
    "dapple-core",
    "dapple-scene",
    "dapple-geometry",
    "dapple-low-discrepancy",
    "dapple-light-selection",
    "dapple-renderer",
    "dapple-distributed",
    "dapple-adaptive",
    "dapple-mitchell",
    "dapple-clustering",
    "dapple-cluster-adaptive",
    "dapple-denoise",
    "dapple-classics",
    "dapple-oidn",
    "dapple-registry",
    "dapple-transport",
    "dapple-metrics",
    "dapple-job",
    "dapple-study",
    "dapple-mpi",
];
const RENDERER: &[&str] = LAYERS.split_at(5).0;
/// The renderer and below, and the clusters of the thesis.
const TRANSPORT: &[&str] = &[
    "dapple-core",
    "dapple-scene",
    "dapple-geometry",
    "dapple-low-discrepancy",
    "dapple-light-selection",
    "dapple-renderer",
    "dapple-clustering",
];
/// Every method with a name, and clusters; no scene.
const REGISTRY: &[&str] = &[
    "dapple-core",
    "dapple-low-discrepancy",
    "dapple-adaptive",
    "dapple-mitchell",
    "dapple-clustering",
    "dapple-cluster-adaptive",
    "dapple-denoise",
    "dapple-classics",
    "dapple-oidn",
];
/// The renderer, and every method with a name.
const JOB: &[&str] = LAYERS.split_at(16).0;
const STUDY: &[&str] = LAYERS.split_at(18).0;

/// Crates for scenes, BVHs, vectors or image files.
const OF_A_SCENE: &[&str] = &["glam", "obvhs", "image", "exr", "dapple-geometry", "dapple-scene", "dapple-renderer"];

/// The features of `examples/foreign_renderer.rs` in the manifest.
const FOREIGN: &str = "clustering,cluster-adaptive,denoise,low-discrepancy,metrics";

#[test]
fn crates_depend_only_on_allowed_crates() {
    let (graph, metadata) = graph();
    for (name, allowed, forbidden) in RULES {
        let reached = reaches(&graph, name);
        for other in reached.iter().filter(|n| n.starts_with("dapple")) {
            assert!(allowed.contains(&other.as_str()), "{name} must not know {other}");
        }
        // No member of the workspace has a tree of its own, if no default feature asks for it.
        let with_itself = || reached.iter().cloned().chain([(*name).to_owned()]).collect();
        let built = if *name == "dapple-mpi" { with_itself() } else { built_with(name) };
        assert!(built.contains(*name), "cargo tree shows nothing of {name}");
        for outsider in *forbidden {
            assert!(!built.contains(*outsider), "{name} must not reach {outsider}");
        }
    }
    // Every crate needs a rule.
    for package in metadata["packages"].as_array().expect("packages") {
        let name = package["name"].as_str().expect("name");
        if name.starts_with("dapple-") {
            assert!(RULES.iter().any(|r| r.0 == name), "{name} has no rule in tests/dependency_gate.rs");
        }
    }
}

#[test]
fn no_program_is_built_with_libloading_unless_asked() {
    for name in ["dapple", "dapple-registry", "dapple-job", "dapple-cli", "dapple-study"] {
        assert!(!built_with(name).contains("libloading"), "{name} loads libraries without the feature oidn");
    }
    assert!(!facade_built_with("full").contains("libloading"), "the feature full has oidn");
    assert!(
        tree(&["--package", "dapple-cli", "--features", "oidn"]).contains("libloading"),
        "the feature adds nothing"
    );
}

#[test]
fn no_program_is_built_with_mpi_unless_asked() {
    assert!(!built_with("dapple-cli").contains("mpi"), "the default program needs MPI");
    assert!(tree(&["--package", "dapple-cli", "--features", "mpi"]).contains("dapple-mpi"), "the feature adds nothing");
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

/// `.ci/run` checks light features alone; for all of them, this finds an export whose crate its feature leaves out.
#[test]
fn features_of_the_facade_enable_the_crates_that_they_export() {
    let metadata = metadata(&["--no-deps"]);
    let packages = metadata["packages"].as_array().expect("packages");
    let facade = packages.iter().find(|p| p["name"] == "dapple").expect("the facade");
    let enables = |feature: &str, name: &str| {
        let parts = facade["features"][feature].as_array().expect("a feature");
        parts.iter().any(|part| part.as_str() == Some(&format!("dep:{name}")))
    };
    let mut exported = BTreeSet::new();
    let lines: Vec<&str> = include_str!("../src/lib.rs").lines().collect();
    for pair in lines.windows(2) {
        let feature = pair[0].strip_prefix("#[cfg(feature = \"").and_then(|rest| rest.strip_suffix("\")]"));
        let (Some(feature), Some(rest)) = (feature, pair[1].strip_prefix("pub use dapple_")) else { continue };
        let end = rest.find(|c: char| !c.is_ascii_lowercase() && c != '_').expect("the end of a name");
        let name = format!("dapple-{}", rest[..end].replace('_', "-"));
        assert!(enables(feature, &name), "the feature {feature} exports {name} and does not enable it");
        exported.insert(name);
    }
    // All but the core, which every feature has, and the control: a feature does not enable every crate.
    let optional = facade["dependencies"].as_array().expect("dependencies").iter().filter(|d| d["optional"] == true);
    assert_eq!(exported, optional.map(|d| d["name"].as_str().expect("a name").to_owned()).collect());
    assert!(!enables("scene", "dapple-renderer"));
}

/// The largest number of other people's crates that the default features may bring. Six are thiserror's, at build time only.
const FOREIGN_CRATES: usize = 27;

#[test]
fn the_default_features_bring_no_scene_and_few_crates() {
    let built = built_with("dapple");
    for ours in ["dapple-registry", "dapple-adaptive", "dapple-denoise", "dapple-low-discrepancy"] {
        assert!(built.contains(ours), "the default features lack {ours}");
    }
    for heavy in OF_A_SCENE.iter().chain(&["dapple-job", "dapple-study", "clap", "serde"]) {
        assert!(!built.contains(*heavy), "the default features bring {heavy}");
    }
    let foreign: Vec<_> = built.iter().filter(|name| !name.starts_with("dapple")).collect();
    assert!(foreign.len() <= FOREIGN_CRATES, "{} crates: {foreign:?}", foreign.len());
    assert!(facade_built_with("full").len() > 3 * foreign.len(), "the tree does not show a heavy facade as heavy");
}

/// `(major, minor)` of a version such as `1.90` or `1.85.0`.
fn minor(version: &str) -> (u32, u32) {
    let mut parts = version.split('.').map(|part| part.parse().unwrap_or(0));
    (parts.next().unwrap_or(0), parts.next().unwrap_or(0))
}

/// Clippy's `incompatible_msrv` covers the workspace's own code.
#[test]
fn no_dependency_needs_a_newer_compiler_than_ours() {
    let (_, metadata) = graph();
    let packages = metadata["packages"].as_array().expect("packages");
    let needed = |package: &Value| package["rust_version"].as_str().map(minor);
    let ours = packages.iter().find(|p| p["name"] == "dapple").and_then(needed).expect("our rust-version");
    for package in packages {
        let (name, needed) = (&package["name"], needed(package));
        assert!(needed.is_none_or(|needed| needed <= ours), "{name} needs Rust {needed:?}; rust-version is {ours:?}");
    }
    assert!(packages.iter().filter(|p| needed(p).is_some()).count() > 50, "few packages state a version");
    assert!(minor("1.100.0") > minor("1.90"), "versions are compared as text");
}

fn deny() -> toml::Table {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("deny.toml");
    std::fs::read_to_string(path).expect("deny.toml").parse().expect("TOML")
}

/// Entries of one of deny.toml's lists: texts, or the crates of tables.
fn listed(section: &str, key: &str) -> BTreeSet<String> {
    let deny = deny();
    let of = |entry: &toml::Value| entry.get("crate").unwrap_or(entry).as_str().expect("a name").to_owned();
    deny[section][key].as_array().expect("a list").iter().map(of).collect()
}

/// Tells whether a licence expression is met by allowed licences: of each part of an AND, one choice of the OR.
///
/// An OR of ANDs without parentheses is read too strictly.
fn allows(allowed: &BTreeSet<String>, expression: &str) -> bool {
    expression.replace('/', " OR ").split(" AND ").all(|part| {
        let part = part.trim_matches(['(', ')', ' ']);
        part.split(" OR ").any(|choice| allowed.contains(choice.trim()))
    })
}

#[test]
fn licences_are_among_those_of_deny_toml() {
    let metadata = metadata(&["--all-features"]);
    let allowed = listed("licenses", "allow");
    for package in metadata["packages"].as_array().expect("packages") {
        let (name, licence) = (&package["name"], package["license"].as_str().unwrap_or("none"));
        assert!(allows(&allowed, licence), "{name} has the licence {licence}");
    }
    assert!(allows(&allowed, "(MIT OR LGPL-2.1) AND Unicode-3.0"));
    for other in ["none", "GPL-3.0-only", "MIT AND GPL-3.0-only", "Apache-2.0 WITH LLVM-exception"] {
        assert!(!allows(&allowed, other), "{other} is let through");
    }
}

/// Name, version and source of every package in Cargo.lock but the workspace's own.
fn locked() -> Vec<(String, String, String)> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.lock");
    let lock: toml::Table = std::fs::read_to_string(path).expect("Cargo.lock").parse().expect("TOML");
    let text = |package: &toml::Value, key: &str| package.get(key).and_then(|v| v.as_str()).map(str::to_owned);
    let packages = lock["package"].as_array().expect("packages").iter();
    packages.filter_map(|p| Some((text(p, "name")?, text(p, "version")?, text(p, "source")?))).collect()
}

/// Packages beside the newest of the same name.
fn second_versions(locked: &[(String, String, String)]) -> BTreeSet<String> {
    let mut versions = BTreeMap::<&str, Vec<&str>>::new();
    for (name, version, _) in locked {
        versions.entry(name).or_default().push(version);
    }
    let newer = |version: &&str| minor(version);
    versions.values_mut().for_each(|v| v.sort_by_key(newer));
    let older =
        |(name, v): (&str, Vec<&str>)| v.iter().rev().skip(1).map(|v| format!("{name}@{v}")).collect::<Vec<_>>();
    versions.into_iter().flat_map(older).collect()
}

#[test]
fn second_versions_are_those_that_deny_toml_explains() {
    let locked = locked();
    assert!(locked.len() > 100, "{} packages", locked.len());
    assert_eq!(second_versions(&locked), listed("bans", "skip"));
    for (name, _, source) in &locked {
        assert_eq!(source, "registry+https://github.com/rust-lang/crates.io-index", "{name} is from elsewhere");
    }
}

#[test]
fn a_forbidden_edge_would_be_seen() {
    let (mut graph, _) = graph();
    graph.get_mut("dapple-core").expect("core").insert("dapple-geometry".into());
    assert!(reaches(&graph, "dapple-core").contains("obvhs"), "the walk does not see through edges");
    assert!(built_with("dapple-cli").contains("clap"), "the tree does not show what is there");
}
