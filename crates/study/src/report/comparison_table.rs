//! Wins and losses against the baseline, as sentences and as tables.

use super::table_cell::TableCell;
use crate::record::{Method, RunBudget};
use crate::recorded_study::RecordedStudy;
use crate::summary::{COMPARED, FactorialEffect, HOLDS, RatioVerdict, Row, Summary, TIME_TOLERANCE, UNFAIR};

/// The comparisons of one method with the baseline, grouped by verdict.
pub(super) struct MethodVerdicts {
    pub(super) method: String,
    /// The scenes with a win, with a loss, with an undecided comparison, and with a loss in FLIP.
    pub(super) groups: Vec<VerdictGroup>,
}

/// The scenes in which a method's comparison with the baseline has the same verdict.
pub(super) struct VerdictGroup {
    pub(super) class: &'static str,
    pub(super) lead: String,
    pub(super) scenes: Vec<(String, TableCell)>,
}

/// A row of the comparison table: one method against the baseline, on one scene at one budget.
pub(super) struct ComparisonLine {
    pub(super) scene: String,
    pub(super) method: String,
    pub(super) budget: String,
    pub(super) cells: Vec<TableCell>,
    pub(super) class: &'static str,
    pub(super) verdict: String,
    /// True if the verdict also holds with intervals so wide that all comparisons together have 95 % confidence.
    pub(super) together: bool,
    /// The reason why the verdict is undecided; empty for a win or a loss.
    pub(super) why: String,
}

/// The budget of the report's first comparison: equal time if there are such runs, else the largest spp; `None` without
/// runs to compare.
pub(super) fn headline(recorded: &RecordedStudy, summary: &Summary) -> Option<RunBudget> {
    let manifest = &recorded.manifest;
    let compared = |budget: &RunBudget| {
        let words = budget.to_string();
        summary.rows().iter().any(|row| row.budget == words && row.metric == "relmse ratio")
    };
    let spp = manifest.spp.iter().rev().map(|&spp| RunBudget::Spp(spp));
    manifest.time_of.map(RunBudget::TimeOf).into_iter().chain(spp).find(compared)
}

/// The verdicts on each method at one budget, in the order of the study's methods.
pub(super) fn method_verdicts(
    recorded: &RecordedStudy,
    summary: &Summary,
    names: &[String],
    budget: RunBudget,
) -> Vec<MethodVerdicts> {
    let manifest = &recorded.manifest;
    let words = budget.to_string();
    let mut method_verdicts = Vec::new();
    for (method, name) in manifest.methods.iter().zip(names) {
        if *method == manifest.baseline {
            continue;
        }
        let rows: Vec<(&str, &Row)> = manifest
            .scenes
            .iter()
            .filter_map(|scene| Some((scene.name.as_str(), summary.find(&scene.name, method, &words, "relmse ratio")?)))
            .collect();
        let group = |verdict: RatioVerdict| -> Option<VerdictGroup> {
            let scenes: Vec<(String, TableCell)> = rows
                .iter()
                .filter(|(_, row)| RatioVerdict::of(row) == Some(verdict))
                .map(|(scene, row)| ((*scene).to_owned(), TableCell::ratio(Some(row))))
                .collect();
            let lead = match verdict {
                RatioVerdict::Win => "wins on",
                RatioVerdict::Loss => "loses on",
                RatioVerdict::Undecided => "is undecided on",
            };
            (!scenes.is_empty()).then(|| VerdictGroup { class: verdict.words(), lead: lead.to_owned(), scenes })
        };
        let verdicts = [RatioVerdict::Win, RatioVerdict::Loss, RatioVerdict::Undecided];
        let flip: Vec<(String, TableCell)> = manifest
            .scenes
            .iter()
            .filter_map(|scene| Some((scene.name.clone(), summary.find(&scene.name, method, &words, "flip ratio")?)))
            .filter(|(_, row)| RatioVerdict::of(row) == Some(RatioVerdict::Loss))
            .map(|(scene, row)| (scene, TableCell::ratio(Some(row))))
            .collect();
        let flip = (!flip.is_empty()).then(|| VerdictGroup {
            class: RatioVerdict::Loss.words(),
            lead: "loses in FLIP on".into(),
            scenes: flip,
        });
        let groups: Vec<VerdictGroup> = verdicts.into_iter().filter_map(group).chain(flip).collect();
        method_verdicts.push(MethodVerdicts { method: name.clone(), groups });
    }
    method_verdicts
}

/// Counts the wins, losses and undecided comparisons of a metric at one budget.
pub(super) fn tally(summary: &Summary, budget: RunBudget, metric: &str) -> [usize; 3] {
    let words = budget.to_string();
    let rows = || summary.rows().iter().filter(|row| row.budget == words && row.metric == metric);
    [RatioVerdict::Win, RatioVerdict::Loss, RatioVerdict::Undecided]
        .map(|verdict| rows().filter(|row| RatioVerdict::of(row) == Some(verdict)).count())
}

/// The rows of the comparison table, ordered by scene, then by method.
pub(super) fn lines(
    recorded: &RecordedStudy,
    summary: &Summary,
    names: &[String],
    budgets: &[RunBudget],
) -> Vec<ComparisonLine> {
    let manifest = &recorded.manifest;
    let mut lines = Vec::new();
    for scene in &manifest.scenes {
        for (method, name) in manifest.methods.iter().zip(names) {
            for &budget in budgets {
                let words = budget.to_string();
                let find = |metric: &str| summary.find(&scene.name, method, &words, metric);
                let Some(row) = find("relmse ratio") else { continue };
                let verdict = RatioVerdict::of(row);
                let errors = COMPARED.iter().map(|metric| TableCell::ratio(find(&format!("{metric} ratio"))));
                let costs =
                    ["seconds ratio", "relmse x seconds ratio"].iter().map(|metric| TableCell::ratio(find(metric)));
                lines.push(ComparisonLine {
                    scene: scene.name.clone(),
                    method: name.clone(),
                    budget: words.clone(),
                    cells: errors.chain(costs).collect(),
                    class: verdict.map_or("", RatioVerdict::words),
                    verdict: row.note.clone(),
                    together: row.note.contains(HOLDS),
                    why: if verdict == Some(RatioVerdict::Undecided) { why_undecided(row) } else { String::new() },
                });
            }
        }
    }
    lines
}

/// The reason why a comparison is undecided: unequal times, a missing interval, or an interval that contains 1.
fn why_undecided(row: &Row) -> String {
    let mut notes = row.note.split("; ").skip(1);
    match row.interval() {
        _ if row.note.contains(UNFAIR) => {
            let note = notes.find(|note| note.contains(UNFAIR)).unwrap_or_default();
            format!("{note}; equal is within {:.0} %", 100.0 * TIME_TOLERANCE)
        }
        Some(_) => "the interval contains 1".into(),
        None => notes.next().unwrap_or("no interval").to_owned(),
    }
}

/// A row of the factorial table, which separates the effects of a method's sampler and filter on relMSE.
pub(super) struct FactorialLine {
    pub(super) scene: String,
    pub(super) sampler: String,
    pub(super) filter: String,
    /// The ratio of each effect, in the order of [`FactorialEffect::ALL`], with the name of its verdict.
    pub(super) parts: Vec<(TableCell, &'static str)>,
}

pub(super) fn factorial_lines(recorded: &RecordedStudy, summary: &Summary, budget: RunBudget) -> Vec<FactorialLine> {
    let manifest = &recorded.manifest;
    let words = budget.to_string();
    let several = manifest.methods.iter().any(|m| m.points != manifest.baseline.points);
    let sampler = |m: &Method| if several { format!("{} / {}", m.sampler, m.points) } else { m.sampler.clone() };
    let mut factorial_lines = Vec::new();
    for scene in &manifest.scenes {
        for method in &manifest.methods {
            let rows = FactorialEffect::ALL.map(|part| summary.find(&scene.name, method, &words, part.metric()));
            if rows[0].is_none() {
                continue;
            }
            let part = |row: &Option<&Row>| {
                (TableCell::ratio(*row), row.and_then(RatioVerdict::of).map_or("", RatioVerdict::words))
            };
            factorial_lines.push(FactorialLine {
                scene: scene.name.clone(),
                sampler: sampler(method),
                filter: method.filter.clone(),
                parts: rows.iter().map(part).collect(),
            });
        }
    }
    factorial_lines
}
