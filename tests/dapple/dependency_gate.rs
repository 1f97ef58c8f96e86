//! The direction of dependencies between crates: the table in docs/ARCHITECTURE.md, checked against `cargo metadata`.
//!
//! Also licences, second versions and sources, by the lists of deny.toml. `cargo deny check` also reads licence texts and
//! advisories; it takes two minutes to install, so that CI runs it only where it is.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

type Names = BTreeSet<String>;

fn text<'a>(of: &'a Value, key: &str) -> &'a str {
    of[key].as_str().expect(key)
}

fn list<'a>(of: &'a Value, key: &str) -> &'a [Value] {
    of[key].as_array().expect(key)
}

fn cargo(arguments: &[&str]) -> Vec<u8> {
    let mut command = Command::new(env!("CARGO"));
    let output = command.args(arguments).arg("--locked").current_dir(env!("CARGO_MANIFEST_DIR")).output();
    let output = output.expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

fn metadata(more: &[&str]) -> Value {
    serde_json::from_slice(&cargo(&[&["metadata", "--format-version", "1"], more].concat())).expect("metadata")
}

/// The package of this name among those of the workspace and their dependencies.
fn package<'a>(metadata: &'a Value, name: &str) -> &'a Value {
    list(metadata, "packages").iter().find(|p| p["name"] == name).expect("a package")
}

/// The resolved graph of normal dependencies: each package with its direct dependencies.
fn graph<'a>(metadata: &'a Value) -> BTreeMap<&'a str, BTreeSet<&'a str>> {
    let names: BTreeMap<&str, &str> =
        list(metadata, "packages").iter().map(|p| (text(p, "id"), text(p, "name"))).collect();
    let is_normal = |edge: &&Value| list(edge, "dep_kinds").iter().any(|k| k["kind"].is_null());
    let needs =
        |node: &'a Value| list(node, "deps").iter().filter(is_normal).map(|edge| names[text(edge, "pkg")]).collect();
    list(&metadata["resolve"], "nodes").iter().map(|node| (names[text(node, "id")], needs(node))).collect()
}

fn reaches<'a>(graph: &BTreeMap<&'a str, BTreeSet<&'a str>>, from: &'a str) -> BTreeSet<&'a str> {
    let mut seen = BTreeSet::new();
    let mut waiting = vec![from];
    while let Some(name) = waiting.pop() {
        waiting.extend(graph.get(name).into_iter().flatten().filter(|next| seen.insert(**next)));
    }
    seen
}

/// Names of all packages that a crate is really built with, by `cargo tree`. `cargo metadata` also resolves optional
/// dependencies of disabled features, such as criterion through obvhs.
fn built_with(name: &str) -> Names {
    tree(&["--package", name])
}

/// Names of all packages that the facade is built with, given only these features.
fn facade_built_with(features: &str) -> Names {
    tree(&["--package", "dapple", "--no-default-features", "--features", features])
}

fn tree(of: &[&str]) -> Names {
    let text = cargo(&[&["tree", "--edges", "normal", "--prefix", "none"], of].concat());
    let text = String::from_utf8_lossy(&text);
    text.lines().filter_map(|l| l.split_whitespace().next()).map(str::to_owned).collect()
}

/// Crates from the bottom up, without `dapple-`.
const LAYERS: &str = "core scene geometry low-discrepancy light-selection renderer distributed adaptive mitchell clustering \
    cluster-adaptive denoise classics oidn registry transport metrics job study mpi cli";
/// Crates for scenes, BVHs, vectors or image files.
const OF_A_SCENE: &str = "glam obvhs image exr dapple-geometry dapple-scene dapple-renderer";
/// Crates of programs.
const OF_A_PROGRAM: &str = "clap indicatif ctrlc";

/// A crate, the Dapple crates that it may depend on, both without `dapple-`, and other crates that it may not. `below` stands
/// for all layers below it.
const RULES: [(&str, &str, &str); 22] = [
    ("core", "", "glam obvhs image exr rand"),
    ("low-discrepancy", "core", "glam obvhs image exr"),
    ("conformance", "core metrics", "glam obvhs image exr"),
    ("adaptive", "core", OF_A_SCENE),
    ("mitchell", "core", OF_A_SCENE),
    // The methods that published ones build on.
    ("classics", "core denoise low-discrepancy mitchell", OF_A_SCENE),
    ("light-selection", "", OF_A_SCENE),
    ("clustering", "", OF_A_SCENE),
    ("cluster-adaptive", "core clustering", OF_A_SCENE),
    ("denoise", "core", OF_A_SCENE),
    ("oidn", "core", OF_A_SCENE),
    // Every method with a name, and clusters; no scene.
    (
        "registry",
        "core low-discrepancy adaptive mitchell clustering cluster-adaptive denoise classics oidn",
        OF_A_SCENE,
    ),
    ("metrics", "", "glam obvhs image exr rayon"),
    ("geometry", "", "image exr clap"),
    ("scene", "core", "obvhs clap indicatif"),
    ("renderer", "below", "clap indicatif"),
    ("distributed", "core", OF_A_SCENE),
    ("mpi", "core distributed", OF_A_SCENE),
    // The renderer, and the clusters of the thesis.
    ("transport", "core scene geometry low-discrepancy light-selection renderer clustering", "clap indicatif"),
    ("job", "below", OF_A_PROGRAM),
    ("study", "below", OF_A_PROGRAM),
    ("cli", "below", ""),
];

#[test]
fn crates_depend_only_on_allowed_crates() {
    let metadata = metadata(&[]);
    let graph = graph(&metadata);
    for (name, allowed, forbidden) in RULES {
        let below = LAYERS.split_whitespace().take_while(|layer| *layer != name).collect();
        let allowed: Vec<&str> = if allowed == "below" { below } else { allowed.split_whitespace().collect() };
        let full = format!("dapple-{name}");
        let reached = reaches(&graph, &full);
        for other in reached.iter().filter_map(|n| n.strip_prefix("dapple-")) {
            assert!(allowed.contains(&other), "{name} must not know {other}");
        }
        assert!(!reached.contains("dapple"), "{name} must not know the facade");
        // No member of the workspace has a tree of its own, if no default feature asks for it.
        let with_itself = || reached.iter().copied().chain([full.as_str()]).map(str::to_owned).collect();
        let built = if name == "mpi" { with_itself() } else { built_with(&full) };
        assert!(built.contains(&full), "cargo tree shows nothing of {name}");
        for outsider in forbidden.split_whitespace() {
            assert!(!built.contains(outsider), "{name} must not reach {outsider}");
        }
    }
    // Every crate needs a rule; benches and hosts may use all.
    let names = list(&metadata, "packages").iter().filter_map(|package| text(package, "name").strip_prefix("dapple-"));
    for name in names.filter(|name| !["benches", "web"].contains(name)) {
        assert!(RULES.iter().any(|rule| rule.0 == name), "{name} has no rule in tests/dapple/dependency_gate.rs");
    }
}

#[test]
fn a_forbidden_edge_would_be_seen() {
    let metadata = metadata(&[]);
    let mut graph = graph(&metadata);
    graph.get_mut("dapple-core").expect("core").insert("dapple-geometry");
    assert!(reaches(&graph, "dapple-core").contains("obvhs"), "the walk does not see through edges");
    assert!(built_with("dapple-cli").contains("clap"), "the tree does not show what is there");
}

#[test]
fn only_the_program_is_built_with_libloading_and_nothing_with_mpi_unless_asked() {
    for name in ["dapple", "dapple-registry", "dapple-job", "dapple-study"] {
        assert!(!built_with(name).contains("libloading"), "{name} loads libraries without the feature oidn");
    }
    assert!(!facade_built_with("classics").contains("libloading"), "the feature classics has oidn");
    assert!(facade_built_with("oidn").contains("libloading"), "the feature oidn has nothing");
    let without = tree(&["--package", "dapple-cli", "--no-default-features"]);
    assert!(!without.contains("libloading"), "the program loads libraries without the feature oidn");
    assert!(!built_with("dapple-cli").contains("mpi"), "the default program needs MPI");
    for (feature, brings) in [("oidn", "libloading"), ("mpi", "dapple-mpi")] {
        let asked = tree(&["--package", "dapple-cli", "--features", feature]);
        assert!(asked.contains(brings), "the feature {feature} adds nothing");
    }
}

#[test]
fn a_foreign_renderer_takes_no_scene_along() {
    let source = include_str!("../../examples/foreign_renderer.rs");
    let uses = source.lines().filter_map(|line| line.strip_prefix("use dapple_")?.split("::").next());
    let mut built: BTreeSet<String> = uses.map(|name| format!("dapple-{}", name.replace('_', "-"))).collect();
    assert!(built.contains("dapple-cluster-adaptive"), "the example uses nothing of Dapple");
    built.extend(built.clone().iter().flat_map(|name| built_with(name)));
    let control = built_with("dapple-renderer");
    for outsider in OF_A_SCENE.split_whitespace() {
        assert!(!built.contains(outsider), "a foreign renderer must not be given {outsider}");
        assert!(control.contains(outsider), "the tree does not show {outsider} where it is");
    }
}

/// The largest number of other people's crates that the default features may bring. Six are of thiserror and serde, at build time only.
const FOREIGN_CRATES: usize = 35;

#[test]
fn the_default_features_bring_no_scene_and_few_crates() {
    let built = built_with("dapple");
    for ours in ["dapple-registry", "dapple-adaptive", "dapple-denoise", "dapple-low-discrepancy"] {
        assert!(built.contains(ours), "the default features lack {ours}");
    }
    for heavy in OF_A_SCENE.split_whitespace().chain(["dapple-job", "dapple-study", "clap", "serde_json"]) {
        assert!(!built.contains(heavy), "the default features bring {heavy}");
    }
    assert!(built.contains("rayon") && !facade_built_with("registry").contains("rayon"), "threads are no feature");
    let foreign: Vec<_> = built.iter().filter(|name| !name.starts_with("dapple")).collect();
    assert!(foreign.len() <= FOREIGN_CRATES, "{} crates: {foreign:?}", foreign.len());
    assert!(built_with("dapple-cli").len() > 3 * foreign.len(), "the tree does not show a heavy crate as heavy");
}

/// `(major, minor)` of a version such as `1.90` or `1.85.0`.
fn minor(version: &str) -> (u32, u32) {
    let mut parts = version.split('.').map(|part| part.parse().unwrap_or(0));
    (parts.next().unwrap_or(0), parts.next().unwrap_or(0))
}

/// Clippy's `incompatible_msrv` covers the workspace's own code.
#[test]
fn no_dependency_needs_a_newer_compiler_than_ours() {
    let metadata = metadata(&[]);
    let needed = |package: &Value| package["rust_version"].as_str().map(minor);
    let ours = needed(package(&metadata, "dapple")).expect("our rust-version");
    for package in list(&metadata, "packages") {
        let (name, needed) = (text(package, "name"), needed(package));
        assert!(needed.is_none_or(|needed| needed <= ours), "{name} needs Rust {needed:?}; rust-version is {ours:?}");
    }
    assert!(list(&metadata, "packages").iter().filter_map(needed).count() > 50, "few packages state a version");
    assert!(minor("1.100.0") > minor("1.90"), "versions are compared as text");
}

/// A file of this repository in TOML.
fn file(name: &str) -> toml::Table {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
    toml::from_str(&std::fs::read_to_string(path).expect(name)).expect(name)
}

/// Entries of one of deny.toml's lists: texts, or the crates of tables.
fn listed(section: &str, key: &str) -> Names {
    let deny = file("deny.toml");
    let of = |entry: &toml::Value| entry.get("crate").unwrap_or(entry).as_str().expect("a name").to_owned();
    deny[section][key].as_array().expect("a list").iter().map(of).collect()
}

/// Tells whether a licence expression is met by allowed licences: of each part of an AND, one choice of the OR.
///
/// An OR of ANDs without parentheses is read too strictly.
fn allows(allowed: &Names, expression: &str) -> bool {
    expression.replace('/', " OR ").split(" AND ").all(|part| {
        let part = part.trim_matches(['(', ')', ' ']);
        part.split(" OR ").any(|choice| allowed.contains(choice.trim()))
    })
}

#[test]
fn licences_are_among_those_of_deny_toml() {
    let allowed = listed("licenses", "allow");
    for package in list(&metadata(&["--all-features"]), "packages") {
        let licence = package["license"].as_str().unwrap_or("none");
        assert!(allows(&allowed, licence), "{} has the licence {licence}", package["name"]);
    }
    assert!(allows(&allowed, "(MIT OR LGPL-2.1) AND Unicode-3.0"));
    for other in ["none", "GPL-3.0-only", "MIT AND GPL-3.0-only", "Apache-2.0 WITH LLVM-exception"] {
        assert!(!allows(&allowed, other), "{other} is let through");
    }
}

#[test]
fn second_versions_are_those_that_deny_toml_explains() {
    let lock = file("Cargo.lock");
    // Name, version and source; the workspace's own have no source.
    let keys = |package| ["name", "version", "source"].map(|key| toml::Value::get(package, key)?.as_str());
    let packages = lock["package"].as_array().expect("packages").iter().map(keys);
    let mut locked: Vec<_> =
        packages.filter(|[_, _, source]| source.is_some()).map(|all| all.map(|text| text.expect("text"))).collect();
    assert!(locked.len() > 100, "{} packages", locked.len());
    for [name, _, source] in &locked {
        assert_eq!(*source, "registry+https://github.com/rust-lang/crates.io-index", "{name} is from elsewhere");
    }
    // Packages beside the newest of the same name.
    locked.sort_by_key(|[name, version, _]| (*name, minor(version)));
    let older = locked.windows(2).filter(|pair| pair[0][0] == pair[1][0]);
    let older: Names = older.map(|pair| format!("{}@{}", pair[0][0], pair[0][1])).collect();
    assert_eq!(older, listed("bans", "skip"));
}
