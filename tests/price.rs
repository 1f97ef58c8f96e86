//! Failures without a safeguard are the same on every machine. Times are only checked for being positive.

#[allow(missing_docs, unreachable_pub, dead_code, reason = "a bench, of which this is the test")]
#[path = "../benches/price/safeguards.rs"]
mod safeguards;

use safeguards::{Effort, Row, overflow_checks, price};
use std::path::Path;

fn check(row: &Row) {
    let price = &row.price;
    assert!(price.low > 0.0 && price.low <= price.median && price.median <= price.high, "{row:?}");
}

#[test]
fn each_safeguard_has_a_price_and_an_input_that_breaks_without_it() {
    let rows = price(Effort::Quick, &mut |_| {}).unwrap_or_else(|e| panic!("{e}"));
    let names: Vec<&str> = rows.iter().map(|row| row.safeguard).collect();
    assert_eq!(names, ["recentring", "film", "invalid", "halves", "checkpoints"]);
    for row in &rows {
        check(row);
        assert!(!row.breaks.is_empty(), "{row:?}");
        for broken in &row.breaks {
            assert!(broken.without > 0 && broken.without <= broken.of, "nothing breaks: {broken:?}");
            assert_eq!(broken.with, 0, "{broken:?}");
        }
    }
}

/// A program that prints the JSON of a render stands for both builds.
#[cfg(unix)]
#[test]
fn overflow_checks_are_the_ratio_of_two_programs() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a folder");
    let program = folder.path().join("dapple");
    std::fs::write(&program, "#!/bin/sh\necho '{\"seconds\": {\"trace\": 0.5}}'\n").expect("a program");
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).expect("permissions");
    let row = overflow_checks(&program, &program, Effort::Quick).unwrap_or_else(|e| panic!("{e}"));
    check(&row);
    assert_eq!((row.safeguard, row.breaks.len(), row.price.median), ("overflow-checks", 0, 1.0));
}

#[test]
fn programs_without_a_render_are_named() {
    for (program, why) in [("./nonesuch", "it does not start"), ("/bin/false", "docs/results/price.md")] {
        if program.starts_with('/') && !Path::new(program).exists() {
            continue;
        }
        let refused = overflow_checks(Path::new(program), Path::new(program), Effort::Quick);
        let refused = refused.expect_err("it renders nothing").to_string();
        assert!(refused.contains(program) && refused.contains(why), "{refused}");
    }
}
