//! The runs of several studies, and ratios between them.

use dapple_metrics::{Interval, geometric_mean_interval, ratio_interval};
use dapple_study::{Manifest, Method, RecordedStudy, Run, RunBudget, StudyError};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The confidence of all intervals.
const CONFIDENCE: f64 = 0.95;

/// The largest factor beyond the longest measured time to which a curve is followed, along its last piece.
const REACH: f64 = 1.5;

/// The same for the long curve of uniform sampling, used for times to the error of a method at a fixed budget.
const LONG_REACH: f64 = 4.0;

/// An error of a run.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Metric {
    Srgb,
    RelMse,
    Flip,
}

impl Metric {
    pub(crate) const ALL: [Self; 3] = [Self::Srgb, Self::RelMse, Self::Flip];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Srgb => "sRGB MSE",
            Self::RelMse => "relMSE",
            Self::Flip => "FLIP",
        }
    }

    fn of(self, run: &Run) -> f64 {
        match self {
            Self::Srgb => run.errors.get("srgb8_mse"),
            Self::RelMse => run.errors.get("relmse"),
            Self::Flip => run.errors.get("flip"),
        }
    }
}

/// The budget of a comparison.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum At {
    /// Samples per pixel.
    Spp(u64),
    /// The seconds that uniform sampling takes for this many samples per pixel.
    TimeOf(u64),
}

impl At {
    pub(crate) fn words(self) -> String {
        match self {
            Self::Spp(n) => format!("{n} spp"),
            Self::TimeOf(n) => format!("the time of {n} spp"),
        }
    }
}

/// A remark on a value.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Mark {
    Plain,
    /// The curve was followed beyond its measured times.
    Beyond,
    /// The least budget takes this many times the time of the comparison; the error is that budget's.
    Slower(f64),
}

/// A ratio with its interval and a remark.
#[derive(Clone, Copy)]
pub(crate) struct Figure {
    pub(crate) value: f64,
    pub(crate) ends: Option<[f64; 2]>,
    pub(crate) mark: Mark,
}

impl Figure {
    fn new(values: &[f64], mark: Mark) -> Option<Self> {
        match values {
            [] => None,
            _ if values.iter().any(|v| !(*v > 0.0 && v.is_finite())) => None,
            &[value] => Some(Self { value, ends: None, mark }),
            _ => Some(Self::from_interval(&geometric_mean_interval(values, CONFIDENCE).ok()?, mark)),
        }
    }

    fn from_interval(interval: &Interval, mark: Mark) -> Self {
        Self { value: interval.value, ends: Some([interval.low, interval.high]), mark }
    }
}

/// One error for each seed.
struct Errors {
    seeds: BTreeMap<u64, f64>,
    mark: Mark,
}

/// All runs by scene, method and samples per pixel, then by seed.
pub(crate) struct Board {
    pub(crate) manifests: Vec<Manifest>,
    pub(crate) scenes: Vec<String>,
    pub(crate) methods: Vec<Method>,
    /// Budgets of the comparison, ascending.
    pub(crate) spp: Vec<u64>,
    pub(crate) uniform: Method,
    pub(crate) missing: usize,
    cells: BTreeMap<(String, Method, u64), BTreeMap<u64, Run>>,
}

impl Board {
    /// Reads studies that have methods and budgets in common, each with its own scenes. `more` are studies of the same
    /// scenes with further methods or budgets, such as the baseline beyond their budgets.
    pub(crate) fn read(folders: &[PathBuf], more: &[PathBuf]) -> Result<Self, StudyError> {
        let mut board = Self {
            manifests: Vec::new(),
            scenes: Vec::new(),
            methods: Vec::new(),
            spp: Vec::new(),
            uniform: Method::new("uniform", "sobol", "none"),
            missing: 0,
            cells: BTreeMap::new(),
        };
        for folder in folders {
            let recorded = RecordedStudy::read(folder)?;
            let manifest = &recorded.manifest;
            let new = |scene: &&String| !board.scenes.contains(scene);
            let scenes: Vec<String> = manifest.scenes.iter().map(|s| &s.name).filter(new).cloned().collect();
            board.scenes.extend(scenes);
            for method in &manifest.methods {
                if !board.methods.contains(method) {
                    board.methods.push(method.clone());
                }
            }
            board.spp.extend(&manifest.spp);
            board.missing += recorded.expected().saturating_sub(recorded.runs.len());
            board.manifests.push(manifest.clone());
            board.take(recorded.runs);
        }
        board.spp.sort_unstable();
        board.spp.dedup();
        for folder in more {
            board.take(RecordedStudy::read(folder)?.runs);
        }
        Ok(board)
    }

    fn take(&mut self, runs: Vec<Run>) {
        for run in runs {
            if let RunBudget::Spp(spp) = run.budget {
                let key = (run.scene.clone(), run.method.clone(), spp);
                let _ = self.cells.entry(key).or_default().entry(run.seed).or_insert(run);
            }
        }
    }

    pub(crate) fn runs(&self) -> impl Iterator<Item = &Run> {
        self.cells.values().flat_map(BTreeMap::values)
    }

    /// All budgets of a method on a scene, those of further studies included.
    fn budgets(&self, scene: &str, method: &Method) -> Vec<(u64, &BTreeMap<u64, Run>)> {
        let own = self.cells.iter().filter(|((s, m, _), _)| s == scene && m == method);
        own.map(|((_, _, spp), runs)| (*spp, runs)).collect()
    }

    fn cell(&self, scene: &str, method: &Method, spp: u64) -> Option<&BTreeMap<u64, Run>> {
        self.cells.get(&(scene.to_owned(), method.clone(), spp))
    }

    /// The median of a run's cost over seeds.
    pub(crate) fn seconds(&self, scene: &str, method: &Method, spp: u64, of: fn(&Run) -> f64) -> Option<f64> {
        median(self.cell(scene, method, spp)?.values().map(of).collect())
    }

    fn errors(&self, scene: &str, method: &Method, at: At, metric: Metric) -> Option<Errors> {
        let exact = |runs: &BTreeMap<u64, Run>| runs.iter().map(|(seed, run)| (*seed, metric.of(run))).collect();
        let spp = match at {
            At::Spp(spp) => spp,
            At::TimeOf(spp) if *method == self.uniform => spp,
            At::TimeOf(spp) => return self.at_time(scene, method, spp, metric),
        };
        Some(Errors { seeds: exact(self.cell(scene, method, spp)?), mark: Mark::Plain })
    }

    /// Errors after the time of uniform sampling with this many samples per pixel. Each seed's curve of error over the
    /// median times is interpolated on logarithmic axes.
    fn at_time(&self, scene: &str, method: &Method, time_of: u64, metric: Metric) -> Option<Errors> {
        let target = self.seconds(scene, &self.uniform, time_of, spent)?;
        let mut curve: Vec<(f64, &BTreeMap<u64, Run>)> = Vec::new();
        for (spp, runs) in self.budgets(scene, method).into_iter().filter(|(spp, _)| self.spp.contains(spp)) {
            let time = self.seconds(scene, method, spp, spent)?;
            // More samples take longer: a median that does not rise is noise of a loaded machine.
            if curve.last().is_none_or(|(before, _)| time > *before) {
                curve.push((time, runs));
            }
        }
        let (first, last) = (curve.first()?, curve.last()?);
        if target < first.0 {
            let seeds = first.1.iter().map(|(seed, run)| (*seed, metric.of(run))).collect();
            return Some(Errors { seeds, mark: Mark::Slower(first.0 / target) });
        }
        let mark = if target > last.0 * 1.02 { Mark::Beyond } else { Mark::Plain };
        let time = target.min(last.0 * REACH);
        let above = curve.iter().position(|(t, _)| *t >= time).unwrap_or(curve.len() - 1).max(1);
        let [(t0, a), (t1, b)] = [curve.get(above - 1)?, curve.get(above)?];
        let share = (time / t0).ln() / (t1 / t0).ln();
        let between = |(seed, run): (&u64, &Run)| {
            let [e0, e1] = [metric.of(run), metric.of(b.get(seed)?)];
            (e0 > 0.0 && e1 > 0.0).then(|| (*seed, (e0.ln() + share * (e1 / e0).ln()).exp()))
        };
        Some(Errors { seeds: a.iter().filter_map(between).collect(), mark })
    }

    /// The error of `a` over that of `b`, seed by seed; each is a scene and a method.
    fn ratios(&self, a: (&str, &Method), b: (&str, &Method), at: At, metric: Metric) -> Option<Errors> {
        let [x, y] = [self.errors(a.0, a.1, at, metric)?, self.errors(b.0, b.1, at, metric)?];
        let seeds: BTreeMap<u64, f64> =
            x.seeds.iter().filter_map(|(seed, error)| Some((*seed, error / y.seeds.get(seed)?))).collect();
        let mark = if x.mark == Mark::Plain { y.mark } else { x.mark };
        (!seeds.is_empty() && seeds.values().all(|r| *r > 0.0 && r.is_finite())).then_some(Errors { seeds, mark })
    }

    /// The ratio on one scene, or between two ways to render it.
    pub(crate) fn ratio(&self, a: (&str, &Method), b: (&str, &Method), at: At, metric: Metric) -> Option<Figure> {
        let ratios = self.ratios(a, b, at, metric)?;
        Figure::new(&ratios.seeds.values().copied().collect::<Vec<_>>(), ratios.mark)
    }

    /// The geometric mean over scenes. Its interval is over the seeds' own means, with the scenes fixed. `None` if any
    /// scene has no ratio, since leaving it out would flatter a method.
    pub(crate) fn mean(&self, scenes: &[&str], a: &Method, b: &Method, at: At, metric: Metric) -> Option<Figure> {
        let all: Option<Vec<Errors>> = scenes.iter().map(|s| self.ratios((s, a), (s, b), at, metric)).collect();
        let all = all?;
        let first = all.first()?;
        let of_seed = |seed: &u64| -> Option<f64> {
            let logs: Option<Vec<f64>> = all.iter().map(|ratios| Some(ratios.seeds.get(seed)?.ln())).collect();
            Some((logs?.iter().sum::<f64>() / all.len() as f64).exp())
        };
        let means: Vec<f64> = first.seeds.keys().filter_map(of_seed).collect();
        let slowest = all.iter().fold(Mark::Plain, |mark, ratios| match (mark, ratios.mark) {
            (Mark::Slower(a), Mark::Slower(b)) => Mark::Slower(a.max(b)),
            (Mark::Slower(_), _) | (_, Mark::Plain) => mark,
            (_, other) => other,
        });
        Figure::new(&means, slowest)
    }

    /// The time that uniform sampling takes to the error of a method with `spp` samples per pixel, over that method's
    /// time.
    pub(crate) fn time_to_error(&self, scene: &str, method: &Method, spp: u64, metric: Metric) -> Option<Figure> {
        let own = self.seconds(scene, method, spp, spent)?;
        let mut curve: Vec<[f64; 2]> = Vec::new();
        for (spp, runs) in self.budgets(scene, &self.uniform) {
            let time = self.seconds(scene, &self.uniform, spp, spent)?;
            let logs: Vec<f64> = runs.values().map(|run| metric.of(run).ln()).collect();
            let error = logs.iter().sum::<f64>() / logs.len() as f64;
            if error.is_finite() && curve.last().is_none_or(|[t, e]| time.ln() > *t && error < *e) {
                curve.push([time.ln(), error]);
            }
        }
        // Noise alone may keep an error from falling.
        if curve.len() < 2 {
            return None;
        }
        let mut mark = Mark::Plain;
        let mut times = Vec::new();
        for error in self.errors(scene, method, At::Spp(spp), metric)?.seeds.values() {
            let at = curve.iter().position(|[_, e]| *e <= error.ln()).unwrap_or(curve.len()).clamp(1, curve.len() - 1);
            let [[t0, e0], [t1, e1]] = [curve.get(at - 1)?, curve.get(at)?];
            let time = (t0 + (t1 - t0) * (e0 - error.ln()) / (e0 - e1)).exp();
            let last = curve.last()?[0].exp();
            if time > last {
                mark = Mark::Beyond;
            }
            times.push(time.min(LONG_REACH * last) / own);
        }
        Figure::new(&times, mark)
    }

    /// The ratio of two methods' errors against a noisy reference. The error of `floor`, an image of very many samples,
    /// is subtracted from both.
    pub(crate) fn above_floor(&self, scene: &str, a: &Method, b: &Method, spp: u64, metric: Metric) -> Option<Figure> {
        let longest = self.budgets(scene, &self.uniform).last()?.0;
        let floor = self.errors(scene, &self.uniform, At::Spp(longest), metric)?;
        let floor = floor.seeds.values().sum::<f64>() / floor.seeds.len() as f64;
        let [x, y] = [self.errors(scene, a, At::Spp(spp), metric)?, self.errors(scene, b, At::Spp(spp), metric)?];
        let pairs: Vec<[f64; 2]> =
            x.seeds.iter().filter_map(|(seed, e)| Some([e - floor, y.seeds.get(seed)? - floor])).collect();
        let (a, b): (Vec<f64>, Vec<f64>) = pairs.iter().map(|[a, b]| (*a, *b)).unzip();
        ratio_interval(&a, &b, CONFIDENCE).ok().map(|interval| Figure::from_interval(&interval, Mark::Plain))
    }
}

/// The cost of a run: CPU seconds, which other work on the machine hardly changes; wall seconds if those are unknown.
pub(crate) fn spent(run: &Run) -> f64 {
    run.cpu_s.unwrap_or(run.render_s)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}

#[cfg(test)]
mod tests;
