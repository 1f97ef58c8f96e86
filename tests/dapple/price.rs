//! Failures without a safeguard are the same on every machine. Times are only checked for being positive.

#[allow(dead_code, reason = "a bench, of which this is the test")]
#[path = "../../benches/price/main.rs"]
mod bench;

use bench::{Ratio, Row, in_turn, of_whole, overflow_checks, prices};
use std::path::Path;

fn check(row: &Row) {
    let price = &row.price;
    assert!(price.low > 0.0 && price.low <= price.median && price.median <= price.high, "{row:?}");
}

#[test]
fn each_safeguard_has_a_price_and_an_input_that_breaks_without_it() {
    let rows = prices(true).expect("prices");
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
    let row = overflow_checks(&program, &program, true).expect("a price");
    check(&row);
    assert_eq!((row.safeguard, row.breaks.len(), row.price.median), ("overflow-checks", 0, 1.0));
}

#[test]
fn programs_without_a_render_are_named() {
    for (program, why) in [("./nonesuch", "it does not start"), ("/bin/false", "docs/results/price.md")] {
        if program.starts_with('/') && !Path::new(program).exists() {
            continue;
        }
        let refused = overflow_checks(Path::new(program), Path::new(program), true);
        let refused = refused.expect_err("it renders nothing").to_string();
        assert!(refused.contains(program) && refused.contains(why), "{refused}");
    }
}

#[test]
fn intervals_hold_their_median() {
    // From tables of the binomial: of 21 the sixth from both ends, 97.3 %; of 6 the ends, 96.9 %; of 9 the second, 96.1 %.
    for (n, low, high) in [(21, 5.0, 15.0), (6, 0.0, 5.0), (9, 1.0, 7.0), (3, 0.0, 2.0)] {
        let ratio = Ratio::of((0..n).rev().map(f64::from).collect());
        assert_eq!((ratio.low, ratio.median, ratio.high, ratio.pairs), (low, f64::from(n - 1) / 2.0, high, n as usize));
    }
}

#[test]
fn turns_alternate_and_parts_are_shares() {
    for number in 0..4 {
        let order = std::cell::RefCell::new(String::new());
        let note = |word: &str| {
            order.borrow_mut().push_str(word);
            Ok(())
        };
        in_turn(number, || note("a"), || note("b")).expect("no error");
        assert_eq!(*order.borrow(), if number % 2 == 0 { "ab" } else { "ba" });
    }
    assert_eq!((of_whole(1.0, 0.0), of_whole(1.0, 0.5), of_whole(1.0, -1.0)), (1.0, 2.0, 0.5));
}
