//! The same number of samples for every pixel.

use crate::{
    Budget, Error, Feedback, Frame, Limits, Needs, Plan, PointSet, Progress, Retention, Sampler, SamplerMemory,
};

/// The same number of samples for every pixel; what the budget leaves over goes to pixels picked by a
/// hash of their number, one each.
///
/// *Guarantees*: unbiased, exact, independent of what is seen. *Weaknesses*: spends as much on a
/// constant wall as on its shadow.
pub struct Uniform<P> {
    points: P,
}

impl<P: PointSet> Uniform<P> {
    /// With these points.
    pub fn new(points: P) -> Self {
        Self { points }
    }
}

impl<P: PointSet> Sampler for Uniform<P> {
    fn name(&self) -> &str {
        "uniform"
    }

    fn a_priori(&self) -> bool {
        true
    }

    fn memory(&self, frame: &Frame, _: &Needs, limits: &Limits) -> SamplerMemory {
        // Floors, counts, scores and a copy of them, a hash and a number of each pixel; of a budget that is known, the only
        // plan is made before anything is written to the film, which takes more.
        let once = matches!(limits.budget, Budget::Samples(_));
        SamplerMemory::planning(frame, false, if once { 0 } else { 40 })
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        plan.retention = Retention::Keep;
        // Counts so far may already differ by one, from a budget that was raised: level to the total.
        let wanted = super::level(seen, seen.budget.total)?;
        for (i, (count, wanted)) in plan.counts.iter_mut().zip(wanted).enumerate() {
            *count = wanted.saturating_sub(u32::try_from(seen.film.count(i)).unwrap_or(u32::MAX));
        }
        // Nothing to add where the ceiling holds every pixel.
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}
