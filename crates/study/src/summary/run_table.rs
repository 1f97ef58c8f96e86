//! A table of runs by scene, method, budget and seed.

use crate::record::{Manifest, Run, RunBudget};
use crate::recorded_study::RecordedStudy;
use std::collections::BTreeMap;

/// The runs of one scene, method and budget, by seed.
pub(super) type Seeds<'a> = BTreeMap<u64, &'a Run>;

/// All runs of a study, by the indices of their scenes and methods in the manifest.
pub(super) struct RunTable<'a> {
    pub(super) manifest: &'a Manifest,
    pub(super) baseline: usize,
    cells: BTreeMap<(usize, usize, (bool, u64)), Seeds<'a>>,
    none: Seeds<'a>,
}

impl<'a> RunTable<'a> {
    pub(super) fn new(recorded: &'a RecordedStudy) -> Self {
        let manifest = &recorded.manifest;
        let mut cells: BTreeMap<_, Seeds<'a>> = BTreeMap::new();
        for run in &recorded.runs {
            let scene = manifest.scenes.iter().position(|s| s.name == run.scene);
            let method = manifest.methods.iter().position(|m| *m == run.method);
            if let (Some(scene), Some(method)) = (scene, method) {
                let _ = cells.entry((scene, method, order(run.budget))).or_default().insert(run.seed, run);
            }
        }
        let baseline = manifest.methods.iter().position(|m| *m == manifest.baseline).unwrap_or(0);
        Self { manifest, baseline, cells, none: BTreeMap::new() }
    }

    /// The runs of a scene and method (by index) at a budget, by seed; possibly none. For the baseline at equal time,
    /// its runs at that spp replace missing ones.
    pub(super) fn at(&self, [scene, method]: [usize; 2], budget: RunBudget) -> &Seeds<'a> {
        let found = |budget| self.cells.get(&(scene, method, order(budget)));
        let instead = match budget {
            RunBudget::TimeOf(spp) if method == self.baseline => found(RunBudget::Spp(spp)),
            _ => None,
        };
        found(budget).or(instead).unwrap_or(&self.none)
    }

    /// The indices of every pair of scene and method, scene by scene.
    pub(super) fn all(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let [scenes, methods] = [self.manifest.scenes.len(), self.manifest.methods.len()];
        (0..scenes).flat_map(move |scene| (0..methods).map(move |method| [scene, method]))
    }

    /// All budgets: those in samples per pixel, ascending, then the equal-time budget.
    pub(super) fn budgets(&self) -> Vec<RunBudget> {
        let timed = self.manifest.time_of.map(RunBudget::TimeOf);
        self.spp_budgets().into_iter().chain(timed).collect()
    }

    pub(super) fn spp_budgets(&self) -> Vec<RunBudget> {
        let mut spp = self.manifest.spp.clone();
        spp.sort_unstable();
        spp.dedup();
        spp.into_iter().map(RunBudget::Spp).collect()
    }

    /// The runs of two methods on one scene at one budget, paired by seed.
    pub(super) fn pairs(&self, scene: usize, methods: [usize; 2], budget: RunBudget) -> Vec<[&'a Run; 2]> {
        let [a, b] = methods.map(|method| self.at([scene, method], budget));
        a.iter().filter_map(|(seed, run)| Some([*run, *b.get(seed)?])).collect()
    }
}

fn order(budget: RunBudget) -> (bool, u64) {
    match budget {
        RunBudget::Spp(spp) => (false, spp),
        RunBudget::TimeOf(spp) => (true, spp),
    }
}

/// The value of a run's error metric with the name `metric`.
pub(super) fn error(run: &Run, metric: &str) -> f64 {
    let e = &run.errors;
    match metric {
        "mse" => e.mse,
        "relmse" => e.relmse,
        "relmse_trimmed" => e.relmse_trimmed,
        "smape" => e.smape,
        "srgb8_mse" => e.srgb8_mse,
        "flip" => e.flip,
        "psnr" => e.psnr,
        _ => e.mean_ratio,
    }
}
