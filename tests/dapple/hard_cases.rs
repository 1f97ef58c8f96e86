//! The catalogue of hard cases: `docs/hard-cases.toml`, the tests that cover each case, and the page made from both.
//!
//! A test covers a case if its name ends, or begins, with the case's id: `rays_never_leak_through_shared_edges_g01`.
//! `DAPPLE_UPDATE=1 cargo test --test dapple hard_cases` writes `docs/results/hard-cases.md` anew.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// One row of `docs/hard-cases.toml`.
#[derive(Clone, Debug)]
struct Case {
    tier: String,
    title: String,
    /// The measured figure.
    figure: String,
    /// The part of the case that fails, with its figure.
    short: String,
    /// The reason why no test exists.
    needs: String,
}

impl Case {
    fn of(id: &str, row: &toml::Value) -> Self {
        let row = row.as_table().expect(id);
        let known = ["tier", "title", "figure", "short", "needs"];
        assert!(row.keys().all(|key| known.contains(&key.as_str())), "{id}: {row:?}");
        let [Some(tier), Some(title), figure, short, needs] =
            known.map(|key| row.get(key).map(|text| text.as_str().expect(id).to_owned()))
        else {
            panic!("{id} has no tier or no title")
        };
        let [figure, short, needs] = [figure, short, needs].map(Option::unwrap_or_default);
        Self { tier, title, figure, short, needs }
    }
}

/// A test function that covers a case.
#[derive(Clone, Debug)]
struct Test {
    id: String,
    /// `crate::file::function`.
    path: String,
    ignored: bool,
}

/// Groups in the order of the file; each case with its id.
type Catalogue = Vec<(String, Vec<(String, Case)>)>;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn catalogue() -> Catalogue {
    let text = read(&root().join("docs/hard-cases.toml"));
    let groups: toml::Table = toml::from_str(&text).expect("docs/hard-cases.toml");
    let cases = |cases: &toml::Value| {
        cases.as_table().expect("cases").iter().map(|(id, row)| (id.clone(), Case::of(id, row))).collect()
    };
    let mut groups: Catalogue = groups.iter().map(|(group, of)| (group.clone(), cases(of))).collect();
    groups.sort_by_key(|(group, _)| text.find(&format!("[{group}]")).or_else(|| text.find(&format!("[\"{group}\"]"))));
    groups
}

pub(crate) fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = entry.expect("an entry").path();
        if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// The id in a test's name: `rest_g01` and `g01_rest` cover G01.
fn id_of(function: &str) -> Option<String> {
    let is_id = |part: &&str| matches!(part.as_bytes(), [a, b, c] if a.is_ascii_lowercase() && b.is_ascii_digit() && c.is_ascii_digit());
    // Types, not cases.
    let is_id = |part: &&str| is_id(part) && !["f16", "f32", "f64"].contains(part);
    let first = function.split('_').next().filter(is_id);
    first.or_else(|| function.rsplit('_').next().filter(is_id)).map(str::to_ascii_uppercase)
}

/// `crate::module` of a file of tests: `crates/core/tests/core/film.rs` is `core::film`.
fn module_of(file: &Path) -> String {
    let parts: Vec<String> = file.with_extension("").iter().map(|part| part.to_string_lossy().into_owned()).collect();
    let (name, rest) = if parts[0] == "crates" { (parts[1].as_str(), &parts[2..]) } else { ("dapple", &parts[..]) };
    let rest = rest.iter().map(String::as_str).filter(|part| !["src", "tests", "mod", name].contains(part));
    std::iter::once(name).chain(rest).collect::<Vec<_>>().join("::")
}

/// Every test with an id, in the order of files and lines.
fn tests() -> Vec<Test> {
    let mut found = Vec::new();
    for file in ["crates", "tests"].iter().flat_map(|folder| rust_files(&root().join(folder))) {
        let module = module_of(file.strip_prefix(root()).expect("a file of this tree"));
        let (mut is_test, mut ignored) = (false, None);
        for line in read(&file).lines().map(str::trim) {
            if line == "#[test]" {
                is_test = true;
            } else if line.starts_with("#[ignore") {
                ignored = Some(line.to_owned());
            } else if let Some(rest) = line.strip_prefix("fn ") {
                let function = rest.split(['(', '<']).next().unwrap_or_default();
                // A test that another test runs in a process of its own.
                let is_child = ignored.as_ref().is_some_and(|reason| reason.contains("\"run by "));
                if let (true, false, Some(id)) = (is_test, is_child, id_of(function)) {
                    found.push(Test { id, path: format!("{module}::{function}"), ignored: ignored.is_some() });
                }
                (is_test, ignored) = (false, None);
            } else if !line.starts_with("#[") && !line.starts_with("//") {
                (is_test, ignored) = (false, None);
            }
        }
    }
    found
}

fn status(case: &Case, tests: &[&Test]) -> String {
    match tests {
        [] => format!("missing: {}", case.needs),
        _ if !case.short.is_empty() => format!("short: {}", case.short),
        _ if tests.iter().all(|test| test.ignored) => "by hand".to_owned(),
        _ => "done".to_owned(),
    }
}

fn of_case<'t>(id: &str, tests: &'t [Test]) -> Vec<&'t Test> {
    tests.iter().filter(|test| test.id == id).collect()
}

/// Ids without a case, cases without a test or a reason, and reasons beside a test.
fn contradictions(catalogue: &Catalogue, tests: &[Test]) -> Vec<String> {
    let cases: BTreeMap<&String, &Case> =
        catalogue.iter().flat_map(|(_, cases)| cases).map(|(id, c)| (id, c)).collect();
    let unknown = tests.iter().filter(|test| !cases.contains_key(&test.id));
    let mut found: Vec<String> = unknown.map(|test| format!("{}: no case {}", test.path, test.id)).collect();
    for (id, case) in &cases {
        let own = of_case(id, tests);
        if own.is_empty() && case.needs.is_empty() {
            found.push(format!("{id} has no test; add `needs` to docs/hard-cases.toml"));
        }
        if !own.is_empty() && !case.needs.is_empty() {
            found.push(format!("{id} has a test; remove its `needs` from docs/hard-cases.toml"));
        }
        if case.tier == "T1" && !own.is_empty() && own.iter().all(|test| test.ignored) {
            found.push(format!("{id} is T1, and all its tests are ignored"));
        }
        if case.title.is_empty() || !["T1", "T2", "T3", "T2/T3"].contains(&case.tier.as_str()) {
            found.push(format!("{id} lacks a title or a tier"));
        }
    }
    found
}

const INTRODUCTION: &str = "\
# Which inputs break straightforward code, and how does Dapple take each?

121 hard inputs, with the figure that their tests measure or assert. A test's name contains its case's id: `cargo test --workspace g01` runs those of G01.
`DAPPLE_UPDATE=1 cargo test --test dapple hard_cases` makes this page from [hard-cases.toml](../hard-cases.toml) and the tests.

* `cargo test --workspace` runs tests of all cases but T2 and T3; `DAPPLE_THOROUGH=1 cargo test --release --workspace -- --include-ignored` runs **T2**. **T3** takes a machine for long.
* *by hand*: every test of the case is slow, and ignored by default. *short*: a part of the case fails. *missing*: no test.

";

fn page(catalogue: &Catalogue, tests: &[Test]) -> String {
    let mut page = INTRODUCTION.to_owned();
    page.push_str("| cases | all | done | by hand | short | missing |\n|---|---|---|---|---|---|\n");
    let mut count = |name: &str, cases: &[&(String, Case)]| {
        let statuses: Vec<String> = cases.iter().map(|(id, case)| status(case, &of_case(id, tests))).collect();
        let of = |kind: &str| statuses.iter().filter(|status| status.starts_with(kind)).count();
        let [done, by_hand, short, missing] = ["done", "by hand", "short", "missing"].map(of);
        let _ = writeln!(page, "| {name} | {} | {done} | {by_hand} | {short} | {missing} |", cases.len());
    };
    let all: Vec<&(String, Case)> = catalogue.iter().flat_map(|(_, cases)| cases).collect();
    count("all", &all);
    count("T1", &all.iter().copied().filter(|(_, case)| case.tier == "T1").collect::<Vec<_>>());
    for (group, cases) in catalogue {
        let _ = write!(page, "\n## {group}\n\n");
        for (id, case) in cases {
            let Case { tier, title, figure, .. } = case;
            let status = status(case, &of_case(id, tests));
            let status = Some(status.as_str()).filter(|&status| status != "done");
            let figure = Some(figure.as_str()).filter(|figure| !figure.is_empty());
            let facts: Vec<&str> = figure.into_iter().chain(status).collect();
            let tier = if tier == "T1" { String::new() } else { format!(" ({tier})") };
            let colon = if facts.is_empty() { "" } else { ": " };
            let _ = writeln!(page, "* **{id}** {title}{tier}{colon}{}", facts.join("; "));
        }
    }
    page
}

#[test]
fn every_case_has_a_test_or_a_reason() {
    let (catalogue, tests) = (catalogue(), tests());
    let cases = || catalogue.iter().flat_map(|(_, cases)| cases);
    assert_eq!(cases().count(), 121);
    assert_eq!(cases().filter(|(_, case)| case.tier == "T1").count(), 95);
    let found = contradictions(&catalogue, &tests);
    assert!(found.is_empty(), "{found:#?}");
    // Negative controls: a case that loses its tests, and a test without a case.
    let without: Vec<_> = tests.iter().filter(|test| test.id != "F01").cloned().collect();
    assert_eq!(contradictions(&catalogue, &without).len(), 1);
    let mut unknown = tests;
    unknown[0].id = "Q99".into();
    assert!(contradictions(&catalogue, &unknown)[0].contains("no case Q99"));
}

#[test]
fn the_page_of_hard_cases_is_up_to_date() {
    let path = root().join("docs/results/hard-cases.md");
    let page = page(&catalogue(), &tests());
    if std::env::var_os("DAPPLE_UPDATE").is_some() {
        std::fs::write(&path, &page).expect("a page that can be written");
    }
    assert!(page == read(&path), "out of date: DAPPLE_UPDATE=1 cargo test --test dapple hard_cases");
}

/// A file of tests that its program's `main.rs` does not name is never compiled.
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
            // Tests of what is private belong to the file of the source that names them.
            if name != "main" && name != "internals" && path.extension().is_some_and(|of| of == "rs") {
                assert!(main.contains(&format!("\nmod {name};\n")), "{}: `mod {name};` is missing", path.display());
                files += 1;
            }
        }
    }
    assert!(files >= 50, "{files}");
}

/// The files that may hold unsafe code, by crate.
const UNSAFE_FILES: [(&str, &str); 3] =
    [("crates/oidn", "src/library.rs"), ("crates/mpi", "src/one_host.rs"), ("examples/web", "src/lib.rs")];

/// Holds the workspace to `unsafe_code = "forbid"`, but for three files, and release builds to overflow checks.
#[test]
fn unsafe_is_forbidden_everywhere_d07() {
    let manifest = |path: &Path| -> toml::Table { toml::from_str(&read(path)).expect("TOML") };
    let workspace = manifest(&root().join("Cargo.toml"));
    assert_eq!(workspace["workspace"]["lints"]["rust"]["unsafe_code"].as_str(), Some("forbid"));
    let release = &workspace["profile"]["release"];
    assert_eq!(release["overflow-checks"].as_bool(), Some(true));
    let packages = release["package"].as_table().expect("packages").iter();
    let without: Vec<&str> =
        packages.filter(|(_, of)| of.get("overflow-checks").is_some()).map(|(name, _)| name.as_str()).collect();
    assert_eq!(without, ["*", "dapple-geometry"], "docs/results/price.md gives the reason for each exception");
    let crates = std::fs::read_dir(root().join("crates")).expect("crates");
    let mut manifests: Vec<_> = crates.map(|e| e.expect("an entry").path().join("Cargo.toml")).collect();
    manifests.push(root().join("Cargo.toml"));
    assert!(manifests.len() >= 12);
    for path in manifests {
        if UNSAFE_FILES.iter().any(|(name, _)| path.ends_with(format!("{name}/Cargo.toml"))) {
            continue;
        }
        let inherits = manifest(&path).get("lints").and_then(|l| l.get("workspace")).and_then(toml::Value::as_bool);
        assert_eq!(inherits, Some(true), "{}: [lints] workspace = true is missing", path.display());
    }
    for (name, file) in UNSAFE_FILES {
        let folder = root().join(name);
        only_one_file_has_unsafe_code(&workspace, &manifest(&folder.join("Cargo.toml")), &folder, file);
    }
}

/// Work with a C library, and names of exported functions, need `unsafe`: `deny` in that crate instead of `forbid`, all else as in the workspace, and one
/// file that allows it.
fn only_one_file_has_unsafe_code(workspace: &toml::Table, calling: &toml::Table, folder: &Path, file: &str) {
    let [ours, theirs] = [&workspace["workspace"]["lints"], &calling["lints"]];
    for tool in ["rust", "clippy"] {
        for (lint, level) in ours[tool].as_table().expect("lints") {
            let deny = toml::Value::from("deny");
            let expected = if lint == "unsafe_code" { &deny } else { level };
            assert_eq!(theirs[tool].get(lint), Some(expected), "{}/Cargo.toml: {tool} {lint}", folder.display());
        }
    }
    let sources = std::fs::read_dir(folder.join("src")).expect("a folder").map(|e| e.expect("an entry").path());
    let sources = sources.filter(|p| p.extension().is_some_and(|e| e == "rs"));
    let allows = |text: &str| text.contains("allow(unsafe_code") || text.contains("expect(unsafe_code");
    let allowing: Vec<_> = sources.filter(|p| allows(&read(p))).collect();
    assert!(matches!(&allowing[..], [one] if one.ends_with(file)), "{allowing:?}");
}
