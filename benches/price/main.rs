//! The cost of each numerical safeguard, and the inputs that break without it.
//!
//! `cargo bench --bench price` takes two or three minutes, on a machine that does nothing else. Arguments after `--`:
//!
//! * `--quick` or `--test`: takes seconds; failures are exact, prices are rough;
//! * `--json`: one line of JSON rather than a table;
//! * `--overflow-checks WITH WITHOUT`: two builds of `dapple`, with overflow checks and without; adds their price.

#![allow(clippy::print_stdout, clippy::print_stderr, missing_docs, unreachable_pub, reason = "a program")]

#[allow(unused_imports, reason = "its unit tests run in tests/price.rs")]
#[path = "safeguards.rs"]
mod safeguards;

use safeguards::{Effort, Error, Row, overflow_checks, price};
use serde::Serialize;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments) {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> Result<String, Error> {
    let clock = Instant::now();
    let has = |name: &str| arguments.iter().any(|argument| argument == name);
    // `cargo test --benches` runs each bench once, without `--bench`; `cargo bench -- --test` asks for the same.
    let quick = has("--quick") || has("--test") || !has("--bench");
    let effort = if quick { Effort::Quick } else { Effort::Full };
    let mut onlooker = |name: &str| eprintln!("measuring: {name}");
    let programs = arguments.iter().position(|argument| argument == "--overflow-checks");
    // First, since another program may fail.
    let checked = match programs.and_then(|at| arguments.get(at + 1..at + 3)) {
        Some([with, without]) => Some(overflow_checks(Path::new(without), Path::new(with), effort)?),
        _ => None,
    };
    let mut rows = price(effort, &mut onlooker)?;
    rows.extend(checked);
    if has("--json") {
        let line = Line { quick, seconds: clock.elapsed().as_secs_f64(), rows: &rows };
        return Ok(serde_json::to_string(&line).unwrap_or_default());
    }
    Ok(table(&rows))
}

#[derive(Serialize)]
struct Line<'a> {
    quick: bool,
    seconds: f64,
    rows: &'a [Row],
}

/// The table as Markdown.
fn table(rows: &[Row]) -> String {
    let mut lines = vec![
        "Time with each safeguard over time without it: median of pairs in turns (an interval that holds it with 95 %). \
         Failures without it and with it, of all trials."
            .to_owned(),
        String::new(),
        "| safeguard | price | breaks | without | with | of | visible defect |".to_owned(),
        "|---|---|---|---|---|---|---|".to_owned(),
    ];
    for row in rows {
        let price = &row.price;
        // A price close to 1 needs more digits.
        let digits = if (price.median - 1.0).abs() < 1e-3 { 5 } else { 3 };
        let [middle, low, high] = [price.median, price.low, price.high].map(|x| format!("{x:.digits$}"));
        let mut head = format!("{} | {middle} ({low}, {high})", row.safeguard);
        if row.breaks.is_empty() {
            lines.push(format!("| {head} | no input is known to | | | | |"));
        }
        for broken in &row.breaks {
            let counts = format!("{} | {} | {}", broken.without, broken.with, broken.of);
            lines.push(format!("| {head} | {} | {counts} | {} |", broken.input, broken.seen));
            head = " |".to_owned();
        }
    }
    lines.push(String::new());
    for row in rows {
        lines.push(format!(
            "* **{}**: {}. Price of {} ({} pairs).",
            row.safeguard, row.does, row.price_of, row.price.pairs
        ));
    }
    lines.join("\n")
}
