//! The commands, files and links of the documentation work as written.
//!
//! Comments in the pages direct this test. Each applies to the fenced block below it:
//!
//! * `<!-- not run: REASON -->`: a shell block that is not run;
//! * `<!-- not run: CI runs it -->`: a shell block of which `.ci/run` has every line;
//! * `<!-- writes: FILE FILE -->`: files that exist after the page's last block;
//! * `<!-- quick: A => B -->`: runs the block with A replaced by B, so that the test takes seconds;
//! * `<!-- file: PATH -->`: a block with the contents of this file;
//! * `<!-- insert: PATH after: TEXT -->`, `before: TEXT`, `instead of: TEXT`: lines to insert after (before, in place
//!   of) the first line that contains TEXT;
//! * `<!-- then: REASON -->`: commands to run in the changed copy of the workspace.
//!
//! Shell blocks of a page run in one temporary folder, in order. It holds `scene.pbrt`, the Cornell box at 24x24
//! pixels. Programs in Rust are doctests of the crate `dapple` (src/lib.rs).

#![allow(unreachable_pub, reason = "files of other crates, compiled as modules")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The sampler of docs/ADDING-A-SAMPLER.md, compiled here so that its tests run.
#[allow(unreachable_pub, reason = "public in its own crate")]
#[path = "docs/brightness.rs"]
mod brightness;
/// The filter of docs/ADDING-A-FILTER.md.
#[allow(unreachable_pub, reason = "public in its own crate")]
#[path = "docs/median.rs"]
mod median;

/// The pages and steps that `docs/results/make` knows.
#[path = "docs/results.rs"]
mod results;

/// Pages whose shell blocks run.
const RUN: [&str; 7] = [
    "README.md",
    "docs/PARTS.md",
    "docs/book/src/first-render.md",
    "docs/book/src/your-scene.md",
    "docs/book/src/maps-and-report.md",
    "docs/book/src/writing-a-sampler.md",
    "docs/book/src/your-renderer.md",
];

/// Pages that describe a change of this workspace.
const ERRANDS: [&str; 8] = [
    "docs/ADDING-A-SAMPLER.md",
    "docs/ADDING-A-FILTER.md",
    "docs/ADDING-A-LIGHT.md",
    "docs/ADDING-A-SCENE-FORMAT.md",
    "docs/ADDING-AN-INTEGRATOR.md",
    "docs/ADDING-A-METRIC.md",
    "docs/ADDING-A-MATERIAL.md",
    "docs/ADDING-A-LAYER.md",
];

/// A fenced block of a page, and the directives above it.
struct Block {
    line: usize,
    language: String,
    directives: Vec<String>,
    text: String,
}

impl Block {
    fn directive(&self, name: &str) -> Option<&str> {
        self.directives.iter().find_map(|d| d.strip_prefix(name)?.strip_prefix(": "))
    }

    /// The block's text with the replacements of `quick`.
    fn quick(&self) -> String {
        self.directives.iter().filter_map(|d| d.strip_prefix("quick: ")?.split_once(" => ")).fold(
            self.text.clone(),
            |text, (from, to)| {
                assert!(text.contains(from), "line {}: the block does not contain \"{from}\"", self.line);
                text.replace(from, to)
            },
        )
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn page(name: &str) -> String {
    std::fs::read_to_string(root().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn blocks(name: &str) -> Vec<Block> {
    let (mut found, mut directives, mut open) = (Vec::new(), Vec::new(), None::<Block>);
    for (i, line) in page(name).lines().enumerate() {
        match open.take() {
            Some(block) if line == "```" => found.push(block),
            Some(mut block) => {
                block.text += line;
                block.text.push('\n');
                open = Some(block);
            }
            None => {
                if let Some(language) = line.strip_prefix("```") {
                    let directives = std::mem::take(&mut directives);
                    open = Some(Block { line: i + 1, language: language.to_owned(), directives, text: String::new() });
                } else if let Some(directive) = line.strip_prefix("<!-- ").and_then(|l| l.strip_suffix(" -->")) {
                    directives.push(directive.to_owned());
                } else if !line.is_empty() {
                    directives.clear();
                }
            }
        }
    }
    assert!(open.is_none(), "{name}: a block is not closed");
    found
}

/// Every Markdown file of the repository's own documentation.
fn pages() -> Vec<String> {
    let (mut found, mut folders) =
        (vec!["README.md".to_owned(), "CONTRIBUTING.md".into(), "CHANGELOG.md".into()], vec!["docs".to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(root().join(&folder)).expect("a folder") {
            let entry = entry.expect("an entry");
            let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
            match entry.path().is_dir() {
                true => folders.push(name),
                false if name.ends_with(".md") => found.push(name),
                false => {}
            }
        }
    }
    found.sort();
    found
}

/// The folder of the program `dapple`, as `cargo test --workspace` builds it for the tests of `dapple-cli`.
fn program_folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let mut build = Command::new(env!("CARGO"));
        build.args(["test", "--quiet", "--offline", "--workspace", "--no-run", "--test", "cli"]);
        if !cfg!(debug_assertions) {
            build.arg("--release");
        }
        let output = build.current_dir(root()).output().expect("cargo runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let test = std::env::current_exe().expect("a test is a program");
        test.ancestors().nth(2).expect("tests lie in target/PROFILE/deps").to_owned()
    })
}

fn small_scene() -> String {
    let scene =
        std::fs::read_to_string(root().join("crates/scene/src/bundled/cornell/scene.pbrt")).expect("a bundled scene");
    assert!(scene.contains("[ 512 ]"));
    scene.replace("[ 512 ]", "[ 24 ]").replace("cornell.exr", "scene.exr")
}

/// Writes a page's files and runs its shell blocks, in order.
fn run_page(name: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("scene.pbrt"), small_scene()).expect("a scene");
    let path = std::env::join_paths(
        [program_folder().to_owned()]
            .into_iter()
            .chain(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())),
    )
    .expect("a path");
    for block in blocks(name) {
        if let Some(file) = block.directive("file") {
            std::fs::write(folder.path().join(file), &block.text).expect("a file");
        }
        if block.language != "sh" || block.directive("not run").is_some() {
            continue;
        }
        let output = Command::new("sh")
            .args(["-e", "-c", &block.quick()])
            .env("PATH", &path)
            .current_dir(folder.path())
            .output()
            .expect("a shell");
        assert!(output.status.success(), "{name}:{}: {}", block.line, String::from_utf8_lossy(&output.stderr));
    }
    for block in blocks(name) {
        if let Some(files) = block.directive("writes") {
            for file in files.split(' ') {
                assert!(folder.path().join(file).is_file(), "{name}:{}: {file} is missing", block.line);
            }
        }
    }
}

#[test]
fn the_commands_of_the_readme_run() {
    run_page(RUN[0]);
}

#[test]
fn the_commands_of_the_tutorial_and_of_shards_run() {
    RUN[1..].iter().for_each(|name| run_page(name));
}

#[test]
fn every_link_of_the_documentation_leads_to_a_file() {
    let mut links = 0;
    for name in pages() {
        let text = page(&name);
        let folder = root().join(&name);
        for (i, line) in text.lines().enumerate() {
            for target in line.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
                let target = target.split('#').next().unwrap_or_default();
                if target.is_empty() || target.contains("://") {
                    continue;
                }
                links += 1;
                let file = folder.parent().expect("a folder").join(target);
                assert!(file.exists(), "{name}:{}: {target} is not there", i + 1);
            }
        }
    }
    assert!(links > 100, "{links} links");
}

/// Text of the repository's pages, and of the crates' front pages.
fn every_page() -> Vec<(String, String)> {
    let crates = std::fs::read_dir(root().join("crates")).expect("a folder");
    let fronts =
        crates.map(|entry| format!("crates/{}/README.md", entry.expect("an entry").file_name().to_string_lossy()));
    pages().into_iter().chain(fronts).map(|name| (name.clone(), page(&name))).collect()
}

#[test]
fn no_page_adds_a_package_that_is_not_published() {
    let published = !page("CHANGELOG.md").contains("(unreleased)");
    for (name, text) in every_page() {
        for command in text.split("cargo add dapple").skip(1) {
            assert!(published || command.starts_with(" --path"), "{name}: cargo add without --path");
        }
    }
    assert!(published || page("README.md").contains("Nothing is published as a package yet"));
}

#[test]
fn figures_of_the_readme_are_those_of_the_race() {
    let race = page("docs/results/race.md");
    let readme = page("README.md");
    let table = readme.lines().skip_while(|line| !line.starts_with("| | 1 spp |")).skip(2);
    let rows: Vec<&str> = table.take_while(|line| line.starts_with('|')).collect();
    assert!((2..=4).contains(&rows.len()), "{rows:?}");
    for row in rows {
        let cells = row.split('|').map(|cell| cell.trim().trim_matches('*')).filter(|cell| cell.parse::<f64>().is_ok());
        let figures: Vec<&str> = cells.collect();
        // A figure, then its interval.
        let has_all = |line: &str| {
            let mut cells = line.split('|').map(|cell| cell.trim().split(' ').next().unwrap_or_default());
            figures.iter().all(|figure| cells.any(|cell| cell == *figure))
        };
        assert!(figures.len() == 5 && race.lines().any(has_all), "{row}");
    }
}

/// Crates whose front page has a program that runs.
const FRONTS: [&str; 15] = [
    "adaptive",
    "classics",
    "cluster-adaptive",
    "geometry",
    "job",
    "light-selection",
    "low-discrepancy",
    "registry",
    "renderer",
    "scene",
    "study",
    "transport",
    "core",
    "denoise",
    "clustering",
];

#[test]
fn the_front_of_each_crate_has_a_program_that_runs() {
    for name in FRONTS {
        let front = page(&format!("crates/{name}/src/lib.rs"));
        let front =
            front.lines().take_while(|line| line.starts_with("//!") || line.starts_with("#![doc")).collect::<Vec<_>>();
        let readme = page(&format!("crates/{name}/README.md"));
        let is_there = |text: &str| text.contains("```rust\n") || text.contains("//! ```\n");
        assert!(is_there(&front.join("\n")) || front[0].contains("../README.md") && is_there(&readme), "{name}");
    }
}

/// Every option in a page exists, even in commands that no test runs.
#[test]
fn shell_blocks_that_do_not_run_here_run_in_ci_or_give_a_reason() {
    let ci = page(".ci/run");
    let in_ci = |command: &str| ci.lines().any(|line| line.trim() == command);
    for name in RUN.iter().chain(&ERRANDS) {
        for block in blocks(name).iter() {
            let Some(reason) = block.directive("not run") else { continue };
            assert_eq!(block.language, "sh", "{name}:{}", block.line);
            if reason == "CI runs it" {
                block.text.lines().for_each(|line| assert!(in_ci(line), "{name}:{}: .ci/run lacks {line}", block.line));
            }
        }
    }
    assert!(page("CONTRIBUTING.md").contains("\ncargo test --workspace\n") && in_ci("cargo test --workspace"));
}

#[test]
fn the_guides_sampler_and_filter_are_the_tested_files() {
    for (name, file) in [(ERRANDS[0], "brightness.rs"), (ERRANDS[1], "median.rs")] {
        let guide = blocks(name);
        let block = guide.iter().find(|b| b.directive("file").is_some_and(|f| f.ends_with(file)));
        assert_eq!(block.expect("a file").text, page(&format!("tests/dapple/docs/{file}")), "{name}");
    }
}

/// Letters of a name, without accents; "oe" and "ö" are alike.
fn letters(text: &str) -> String {
    let plain = text
        .to_lowercase()
        .replace('ö', "o")
        .replace('š', "s")
        .replace('á', "a")
        .replace(['é', 'è'], "e")
        .replace('ř', "r");
    plain.chars().filter(char::is_ascii_alphabetic).collect::<String>().replace("oe", "o")
}

/// Citations such as `[Kirk and Arvo 1991]` or `[after Pharr et al. 2023, eq. 9.6; Veach 1997]`: first author and year.
fn citations(text: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for inside in text.split('[').skip(1).filter_map(|rest| rest.split(['[', ']', '\n']).next()) {
        for part in inside.split(';') {
            let part = part.trim().trim_start_matches("after ");
            let words: Vec<&str> = part.split([' ', ',']).collect();
            let year = words.iter().position(|w| w.len() == 4 && w.starts_with(['1', '2']) && w.parse::<u32>().is_ok());
            let known = |w: &&str| w.starts_with(char::is_uppercase) || matches!(*w, "and" | "et" | "al." | "van");
            if let Some(at) = year.filter(|&at| at > 0 && words[..at].iter().all(known) && letters(words[0]).len() > 2)
            {
                found.push((words[0].to_owned(), words[at].to_owned()));
            }
        }
    }
    found
}

#[test]
fn every_citation_has_an_entry_in_the_bibliography() {
    let bibliography = page("docs/references.bib");
    let entries: Vec<(String, &str)> = bibliography.split("\n@").map(|e| (letters(e), e)).collect();
    let list = Command::new("git").args(["ls-files", "*.rs", "*.md"]).current_dir(root()).output().expect("git");
    let mut cited = 0;
    for name in String::from_utf8(list.stdout).expect("names").lines().filter(|&name| name != "tests/dapple/docs.rs") {
        let Ok(text) = std::fs::read_to_string(root().join(name)) else { continue };
        for (author, year) in citations(&text) {
            let there = entries.iter().any(|(all, entry)| all.contains(&letters(&author)) && entry.contains(&year));
            assert!(there, "{name}: [{author} {year}] has no entry in docs/references.bib");
            cited += 1;
        }
    }
    assert!(cited > 60, "{cited} citations");
    assert_eq!(citations("[after Möller and Trumbore 1997, p. 3; Nobody 1801] [a 1999]").len(), 2);
}

/// A copy of the workspace without build products, at a fixed place, so that the next run compiles less.
fn scratch() -> PathBuf {
    let folder = root().join("target/docs/workspace");
    let list =
        Command::new("git").args(["ls-files", "-co", "--exclude-standard"]).current_dir(root()).output().expect("git");
    assert!(list.status.success(), "{}", String::from_utf8_lossy(&list.stderr));
    for name in String::from_utf8(list.stdout).expect("names").lines() {
        let (from, to) = (root().join(name), folder.join(name));
        let Ok(text) = std::fs::read(&from) else { continue };
        if std::fs::read(&to).is_ok_and(|there| there == text) {
            continue;
        }
        std::fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
        std::fs::write(to, text).expect("a file");
    }
    folder
}

/// Makes the changes that a page describes; returns the number of changed files.
fn apply(name: &str, workspace: &Path) -> usize {
    let mut touched = std::collections::BTreeSet::new();
    for block in blocks(name) {
        if let Some(file) = block.directive("file") {
            let to = workspace.join(file);
            std::fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
            std::fs::write(&to, &block.text).expect("a file");
            touched.insert(file.to_owned());
        }
        if let Some((file, place)) = block.directive("insert").and_then(|d| d.split_once(' ')) {
            let path = workspace.join(file);
            let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{name}:{}: {file}: {e}", block.line));
            let (kind, anchor) = place.split_once(": ").unwrap_or_else(|| panic!("{name}:{}: {place}", block.line));
            let (first, last) = match kind {
                "after" => (1, 1),
                "before" => (0, 0),
                "instead of" => (0, 1),
                _ => panic!("{name}:{}: {place}", block.line),
            };
            let at = text.lines().position(|l| l.contains(anchor));
            let at = at.unwrap_or_else(|| panic!("{name}:{}: {file} has no line with \"{anchor}\"", block.line));
            let mut lines: Vec<&str> = text.lines().collect();
            lines.splice(at + first..at + last, block.text.lines());
            if !text.contains(block.text.trim()) {
                std::fs::write(path, lines.join("\n") + "\n").expect("a file");
            }
            touched.insert(file.to_owned());
        }
    }
    touched.len()
}

/// The number of files that each guide changes, tests included; the fourth file of a light or a material is the pbrt
/// reader.
const FILES: [usize; 7] = [3, 3, 4, 2, 2, 2, 4];

#[test]
fn the_places_where_the_guides_insert_lines_exist() {
    for (name, most) in ERRANDS.iter().zip(FILES) {
        let folder = tempfile::tempdir().expect("a folder");
        for block in blocks(name) {
            if let Some((file, _)) = block.directive("insert").and_then(|d| d.split_once(' ')) {
                let to = folder.path().join(file);
                std::fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
                let copied = std::fs::copy(root().join(file), &to);
                assert!(copied.is_ok(), "{name}:{}: {file} is not there", block.line);
            }
        }
        assert_eq!(apply(name, folder.path()), most, "{name}: files touched");
    }
}

#[test]
#[ignore = "compiles a copy of the workspace: minutes; .ci/run --full runs it"]
fn the_guides_compile_and_their_tests_pass_when_followed_to_the_letter() {
    let workspace = scratch();
    for name in ERRANDS {
        apply(name, &workspace);
    }
    for name in ERRANDS {
        for block in blocks(name).iter().filter(|b| b.directive("then").is_some()) {
            let output = Command::new("sh")
                .args(["-e", "-c", &block.text])
                .env("CARGO_TARGET_DIR", root().join("target/docs/target"))
                .env("CARGO_NET_OFFLINE", "true")
                // Compiling takes longer than these tests.
                .env("CARGO_PROFILE_DEV_OPT_LEVEL", "0")
                .current_dir(&workspace)
                .output()
                .expect("a shell");
            assert!(output.status.success(), "{name}:{}: {}", block.line, String::from_utf8_lossy(&output.stderr));
        }
    }
}

/// The three numbers of `0.93 [0.91, 0.95]`, wherever a text has such.
fn intervals(text: &str) -> Vec<[f64; 3]> {
    let number = |s: &str| s.trim().rsplit(' ').next().and_then(|s| s.parse::<f64>().ok());
    let mut found = Vec::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once(" [") {
        let Some((inside, behind)) = after.split_once(']') else { break };
        if let (Some(value), Some((low, high))) = (number(before), inside.split_once(", ")) {
            found.extend(number(low).zip(number(high)).map(|(low, high)| [value, low, high]));
        }
        rest = behind;
    }
    found
}

/// `dapple samplers NAME` prints figures of the committed table, each rounded to three digits.
#[test]
fn results_of_methods_are_those_of_the_table() {
    let read = |path: &str| std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"));
    let table = read("docs/results/tables/methods.csv");
    let column = table.lines().next().expect("a head").matches(',').count();
    assert!(column > 10, "{table}");
    // Descriptions hold commas, and are quoted then.
    let rows: Vec<(String, Vec<f64>)> = table
        .lines()
        .filter(|line| line.starts_with("all,"))
        .map(|line| {
            let figures: Vec<f64> = line.rsplit(',').take(14).filter_map(|cell| cell.parse().ok()).collect();
            (line.to_owned(), figures)
        })
        .collect();
    let verdicts = read("crates/registry/src/verdicts.tsv");
    assert!(verdicts.lines().count() > 30, "{verdicts}");
    for line in verdicts.lines() {
        let description = line.split('\t').nth(1).expect("a description").replace(" with points ", "/");
        for interval in intervals(line) {
            let is_there = |(row, figures): &(String, Vec<f64>)| {
                let near = |x: f64| figures.iter().any(|figure| (figure - x).abs() <= 0.006 * x.abs());
                row.contains(&description) && interval.into_iter().all(near)
            };
            assert!(rows.iter().any(is_there), "{description}: {interval:?} is not in docs/results/tables/methods.csv");
        }
    }
}
