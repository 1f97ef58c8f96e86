//! `dapple price`: what breaks without each safeguard is the same everywhere; times are not looked at but for being some.

mod common;

use common::Folder;
use serde_json::Value;
use std::path::Path;

fn rows(folder: &Folder, words: &str) -> Vec<Value> {
    let said = folder.run(&format!("price --quick --json {words}"));
    assert_eq!((said.status, said.err.as_str()), (Some(0), ""));
    assert_eq!(said.out.matches('\n').count(), 1, "one line: {}", said.out);
    let json: Value = serde_json::from_str(&said.out).expect("JSON");
    assert_eq!(json["quick"], true);
    json["rows"].as_array().expect("rows").clone()
}

#[test]
fn each_safeguard_has_a_price_and_something_that_breaks_without_it() {
    let folder = Folder::new();
    // The program with itself in the place of a build without overflow checks: only the row is looked at.
    let itself = assert_cmd::cargo::cargo_bin!("dapple").display().to_string();
    let rows = rows(&folder, &format!("--without-overflow-checks {itself}"));
    let names: Vec<&str> = rows.iter().filter_map(|row| row["safeguard"].as_str()).collect();
    let wanted = ["recentring", "exact", "padding", "ties", "offsets", "film", "invalid", "halves", "checkpoints"];
    assert_eq!(names, [&wanted[..], &["overflow-checks"]].concat());
    for row in &rows {
        let price = |key: &str| row["price"][key].as_f64().unwrap_or(f64::NAN);
        assert!(price("low") > 0.0 && price("low") <= price("median") && price("median") <= price("high"), "{row}");
        let breaks = row["breaks"].as_array().expect("breaks");
        assert_eq!(breaks.is_empty(), row["safeguard"] == "overflow-checks", "{row}");
        for broken in breaks {
            let count = |key: &str| broken[key].as_u64().expect("a count");
            assert!(count("without") > 0 && count("without") <= count("of"), "nothing breaks: {broken}");
            assert_eq!(count("with"), 0, "{broken}");
        }
    }
    assert_eq!(folder.names(), Vec::<String>::new(), "nothing is left");
}

#[test]
fn programs_that_are_none_are_named() {
    let folder = Folder::new();
    for (program, why) in [("./nonesuch", "it does not start"), ("/bin/false", "docs/results/make price")] {
        if program.starts_with('/') && !Path::new(program).exists() {
            continue;
        }
        let said = folder.run(&format!("price --quick --json --without-overflow-checks {program}"));
        assert_eq!(said.status, Some(1));
        assert!(said.err.contains(program) && said.err.contains(why), "{}", said.err);
    }
}
