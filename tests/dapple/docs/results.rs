//! `docs/results/make` knows every page of results, and runs what is there.

use super::{every_page, page, pages, root};
use crate::hard_cases::rust_files;

/// The five cells of each step: pages, name, needs, time and command.
fn steps() -> Vec<Vec<String>> {
    let text = page("docs/results/steps.txt");
    let lines = text.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    let steps: Vec<Vec<String>> =
        lines.map(|l| l.splitn(5, '|').map(|cell| cell.trim().to_owned()).collect()).collect();
    assert!(steps.len() > 30, "{} steps", steps.len());
    steps.iter().for_each(|step| assert_eq!(step.len(), 5, "{step:?}"));
    steps
}

/// Pages of results by name, without the list of all.
fn names() -> Vec<String> {
    let name = |path: &String| Some(path.strip_prefix("docs/results/")?.strip_suffix(".md")?.to_owned());
    pages().iter().filter_map(name).filter(|name| name != "README" && !name.contains('/')).collect()
}

#[test]
fn every_page_of_results_can_be_made_again() {
    let (steps, names) = (steps(), names());
    assert!(names.len() > 20, "{names:?}");
    let of_pages: Vec<(&str, &str)> = steps.iter().flat_map(|s| s[0].split(' ').map(|p| (p, s[1].as_str()))).collect();
    for name in &names {
        assert!(of_pages.iter().any(|(of, _)| of == name), "docs/results/steps.txt has no step of the page {name}");
    }
    for (of, step) in &of_pages {
        assert!(names.iter().any(|name| name == of), "{step} belongs to the page {of}, which is not there");
    }
    // What a page tells its reader to run.
    for name in pages() {
        for call in page(&name).split("docs/results/make ").skip(1) {
            let words: Vec<&str> =
                call.split(['`', '\n', '#', ')']).next().unwrap_or_default().split_whitespace().collect();
            if let [of, steps @ ..] = words.as_slice()
                && !matches!(*of, "PAGE" | "--list")
            {
                assert!(of_pages.iter().any(|(page, _)| page == of), "{name}: {of} is no page");
                steps
                    .iter()
                    .for_each(|step| assert!(of_pages.contains(&(of, step)), "{name}: {of} has no step {step}"));
            }
        }
    }
}

#[test]
fn scripts_plans_and_programs_of_every_step_are_there() {
    let folders = ["examples", "crates/geometry/examples", "benches"];
    let mut found = 0;
    for step in steps() {
        let command = format!("{} ", step[4]);
        let words: Vec<&str> = command.split([' ', ';', '=', '"', '<', '>']).collect();
        for pair in words.windows(2) {
            let is_there = match pair {
                ["--example" | "--bench", name] => folders.iter().any(|folder| {
                    let path = root().join(folder).join(name);
                    path.with_extension("rs").is_file() || path.is_dir()
                }),
                ["--test", name] => has_test(name),
                [path, _] | [_, path] if ["docs/", "tools/", ".ci/"].iter().any(|start| path.starts_with(start)) => {
                    root().join(path).exists()
                }
                _ => continue,
            };
            assert!(is_there, "{}: {pair:?} is not there", step[1]);
            found += 1;
        }
    }
    assert!(found > 40, "{found} names");
}

/// `cargo test` succeeds if its filter matches no test, so a renamed test would measure nothing. The control: no such name.
#[test]
fn tests_that_pages_and_steps_name_are_there() {
    let files = ["crates", "src", "tests", "examples"].map(|folder| rust_files(&root().join(folder))).concat();
    let names: Vec<String> = files
        .iter()
        .flat_map(|path| {
            std::fs::read_to_string(path).expect("a source").lines().map(str::to_owned).collect::<Vec<_>>()
        })
        .filter(|line| line.contains("fn ") || line.contains("mod "))
        .collect();
    let is_there = |filter: &str| {
        let last = filter.trim_end_matches(':').rsplit("::").next().unwrap_or_default();
        names.iter().any(|line| line.contains(last))
    };
    let mut found = 0;
    let steps = [("steps.txt".to_owned(), page("docs/results/steps.txt"))];
    // The guides to adding a method name tests that they add.
    for (page, text) in every_page().into_iter().filter(|(name, _)| !name.contains("ADDING")).chain(steps) {
        for command in text.split("cargo test ").skip(1) {
            let words = command.split(['`', '\n', '#', '|', ';', ')']).next().unwrap_or_default().split_whitespace();
            let mut takes_value = false;
            for word in words {
                let is_value = std::mem::replace(&mut takes_value, matches!(word, "-p" | "--test" | "--manifest-path"));
                if !is_value && !word.starts_with('-') {
                    assert!(is_there(word), "{page}: no test is called {word}");
                    found += 1;
                }
            }
        }
    }
    assert!(found > 15 && !is_there("thorough_and_gone"), "{found} names");
}

/// True if a crate or the workspace has this test program.
fn has_test(name: &str) -> bool {
    let crates = std::fs::read_dir(root().join("crates")).expect("a folder");
    let folders = crates.map(|entry| entry.expect("an entry").path()).chain([root().to_owned()]);
    folders.into_iter().any(|folder| folder.join("tests").join(name).is_dir())
}
