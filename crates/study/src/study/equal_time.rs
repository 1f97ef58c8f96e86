//! Equal-time runs: each method gets the time that the baseline takes at one budget.
//!
//! 1. A method's time is modelled as `fixed + rate * samples`, from medians over seeds at the nearest budget. `fixed` is the
//!    time of clustering, first-hit rays and filter.
//! 2. The model is solved for the number of samples that takes the baseline's median time with `time_of` spp.
//! 3. The time of the first seed's run is compared with the time of the baseline's equal-time run. Beyond a difference of 5 %,
//!    the run is repeated. If both runs differ as much, the number of samples is corrected once, from the run whose time is
//!    nearer.
//! 4. All seeds use the same number of samples. A resumed study reads it from `runs.jsonl`.

use super::{Study, StudyStatus};
use crate::runner::{RunRequest, Runner};
use crate::summary::median;
use crate::{Method, Run, RunBudget, StudyError, study::StudyMonitor};
use dapple_core::render::Control;

/// The largest relative difference at which a run's time counts as equal to the baseline's time.
const TOLERANCE: f64 = 0.05;

impl Study {
    /// Performs a scene's equal-time runs. For each seed, the baseline's run comes first.
    pub(super) fn equal_time(
        &mut self,
        at: usize,
        runner: &mut dyn Runner,
        monitor: &mut dyn StudyMonitor,
    ) -> Result<StudyStatus, StudyError> {
        let Some(time_of) = self.plan.time_of else { return Ok(StudyStatus::Done) };
        let baseline = self.plan.settings.baseline.clone();
        let others = self.plan.methods.iter().filter(|m| **m != baseline).cloned();
        let methods: Vec<Method> = std::iter::once(baseline.clone()).chain(others).collect();
        let budget = RunBudget::TimeOf(time_of);
        for seed in self.plan.seeds.clone() {
            let mut target = None;
            for method in &methods {
                let found = self.of_method(at, method, budget).next().map(|run| run.asked);
                let asked = match found {
                    Some(asked) => asked,
                    None if *method == baseline => time_of * self.views[at].pixels(),
                    None => self.solve(at, method, time_of),
                };
                let request = self.request(at, method, budget, seed, asked);
                if let Some(run) = self.find(&request) {
                    target = target.or(Some(run.render_s));
                    continue;
                }
                if self.announce(&request, monitor) == Control::Stop {
                    return Ok(StudyStatus::Stopped);
                }
                let run = match target {
                    Some(target) if found.is_none() => first_run(request, target, runner)?,
                    _ => runner.run(&request)?,
                };
                // The baseline's run comes first and sets the time of the other methods' runs.
                target = target.or(Some(run.render_s));
                self.keep(run)?;
            }
        }
        Ok(StudyStatus::Done)
    }

    fn of_method<'a>(&'a self, at: usize, method: &'a Method, budget: RunBudget) -> impl Iterator<Item = &'a Run> {
        let scene = &self.views[at].name;
        self.runs().iter().filter(move |r| r.scene == *scene && r.method == *method && r.budget == budget)
    }

    /// The total number of samples with which, by the time model, a method takes as long as the baseline with `time_of` spp.
    fn solve(&self, at: usize, method: &Method, time_of: u64) -> u64 {
        let pixels = self.views[at].pixels();
        let baseline = self.of_method(at, &self.plan.settings.baseline, RunBudget::Spp(time_of));
        let target = median(baseline.map(|r| r.render_s).collect());
        let mut spp = time_of as f64;
        let mut asked = time_of * pixels;
        // The second pass uses times at the budget nearest to the first result.
        for _ in 0..2 {
            let distance = |n: &&u64| (**n as f64 / spp).ln().abs();
            let nearest = self.plan.spp.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let budget = RunBudget::Spp(nearest.copied().unwrap_or(time_of));
            let fixed = median(self.of_method(at, method, budget).map(|r| r.seconds.fixed()).collect());
            let rate = self.of_method(at, method, budget).map(|r| (r.render_s - r.seconds.fixed()) / r.asked as f64);
            asked = samples(target, fixed, median(rate.collect()), pixels);
            spp = asked as f64 / pixels as f64;
        }
        asked
    }
}

/// Performs a method's first equal-time run. Corrects the requested number of samples if neither of two runs takes about
/// `target` seconds.
fn first_run(request: RunRequest, target: f64, runner: &mut dyn Runner) -> Result<Run, StudyError> {
    let off = |run: &Run| (run.render_s / target).ln().abs();
    let near = |run: &Run| off(run) <= TOLERANCE.ln_1p();
    let first = runner.run(&request)?;
    if near(&first) {
        return Ok(first);
    }
    let second = runner.run(&request)?;
    if near(&second) {
        return Ok(second);
    }
    let nearer = if off(&first) < off(&second) { first } else { second };
    let fixed = nearer.seconds.fixed();
    let rate = (nearer.render_s - fixed) / nearer.asked as f64;
    let asked = samples(target, fixed, rate, request.view.pixels());
    if asked == request.asked {
        return Ok(nearer);
    }
    runner.run(&RunRequest { asked, ..request })
}

/// The total number of samples for which `fixed + rate * samples` equals `target` seconds; at least one per pixel.
fn samples(target: f64, fixed: f64, rate: f64, pixels: u64) -> u64 {
    let samples = (target - fixed) / rate;
    if samples.is_finite() { (samples as u64).max(pixels) } else { pixels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_fill_the_time() {
        assert_eq!(samples(1.0, 0.2, 0.01, 10), 80);
        assert_eq!(samples(1.0, 2.0, 0.01, 10), 10, "a method that is too slow gets one sample per pixel");
        assert_eq!(samples(f64::NAN, 0.0, 0.01, 10), 10);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), 2.5);
    }
}
