//! Overflow checks: two builds of the program, run in turns.

use super::pairs::{in_turn, pairs};
use super::{Effort, Error, Result, Row};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// A scene with one light, one with an environment map, and one with hundreds of thousands of triangles.
const SCENES: [&str; 3] = ["cornell", "teapot", "terrain"];

/// The row of overflow checks. `without` and `with` are builds of the program that differ in nothing else.
///
/// # Errors
///
/// [`Error::Program`] for a program that does not render.
pub fn overflow_checks(without: &Path, with: &Path, effort: Effort) -> Result<Row> {
    let (count, size) = match effort {
        Effort::Quick => (3, "--resolution 32x32 --spp 2"),
        Effort::Full => (90, "--resolution 192x192 --spp 16"),
    };
    let price = pairs(count, |number| {
        let words = format!("{} {size}", SCENES[number % SCENES.len()]);
        // The order within a pair alternates after each round of scenes.
        let turn = number / SCENES.len();
        let [with, without] = in_turn(turn, || trace(with, &words), || trace(without, &words))?;
        Ok::<_, Error>(with / without)
    })?;
    Ok(Row {
        safeguard: "overflow-checks",
        does: "whole numbers that overflow end the program (against a build of its own, without them; the BVH has none)",
        price,
        price_of: format!("`dapple render SCENE {size}`, tracing, one thread; {} in turn", SCENES.join(", ")),
        breaks: Vec::new(),
    })
}

/// The seconds of tracing that a program reports.
fn trace(program: &Path, words: &str) -> Result<f64> {
    let wrong = |why: String| Error::Program { program: program.to_owned(), why };
    // The image is temporary and removed.
    let image = std::env::temp_dir().join(format!("dapple-price-{}.pfm", std::process::id()));
    let mut command = Command::new(program);
    command.arg("render").args(words.split(' ')).args(["--threads", "1", "--json", "-o"]).arg(&image);
    let output = command.output().map_err(|e| wrong(format!("it does not start ({e})")))?;
    let _ = std::fs::remove_file(&image);
    if !output.status.success() {
        return Err(wrong(String::from_utf8_lossy(&output.stderr).trim().to_owned()));
    }
    let said: Option<Value> = serde_json::from_slice(&output.stdout).ok();
    let seconds = said.and_then(|said| said["seconds"]["trace"].as_f64());
    seconds.filter(|s| *s > 0.0).ok_or_else(|| wrong("it says nothing of tracing".into()))
}
