//! Wins and losses: in sentences, and as tables.

use super::words::Cell;
use crate::folder::Recorded;
use crate::record::{Budget, Method};
use crate::summary::{COMPARED, HOLDS, Part, Row, Summary, UNFAIR, Verdict, budget_words};

/// What may be said of one method.
pub(super) struct Sentence {
    pub(super) method: String,
    /// `wins on`, and where.
    pub(super) groups: Vec<Group>,
}

/// Scenes that a method has in common.
pub(super) struct Group {
    pub(super) class: &'static str,
    pub(super) lead: String,
    pub(super) scenes: Vec<(String, Cell)>,
}

/// A line of a table of comparisons.
pub(super) struct Line {
    pub(super) scene: String,
    pub(super) method: String,
    pub(super) budget: String,
    pub(super) cells: Vec<Cell>,
    pub(super) class: &'static str,
    pub(super) verdict: String,
    /// Whether it holds beside all others.
    pub(super) together: bool,
    /// Why an interval that excludes 1 decides nothing.
    pub(super) unfair: String,
}

/// The budget at which methods are compared first: equal time where there is one, else the most samples.
pub(super) fn headline(recorded: &Recorded, summary: &Summary) -> Option<Budget> {
    let manifest = &recorded.manifest;
    let compared = |budget: &Budget| {
        let words = budget_words(*budget);
        summary.rows().iter().any(|row| row.budget == words && row.metric == "relmse ratio")
    };
    let spp = manifest.spp.iter().rev().map(|&spp| Budget::Spp(spp));
    manifest.time_of.map(Budget::TimeOf).into_iter().chain(spp).find(compared)
}

/// One sentence a method, in their order, so that none is hidden.
pub(super) fn sentences(recorded: &Recorded, summary: &Summary, names: &[String], budget: Budget) -> Vec<Sentence> {
    let manifest = &recorded.manifest;
    let words = budget_words(budget);
    let mut sentences = Vec::new();
    for (method, name) in manifest.methods.iter().zip(names) {
        if *method == manifest.baseline {
            continue;
        }
        let rows: Vec<(&str, &Row)> = manifest
            .scenes
            .iter()
            .filter_map(|scene| Some((scene.name.as_str(), summary.find(&scene.name, method, &words, "relmse ratio")?)))
            .collect();
        let group = |verdict: Verdict| -> Option<Group> {
            let scenes: Vec<(String, Cell)> = rows
                .iter()
                .filter(|(_, row)| Verdict::of(row) == Some(verdict))
                .map(|(scene, row)| ((*scene).to_owned(), Cell::ratio(Some(row))))
                .collect();
            let lead = match verdict {
                Verdict::Win => "wins on",
                Verdict::Loss => "loses on",
                Verdict::Undecided => "is undecided on",
            };
            (!scenes.is_empty()).then(|| Group { class: verdict.words(), lead: lead.to_owned(), scenes })
        };
        let groups: Vec<Group> =
            [Verdict::Win, Verdict::Loss, Verdict::Undecided].into_iter().filter_map(group).collect();
        sentences.push(Sentence { method: name.clone(), groups });
    }
    sentences
}

/// Wins, losses and undecided ones.
pub(super) fn tally(summary: &Summary, budget: Budget) -> [usize; 3] {
    let words = budget_words(budget);
    let rows = || summary.rows().iter().filter(|row| row.budget == words && row.metric == "relmse ratio");
    [Verdict::Win, Verdict::Loss, Verdict::Undecided]
        .map(|verdict| rows().filter(|row| Verdict::of(row) == Some(verdict)).count())
}

/// Scene by scene, each with its methods in their order.
pub(super) fn lines(recorded: &Recorded, summary: &Summary, names: &[String], budgets: &[Budget]) -> Vec<Line> {
    let manifest = &recorded.manifest;
    let mut lines = Vec::new();
    for scene in &manifest.scenes {
        for (method, name) in manifest.methods.iter().zip(names) {
            for &budget in budgets {
                let words = budget_words(budget);
                let find = |metric: &str| summary.find(&scene.name, method, &words, metric);
                let Some(row) = find("relmse ratio") else { continue };
                let verdict = Verdict::of(row);
                let errors = COMPARED.iter().map(|metric| Cell::ratio(find(&format!("{metric} ratio"))));
                let costs = ["seconds ratio", "relmse x seconds ratio"].iter().map(|metric| Cell::ratio(find(metric)));
                lines.push(Line {
                    scene: scene.name.clone(),
                    method: name.clone(),
                    budget: words.clone(),
                    cells: errors.chain(costs).collect(),
                    class: verdict.map_or("", Verdict::words),
                    verdict: row.note.clone(),
                    together: row.note.contains(HOLDS),
                    unfair: row.note.split("; ").find(|n| n.contains(UNFAIR)).unwrap_or_default().to_owned(),
                });
            }
        }
    }
    lines
}

/// A line of the factorial table.
pub(super) struct Square {
    pub(super) scene: String,
    pub(super) sampler: String,
    pub(super) filter: String,
    /// As [`Part::ALL`], with the classes of their verdicts.
    pub(super) parts: Vec<(Cell, &'static str)>,
}

pub(super) fn squares(recorded: &Recorded, summary: &Summary, budget: Budget) -> Vec<Square> {
    let manifest = &recorded.manifest;
    let words = budget_words(budget);
    let several = manifest.methods.iter().any(|m| m.points != manifest.baseline.points);
    let sampler = |m: &Method| if several { format!("{} / {}", m.sampler, m.points) } else { m.sampler.clone() };
    let mut squares = Vec::new();
    for scene in &manifest.scenes {
        for method in &manifest.methods {
            let rows = Part::ALL.map(|part| summary.find(&scene.name, method, &words, part.metric()));
            if rows[0].is_none() {
                continue;
            }
            let part = |row: &Option<&Row>| (Cell::ratio(*row), row.and_then(Verdict::of).map_or("", Verdict::words));
            squares.push(Square {
                scene: scene.name.clone(),
                sampler: sampler(method),
                filter: method.filter.clone(),
                parts: rows.iter().map(part).collect(),
            });
        }
    }
    squares
}
