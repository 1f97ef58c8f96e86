//! The factorial design {baseline's sampler, method's sampler} x {baseline's filter, method's filter}.

use super::Summary;
use super::comparison::judge;
use super::run_table::{RunTable, error};
use super::seed_statistic::SeedStatistic;
use crate::record::{Method, Run, RunBudget};

/// An effect in the factorial design of a method's sampler and filter: a ratio of relMSE, below 1 for an improvement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FactorialEffect {
    /// The effect of the method's sampler, with the baseline's filter.
    Sampler,
    /// The effect of the method's filter, with the baseline's sampler.
    Filter,
    /// The effect of the method's sampler and filter together.
    Both,
    /// The effect of both, divided by the product of the separate effects; below 1, sampler and filter reinforce each
    /// other.
    Interaction,
}

impl FactorialEffect {
    /// All effects, in the order of the report's table.
    pub const ALL: [Self; 4] = [Self::Sampler, Self::Filter, Self::Both, Self::Interaction];

    /// The effect's name in [`Row::metric`](super::Row::metric).
    pub fn metric(self) -> &'static str {
        match self {
            Self::Sampler => "relmse part of counts",
            Self::Filter => "relmse part of filter",
            Self::Both => "relmse part of both",
            Self::Interaction => "relmse part of their interplay",
        }
    }
}

/// The indices of four methods: baseline, baseline with the method's sampler, baseline with the method's filter, and
/// the method. All four use the method's point set, so that it does not count as an effect of the sampler. `None` if
/// one is missing, or if the method has the baseline's sampler or filter.
pub(crate) fn corners(methods: &[Method], baseline: &Method, method: &Method) -> Option<[usize; 4]> {
    if method.sampler == baseline.sampler || method.filter == baseline.filter {
        return None;
    }
    let find = |sampler: &str, filter: &str| {
        methods.iter().position(|m| m.sampler == sampler && m.filter == filter && m.points == method.points)
    };
    let [none, filter] = [&baseline.filter, &method.filter];
    Some([
        find(&baseline.sampler, none)?,
        find(&method.sampler, none)?,
        find(&baseline.sampler, filter)?,
        find(&method.sampler, filter)?,
    ])
}

pub(super) fn add(summary: &mut Summary, grid: &RunTable<'_>) {
    let manifest = grid.manifest;
    for at in grid.all() {
        let Some(corners) = corners(&manifest.methods, &manifest.baseline, &manifest.methods[at[1]]) else { continue };
        for budget in grid.budgets() {
            let complete = complete(grid, at[0], corners, budget);
            if complete.is_empty() {
                continue;
            }
            for part in FactorialEffect::ALL {
                let pairs: Vec<(f64, f64)> = complete.iter().map(|runs| sides(part, runs)).collect();
                summary.add(grid, at, Some(budget), part.metric(), judge(SeedStatistic::ratio(&pairs), None, None));
            }
        }
    }
}

/// The runs of the design's four methods, for each seed with runs of all four.
fn complete<'a>(grid: &RunTable<'a>, scene: usize, corners: [usize; 4], budget: RunBudget) -> Vec<[&'a Run; 4]> {
    let runs = corners.map(|method| grid.at([scene, method], budget));
    let with = |seed: &u64| Some([*runs[0].get(seed)?, *runs[1].get(seed)?, *runs[2].get(seed)?, *runs[3].get(seed)?]);
    runs[3].keys().filter_map(with).collect()
}

/// The numerator and the denominator of an effect, in relMSE.
fn sides(part: FactorialEffect, runs: &[&Run; 4]) -> (f64, f64) {
    let [base, counts, filter, both] = runs.map(|run| error(run, "relmse"));
    match part {
        FactorialEffect::Sampler => (counts, base),
        FactorialEffect::Filter => (filter, base),
        FactorialEffect::Both => (both, base),
        FactorialEffect::Interaction => (both * base, counts * filter),
    }
}
