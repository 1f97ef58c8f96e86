//! `dapple price`.

use crate::output::{say, tell};
use crate::{Failure, Outcome, Result};
use dapple_price::{Effort, Row, overflow_checks, price};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Say what each numerical safeguard costs in time, and what breaks without it
///
/// Each is left out in turn, in this very program: time with it over time without it, pair by pair, on one thread, as the
/// median of the pairs and an interval that holds it with 95 %. Beside it stands the smallest input tried that
/// breaks without it, and how many rays, pixels or samples of it go wrong: these counts are the same on every machine.
#[derive(clap::Args)]
#[command(after_help = AFTER)]
pub(crate) struct PriceArgs {
    /// Take seconds: what breaks is as true, prices say little
    #[arg(long)]
    quick: bool,

    /// Print one line of JSON rather than a table; no progress
    #[arg(long)]
    json: bool,

    /// A build of this program without overflow checks: adds what they cost (docs/results/make price builds one)
    #[arg(long, value_name = "PROGRAM")]
    without_overflow_checks: Option<PathBuf>,
}

const AFTER: &str = "\
Examples:
  dapple price                                   two or three minutes, on a machine that does nothing else
  dapple price --quick
  dapple price --json | jq '.rows[] | {safeguard, price: .price.median}'";

pub(crate) fn run(options: &PriceArgs) -> Result<Outcome> {
    let clock = Instant::now();
    let effort = if options.quick { Effort::Quick } else { Effort::Full };
    let mut onlooker = |name: &str| {
        if !options.json {
            say("measuring", name);
        }
    };
    // First, since it is the one that somebody else's program can fail.
    let mut checked = None;
    if let Some(program) = &options.without_overflow_checks {
        onlooker("overflow checks");
        let itself = std::env::current_exe().map_err(|e| Failure::new(format!("cannot find this program: {e}")))?;
        checked = Some(overflow_checks(program, &itself, effort).map_err(Failure::new)?);
    }
    let mut rows = price(effort, &mut onlooker).map_err(Failure::new)?;
    rows.extend(checked);
    if options.json {
        let line = Line { quick: options.quick, seconds: clock.elapsed().as_secs_f64(), rows: &rows };
        tell(serde_json::to_string(&line).map_err(Failure::new)?)?;
    } else {
        tell(table(&rows))?;
    }
    Ok(Outcome::Done)
}

#[derive(Serialize)]
struct Line<'a> {
    quick: bool,
    seconds: f64,
    rows: &'a [Row],
}

/// Markdown.
fn table(rows: &[Row]) -> String {
    let mut lines = vec![
        "Time with each safeguard over time without it: median of pairs in turns (an interval that holds it with 95 %). \
         What goes wrong without it, and with it, of how many tried."
            .to_owned(),
        String::new(),
        "| safeguard | price | breaks | without | with | of | what is seen |".to_owned(),
        "|---|---|---|---|---|---|---|".to_owned(),
    ];
    for row in rows {
        let price = &row.price;
        // What hardly costs anything needs more digits to be told.
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
