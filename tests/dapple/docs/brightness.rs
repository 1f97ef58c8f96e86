//! Counts by brightness.

use dapple_core::plan::{Feedback, Plan, Progress, SamplerMemory, allocate};
use dapple_core::{Error, Frame, Limits, Needs, PointSet, Sampler};

/// Counts in proportion to the root of a pilot's brightness.
///
/// The pilot has 4 samples per pixel, or the mean budget if that is less. The pilot is kept, so the image is biased
/// [Kirk and Arvo 1991]. Brightness is not variance: use this sampler to learn, not to render.
#[derive(Clone, Debug)]
pub struct Brightness<P> {
    points: P,
}

impl<P: PointSet> Brightness<P> {
    /// Takes its samples from these points.
    pub fn new(points: P) -> Self {
        Self { points }
    }
}

impl<P: PointSet> Sampler for Brightness<P> {
    fn name(&self) -> &str {
        "brightness"
    }

    fn needs(&self) -> Needs {
        Needs::none() // means are always recorded
    }

    fn memory(&self, frame: &Frame, _: &Needs, _: &Limits) -> SamplerMemory {
        // Scores and their copy in `allocate`, 8 bytes each, and two sets of counts, 4 bytes each.
        SamplerMemory::planning(frame, 24)
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let now: Vec<u32> = (0..seen.pixels()).map(|i| seen.film.count(i) as u32).collect();
        // The pilot: what every pixel gets first.
        let mean = seen.budget.total / seen.pixels() as u64;
        let pilot = mean.min(4).max(u64::from(seen.budget.min_spp)) as u32;
        for (count, now) in plan.counts.iter_mut().zip(&now) {
            *count = pilot.saturating_sub(*now);
        }
        if plan.total() > 0 && plan.total() <= seen.budget.left() {
            return Ok(Progress::Trace);
        }
        // The rest: `allocate` hands out exactly the budget. The floor of a score keeps dark pixels alive.
        let scores: Vec<f64> = (0..seen.pixels()).map(|i| seen.film.mean(i).iter().sum::<f64>().max(1e-3)).collect();
        let wanted = allocate(&scores, &now, seen.budget.max_spp, seen.budget.total)?.counts;
        plan.counts = wanted.iter().zip(&now).map(|(wanted, now)| wanted - now).collect();
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}

#[cfg(test)]
mod tests {
    use super::Brightness;
    use dapple_low_discrepancy::Sobol;

    #[test]
    fn brightness_conforms() {
        dapple_conformance::sampler(|| Box::new(Brightness::new(Sobol::new(7))));
    }
}
