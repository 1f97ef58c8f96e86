//! The list of hard cases, the tests of the tree, and the page that shows both.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// One case of `docs/hard-cases.toml`.
#[derive(Clone, Debug, Default)]
pub struct Case {
    /// A letter and two digits.
    pub id: String,
    pub group: String,
    pub tier: String,
    pub title: String,
    pub figure: String,
    pub short: String,
    pub needs: String,
    /// Why no safeguard was taken out.
    pub whole: String,
}

/// One test function whose name begins with an id.
#[derive(Clone, Debug)]
pub struct Test {
    pub id: String,
    /// `crate::file::function`.
    pub path: String,
    /// Why it is not run by `cargo test`.
    pub ignored: Option<String>,
    /// What runs it.
    pub command: String,
}

/// The list, group by group, in the order of the file.
pub fn cases(root: &Path) -> Result<Vec<Case>, String> {
    let path = root.join("docs/hard-cases.toml");
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let table: toml::Table = toml::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut found = Vec::new();
    for (group, rows) in &table {
        for (id, row) in rows.as_table().ok_or_else(|| format!("{group} is no table"))? {
            let row = row.as_table().ok_or_else(|| format!("{id} is no table"))?;
            let word = |key: &str| row.get(key).and_then(toml::Value::as_str).unwrap_or_default().to_owned();
            let known = ["tier", "title", "figure", "short", "needs", "whole"];
            if let Some(key) = row.keys().find(|k| !known.contains(&k.as_str())) {
                return Err(format!("{id}: '{key}' is no word of this list"));
            }
            found.push(Case {
                id: id.clone(),
                group: group.clone(),
                tier: word("tier"),
                title: word("title"),
                figure: word("figure"),
                short: word("short"),
                needs: word("needs"),
                whole: word("whole"),
            });
        }
    }
    let place = |c: &Case| (text.find(&format!("\n{} = ", c.id)), c.id.clone());
    found.sort_by_key(place);
    Ok(found)
}

/// Every test of the tree whose name begins with an id, in the order of files and lines.
pub fn tests(root: &Path) -> Result<Vec<Test>, String> {
    let mut files = Vec::new();
    for folder in ["crates", "tests"] {
        collect(&root.join(folder), &mut files)?;
    }
    files.sort();
    let mut found = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).map_err(|e| format!("{}: {e}", file.display()))?;
        let place = Place::of(file.strip_prefix(root).map_err(|e| e.to_string())?);
        tests_of(&text, &place, &mut found);
    }
    Ok(found)
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), String> {
    for entry in std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))? {
        let path = entry.map_err(|e| e.to_string())?.path();
        if path.is_dir() {
            if path.file_name().is_none_or(|n| n != "target") {
                collect(&path, files)?;
            }
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    Ok(())
}

/// Where a file of tests belongs.
struct Place {
    package: String,
    module: String,
    /// The name of an integration test; none for unit tests.
    target: Option<String>,
    /// The part of the module that the test program knows: all but its own name.
    within: String,
}

impl Place {
    fn of(file: &Path) -> Self {
        let words: Vec<String> = file.with_extension("").iter().map(|w| w.to_string_lossy().into_owned()).collect();
        let (package, rest) = match &words[..] {
            [first, name, rest @ ..] if first == "crates" => (name.clone(), rest),
            rest => ("dapple".to_owned(), rest),
        };
        let target = (rest[0] == "tests").then(|| rest[1].clone());
        let path = |words: &[String]| words.iter().filter(|w| *w != "mod").cloned().collect::<Vec<_>>().join("::");
        let within = if target.is_some() { path(&rest[2..]) } else { String::new() };
        // A crate's one test program has its name, which need not be said twice.
        let module = if target.as_ref() == Some(&package) { within.clone() } else { path(&rest[1..]) };
        Self { package, module, target, within }
    }

    fn command(&self, function: &str, ignored: bool) -> String {
        let package = if self.package == "dapple" { "dapple".to_owned() } else { format!("dapple-{}", self.package) };
        let target = self.target.as_ref().map_or("--lib".to_owned(), |t| format!("--test {t}"));
        let ignored = if ignored { "--ignored " } else { "" };
        let within = if self.within.is_empty() { String::new() } else { format!("{}::", self.within) };
        format!("cargo test --release -p {package} {target} -- {ignored}{within}{function}")
    }
}

/// Functions under `#[test]`, attributes being the lines right above.
fn tests_of(text: &str, place: &Place, found: &mut Vec<Test>) {
    let (mut is_test, mut ignored) = (false, None);
    for line in text.lines().map(str::trim) {
        if line == "#[test]" {
            is_test = true;
        } else if let Some(rest) = line.strip_prefix("#[ignore") {
            ignored = Some(rest.split('"').nth(1).unwrap_or("").to_owned());
        } else if let Some(rest) = line.strip_prefix("fn ") {
            let function = rest.split(['(', '<']).next().unwrap_or_default();
            // What a test runs as a process of its own is no test by itself.
            let own = ignored.as_ref().is_some_and(|why: &String| why.starts_with("run by "));
            if let (true, false, Some(id)) = (is_test, own, id_of(function)) {
                let command = place.command(function, ignored.is_some());
                let path = format!("{}::{}::{function}", place.package, place.module);
                found.push(Test { id, path, ignored: ignored.take(), command });
            }
            (is_test, ignored) = (false, None);
        } else if !line.starts_with("#[") && !line.starts_with("//") && !line.is_empty() {
            (is_test, ignored) = (false, None);
        }
    }
}

/// The id that a name begins with: `g01_rest` is of G01.
fn id_of(function: &str) -> Option<String> {
    let (id, _) = function.split_once('_')?;
    let [letter, tens, ones] = id.as_bytes() else { return None };
    (letter.is_ascii_lowercase() && tens.is_ascii_digit() && ones.is_ascii_digit()).then(|| id.to_ascii_uppercase())
}

/// How a case stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    Done,
    Short,
    ByHand,
    Missing,
}

impl Status {
    pub fn of(case: &Case, tests: &[&Test]) -> Self {
        match tests {
            [] => Self::Missing,
            _ if !case.short.is_empty() => Self::Short,
            _ if tests.iter().all(|t| t.ignored.is_some()) => Self::ByHand,
            _ => Self::Done,
        }
    }
}

/// What contradicts itself: ids without a case, T1 cases without a test or a reason, reasons beside a test; tested cases whose
/// safeguard nothing has taken out (`taken_out` are the ids of mutations), without a reason, and reasons beside one.
#[allow(dead_code, reason = "the test asks, the program does not")]
pub fn contradictions(cases: &[Case], tests: &[Test], taken_out: &[String]) -> Vec<String> {
    let mut found = Vec::new();
    for test in tests.iter().filter(|t| !cases.iter().any(|c| c.id == t.id)) {
        found.push(format!("{}: there is no case {}", test.path, test.id));
    }
    for case in cases {
        let own: Vec<&Test> = tests.iter().filter(|t| t.id == case.id).collect();
        match (own.is_empty(), case.needs.is_empty()) {
            (true, true) => {
                found.push(format!("{} has no test, and docs/hard-cases.toml does not say what it needs", case.id))
            }
            (false, false) => {
                found.push(format!("{} has a test: take its `needs` out of docs/hard-cases.toml", case.id))
            }
            _ => {}
        }
        match (own.is_empty(), taken_out.contains(&case.id), case.whole.is_empty()) {
            (false, false, true) => found.push(format!(
                "{} has no mutation in tests/mutations/list.toml, and docs/hard-cases.toml does not say why (`whole`)",
                case.id
            )),
            (true, _, false) | (_, true, false) => found
                .push(format!("{} has no test, or a mutation: take its `whole` out of docs/hard-cases.toml", case.id)),
            _ => {}
        }
        let runs = own.iter().any(|t| t.ignored.is_none());
        if case.tier == "T1" && !own.is_empty() && !runs {
            found.push(format!("{} is T1, and all its tests are ignored", case.id));
        }
        if case.title.is_empty() || !["T1", "T2", "T3", "T2/T3"].contains(&case.tier.as_str()) {
            found.push(format!("{} lacks a title or a tier", case.id));
        }
    }
    found
}

/// The page.
pub fn page(cases: &[Case], tests: &[Test], mutations: &str) -> String {
    let mut page = String::from(
        "# Hard cases\n\nInputs on which straightforward code fails, each with the tests that hold it off; their names begin with the \
         case's id. Made by `cargo run --example hard_cases -- --write` from [docs/hard-cases.toml](../hard-cases.toml) and the \
         tests of the tree; `cargo test --test hard_cases` fails where this page is out of date.\n\n\
         * **T1** is run by every `cargo test --workspace`; **T2** by hand, before an issue is called resolved (`cargo test \
         --release --workspace -- --ignored`, or one by the command beside it); **T3** before a release.\n\
         * *done*: run by every `cargo test`. *by hand*: every test of it is ignored there, for its time. *short*: tested, and \
         something is not as it should be. *missing*: no test yet.\n\n",
    );
    let own = |case: &Case| -> Vec<&Test> { tests.iter().filter(|t| t.id == case.id).collect() };
    let mut groups: Vec<&str> = cases.iter().map(|c| c.group.as_str()).collect();
    groups.dedup();
    page.push_str("| group | cases | done | by hand | short | missing |\n|---|---|---|---|---|---|\n");
    let count = |name: &str, of: &dyn Fn(&Case) -> bool| {
        let mut counts: BTreeMap<Status, usize> = BTreeMap::new();
        for case in cases.iter().filter(|c| of(c)) {
            *counts.entry(Status::of(case, &own(case))).or_default() += 1;
        }
        let n = |s| counts.get(&s).copied().unwrap_or(0);
        format!(
            "| {name} | {} | {} | {} | {} | {} |\n",
            counts.values().sum::<usize>(),
            n(Status::Done),
            n(Status::ByHand),
            n(Status::Short),
            n(Status::Missing)
        )
    };
    for group in &groups {
        page.push_str(&count(group, &|c| c.group == *group));
    }
    page.push_str(&count("**all**", &|_| true));
    page.push_str(&count("of these T1", &|c| c.tier == "T1"));
    for group in groups {
        let _ =
            write!(page, "\n## {group}\n\n| id | tier | case | status | tests | figure |\n|---|---|---|---|---|---|\n");
        for case in cases.iter().filter(|c| c.group == group) {
            page.push_str(&row(case, &own(case)));
        }
    }
    let ignored: Vec<&Test> = tests.iter().filter(|t| t.ignored.is_some()).collect();
    page.push_str("\n## By hand\n\n| test | why | command |\n|---|---|---|\n");
    for test in ignored {
        let _ = writeln!(
            page,
            "| `{}` | {} | `{}` |",
            test.path,
            test.ignored.as_deref().unwrap_or_default(),
            test.command
        );
    }
    page.push_str(mutations);
    page.push_str("\nNothing was taken out of these, and why:\n\n");
    for case in cases.iter().filter(|c| !c.whole.is_empty()) {
        let _ = writeln!(page, "* {} ({}): {}.", case.id, case.title, case.whole);
    }
    page
}

fn row(case: &Case, tests: &[&Test]) -> String {
    let status = match Status::of(case, tests) {
        Status::Done => "done".to_owned(),
        Status::ByHand => "by hand".to_owned(),
        Status::Short => format!("short: {}", case.short),
        Status::Missing => format!("missing: {}", case.needs),
    };
    let name = |t: &&Test| format!("`{}`{}", t.path, if t.ignored.is_some() { " (by hand)" } else { "" });
    let tests: Vec<String> = tests.iter().map(name).collect();
    format!("| {} | {} | {} | {status} | {} | {} |\n", case.id, case.tier, case.title, tests.join("<br>"), case.figure)
}
