//! The tables of the report as Markdown.

use super::comparison_table::{factorial_lines, headline, lines, tally};
use super::html::Builder;
use super::method_style::{names, styles};
use super::table_cell::TableCell;
use crate::record::RunBudget;
use crate::recorded_study::RecordedStudy;
use crate::summary::Summary;
use std::fmt::Write;

pub(super) fn render(recorded: &RecordedStudy, summary: &Summary) -> String {
    let manifest = &recorded.manifest;
    let (names, styles) = (names(&manifest.methods), styles(&manifest.methods));
    let base = manifest.methods.iter().position(|m| *m == manifest.baseline).map_or("", |i| &names[i]);
    let list = |numbers: &[u64]| numbers.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
    let mut page = format!(
        "{} scenes, {} spp, {} seeds, {} of {} runs; [ , ]: 95 % intervals over seeds, paired.\n",
        manifest.scenes.len(),
        list(&manifest.spp),
        manifest.seeds.len(),
        recorded.runs.len(),
        recorded.expected()
    );
    if let Some(budget) = headline(recorded, summary) {
        let [won, lost, open] = tally(summary, budget, "relmse ratio");
        let what = match budget {
            RunBudget::TimeOf(spp) => format!("At equal time, that of {base} with {spp} spp"),
            RunBudget::Spp(spp) => format!("At {spp} spp"),
        };
        let heads = ["scene", "method", "verdict", "relMSE", "trimmed relMSE", "sRGB MSE", "FLIP", "time"];
        let intro = format!("{what}, over {base}: {won} won, {lost} lost, {open} undecided");
        let rows = lines(recorded, summary, &names, &[budget]).into_iter().map(|line| {
            let verdict = format!("{}{}", line.class, if line.together { " *" } else { "" });
            [line.scene, line.method, verdict].into_iter().chain(line.cells[..5].iter().map(cell)).collect()
        });
        table(&mut page, &intro, &heads, rows);
        let heads = ["scene", "sampler", "filter", "sampler alone", "filter alone", "both", "interaction"];
        let rows = factorial_lines(recorded, summary, budget).into_iter().map(|square| {
            let parts = square.parts.iter().map(|(part, _)| cell(part));
            [square.scene, square.sampler, square.filter].into_iter().chain(parts).collect()
        });
        table(&mut page, &format!("{what}: relMSE by sampler and filter"), &heads, rows);
    }
    let builder = Builder { recorded, summary, names: &names, styles: &styles, budget: None };
    for scene in &manifest.scenes {
        let levels = builder.levels(scene);
        let mut heads = vec!["method".to_owned(), "slope over spp".to_owned(), "slope over time".to_owned()];
        heads.extend(levels.iter().map(|level| format!("time to relMSE {level} over {base}")));
        let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
        let rows = manifest.methods.iter().zip(&names).map(|(method, name)| {
            let find = |metric: &str| summary.find(&scene.name, method, "", metric);
            let slopes = ["relmse slope over spp", "relmse slope over seconds"].map(|m| cell(&TableCell::of(find(m))));
            let times = levels.iter().map(|l| cell(&TableCell::ratio(find(&format!("seconds ratio to relmse {l}")))));
            [name.clone()].into_iter().chain(slopes).chain(times).collect()
        });
        table(&mut page, &format!("{}, {}x{}", scene.name, scene.resolution[0], scene.resolution[1]), &heads, rows);
    }
    page.push_str(
        "\nUndecided: the 95 % interval contains 1. \\*: holds with intervals widened so that all hold together (Šidák). †: extrapolated by a fit, at most \
         4 times beyond the measured times. ‡: of the mean curve. §: affected by the noise of the reference. –: not measured.\n",
    );
    page
}

fn table(page: &mut String, title: &str, heads: &[&str], rows: impl Iterator<Item = Vec<String>>) {
    let rows: Vec<String> = rows.map(|row| format!("| {} |\n", row.join(" | "))).collect();
    if rows.is_empty() {
        return;
    }
    // Writing to a string does not fail.
    let _ =
        write!(page, "\n**{title}**\n\n| {} |\n|{}\n{}", heads.join(" | "), "---|".repeat(heads.len()), rows.concat());
}

/// Formats a value with its interval, such as `0.86 [0.83, 0.90]`.
fn cell(cell: &TableCell) -> String {
    let parts = [cell.text.as_str(), &cell.interval].into_iter().filter(|part| !part.is_empty());
    format!("{}{}", parts.collect::<Vec<_>>().join(" "), cell.mark)
}
